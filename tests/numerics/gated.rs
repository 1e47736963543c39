//! The scheme `gated`, which libtorch trains, from points to a mesh and a model file.

use meshway::reconstruction::settings::{Preset, Scheme, Settings};
use meshway::reconstruction::vector::Vec3;
use meshway::reconstruction::{Model, Reconstruction};

use crate::blocks::{bumpy, run};
use crate::kinds::{bare, ellipsoid_volume, spiral};

/// Settings of a quick run.
fn settings() -> Settings {
    let mut settings = Preset::Fast.settings();
    settings.network.scheme = Scheme::Gated;
    settings.training.max_evaluations = 60;
    settings.surface.resolution = 48;
    settings
}

fn is_one_ball(made: &Reconstruction) {
    let topology = &made.report.mesh.topology;
    assert!(topology.closed && topology.manifold);
    assert_eq!((topology.components, topology.genus), (1, Some(0)));
}

/// Values of the model's field near the vertices.
fn values(model: &Model, made: &Reconstruction) -> Vec<f64> {
    let places = made.mesh.vertices.iter().step_by(50);
    let places: Vec<Vec3> = places.map(|p| model.frame.to_unit(*p)).collect();
    let mut values = vec![0.0; places.len()];
    let field = model.field().unwrap();
    field.values(&places, &mut values).unwrap();
    values
}

/// The model file gives the field of the mesh, and the same bits as the model.
fn the_file_keeps_the_field(made: &Reconstruction) {
    let read = Model::decode(&made.model.encode().unwrap()).unwrap();
    let kept = values(&read, made);
    assert!(!kept.is_empty());
    assert_eq!(kept, values(&made.model, made));
    let largest = kept.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
    assert!(largest < 0.02, "{largest}");
}

#[test]
fn gated_gives_a_sphere_and_its_file_the_same_field() {
    let made = run(&bare(spiral(300)), &settings());
    is_one_ball(&made);
    let ball = ellipsoid_volume([1.0; 3]);
    let volume = made.report.mesh.volume.unwrap();
    assert!((volume / ball - 1.0).abs() < 0.03, "{volume}");
    the_file_keeps_the_field(&made);
}

#[test]
fn gated_fits_blocks() {
    let mut settings = settings();
    settings.training.max_evaluations = 30;
    settings.training.block_evaluations = 15;
    let made = run(&bumpy(3_000), &settings);
    assert!(made.report.blocks.as_ref().unwrap().count > 1);
    is_one_ball(&made);
    the_file_keeps_the_field(&made);
}
