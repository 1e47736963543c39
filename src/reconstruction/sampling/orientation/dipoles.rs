//! Sums over all pairs of points, of which the iteration for the normals is made.
//!
//! In f32 and a vector of places at a time, with the widest vectors of the processor (`pulp`). Each place
//! is summed over the sources in their order, so that the number of threads changes no bit.

#![expect(
    clippy::inline_always,
    reason = "code compiles for an instruction set only inside the function that enables it"
)]

use std::f32::consts::PI;

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use crate::reconstruction::vector::Vec3;

/// Places that one task sums up: a multiple of the lanes of every vector.
const BLOCK: usize = 64;

/// Points that act on each other as dipoles, with kernels regularised within a width.
pub(super) struct Dipoles {
    points: Vec<[f32; 3]>,
    width: f32,
}

/// A point and what it carries: a dipole, or in the first component a number.
type Source = ([f32; 3], [f32; 3]);

impl Dipoles {
    pub(super) fn new(points: &[Vec3]) -> Self {
        Self {
            points: single(points),
            width: 0.0,
        }
    }

    /// Sets the distance below which the kernel stays as it is there.
    pub(super) fn set_width(&mut self, width: f64) {
        self.width = width as f32;
    }

    /// The winding field at the points: Σⱼ μⱼ·(pⱼ - pᵢ) / (4π max(r, width)³).
    pub(super) fn potential(&self, moments: &[Vec3]) -> Vec<f64> {
        let sums = self.sums::<Potential>(&self.points, &single(moments));
        sums.into_iter().map(|[v, _, _]| f64::from(v)).collect()
    }

    /// The transpose of [`Dipoles::potential`], applied to one number a point.
    pub(super) fn transposed(&self, residuals: &[f64]) -> Vec<Vec3> {
        let numbers: Vec<[f32; 3]> = residuals.iter().map(|&r| [r as f32, 0.0, 0.0]).collect();
        double(&self.sums::<Transposed>(&self.points, &numbers))
    }

    /// The negative gradient of the winding field at `places`.
    pub(super) fn downhill(&self, places: &[Vec3], moments: &[Vec3]) -> Vec<Vec3> {
        double(&self.sums::<Downhill>(&single(places), &single(moments)))
    }

    fn sums<T: Term>(&self, places: &[[f32; 3]], carried: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let sources: Vec<Source> = self
            .points
            .iter()
            .copied()
            .zip(carried.iter().copied())
            .collect();
        let arch = Arch::new();
        let mut sums = vec![[0.0; 3]; places.len()];
        sums.par_chunks_mut(BLOCK)
            .zip(places.par_chunks(BLOCK))
            .for_each(|(sums, places)| {
                arch.dispatch(Block::<T> {
                    places,
                    sources: &sources,
                    square: (self.width * self.width).max(f32::MIN_POSITIVE),
                    sums,
                    term: std::marker::PhantomData,
                });
            });
        sums
    }
}

/// What a source adds to a place.
trait Term {
    /// Adds the term of a source that carries `m`, `d` away, to `sum`.
    fn add<S: Simd>(simd: S, pair: &Pair<S>, m: [S::f32s; 3], sum: &mut [S::f32s; 3]);
}

/// A source seen from a vector of places.
struct Pair<S: Simd> {
    /// Source minus place.
    away: [S::f32s; 3],
    /// Squared distance.
    square: S::f32s,
    /// Squared width.
    bound: S::f32s,
    /// 1 / max(r, width)².
    inverse_square: S::f32s,
    /// 1 / max(r, width)³.
    kernel: S::f32s,
}

struct Potential;
struct Transposed;
struct Downhill;

impl Term for Potential {
    #[inline(always)]
    fn add<S: Simd>(simd: S, pair: &Pair<S>, m: [S::f32s; 3], sum: &mut [S::f32s; 3]) {
        sum[0] = simd.mul_add_e_f32s(inner(simd, pair.away, m), pair.kernel, sum[0]);
    }
}

impl Term for Transposed {
    #[inline(always)]
    fn add<S: Simd>(simd: S, pair: &Pair<S>, m: [S::f32s; 3], sum: &mut [S::f32s; 3]) {
        let weight = simd.mul_f32s(m[0], pair.kernel);
        for (axis, sum) in sum.iter_mut().enumerate() {
            *sum = simd.sub_f32s(*sum, simd.mul_f32s(weight, pair.away[axis]));
        }
    }
}

impl Term for Downhill {
    #[inline(always)]
    fn add<S: Simd>(simd: S, pair: &Pair<S>, m: [S::f32s; 3], sum: &mut [S::f32s; 3]) {
        let three = simd.splat_f32s(3.0);
        let radial = simd.mul_f32s(
            simd.mul_f32s(three, pair.inverse_square),
            inner(simd, pair.away, m),
        );
        // Within the width the kernel is linear and has no radial part.
        let outside = simd.less_than_f32s(pair.bound, pair.square);
        let radial = simd.select_f32s(outside, radial, simd.splat_f32s(0.0));
        for (axis, sum) in sum.iter_mut().enumerate() {
            let part = simd.sub_f32s(m[axis], simd.mul_f32s(radial, pair.away[axis]));
            *sum = simd.mul_add_e_f32s(pair.kernel, part, *sum);
        }
    }
}

#[inline(always)]
fn inner<S: Simd>(simd: S, a: [S::f32s; 3], b: [S::f32s; 3]) -> S::f32s {
    let xy = simd.mul_add_e_f32s(a[0], b[0], simd.mul_f32s(a[1], b[1]));
    simd.mul_add_e_f32s(a[2], b[2], xy)
}

/// The sums at some places.
struct Block<'a, T> {
    places: &'a [[f32; 3]],
    sources: &'a [Source],
    square: f32,
    sums: &'a mut [[f32; 3]],
    term: std::marker::PhantomData<T>,
}

impl<T: Term> WithSimd for Block<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (one, bound) = (simd.splat_f32s(1.0), simd.splat_f32s(self.square));
        let zero = [simd.splat_f32s(0.0); 3];
        for (sums, places) in self
            .sums
            .chunks_mut(S::F32_LANES)
            .zip(self.places.chunks(S::F32_LANES))
        {
            let mut at = zero;
            for (axis, at) in at.iter_mut().enumerate() {
                let mut row = [0.0; BLOCK];
                for (to, place) in row.iter_mut().zip(places) {
                    *to = place[axis];
                }
                *at = simd.partial_load_f32s(&row[..S::F32_LANES]);
            }
            let mut sum = zero;
            // Loops and not `map`: what a closure does is not inlined here, and calls cost more than it does.
            for (p, m) in self.sources {
                let (mut away, mut carried) = (zero, zero);
                for axis in 0..3 {
                    away[axis] = simd.sub_f32s(simd.splat_f32s(p[axis]), at[axis]);
                    carried[axis] = simd.splat_f32s(m[axis]);
                }
                let square = inner(simd, away, away);
                let inverse_square = simd.div_f32s(one, simd.max_f32s(square, bound));
                let pair = Pair {
                    away,
                    square,
                    bound,
                    inverse_square,
                    kernel: simd.mul_f32s(inverse_square, simd.sqrt_f32s(inverse_square)),
                };
                T::add(simd, &pair, carried, &mut sum);
            }
            for (axis, sum) in sum.into_iter().enumerate() {
                let mut row = [0.0; BLOCK];
                simd.partial_store_f32s(&mut row[..S::F32_LANES], sum);
                for (to, from) in sums.iter_mut().zip(row) {
                    to[axis] = from / (4.0 * PI);
                }
            }
        }
    }
}

fn single(vectors: &[Vec3]) -> Vec<[f32; 3]> {
    vectors.iter().map(|v| v.map(|x| x as f32)).collect()
}

fn double(vectors: &[[f32; 3]]) -> Vec<Vec3> {
    vectors.iter().map(|v| v.map(f64::from)).collect()
}
