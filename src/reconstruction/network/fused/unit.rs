//! What a neuron makes of z = W a + b, a vector of points at a time.

use pulp::Simd;

/// Beyond this |x| the result is that of the bound: 1 - tanh 8.4 is 1e-7, about one rounding.
const BOUND: f32 = 8.4;

/// tanh x = x p(x²) / q(x²): the minimax fit of the relative error up to [`BOUND`] by a rational
/// function of these degrees, by Lawson's iteration; its error is 1e-8, that of f32 arithmetic
/// 3e-7 on top.
const NUMERATOR: [f32; 5] = [
    1.0,
    0.134_195_76,
    3.541_612_5e-3,
    2.137_968_5e-5,
    1.445_771_5e-8,
];
const DENOMINATOR: [f32; 5] = [1.0, 0.467_529, 2.605_142e-2, 3.361_418_8e-4, 8.219_908e-7];

/// The part of a hidden layer that depends on its own neuron only.
pub(super) trait Unit {
    /// a(z) and its derivative.
    fn apply<S: Simd>(simd: S, z: S::f32s) -> (S::f32s, S::f32s);
}

/// a = tanh z.
pub(super) struct Tanh;

/// a = tanh z + z.
pub(super) struct Hw;

/// a = tanh z + z².
pub(super) struct Sqrhw;

impl Unit for Tanh {
    #[inline(always)]
    fn apply<S: Simd>(simd: S, z: S::f32s) -> (S::f32s, S::f32s) {
        let t = tanh(simd, z);
        let slope = simd.sub_f32s(simd.splat_f32s(1.0), simd.mul_f32s(t, t));
        (t, slope)
    }
}

impl Unit for Hw {
    #[inline(always)]
    fn apply<S: Simd>(simd: S, z: S::f32s) -> (S::f32s, S::f32s) {
        let (t, slope) = Tanh::apply(simd, z);
        let one = simd.splat_f32s(1.0);
        (simd.add_f32s(t, z), simd.add_f32s(slope, one))
    }
}

impl Unit for Sqrhw {
    #[inline(always)]
    fn apply<S: Simd>(simd: S, z: S::f32s) -> (S::f32s, S::f32s) {
        let (t, slope) = Tanh::apply(simd, z);
        let twice = simd.add_f32s(z, z);
        (simd.mul_add_e_f32s(z, z, t), simd.add_f32s(slope, twice))
    }
}

/// tanh to 3e-7.
#[inline(always)]
fn tanh<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    let x = simd.min_f32s(simd.splat_f32s(BOUND), x);
    let x = simd.max_f32s(simd.splat_f32s(-BOUND), x);
    let square = simd.mul_f32s(x, x);
    let p = polynomial(simd, square, NUMERATOR);
    let q = polynomial(simd, square, DENOMINATOR);
    simd.div_f32s(simd.mul_f32s(x, p), q)
}

/// Horner's rule; the constant term comes first.
#[inline(always)]
fn polynomial<S: Simd>(simd: S, x: S::f32s, coefficients: [f32; 5]) -> S::f32s {
    let [lower @ .., highest] = coefficients;
    let mut sum = simd.splat_f32s(highest);
    for coefficient in lower.into_iter().rev() {
        sum = simd.mul_add_e_f32s(sum, x, simd.splat_f32s(coefficient));
    }
    sum
}
