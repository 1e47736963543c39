//! Several networks whose mean is the field.

use meshway::reconstruction::network::{Engine, Ensemble, initial_parameters};
use meshway::reconstruction::reconstruct;
use meshway::reconstruction::settings::{OutputLayer, Preset, Scheme};
use meshway::reconstruction::shapes::{Recipe, Shape, sample};
use meshway::reconstruction::surface::Field;
use meshway::reconstruction::training::Problem;
use meshway::reconstruction::vector::Vec3;

use crate::network::{architecture, engine, spiral, undecayed};
use crate::uncertainty::Silent;

const POINTS: [Vec3; 3] = [[0.1, 0.2, 0.3], [-0.4, 0.5, 0.0], [0.0, 0.0, 0.9]];

fn values_and_gradients(field: &dyn Field) -> ([f64; 3], [Vec3; 3]) {
    let (mut values, mut gradients) = ([0.0; 3], [[0.0; 3]; 3]);
    field
        .values_and_gradients(&POINTS, &mut values, &mut gradients)
        .unwrap();
    (values, gradients)
}

#[test]
fn members_start_one_after_the_other_and_the_first_as_one_alone_would() {
    let ensemble = Ensemble {
        architecture: architecture(Scheme::Sqrhw, 5, 3),
        members: 3,
    };
    let all = ensemble.initial_parameters::<f64>(4);
    assert_eq!(all.len(), ensemble.parameter_count());
    let members: Vec<_> = ensemble.architecture.members(&all).collect();
    assert_eq!(members.len(), 3);
    assert_eq!(
        members[0],
        initial_parameters::<f64>(&ensemble.architecture, 4)
    );
    assert_ne!(members[1], members[0]);
    assert_ne!(members[2], members[1]);
}

#[test]
fn the_field_is_the_mean_of_those_of_the_members() {
    let ensemble = Ensemble {
        architecture: architecture(Scheme::Sqrhw, 5, 3),
        members: 4,
    };
    let engine = engine::<f64>(ensemble.architecture.clone(), &spiral(9));
    let parameters = ensemble.initial_parameters(2);
    let mean = undecayed(&engine).field(&parameters).unwrap();
    let (values, gradients) = values_and_gradients(&mean);
    let mut alone = [0.0; 3];
    mean.values(&POINTS, &mut alone).unwrap();
    let members: Vec<_> = ensemble
        .architecture
        .members(&parameters)
        .map(|p| values_and_gradients(engine.field(p).unwrap().as_ref()))
        .collect();
    for i in 0..POINTS.len() {
        let expected = members.iter().map(|(f, _)| f[i]).sum::<f64>() / 4.0;
        assert!((values[i] - expected).abs() < 1e-15);
        assert!((alone[i] - expected).abs() < 1e-15);
        for axis in 0..3 {
            let expected = members.iter().map(|(_, g)| g[i][axis]).sum::<f64>() / 4.0;
            assert!((gradients[i][axis] - expected).abs() < 1e-14);
        }
    }
}

/// A sparse or noisy sphere is fitted by several networks, a dense clean one by one.
#[test]
fn uncertain_clouds_have_several_networks_and_others_one() {
    let mut settings = Preset::Fast.settings();
    settings.training.max_evaluations = 30;
    settings.surface.resolution = 32;
    let members = |points: usize, noise_percent: f64| {
        let recipe = Recipe {
            points,
            noise_percent,
            ..Recipe::default()
        };
        let cloud = sample(&Shape::Sphere { radius: 1.0 }, &recipe);
        let made = reconstruct(&cloud, &settings, &Silent).unwrap();
        let ensemble = made.model.ensemble;
        assert_eq!(made.model.parameters.len(), ensemble.parameter_count());
        assert_eq!(made.report.network.members, ensemble.members);
        assert_eq!(made.report.network.width, ensemble.architecture.width);
        (ensemble.members, ensemble.architecture.width)
    };
    assert_eq!(members(200, 0.0), (6, 16), "sparse");
    assert_eq!(members(2_000, 2.0), (6, 16), "noisy");
    assert_eq!(members(2_000, 0.0), (1, 50), "neither");
}

#[test]
fn the_loss_is_the_mean_and_each_output_layer_is_solved_for() {
    let mut samples = spiral(60);
    samples.one_sided.fill(false);
    let ensemble = Ensemble {
        architecture: architecture(Scheme::Hw, 5, 3),
        members: 2,
    };
    let engine = engine::<f64>(ensemble.architecture.clone(), &samples);
    for output_layer in [OutputLayer::Trained, OutputLayer::Solved] {
        let problem = Problem {
            weight_decay: 1e-3,
            output_layer,
            ..undecayed(&engine)
        };
        let start = ensemble.initial_parameters::<f64>(5);
        let mut all = start.clone();
        let mut gradient = vec![0.0; all.len()];
        let loss = problem.loss_and_gradient(&mut all, &mut gradient).unwrap();
        let length = start.len() / 2;
        let mut losses = 0.0;
        for (member, range) in [0..length, length..2 * length].into_iter().enumerate() {
            let mut parameters = start[range.clone()].to_vec();
            let mut alone = vec![0.0; length];
            losses += problem
                .loss_and_gradient(&mut parameters, &mut alone)
                .unwrap();
            assert_eq!(parameters, all[range.clone()], "{member}");
            for (g, alone) in gradient[range].iter().zip(&alone) {
                assert!((g - 0.5 * alone).abs() < 1e-15, "{member}");
            }
        }
        assert!((loss - 0.5 * losses).abs() < 1e-15 * losses);
    }
}
