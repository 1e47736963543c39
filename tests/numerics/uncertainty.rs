//! How far samples are trusted: noise, sparse clouds, holes, weight decay; and what comes of it.

use meshway::reconstruction::cloud::PointCloud;
use meshway::reconstruction::network::{Engine, Fused, Libtorch};
use meshway::reconstruction::plan::{Findings, Plan};
use meshway::reconstruction::sampling::{Prepared, Samples, prepare};
use meshway::reconstruction::settings::{Preset, Scheme, Settings};
use meshway::reconstruction::shapes::{Recipe, Shape, sample};
use meshway::reconstruction::{Event, Observer, Reconstruction, reconstruct};
use serde_json::json;

use crate::network::architecture;

pub(crate) const SPHERE: Shape = Shape::Sphere { radius: 1.0 };

const TORUS: Shape = Shape::Torus {
    major: 1.0,
    minor: 0.4,
};

pub(crate) struct Silent;

impl Observer for Silent {
    fn event(&self, _: Event<'_>) {}

    fn seconds(&self) -> f64 {
        0.0
    }
}

pub(crate) fn bare(points: usize) -> Recipe {
    Recipe {
        points,
        ..Recipe::default()
    }
}

fn prepared(cloud: &PointCloud) -> Prepared {
    prepare(cloud, &Preset::Balanced.settings(), 0.0, &|| false).unwrap()
}

#[test]
fn what_is_missing_of_a_surface_is_told() {
    let missing = |keep: fn(&[f64; 3]) -> bool, noise_percent: f64| {
        let recipe = Recipe {
            noise_percent,
            ..bare(3_000)
        };
        let mut cloud = sample(&SPHERE, &recipe);
        cloud.points.retain(keep);
        let uncertainty = prepared(&cloud).uncertainty.unwrap();
        (uncertainty.missing, uncertainty.tells_details())
    };
    let (whole, tells) = missing(|_| true, 0.0);
    assert!(whole < 0.04 && tells, "{whole}");
    // A cap of a quarter of the area takes up less of the view, for it is farther away than the rest.
    let (cut, tells) = missing(|p| p[2] < 0.5, 0.0);
    assert!((0.13..0.25).contains(&cut) && !tells, "{cut}");
    let (noisy, tells) = missing(|_| true, 0.5);
    assert!(noisy < 0.1 && !tells, "{noisy}");
}

#[test]
fn noise_is_told_from_shape() {
    for (shape, points) in [
        (SPHERE, 300),
        (TORUS, 300),
        (TORUS, 3_000),
        (Shape::Hand, 3_000),
    ] {
        for given in [0.0, 0.3, 0.6] {
            let recipe = Recipe {
                noise_percent: given,
                ..bare(points)
            };
            let prepared = prepared(&sample(&shape, &recipe));
            let found = 100.0 * prepared.noise().unwrap() / prepared.diagonal;
            let context = format!("{shape} {points}: {found} of {given}");
            // What fits to 300 points miss of the shape itself.
            assert!(
                found > 0.6 * given && found < 1.6 * given + 0.2,
                "{context}"
            );
        }
    }
}

#[test]
fn sparse_clouds_give_all_their_points_and_bounds() {
    let sparse = prepared(&sample(&SPHERE, &bare(300)));
    let dense = prepared(&sample(&SPHERE, &bare(3_000)));
    assert_eq!(sparse.counts.surface, 300);
    assert!(sparse.validation.is_empty());
    assert_eq!(dense.counts.surface, 2_700);
    for (prepared, far) in [(&sparse, sparse.counts.far), (&dense, 0)] {
        let samples = &prepared.training;
        let bounds = samples.one_sided.iter().filter(|one_sided| **one_sided);
        assert_eq!(bounds.count(), far);
        // The far samples come last.
        assert!(samples.one_sided.iter().rev().take(far).all(|b| *b));
        assert!(samples.weights[0] > 5.0 * samples.weights[samples.len() - 1]);
    }
}

#[test]
fn noise_takes_weight_from_the_points_and_gives_it_to_decay() {
    let clean = prepared(&sample(&TORUS, &bare(1_500)));
    let noisy = prepared(&sample(
        &TORUS,
        &Recipe {
            noise_percent: 1.0,
            ..bare(1_500)
        },
    ));
    assert!(noisy.training.weights[0] < 0.5 * clean.training.weights[0]);
    let mut settings = Preset::Balanced.settings();
    let decay = |settings: &Settings, prepared: &Prepared| {
        Plan::new(settings, Findings::from(prepared)).weight_decay
    };
    assert!(decay(&settings, &noisy) > 10.0 * decay(&settings, &clean));
    settings.training.smoothing = 0.0;
    assert!(decay(&settings, &noisy).abs() < f64::EPSILON);
}

/// Nothing may be sure of its side in the open part: the flat lid of a winding number is not the surface.
#[test]
fn around_a_hole_no_sample_closes_it() {
    let recipe = Recipe {
        missing_percent: 30.0,
        ..bare(3_000)
    };
    let prepared = prepared(&sample(&SPHERE, &recipe));
    let samples = &prepared.training;
    let wrong = (0..samples.len()).filter(|&i| {
        let truth = SPHERE.signed(prepared.frame.to_world(samples.points[i]));
        // Within gaps of the sampling a side is a matter of a hair.
        truth * samples.targets[i] < 0.0 && truth.abs() > 0.05
    });
    assert_eq!(wrong.count(), 0);
    assert!(prepared.counts.far > 1_000);
}

#[test]
fn what_passes_a_bound_costs_nothing() {
    let architecture = architecture(Scheme::Plain, 4, 1);
    // All weights 0 and the bias of the output 1: f = 1 everywhere.
    let mut parameters = vec![0.0_f32; architecture.parameter_count()];
    parameters[architecture.layers()[1].bias.start] = 1.0;
    let loss = |target: f64, one_sided: bool| {
        let samples = Samples {
            points: vec![[0.1, 0.2, 0.3]],
            targets: vec![target],
            weights: vec![1.0],
            one_sided: vec![one_sided],
        };
        let mut gradient = vec![0.0; parameters.len()];
        let engines: [Box<dyn Engine<f32>>; 2] = [
            Box::new(Fused::new(architecture.clone(), &samples).unwrap()),
            Box::new(Libtorch::new(architecture.clone(), &samples).unwrap()),
        ];
        let [fused, libtorch] =
            engines.map(|e| e.loss_and_gradient(&parameters, &mut gradient).unwrap());
        assert!((fused - libtorch).abs() < 1e-6);
        fused
    };
    for (target, exact, bound) in [(0.5, 0.25, 0.0), (1.5, 0.25, 0.25), (-0.5, 2.25, 2.25)] {
        assert!((loss(target, false) - exact).abs() < 1e-6);
        assert!((loss(target, true) - bound).abs() < 1e-6);
    }
}

/// Mean distance from the vertices to the shape, in % of the diagonal of the cloud.
fn error(made: &Reconstruction, shape: &Shape) -> f64 {
    let vertices = &made.mesh.vertices;
    let sum: f64 = vertices.iter().map(|v| shape.signed(*v).abs()).sum();
    let diagonal = made.report.distances.as_ref().unwrap().diagonal;
    100.0 * sum / (vertices.len() as f64 * diagonal)
}

/// Bounds of about twice what was seen, on what users bring: few points, noise, holes. The whole bench is
/// `make bench-quality`.
#[test]
fn bare_points_give_the_shape_closely() {
    let settings = Settings::resolve(
        Preset::Balanced,
        &json!({"training": {"max_evaluations": 400}, "surface": {"resolution": 96}}),
    )
    .unwrap();
    tch::set_num_threads(1);
    for (shape, points, noise_percent, missing_percent, most, genus) in [
        (TORUS, 300, 0.0, 0.0, 0.2, 1),
        (TORUS, 300, 0.5, 0.0, 0.6, 1),
        (Shape::Uterus, 300, 0.0, 0.0, 0.5, 0),
        (SPHERE, 900, 0.0, 30.0, 1.5, 0),
    ] {
        let recipe = Recipe {
            noise_percent,
            missing_percent,
            ..bare(points)
        };
        let made = reconstruct(&sample(&shape, &recipe), &settings, &Silent).unwrap();
        let found = error(&made, &shape);
        let topology = &made.report.mesh.topology;
        let context = format!("{shape} {points} {noise_percent} {missing_percent}: {found}");
        assert!(topology.closed && topology.manifold, "{context}");
        assert_eq!(
            (topology.components, topology.genus),
            (1, Some(genus)),
            "{context}"
        );
        assert!(found < most, "{context}");
        // What is missing, but for a rim of three spacings; nothing in the gaps of a random sampling.
        let unsupported = made.report.surface.unsupported_area_percent;
        let [least, most] = if missing_percent > 0.0 {
            [0.3 * missing_percent, missing_percent]
        } else {
            [0.0, 0.01]
        };
        let context = format!("{context}, unsupported {unsupported} %");
        assert!(unsupported >= least && unsupported <= most, "{context}");
        let mut warnings = made.report.warnings.iter();
        let warned = warnings.any(|warning| warning.code == "surface_unsupported");
        assert_eq!(warned, missing_percent > 0.0, "{context}");
        assert_eq!(made.report.summary().contains("no point within"), warned);
    }
}
