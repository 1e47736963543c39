//! Clouds with more detail than one network holds: many networks, one field.

use std::cell::{Cell, RefCell};

use meshway::reconstruction::cloud::PointCloud;
use meshway::reconstruction::report::Verdict;
use meshway::reconstruction::settings::{Preset, Settings};
use meshway::reconstruction::training::Metrics;
use meshway::reconstruction::vector::{Vec3, norm, scale};
use meshway::reconstruction::{Error, Event, Observer, Reconstruction, reconstruct};

use crate::kinds::{bare, spiral};
use crate::uncertainty::Silent;

/// Distance of the bumpy ball's surface from its middle, in this direction.
fn radius([x, y, z]: Vec3) -> f64 {
    1.0 + 0.05 * (14.0 * x).sin() * (14.0 * y).sin() * (14.0 * z).cos()
}

/// A ball with some hundred bumps.
pub(crate) fn bumpy(points: usize) -> PointCloud {
    let directions = spiral(points).into_iter();
    bare(directions.map(|d| scale(d, radius(d))).collect())
}

fn settings() -> Settings {
    let mut settings = Preset::Fast.settings();
    settings.training.max_evaluations = 200;
    settings
}

pub(crate) fn run(cloud: &PointCloud, settings: &Settings) -> Reconstruction {
    tch::set_num_threads(1);
    reconstruct(cloud, settings, &Silent).unwrap()
}

/// Mean distance of the vertices from the bumpy ball.
fn error(made: &Reconstruction) -> f64 {
    let off = |p: &Vec3| {
        let length = norm(*p);
        (length - radius(scale(*p, 1.0 / length))).abs()
    };
    let vertices = &made.mesh.vertices;
    vertices.iter().map(off).sum::<f64>() / vertices.len() as f64
}

#[test]
fn blocks_keep_detail_that_one_network_loses() {
    let cloud = bumpy(6_000);
    let many = run(&cloud, &settings());
    let mut one = settings();
    one.network.block_points = 0;
    let one = run(&cloud, &one);
    assert_eq!(one.report.blocks, None);
    let blocks = many.report.blocks.clone().unwrap();
    // Exact points are shared by more blocks than the settings ask for at least.
    let asked = settings().network.block_points;
    assert!(blocks.count > (3 * many.report.samples.surface).div_ceil(2 * asked));
    assert!(blocks.count < (3 * many.report.samples.surface).div_ceil(asked));
    assert!(
        error(&many) < 0.3 * error(&one),
        "{} {}",
        error(&many),
        error(&one)
    );
    assert!(error(&many) < 2e-3, "{}", error(&many));
    let mesh = &many.report.mesh;
    assert!(mesh.topology.closed && mesh.topology.manifold);
    assert_eq!(
        (mesh.topology.components, mesh.topology.genus),
        (1, Some(0))
    );
    assert_eq!(many.report.verdict, Verdict::Good);
    // What is measured on held-out points is, and none of them is trained on.
    let samples = &many.report.samples;
    assert_eq!(samples.surface + samples.held_out, cloud.points.len());
    assert!(samples.held_out >= 500);

    // The model has the field of the mesh.
    let model = many.model;
    let field = model.field().unwrap();
    let places: Vec<Vec3> = many.mesh.vertices.iter().step_by(50).copied().collect();
    let inner: Vec<Vec3> = places.iter().map(|p| model.frame.to_unit(*p)).collect();
    let mut values = vec![0.0; inner.len()];
    field.values(&inner, &mut values).unwrap();
    let largest = values.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
    assert!(largest < 0.01, "{largest}");
}

#[test]
fn one_network_stays_where_it_is_enough() {
    for points in [3_000, 6_000] {
        let made = run(&bare(spiral(points)), &settings());
        assert_eq!(made.report.blocks, None, "{points}");
    }
}

/// Keeps the last checkpoint; wants one after each block, and room after some.
#[derive(Default)]
struct Keeper {
    from: Option<Vec<u8>>,
    room_after: Option<usize>,
    cancels: bool,
    checkpoints: Cell<usize>,
    last: RefCell<Vec<u8>>,
    progress: RefCell<Vec<f64>>,
    warnings: RefCell<Vec<&'static str>>,
    series: RefCell<Vec<Metrics>>,
}

impl Keeper {
    fn wants_room(&self) -> bool {
        self.room_after
            .is_some_and(|most| self.checkpoints.get() >= most)
    }
}

impl Observer for Keeper {
    fn event(&self, event: Event<'_>) {
        match event {
            Event::Checkpoint { data, .. } => {
                if data.starts_with(b"MWBLOCK") {
                    self.checkpoints.set(self.checkpoints.get() + 1);
                }
                *self.last.borrow_mut() = data.to_vec();
            }
            Event::Metrics(row) if row.blocks.is_some() => {
                self.series.borrow_mut().push(row.clone());
            }
            Event::Progress(share) => self.progress.borrow_mut().push(share),
            Event::Phase(_) => self.progress.borrow_mut().clear(),
            Event::Warning(warning) => self.warnings.borrow_mut().push(warning.code),
            _ => {}
        }
    }

    fn cancelled(&self) -> bool {
        self.cancels && self.wants_room()
    }

    fn released(&self) -> bool {
        !self.cancels && self.wants_room()
    }

    fn checkpoint_due(&self) -> bool {
        true
    }

    fn checkpoint(&self) -> Option<&[u8]> {
        self.from.as_deref()
    }

    fn seconds(&self) -> f64 {
        0.0
    }
}

/// The settings of runs that are to be quick.
fn quick() -> Settings {
    let mut settings = settings();
    settings.training.max_evaluations = 30;
    settings.training.block_evaluations = 15;
    settings.surface.resolution = 48;
    settings
}

#[test]
fn an_interrupted_run_ends_with_the_same_bits() {
    let (cloud, settings) = (bumpy(3_000), quick());
    let whole = Keeper::default();
    let expected = reconstruct(&cloud, &settings, &whole).unwrap();
    let blocks = expected.report.blocks.as_ref().unwrap();
    let whole = whole.series.take();
    // A row a block where they are few; the last has all of them.
    assert_eq!(whole.len(), blocks.count.min(32));
    let last = whole.last().unwrap();
    assert_eq!(last.blocks, Some(blocks.count as u64));
    assert!((last.loss - blocks.loss).abs() < 1e-12);
    assert!(last.validation_loss.is_some() && last.gradient_norm > 0.0);
    let training = &expected.report.training;
    assert_eq!(last.evaluation, training.evaluations + blocks.evaluations);
    assert!(whole.is_sorted_by(|a, b| a.evaluation < b.evaluation));
    let mut series = Vec::new();
    let mut from = None;
    for room_after in [1, 2, usize::MAX] {
        let keeper = Keeper {
            from: from.take(),
            room_after: Some(room_after),
            ..Keeper::default()
        };
        let result = reconstruct(&cloud, &settings, &keeper);
        assert!(keeper.warnings.borrow().is_empty());
        series.extend(keeper.series.take());
        if room_after == usize::MAX {
            let made = result.unwrap();
            assert_eq!(made.mesh, expected.mesh);
            assert_eq!(made.model, expected.model);
            assert_eq!(series, whole);
        } else {
            assert!(matches!(result, Err(Error::Interrupted)));
            assert!(
                keeper.progress.borrow().is_sorted(),
                "{:?}",
                keeper.progress
            );
            from = Some(keeper.last.take());
        }
    }
}

#[test]
fn a_cancelled_run_ends_while_blocks_are_fitted() {
    let keeper = Keeper {
        room_after: Some(1),
        cancels: true,
        ..Keeper::default()
    };
    let result = reconstruct(&bumpy(3_000), &quick(), &keeper);
    assert!(matches!(result, Err(Error::Cancelled)));
}

#[test]
fn a_checkpoint_of_another_run_is_refused_with_a_warning() {
    let (cloud, settings) = (bumpy(3_000), quick());
    let keeper = Keeper {
        room_after: Some(1),
        ..Keeper::default()
    };
    reconstruct(&cloud, &settings, &keeper).unwrap_err();
    let mut other = settings;
    other.training.seed = 9;
    let keeper = Keeper {
        from: Some(keeper.last.take()),
        ..Keeper::default()
    };
    reconstruct(&cloud, &other, &keeper).unwrap();
    assert_eq!(*keeper.warnings.borrow(), ["checkpoint_refused"]);
}

#[test]
fn the_bits_do_not_depend_on_the_threads() {
    let (cloud, settings) = (bumpy(3_000), quick());
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().unwrap();
        pool.install(|| run(&cloud, &settings).mesh)
    };
    let one = with(1);
    assert_eq!(one, with(3));
}
