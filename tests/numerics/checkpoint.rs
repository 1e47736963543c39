//! Training that is interrupted and taken up again ends as if it had never stopped.

use std::cell::{Cell, RefCell};

use meshway::reconstruction::network::{Ensemble, Libtorch, Scalar};
use meshway::reconstruction::sampling::Samples;
use meshway::reconstruction::settings::{Open, Optimizer, Preset, Scheme, Training};
use meshway::reconstruction::training::{Hooks, Identity, Metrics, Problem, Trained, train};
use meshway::reconstruction::{Error, Event, Observer};

use crate::network::{architecture, spiral, undecayed};

/// Keeps the last checkpoint and the evaluations it heard of; wants room after some iterations.
#[derive(Default)]
struct Keeper {
    from: Option<Vec<u8>>,
    release_after: Option<usize>,
    checkpoint: RefCell<Vec<u8>>,
    metrics: RefCell<Vec<Metrics>>,
    warnings: RefCell<Vec<&'static str>>,
    calls: Cell<u64>,
}

impl Observer for Keeper {
    fn event(&self, event: Event<'_>) {
        match event {
            Event::Metrics(metrics) => self.metrics.borrow_mut().push(metrics.clone()),
            Event::Warning(warning) => self.warnings.borrow_mut().push(warning.code),
            Event::Checkpoint { data, .. } => *self.checkpoint.borrow_mut() = data.to_vec(),
            _ => {}
        }
    }

    fn released(&self) -> bool {
        self.release_after
            .is_some_and(|iterations| self.metrics.borrow().len() >= iterations)
    }

    fn checkpoint(&self) -> Option<&[u8]> {
        self.from.as_deref()
    }

    fn seconds(&self) -> f64 {
        self.calls.set(self.calls.get() + 1);
        self.calls.get() as f64
    }
}

fn settings(optimizer: Optimizer) -> Training {
    Training {
        optimizer,
        max_evaluations: 70,
        // Fewer than the iterations, so that the ring of pairs has turned when it is saved.
        history: 5,
        patience: 50,
        adam_evaluations: 12,
        ..Preset::Balanced.settings().training
    }
}

fn run<T: Scalar>(
    settings: &Training,
    keeper: &Keeper,
    identity: Identity,
) -> Result<Trained<T>, Error> {
    tch::set_num_threads(1);
    let shape = architecture(Scheme::Sqrhw, 6, 3);
    let engine = Libtorch::new(shape.clone(), &spiral(60)).unwrap();
    let validation = spiral(7);
    let problem = Problem {
        validation: &validation,
        ..undecayed(&engine)
    };
    // Two members.
    let ensemble = Ensemble {
        architecture: shape,
        members: 2,
    };
    let hooks = Hooks {
        observer: keeper,
        snapshot: &mut |_, _| Ok(()),
        enough: &mut |_, _| Ok(false),
        identity,
    };
    train(problem, ensemble.initial_parameters(1), settings, hooks)
}

fn interrupted_equals_uninterrupted<T: Scalar>(optimizer: Optimizer) {
    let settings = settings(optimizer);
    let whole = Keeper::default();
    let expected = run::<T>(&settings, &whole, Identity::default()).unwrap();

    let mut metrics = Vec::new();
    let mut from = None;
    // Early, late, and in between; with Adam first, one of them before the change of method.
    for iterations in [1, 6, 12, usize::MAX] {
        let keeper = Keeper {
            from: from.take(),
            release_after: Some(iterations),
            ..Keeper::default()
        };
        let result = run::<T>(&settings, &keeper, Identity::default());
        metrics.append(&mut keeper.metrics.borrow_mut());
        if iterations == usize::MAX {
            assert_eq!(result.unwrap(), expected, "{optimizer:?}");
        } else {
            assert!(matches!(result, Err(Error::Interrupted)), "{optimizer:?}");
            from = Some(keeper.checkpoint.take());
        }
        assert!(keeper.warnings.borrow().is_empty());
    }
    assert_eq!(metrics, *whole.metrics.borrow(), "{optimizer:?}");
}

#[test]
fn an_interrupted_run_ends_with_the_same_bits() {
    for optimizer in [Optimizer::Lbfgs, Optimizer::Adam, Optimizer::AdamLbfgs] {
        interrupted_equals_uninterrupted::<f32>(optimizer);
        interrupted_equals_uninterrupted::<f64>(optimizer);
    }
}

#[test]
fn training_that_has_ended_is_not_repeated() {
    for optimizer in [Optimizer::Lbfgs, Optimizer::Adam] {
        // By the number of evaluations, and by the hold-out.
        for patience in [0, 5] {
            let settings = Training {
                patience,
                ..settings(optimizer)
            };
            let whole = Keeper::default();
            let expected = run::<f64>(&settings, &whole, Identity::default()).unwrap();
            let again = Keeper {
                from: Some(whole.checkpoint.take()),
                ..Keeper::default()
            };
            let found = run::<f64>(&settings, &again, Identity::default()).unwrap();
            assert_eq!(found, expected, "{optimizer:?} {patience}");
            assert!(again.metrics.borrow().is_empty());
        }
    }
}

#[test]
fn a_checkpoint_of_something_else_is_refused_and_training_starts_anew() {
    let settings = settings(Optimizer::Lbfgs);
    let expected = run::<f64>(&settings, &Keeper::default(), Identity::default()).unwrap();
    let keeper = Keeper {
        release_after: Some(3),
        ..Keeper::default()
    };
    run::<f64>(&settings, &keeper, Identity::default()).unwrap_err();
    let good = keeper.checkpoint.take();

    let mut flipped = good.clone();
    *flipped.last_mut().unwrap() ^= 1;
    let other = Identity::new(
        &Preset::Balanced.settings(),
        &spiral(60),
        &Samples::default(),
    );
    let cases = [
        (good.clone(), other),
        (flipped, Identity::default()),
        (good[..50].to_vec(), Identity::default()),
        (Vec::new(), Identity::default()),
        (b"something else altogether".to_vec(), Identity::default()),
    ];
    for (from, identity) in cases {
        let keeper = Keeper {
            from: Some(from),
            ..Keeper::default()
        };
        assert_eq!(run::<f64>(&settings, &keeper, identity).unwrap(), expected);
        assert_eq!(*keeper.warnings.borrow(), ["checkpoint_refused"]);
    }
}

#[test]
fn the_identity_changes_with_every_sample_and_setting() {
    let settings = Preset::Balanced.settings();
    let none = Samples::default();
    let base = Identity::new(&settings, &spiral(60), &none);
    assert_eq!(base, Identity::new(&settings, &spiral(60), &none));
    let mut moved = spiral(60);
    moved.points[59][2] += 1e-12;
    assert_ne!(base, Identity::new(&settings, &moved, &none));
    assert_ne!(base, Identity::new(&settings, &spiral(60), &spiral(1)));
    let mut other = settings.clone();
    other.training.seed += 1;
    assert_ne!(base, Identity::new(&other, &spiral(60), &none));
    // What happens after training: checkpoints that are older than the setting stay good.
    let mut trimmed = settings.clone();
    trimmed.surface.open = Open::Trimmed;
    trimmed.surface.target_triangles = 10_000;
    assert_eq!(base, Identity::new(&trimmed, &spiral(60), &none));
}
