//! The matrix products of a network, with what follows each of them done while its sums are still
//! in registers.
//!
//! Points lie in blocks of N vectors. A matrix over a block has one row a feature, so that vectors
//! run along the points whatever the width of the network. All functions are inlined into the one
//! that is compiled for the instruction set.

use pulp::Simd;

use super::panels::{Affine, runs};
use super::unit::Unit;

/// One feature at all points of a block.
pub(super) type Row<S, const N: usize> = [<S as Simd>::f32s; N];

/// Sums of panel · input on top of `sums`, one row for each row of the panel.
#[inline(always)]
fn product<S: Simd, const M: usize, const N: usize>(
    simd: S,
    panel: &[f32],
    input: &[Row<S, N>],
    mut sums: [Row<S, N>; M],
) -> [Row<S, N>; M] {
    let (columns, _) = panel.as_chunks::<M>();
    for (weights, a) in columns.iter().zip(input) {
        for i in 0..M {
            let weight = simd.splat_f32s(weights[i]);
            for v in 0..N {
                sums[i][v] = simd.mul_add_e_f32s(weight, a[v], sums[i][v]);
            }
        }
    }
    sums
}

/// Calls a function for the number of rows of a panel.
macro_rules! for_rows {
    ($rows:expr, $function:ident :: <$simd:ident, $n:ident $(, $unit:ident)?> ($($argument:expr),*)) => {
        match $rows {
            1 => $function::<$simd, 1, $n $(, $unit)?>($($argument),*),
            2 => $function::<$simd, 2, $n $(, $unit)?>($($argument),*),
            3 => $function::<$simd, 3, $n $(, $unit)?>($($argument),*),
            4 => $function::<$simd, 4, $n $(, $unit)?>($($argument),*),
            5 => $function::<$simd, 5, $n $(, $unit)?>($($argument),*),
            _ => $function::<$simd, 6, $n $(, $unit)?>($($argument),*),
        }
    };
}

/// A hidden layer at a block of points.
pub(super) struct Hidden<'a, S: Simd, const N: usize> {
    /// a of the layer before.
    pub(super) input: &'a [Row<S, N>],
    /// a of this layer, to be written.
    pub(super) output: &'a mut [Row<S, N>],
    /// ∂a/∂z of this layer, to be written.
    pub(super) slope: &'a mut [Row<S, N>],
    /// Whether the input is added to the output.
    pub(super) carries_input: bool,
}

/// a = unit(W input + b).
#[inline(always)]
pub(super) fn forward<S: Simd, const N: usize, U: Unit>(
    simd: S,
    map: &Affine,
    hidden: &mut Hidden<'_, S, N>,
) {
    for (start, rows, panel) in map.weight.iter() {
        let bias = &map.bias[start..start + rows];
        for_rows!(
            rows,
            forward_panel::<S, N, U>(simd, panel, bias, start, hidden)
        );
    }
}

#[inline(always)]
fn forward_panel<S: Simd, const M: usize, const N: usize, U: Unit>(
    simd: S,
    panel: &[f32],
    bias: &[f32],
    start: usize,
    hidden: &mut Hidden<'_, S, N>,
) {
    let mut sums = [[simd.splat_f32s(0.0); N]; M];
    for (row, bias) in sums.iter_mut().zip(bias) {
        *row = [simd.splat_f32s(*bias); N];
    }
    let z = product::<S, M, N>(simd, panel, hidden.input, sums);
    let output = &mut hidden.output[start..start + M];
    let slope = &mut hidden.slope[start..start + M];
    for i in 0..M {
        for v in 0..N {
            (output[i][v], slope[i][v]) = U::apply(simd, z[i][v]);
        }
    }
    if hidden.carries_input {
        let input = &hidden.input[start..start + M];
        for i in 0..M {
            for v in 0..N {
                output[i][v] = simd.add_f32s(output[i][v], input[i][v]);
            }
        }
    }
}

/// The output layer, which has one row.
#[inline(always)]
pub(super) fn output<S: Simd, const N: usize>(
    simd: S,
    map: &Affine,
    input: &[Row<S, N>],
) -> Row<S, N> {
    let mut sum = [simd.splat_f32s(map.bias[0]); N];
    for (_, _, panel) in map.weight.iter() {
        [sum] = product::<S, 1, N>(simd, panel, input, [sum]);
    }
    sum
}

/// What flows back through a hidden layer at a block of points.
pub(super) struct Backward<'a, S: Simd, const N: usize> {
    /// ∂L/∂z of the layer behind.
    pub(super) delta: &'a [Row<S, N>],
    /// ∂a/∂z of this layer; ∂L/∂z takes its place.
    pub(super) slope: &'a mut [Row<S, N>],
    /// ∂L/∂a of the layer behind where that adds its input to its output; ∂L/∂a of this layer takes
    /// its place. None where no layer does so.
    pub(super) carried: Option<&'a mut [Row<S, N>]>,
    /// Whether the layer behind adds its input to its output.
    pub(super) adds_carried: bool,
}

/// ∂L/∂z = (Wᵀ delta) ∘ slope, where W is that of the layer behind.
#[inline(always)]
pub(super) fn backward<S: Simd, const N: usize>(
    simd: S,
    map: &Affine,
    layer: &mut Backward<'_, S, N>,
) {
    for (start, rows, panel) in map.transposed.iter() {
        for_rows!(rows, backward_panel::<S, N>(simd, panel, start, layer));
    }
}

#[inline(always)]
fn backward_panel<S: Simd, const M: usize, const N: usize>(
    simd: S,
    panel: &[f32],
    start: usize,
    layer: &mut Backward<'_, S, N>,
) {
    let zero = [[simd.splat_f32s(0.0); N]; M];
    let mut sums = product::<S, M, N>(simd, panel, layer.delta, zero);
    if let Some(carried) = &mut layer.carried {
        let carried = &mut carried[start..start + M];
        for i in 0..M {
            for v in 0..N {
                if layer.adds_carried {
                    sums[i][v] = simd.add_f32s(sums[i][v], carried[i][v]);
                }
                carried[i][v] = sums[i][v];
            }
        }
    }
    let slope = &mut layer.slope[start..start + M];
    for i in 0..M {
        for v in 0..N {
            slope[i][v] = simd.mul_f32s(sums[i][v], slope[i][v]);
        }
    }
}

/// Most rows and columns of a patch of ∂L/∂W, so that its sums stay in registers.
const fn patch_size<S: Simd>() -> usize {
    if S::REGISTER_COUNT >= 32 { 5 } else { 3 }
}

/// The two factors of ∂L/∂W over some blocks of points.
pub(super) struct Factors<'a, S: Simd, const N: usize> {
    /// ∂L/∂z, block by block.
    pub(super) delta: &'a [Row<S, N>],
    /// a of the layer before, block by block.
    pub(super) input: &'a [Row<S, N>],
    /// Rows of a block of `delta`.
    pub(super) rows: usize,
    /// Rows of a block of `input`.
    pub(super) columns: usize,
    /// What of the product is wanted.
    pub(super) wanted: Wanted,
}

/// Parts of a product.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Wanted {
    All,
    /// Of a symmetric one, what lies on the diagonal and below it, and some of the rest.
    LowerHalf,
}

/// ∂L/∂W (rows × columns) and ∂L/∂b, added to what is there.
#[inline(always)]
pub(super) fn weight_gradient<S: Simd, const N: usize>(
    simd: S,
    factors: &Factors<'_, S, N>,
    weight: &mut [f32],
    bias: &mut [f32],
) {
    for (row, bias) in bias.iter_mut().enumerate() {
        let mut sums = [simd.splat_f32s(0.0); N];
        for delta in factors.delta.chunks_exact(factors.rows) {
            for v in 0..N {
                sums[v] = simd.add_f32s(sums[v], delta[row][v]);
            }
        }
        for sum in sums {
            *bias += simd.reduce_sum_f32s(sum);
        }
    }
    for (row, rows) in runs(factors.rows, patch_size::<S>()) {
        let weight = &mut weight[row * factors.columns..][..rows * factors.columns];
        match rows {
            1 => patches::<S, 1, N>(simd, factors, row, weight),
            2 => patches::<S, 2, N>(simd, factors, row, weight),
            3 => patches::<S, 3, N>(simd, factors, row, weight),
            4 => patches::<S, 4, N>(simd, factors, row, weight),
            _ => patches::<S, 5, N>(simd, factors, row, weight),
        }
    }
}

/// M rows of ∂L/∂W, from `row` on.
#[inline(always)]
fn patches<S: Simd, const M: usize, const N: usize>(
    simd: S,
    factors: &Factors<'_, S, N>,
    row: usize,
    weight: &mut [f32],
) {
    for (column, columns) in runs(factors.columns, patch_size::<S>()) {
        if factors.wanted == Wanted::LowerHalf && column >= row + M {
            break;
        }
        let corner = (row, column);
        match columns {
            1 => patch::<S, M, 1, N>(simd, factors, corner, weight),
            2 => patch::<S, M, 2, N>(simd, factors, corner, weight),
            3 => patch::<S, M, 3, N>(simd, factors, corner, weight),
            4 => patch::<S, M, 4, N>(simd, factors, corner, weight),
            _ => patch::<S, M, 5, N>(simd, factors, corner, weight),
        }
    }
}

#[inline(always)]
fn patch<S: Simd, const M: usize, const K: usize, const N: usize>(
    simd: S,
    factors: &Factors<'_, S, N>,
    (row, column): (usize, usize),
    weight: &mut [f32],
) {
    let mut sums = [[simd.splat_f32s(0.0); K]; M];
    let delta = factors.delta.chunks_exact(factors.rows);
    let input = factors.input.chunks_exact(factors.columns);
    for (delta, input) in delta.zip(input) {
        let (delta, input) = (&delta[row..row + M], &input[column..column + K]);
        for v in 0..N {
            for i in 0..M {
                for k in 0..K {
                    sums[i][k] = simd.mul_add_e_f32s(delta[i][v], input[k][v], sums[i][k]);
                }
            }
        }
    }
    for (weight, sums) in weight.chunks_exact_mut(factors.columns).zip(sums) {
        for (weight, sum) in weight[column..column + K].iter_mut().zip(sums) {
            *weight += simd.reduce_sum_f32s(sum);
        }
    }
}
