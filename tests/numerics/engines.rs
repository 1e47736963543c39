//! The fused engine against libtorch in f64, on every instruction set of this machine.

use meshway::reconstruction::network::{
    Architecture, Engine, Fused, Libtorch, initial_parameters, instruction_sets,
};
use meshway::reconstruction::sampling::Samples;
use meshway::reconstruction::settings::Scheme;
use meshway::reconstruction::surface::Field;
use meshway::reconstruction::vector::Vec3;
use proptest::prelude::*;
use pulp::Arch;

use crate::network::{architecture, engine, spiral};

const SCHEMES: [Scheme; 4] = [Scheme::Plain, Scheme::Resnet, Scheme::Hw, Scheme::Sqrhw];

/// Relative error of the loss: a sum of squares of which each has the rounding errors of f32, 6e-8,
/// through all layers. Where f meets its targets, it is relative to the squares of these.
const LOSS: f64 = 1e-6;
/// Relative error of the gradient, as the norm of the difference: two passes through all layers.
const GRADIENT: f64 = 1e-5;

/// By how much more a network magnifies rounding than one with three squares in a row, as that of
/// \[N24\] has: a square doubles relative errors.
fn magnification(architecture: &Architecture) -> f64 {
    let layers = 1..=architecture.hidden_layers;
    let squares = match architecture.scheme {
        Scheme::Sqrhw => layers.filter(|h| architecture.carries_residual(*h)).count(),
        _ => 0,
    };
    2_f64.powi(squares.saturating_sub(3) as i32)
}

/// Parameters that f32 holds exactly, so that both engines start from the same numbers; biases that
/// are not 0.
fn parameters(architecture: &Architecture, seed: u64) -> Vec<f32> {
    let mut parameters = initial_parameters::<f32>(architecture, seed);
    for layer in architecture.layers() {
        for (i, bias) in parameters[layer.bias].iter_mut().enumerate() {
            *bias = 0.1 * (1.7 * i as f32).sin();
        }
    }
    parameters
}

/// The same with coordinates, targets and weights that f32 holds exactly.
fn samples(count: usize) -> Samples {
    let mut samples = spiral(count);
    let round = |value: &mut f64| *value = f64::from(*value as f32);
    samples.points.as_flattened_mut().iter_mut().for_each(round);
    samples.targets.iter_mut().for_each(round);
    samples.weights.iter_mut().for_each(round);
    samples
}

fn fused(arch: Arch, architecture: &Architecture, samples: &Samples) -> Fused {
    Fused::on(arch, architecture.clone(), samples).unwrap()
}

fn norm(values: impl Iterator<Item = f64>) -> f64 {
    values.map(|v| v * v).sum::<f64>().sqrt()
}

/// Holds loss and gradient against those of libtorch.
fn compare(architecture: &Architecture, count: usize, seed: u64) {
    let samples = samples(count);
    let parameters = parameters(architecture, seed);
    let exact: Vec<f64> = parameters.iter().map(|p| f64::from(*p)).collect();
    let reference = engine::<f64>(architecture.clone(), &samples);
    let mut expected = vec![0.0; exact.len()];
    let loss = reference.loss_and_gradient(&exact, &mut expected).unwrap();
    let weighted = samples.targets.iter().zip(&samples.weights);
    let targets = weighted.map(|(y, w)| w * y * y).sum::<f64>() / count as f64;
    let magnified = magnification(architecture);
    // Squares of squares leave the range of f32.
    if loss > 1e12 {
        return;
    }
    for arch in instruction_sets() {
        let name = std::mem::discriminant(&arch);
        let context = format!("{name:?} {architecture:?} {count} points");
        let engine = fused(arch, architecture, &samples);
        let mut gradient = vec![0.0; parameters.len()];
        let ours = engine
            .loss_and_gradient(&parameters, &mut gradient)
            .unwrap();
        let tolerance = LOSS * magnified * (loss + targets);
        assert!((ours - loss).abs() <= tolerance, "{context}: {ours} {loss}");
        let pairs = gradient.iter().zip(&expected);
        let difference = norm(pairs.map(|(a, b)| f64::from(*a) - b));
        // Where residuals are small, so is the gradient, but not their errors.
        let size = norm(expected.iter().copied()) * (1.0 + targets / loss).sqrt();
        let tolerance = GRADIENT * magnified * size;
        assert!(difference <= tolerance, "{context}: {difference} of {size}");
    }
}

/// Holds the equations of the output layer against those of libtorch.
fn compare_output_equations(architecture: &Architecture, count: usize, seed: u64) {
    let mut samples = samples(count);
    samples.one_sided.fill(false);
    let parameters = parameters(architecture, seed);
    let exact: Vec<f64> = parameters.iter().map(|p| f64::from(*p)).collect();
    let reference = engine::<f64>(architecture.clone(), &samples);
    let expected = reference.output_equations(&exact).unwrap();
    assert_eq!(expected.right.len(), architecture.width + 1);
    let tolerance = GRADIENT * magnification(architecture);
    for arch in instruction_sets() {
        let ours = fused(arch, architecture, &samples)
            .output_equations(&parameters)
            .unwrap();
        for (ours, expected) in [
            (&ours.matrix, &expected.matrix),
            (&ours.right, &expected.right),
        ] {
            assert_eq!(ours.len(), expected.len());
            let size = norm(expected.iter().copied());
            let difference = norm(ours.iter().zip(expected).map(|(a, b)| a - b));
            let context = format!("{arch:?} {architecture:?} {count} points");
            assert!(difference <= tolerance * size, "{context}: {difference}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(60) })]

    #[test]
    fn loss_and_gradient_are_those_of_libtorch(
        scheme in prop::sample::select(&SCHEMES[..]),
        hidden_layers in 1..=8_usize,
        width in 1..=70_usize,
        residual_every in 1..=3_usize,
        count in 1..=1_500_usize,
        seed in 0..1_000_u64,
    ) {
        let architecture = Architecture { scheme, width, hidden_layers, residual_every };
        compare(&architecture, count, seed);
        if scheme != Scheme::Sqrhw || hidden_layers <= 5 {
            compare_output_equations(&architecture, count, seed);
        }
    }
}

#[test]
fn the_largest_shapes_agree_too() {
    for scheme in SCHEMES {
        compare(&architecture(scheme, 256, 8), 100, 5);
        compare(&architecture(scheme, 20, 3), 20_000, 5);
    }
}

#[test]
fn the_gates_of_highway_are_not_supported() {
    let none = Samples::default();
    let highway = architecture(Scheme::Highway, 9, 2);
    assert!(!Fused::supports(&highway));
    assert!(Fused::new(highway, &none).is_none());
    let gated = architecture(Scheme::Gated, 9, 2);
    assert!(!Fused::supports(&gated));
    assert!(Fused::new(gated, &none).is_none());
    // Without a second hidden layer there is no gate.
    assert!(Fused::supports(&architecture(Scheme::Highway, 9, 1)));
}

#[test]
fn the_bits_do_not_depend_on_the_number_of_threads() {
    let architecture = architecture(Scheme::Sqrhw, 23, 4);
    let samples = samples(3_000);
    let parameters = parameters(&architecture, 2);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| {
            let engine = Fused::new(architecture.clone(), &samples).unwrap();
            let mut gradient = vec![0.0; parameters.len()];
            let loss = engine
                .loss_and_gradient(&parameters, &mut gradient)
                .unwrap();
            (loss.to_bits(), gradient)
        })
    };
    let one = run(1);
    assert_eq!(run(2), one);
    assert_eq!(run(5), one);
}

#[test]
fn parameters_that_are_not_finite_show() {
    let architecture = architecture(Scheme::Plain, 9, 2);
    let samples = samples(100);
    for arch in instruction_sets() {
        let engine = fused(arch, &architecture, &samples);
        let mut parameters = parameters(&architecture, 1);
        parameters[4] = f32::NAN;
        let mut gradient = vec![0.0; parameters.len()];
        let loss = engine
            .loss_and_gradient(&parameters, &mut gradient)
            .unwrap();
        assert!(loss.is_nan(), "{arch:?}");
    }
}

#[test]
fn the_field_and_its_gradient_are_those_of_libtorch() {
    // More than one chunk, and the last block not full.
    let points: Vec<Vec3> = samples(1_501).points;
    for scheme in SCHEMES {
        let architecture = architecture(scheme, 31, 5);
        let parameters = parameters(&architecture, 7);
        let exact: Vec<f64> = parameters.iter().map(|p| f64::from(*p)).collect();
        let none = Samples::default();
        let reference: Libtorch<f64> = engine(architecture.clone(), &none);
        let reference = reference.field(&exact).unwrap();
        let expected = evaluate(reference.as_ref(), &points);
        let largest = norm(expected.iter().map(|[f, ..]| *f)) / (points.len() as f64).sqrt();
        for arch in instruction_sets() {
            let engine = fused(arch, &architecture, &none);
            let field = engine.field(&parameters).unwrap();
            let ours = evaluate(field.as_ref(), &points);
            let mut values = vec![0.0; points.len()];
            field.values(&points, &mut values).unwrap();
            for (i, (ours, expected)) in ours.iter().zip(&expected).enumerate() {
                assert_eq!(values[i].to_bits(), ours[0].to_bits());
                let size = norm(expected[1..].iter().copied());
                // Rounding through six layers, against the typical size of f and of its gradient.
                assert!(
                    (ours[0] - expected[0]).abs() <= 1e-5 * largest,
                    "{scheme:?} {arch:?}"
                );
                let difference = norm((1..4).map(|axis| ours[axis] - expected[axis]));
                assert!(
                    difference <= 1e-4 * size,
                    "{scheme:?} {arch:?}: {difference} {size}"
                );
            }
        }
    }
}

/// f and its gradient at each point.
fn evaluate(field: &dyn Field, points: &[Vec3]) -> Vec<[f64; 4]> {
    let mut values = vec![0.0; points.len()];
    let mut gradients = vec![[0.0; 3]; points.len()];
    field
        .values_and_gradients(points, &mut values, &mut gradients)
        .unwrap();
    let both = values.iter().zip(&gradients);
    both.map(|(f, [x, y, z])| [*f, *x, *y, *z]).collect()
}
