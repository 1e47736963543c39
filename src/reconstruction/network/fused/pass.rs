//! One pass over some blocks of points: all layers of a block while it is in the cache.

use pulp::Simd;

use super::aligned::Aligned;
use super::panels::Affine;
use super::products::{self, Backward, Factors, Hidden, Row, Wanted};
use super::unit::{Hw, Sqrhw, Tanh};
use crate::reconstruction::network::{Architecture, Layer};
use crate::reconstruction::settings::Scheme;

/// Vectors of points in a block: with the rows of a panel or patch they fill the registers.
pub(super) const fn block_vectors<S: Simd>() -> usize {
    if S::REGISTER_COUNT >= 32 { 4 } else { 2 }
}

/// What a hidden layer does with z = W a + b.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Rule {
    Tanh,
    Hw,
    Sqrhw,
    /// tanh z + a.
    Resnet,
}

/// The rule of each hidden layer; `None` where this engine has no such layer.
pub(super) fn rules(architecture: &Architecture) -> Option<Vec<Rule>> {
    let rule = |h| {
        if !architecture.carries_residual(h) {
            return Some(Rule::Tanh);
        }
        match architecture.scheme {
            Scheme::Plain => Some(Rule::Tanh),
            Scheme::Resnet => Some(Rule::Resnet),
            Scheme::Hw => Some(Rule::Hw),
            Scheme::Sqrhw => Some(Rule::Sqrhw),
            Scheme::Highway | Scheme::Gated => None,
        }
    };
    (1..=architecture.hidden_layers).map(rule).collect()
}

/// A network with given parameters.
#[derive(Debug)]
pub(super) struct Network<'a> {
    pub(super) rules: &'a [Rule],
    /// Those of the hidden layers and of the output.
    pub(super) maps: Vec<Affine>,
}

impl Network<'_> {
    /// Takes the output layer of `parameters`, the last of the `layers`.
    pub(super) fn set_output(&mut self, layers: &[Layer], parameters: &[f32]) {
        if let (Some(map), Some(layer)) = (self.maps.last_mut(), layers.last()) {
            *map = Affine::new(layer, parameters);
        }
    }
}

/// What a pass keeps of its points, block by block; made once and used again and again.
#[derive(Debug)]
pub(super) struct Scratch {
    /// a of each hidden layer.
    outputs: Vec<Aligned>,
    /// ∂a/∂z of each hidden layer, and ∂L/∂z in its place after the way back.
    slopes: Vec<Aligned>,
    /// f, and ∂L/∂f in its place.
    pub(super) values: Aligned,
    /// Coordinates of the points, three rows a block, where weight gradients are wanted.
    points: Aligned,
    /// w a of the last hidden layer and w y, where the equations of the output layer are wanted.
    weighted: Aligned,
    weighted_targets: Aligned,
    /// ∂L/∂a of one block, for [`Rule::Resnet`].
    carried: Aligned,
}

impl Scratch {
    /// Room for so many points, which are whole blocks of `block_points`.
    pub(super) fn new(rules: &[Rule], width: usize, points: usize, block_points: usize) -> Self {
        let layers = || {
            rules
                .iter()
                .map(|_| Aligned::zeros(width * points))
                .collect()
        };
        let carries = rules.contains(&Rule::Resnet);
        Self {
            outputs: layers(),
            slopes: layers(),
            values: Aligned::zeros(points),
            points: Aligned::zeros(3 * points),
            weighted: Aligned::zeros(width * points),
            weighted_targets: Aligned::zeros(points),
            carried: Aligned::zeros(if carries { width * block_points } else { 0 }),
        }
    }
}

/// A network, and the memory that it works in.
pub(super) struct Pass<'a, S> {
    pub(super) simd: S,
    pub(super) network: &'a Network<'a>,
    pub(super) scratch: &'a mut Scratch,
}

impl<S: Simd> Pass<'_, S> {
    /// f at a block of points (3 rows) into `values` of the block, keeping what the way back needs.
    #[inline(always)]
    pub(super) fn forward<const N: usize>(&mut self, block: usize, points: &[f32]) {
        self.hidden::<N>(block, points);
        self.output::<N>(block);
    }

    /// The hidden layers at a block of points (3 rows).
    #[inline(always)]
    pub(super) fn hidden<const N: usize>(&mut self, block: usize, points: &[f32]) {
        let Scratch {
            outputs, slopes, ..
        } = &mut *self.scratch;
        for (h, rule) in self.network.rules.iter().enumerate() {
            let map = &self.network.maps[h];
            let (before, behind) = outputs.split_at_mut(h);
            let mut hidden = Hidden {
                input: match before.last() {
                    Some(input) => block_of::<S, N>(input, block, map.weight.columns),
                    None => rows::<S, N>(points),
                },
                output: block_of_mut::<S, N>(&mut behind[0], block, map.weight.rows),
                slope: block_of_mut::<S, N>(&mut slopes[h], block, map.weight.rows),
                carries_input: *rule == Rule::Resnet,
            };
            match rule {
                Rule::Tanh | Rule::Resnet => {
                    products::forward::<S, N, Tanh>(self.simd, map, &mut hidden);
                }
                Rule::Hw => products::forward::<S, N, Hw>(self.simd, map, &mut hidden),
                Rule::Sqrhw => products::forward::<S, N, Sqrhw>(self.simd, map, &mut hidden),
            }
        }
    }

    /// f at a block of points of which the hidden layers are known.
    #[inline(always)]
    pub(super) fn output<const N: usize>(&mut self, block: usize) {
        let outputs = &self.scratch.outputs;
        let (Some(last), Some(map)) = (outputs.last(), self.network.maps.last()) else {
            return;
        };
        let last = block_of::<S, N>(last, block, map.weight.columns);
        let f = products::output::<S, N>(self.simd, map, last);
        block_of_mut::<S, N>(&mut self.scratch.values, block, 1)[0] = f;
    }

    /// Keeps the points of a block for its [`weight_gradients`](Self::weight_gradients).
    #[inline(always)]
    pub(super) fn keep_points(&mut self, block: usize, points: &[f32]) {
        self.scratch.points[block * points.len()..][..points.len()].copy_from_slice(points);
    }

    /// From ∂L/∂f in `values` of the block to ∂L/∂z of each hidden layer.
    #[inline(always)]
    pub(super) fn backward<const N: usize>(&mut self, block: usize) {
        let Scratch {
            slopes,
            values,
            carried,
            ..
        } = &mut *self.scratch;
        let rules = self.network.rules;
        let mut carried = rules.contains(&Rule::Resnet).then_some(carried);
        for h in (0..rules.len()).rev() {
            let map = &self.network.maps[h + 1];
            let (before, behind) = slopes.split_at_mut(h + 1);
            let mut layer = Backward {
                delta: match behind.first() {
                    Some(delta) => block_of::<S, N>(delta, block, map.weight.rows),
                    None => block_of::<S, N>(values, block, 1),
                },
                slope: block_of_mut::<S, N>(&mut before[h], block, map.weight.columns),
                carried: carried.as_deref_mut().map(|rows| rows_mut::<S, N>(rows)),
                adds_carried: rules.get(h + 1) == Some(&Rule::Resnet),
            };
            products::backward(self.simd, map, &mut layer);
        }
    }

    /// ∂f/∂x into `gradients` (3 rows) of one block after its way back from ∂L/∂f = 1.
    #[inline(always)]
    pub(super) fn point_gradient<const N: usize>(&mut self, block: usize, gradients: &mut [f32]) {
        let map = &self.network.maps[0];
        gradients.fill(1.0);
        let mut input = Backward {
            delta: block_of::<S, N>(&self.scratch.slopes[0], block, map.weight.rows),
            slope: rows_mut::<S, N>(gradients),
            carried: None,
            adds_carried: false,
        };
        products::backward(self.simd, map, &mut input);
    }

    /// Weighs the last hidden layer and the targets of a block, for its [`output_sums`](Self::output_sums).
    #[inline(always)]
    pub(super) fn weigh_output<const N: usize>(
        &mut self,
        block: usize,
        targets: &[f32],
        weights: &[f32],
    ) {
        let Scratch {
            outputs,
            weighted,
            weighted_targets,
            ..
        } = &mut *self.scratch;
        let values = weighted_targets[block * weights.len()..].iter_mut();
        for ((value, target), weight) in values.zip(targets).zip(weights) {
            *value = weight * target;
        }
        let Some(a) = outputs.last() else {
            return;
        };
        let width = self.network.maps[self.network.rules.len()].weight.columns;
        let weights = rows::<S, N>(weights)[0];
        let rows = block_of_mut::<S, N>(weighted, block, width).iter_mut();
        for (weighted, a) in rows.zip(block_of::<S, N>(a, block, width)) {
            for v in 0..N {
                weighted[v] = self.simd.mul_f32s(weights[v], a[v]);
            }
        }
    }

    /// What [`super::output::OutputSums`] adds up, over the first `blocks` blocks, once they are weighed.
    #[inline(always)]
    pub(super) fn output_sums<const N: usize>(&self, blocks: usize, sums: &mut [f32]) {
        let Scratch {
            outputs,
            weighted,
            weighted_targets,
            ..
        } = &*self.scratch;
        let Some(a) = outputs.last() else {
            return;
        };
        let width = self.network.maps[self.network.rules.len()].weight.columns;
        let mut rest = sums;
        for (delta, rows, wanted) in [
            (weighted, width, Wanted::LowerHalf),
            (weighted_targets, 1, Wanted::All),
        ] {
            let factors = Factors {
                delta: &self::rows::<S, N>(delta)[..blocks * rows],
                input: &self::rows::<S, N>(a)[..blocks * width],
                rows,
                columns: width,
                wanted,
            };
            let (products, behind) = rest.split_at_mut(rows * width);
            let (sums, behind) = behind.split_at_mut(rows);
            products::weight_gradient(self.simd, &factors, products, sums);
            rest = behind;
        }
    }

    /// ∂L/∂parameters over the first `blocks` blocks, added to `gradient`, in which every weight is
    /// followed by its bias.
    #[inline(always)]
    pub(super) fn weight_gradients<const N: usize>(&self, blocks: usize, gradient: &mut [f32]) {
        let scratch = &*self.scratch;
        let mut rest = gradient;
        for (h, map) in self.network.maps.iter().enumerate() {
            let (rows, columns) = (map.weight.rows, map.weight.columns);
            let delta = scratch.slopes.get(h).unwrap_or(&scratch.values);
            let factors = Factors {
                delta: &self::rows::<S, N>(delta)[..blocks * rows],
                input: match h.checked_sub(1) {
                    Some(before) => {
                        &self::rows::<S, N>(&scratch.outputs[before])[..blocks * columns]
                    }
                    None => &self::rows::<S, N>(&scratch.points)[..3 * blocks],
                },
                rows,
                columns,
                wanted: Wanted::All,
            };
            let (weight, behind) = rest.split_at_mut(rows * columns);
            let (bias, behind) = behind.split_at_mut(rows);
            products::weight_gradient(self.simd, &factors, weight, bias);
            rest = behind;
        }
    }
}

/// Floats as rows of blocks.
#[inline(always)]
fn rows<S: Simd, const N: usize>(floats: &[f32]) -> &[Row<S, N>] {
    S::as_simd_f32s(floats).0.as_chunks::<N>().0
}

#[inline(always)]
fn rows_mut<S: Simd, const N: usize>(floats: &mut [f32]) -> &mut [Row<S, N>] {
    S::as_mut_simd_f32s(floats).0.as_chunks_mut::<N>().0
}

/// One block of a matrix that has so many rows.
#[inline(always)]
fn block_of<S: Simd, const N: usize>(floats: &[f32], block: usize, count: usize) -> &[Row<S, N>] {
    &rows::<S, N>(floats)[block * count..][..count]
}

#[inline(always)]
fn block_of_mut<S: Simd, const N: usize>(
    floats: &mut [f32],
    block: usize,
    count: usize,
) -> &mut [Row<S, N>] {
    &mut rows_mut::<S, N>(floats)[block * count..][..count]
}
