//! The network and its reference engine.

use meshway::reconstruction::network::{
    Architecture, Engine, Libtorch, Scalar, initial_parameters,
};
use meshway::reconstruction::sampling::Samples;
use meshway::reconstruction::settings::{OutputLayer, Scheme};
use meshway::reconstruction::surface::Field;
use meshway::reconstruction::training::Problem;
use meshway::reconstruction::vector::Vec3;

const SCHEMES: [Scheme; 6] = [
    Scheme::Plain,
    Scheme::Resnet,
    Scheme::Highway,
    Scheme::Hw,
    Scheme::Sqrhw,
    Scheme::Gated,
];

/// Step of the central differences.
const H: f64 = 1e-5;
/// Error of central differences, relative to the largest component of the gradient: rounding,
/// 1e-16 / H = 1e-11, and truncation, H² / 6 = 2e-11 times the third derivative, which is up to some
/// thousands of times the first where five layers square. A wrong term shows at order 1.
const TOLERANCE: f64 = 1e-6;

/// Points on a spiral with unlike targets and weights.
pub(crate) fn spiral(count: usize) -> Samples {
    let t = |i: usize| i as f64 / count as f64;
    Samples {
        points: (0..count)
            .map(|i| [(9.0 * t(i)).cos(), (9.0 * t(i)).sin(), 2.0 * t(i) - 1.0])
            .collect(),
        targets: (0..count).map(|i| (5.0 * t(i)).sin()).collect(),
        weights: (0..count).map(|i| 0.5 + t(i)).collect(),
        one_sided: (0..count).map(|i| i % 3 == 0).collect(),
    }
}

pub(crate) fn engine<T: Scalar>(architecture: Architecture, training: &Samples) -> Libtorch<T> {
    // With more threads than cores libtorch's threads spin against each other: tests run side by
    // side.
    tch::set_num_threads(1);
    Libtorch::new(architecture, training).unwrap()
}

/// Without a hold-out.
pub(crate) static NONE: Samples = Samples {
    points: Vec::new(),
    targets: Vec::new(),
    weights: Vec::new(),
    one_sided: Vec::new(),
};

/// The loss alone.
pub(crate) fn undecayed<T>(engine: &dyn Engine<T>) -> Problem<'_, T> {
    Problem {
        engine,
        validation: &NONE,
        weight_decay: 0.0,
        output_layer: OutputLayer::Trained,
    }
}

pub(crate) fn architecture(scheme: Scheme, width: usize, hidden_layers: usize) -> Architecture {
    Architecture {
        scheme,
        width,
        hidden_layers,
        residual_every: 2,
    }
}

/// All schemes, also at depth 1 and width 1, and with residuals at other places.
fn architectures() -> Vec<Architecture> {
    let shapes = [(7, 5, 2), (7, 5, 1), (4, 5, 3), (1, 3, 1), (5, 1, 1)];
    let mut all = Vec::new();
    for scheme in SCHEMES {
        all.extend(
            shapes.map(|(width, hidden_layers, residual_every)| Architecture {
                scheme,
                width,
                hidden_layers,
                residual_every,
            }),
        );
    }
    all
}

#[test]
fn gradient_agrees_with_central_differences() {
    for architecture in architectures() {
        let engine = engine::<f64>(architecture.clone(), &spiral(23));
        let mut parameters = initial_parameters::<f64>(&architecture, 3);
        let mut gradient = vec![0.0; parameters.len()];
        let mut unused = gradient.clone();
        engine
            .loss_and_gradient(&parameters, &mut gradient)
            .unwrap();
        for i in 0..parameters.len() {
            let parameter = parameters[i];
            let mut loss_at = |value: f64| {
                parameters[i] = value;
                engine.loss_and_gradient(&parameters, &mut unused).unwrap()
            };
            let difference = (loss_at(parameter + H) - loss_at(parameter - H)) / (2.0 * H);
            parameters[i] = parameter;
            assert!(
                (difference - gradient[i]).abs() < TOLERANCE * largest(&gradient),
                "{architecture:?}, parameter {i}: {difference} and {}",
                gradient[i]
            );
        }
    }
}

#[test]
fn field_gradient_agrees_with_central_differences() {
    for architecture in architectures() {
        let engine = engine::<f64>(architecture.clone(), &spiral(3));
        let parameters = initial_parameters::<f64>(&architecture, 4);
        let field = engine.field(&parameters).unwrap();
        let points = spiral(11).points;
        let (values, gradients) = with_gradients(field.as_ref(), &points);
        assert_bits_eq(&values, &values_of(field.as_ref(), &points));
        for axis in 0..3 {
            let moved = |step: f64| {
                let mut points = points.clone();
                for point in &mut points {
                    point[axis] += step;
                }
                values_of(field.as_ref(), &points)
            };
            let (ahead, behind) = (moved(H), moved(-H));
            let scale = largest(gradients.as_flattened());
            for (i, gradient) in gradients.iter().enumerate() {
                let difference = (ahead[i] - behind[i]) / (2.0 * H);
                assert!(
                    (difference - gradient[axis]).abs() < TOLERANCE * scale,
                    "{architecture:?}"
                );
            }
        }
    }
}

#[test]
fn field_does_not_depend_on_the_chunks() {
    let architecture = architecture(Scheme::Sqrhw, 6, 2);
    let engine = engine::<f64>(architecture.clone(), &spiral(3));
    let parameters = initial_parameters::<f64>(&architecture, 5);
    let field = engine.field(&parameters).unwrap();
    // More than two chunks, the last one short.
    let points = spiral(5_000).points;
    let (values, gradients) = with_gradients(field.as_ref(), &points);
    for i in [0, 2_047, 2_048, 4_095, 4_096, 4_999] {
        let (value, gradient) = with_gradients(field.as_ref(), &points[i..=i]);
        // Another kernel of the matrix product may sum in another order.
        assert!((value[0] - values[i]).abs() < 1e-14);
        assert!((0..3).all(|k| (gradient[0][k] - gradients[i][k]).abs() < 1e-13));
    }
}

#[test]
fn residuals_sit_where_they_should() {
    let carriers = |scheme, residual_every| {
        let architecture = Architecture {
            scheme,
            width: 2,
            hidden_layers: 5,
            residual_every,
        };
        (1..=5)
            .filter(|h| architecture.carries_residual(*h))
            .collect::<Vec<_>>()
    };
    assert_eq!(carriers(Scheme::Plain, 1), [0; 0]);
    assert_eq!(carriers(Scheme::Resnet, 2), [2, 3, 4, 5]);
    assert_eq!(carriers(Scheme::Highway, 2), [2, 3, 4, 5]);
    assert_eq!(carriers(Scheme::Gated, 2), [2, 3, 4, 5]);
    assert_eq!(carriers(Scheme::Hw, 1), [1, 2, 3, 4, 5]);
    assert_eq!(carriers(Scheme::Sqrhw, 2), [1, 3, 5]);
    assert_eq!(carriers(Scheme::Sqrhw, 3), [1, 4]);
}

#[test]
fn parameters_lie_as_in_pytorch() {
    let highway = architecture(Scheme::Highway, 50, 5);
    let names: Vec<_> = highway.layers().into_iter().map(|l| l.name).collect();
    let expected =
        "linear.0 linear.1 linear.2 linear.3 linear.4 linear.5 gate.0 gate.1 gate.2 gate.3";
    assert_eq!(names.join(" "), expected);
    assert_eq!(highway.parameter_count(), 10_451 + 4 * 2_550);
    let gated = architecture(Scheme::Gated, 50, 5);
    let layers = gated.layers();
    assert_eq!(layers[6].name, "encoder.0");
    assert_eq!(layers[7].name, "encoder.1");
    assert_eq!((layers[7].rows, layers[7].columns), (50, 3));
    assert_eq!(gated.parameter_count(), 10_451 + 2 * 200);
    assert_eq!(gated.output_layer(), 10_400..10_451);
    // Without a second hidden layer there is nothing to blend.
    assert_eq!(architecture(Scheme::Gated, 50, 1).parameter_count(), 251);
    let layers = architecture(Scheme::Sqrhw, 50, 5).layers();
    assert_eq!((layers[0].rows, layers[0].columns), (50, 3));
    assert_eq!(
        (layers[0].weight.clone(), layers[0].bias.clone()),
        (0..150, 150..200)
    );
    assert_eq!((layers[5].rows, layers[5].columns), (1, 50));
    assert_eq!(layers[5].bias, 10_450..10_451);
}

#[test]
fn first_weights_have_the_spread_of_xavier() {
    let architecture = architecture(Scheme::Highway, 100, 2);
    let parameters = initial_parameters::<f64>(&architecture, 1);
    let layers = architecture.layers();
    let layer = |range: &std::ops::Range<usize>| &parameters[range.clone()];
    let weights = layer(&layers[1].weight);
    let variance = weights.iter().map(|w| w * w).sum::<f64>() / weights.len() as f64;
    // The variance of n normal numbers is known to √(2/n) = 1.4 % here; four times that.
    assert!((variance / 0.01 - 1.0).abs() < 0.057, "{variance}");
    assert_bits_eq(layer(&layers[1].bias), &[0.0; 100]);
    assert_bits_eq(layer(&layers[3].bias), &[-1.0; 100]);
    let norms = architecture.weight_norms(&parameters);
    assert!((norms[1] - (variance * 10_000.0).sqrt()).abs() < 1e-12);

    assert_bits_eq(&parameters, &initial_parameters::<f64>(&architecture, 1));
    assert_ne!(parameters, initial_parameters::<f64>(&architecture, 2));
    let single = initial_parameters::<f32>(&architecture, 1);
    let rounded: Vec<f32> = parameters.iter().map(|p| *p as f32).collect();
    assert_eq!(single, rounded);
}

#[test]
fn precisions_agree() {
    for scheme in SCHEMES {
        let architecture = architecture(scheme, 20, 5);
        let parameters = initial_parameters::<f32>(&architecture, 6);
        let wide: Vec<f64> = parameters.iter().map(|p| f64::from(*p)).collect();
        let mut gradient = vec![0.0; parameters.len()];
        let mut wide_gradient = vec![0.0; parameters.len()];
        let loss = engine::<f32>(architecture.clone(), &spiral(100))
            .loss_and_gradient(&parameters, &mut gradient)
            .unwrap();
        let wide_loss = engine::<f64>(architecture, &spiral(100))
            .loss_and_gradient(&wide, &mut wide_gradient)
            .unwrap();
        // Unit roundoff 6e-8, some tens of operations deep, on values of order 1.
        assert!((loss - wide_loss).abs() < 1e-5 * wide_loss, "{scheme:?}");
        let largest = wide_gradient
            .iter()
            .fold(0.0, |max: f64, g| max.max(g.abs()));
        for (g, wide) in gradient.iter().zip(&wide_gradient) {
            assert!((f64::from(*g) - wide).abs() < 1e-5 * largest, "{scheme:?}");
        }
    }
}

#[test]
fn wrong_lengths_are_errors() {
    let architecture = architecture(Scheme::Sqrhw, 5, 3);
    let engine = engine::<f64>(architecture.clone(), &spiral(10));
    let count = architecture.parameter_count();
    let short = vec![0.0; count - 1];
    assert!(
        engine
            .loss_and_gradient(&short, &mut vec![0.0; count])
            .is_err()
    );
    assert!(engine.field(&short).is_err());
    let right = vec![0.0; count];
    assert!(engine.loss_and_gradient(&right, &mut [0.0; 3]).is_err());
}

/// Largest absolute value.
fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |max, v| v.abs().max(max))
}

fn values_of(field: &dyn Field, points: &[Vec3]) -> Vec<f64> {
    let mut values = vec![0.0; points.len()];
    field.values(points, &mut values).unwrap();
    values
}

fn with_gradients(field: &dyn Field, points: &[Vec3]) -> (Vec<f64>, Vec<Vec3>) {
    let mut values = vec![0.0; points.len()];
    let mut gradients = vec![[0.0; 3]; points.len()];
    field
        .values_and_gradients(points, &mut values, &mut gradients)
        .unwrap();
    (values, gradients)
}

fn assert_bits_eq(a: &[f64], b: &[f64]) {
    let bits = |v: &[f64]| v.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(a), bits(b));
}
