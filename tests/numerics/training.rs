//! The loop around the optimisers: limits, hold-out, and what is told on the way.

use std::cell::{Cell, RefCell};

use meshway::reconstruction::network::{
    Architecture, Engine, Ensemble, Libtorch, initial_parameters,
};
use meshway::reconstruction::settings::{Optimizer, OutputLayer, Preset, Scheme, Training};
use meshway::reconstruction::surface::Field;
use meshway::reconstruction::training::{
    GradientHistogram, Hooks, Identity, Metrics, Problem, Termination, Trained, train,
};
use meshway::reconstruction::{Error, Event, Observer};

use crate::network::{architecture, engine, spiral, undecayed};

/// An observer with a clock of its own that writes down what it hears.
#[derive(Default)]
struct Notes {
    metrics: RefCell<Vec<Metrics>>,
    histograms: RefCell<Vec<GradientHistogram>>,
    progress: Cell<f64>,
    asked: Cell<u64>,
    cancel_at: Option<u64>,
}

impl Observer for Notes {
    fn event(&self, event: Event<'_>) {
        match event {
            Event::Metrics(metrics) => self.metrics.borrow_mut().push(metrics.clone()),
            Event::Gradients(histogram) => self.histograms.borrow_mut().push(histogram.clone()),
            Event::Progress(share) => self.progress.set(share),
            _ => {}
        }
    }

    fn cancelled(&self) -> bool {
        self.asked.set(self.asked.get() + 1);
        self.cancel_at.is_some_and(|at| self.asked.get() >= at)
    }

    /// One second passes from evaluation to evaluation.
    fn seconds(&self) -> f64 {
        self.asked.get() as f64
    }
}

fn settings() -> Training {
    Training {
        max_evaluations: 60,
        patience: 0,
        ..Preset::Balanced.settings().training
    }
}

fn small() -> Architecture {
    architecture(Scheme::Sqrhw, 6, 3)
}

fn run(engine: &Libtorch<f64>, settings: &Training, notes: &Notes) -> Result<Trained<f64>, Error> {
    let start = initial_parameters(engine.architecture(), settings.seed);
    solve(undecayed(engine), start, settings, notes)
}

fn solve(
    problem: Problem<'_, f64>,
    start: Vec<f64>,
    settings: &Training,
    notes: &Notes,
) -> Result<Trained<f64>, Error> {
    let hooks = Hooks {
        observer: notes,
        snapshot: &mut |_, _| Ok(()),
        enough: &mut |_, _| Ok(false),
        identity: Identity::default(),
    };
    train(problem, start, settings, hooks)
}

#[test]
fn training_tells_of_every_accepted_step() {
    let engine = engine::<f64>(small(), &spiral(60));
    let notes = Notes::default();
    let trained = run(&engine, &settings(), &notes).unwrap();
    assert_eq!(trained.termination, Termination::MaxEvaluations);
    assert_eq!(trained.evaluations, 60);
    assert_eq!(trained.validation_loss, None);
    let metrics = notes.metrics.borrow();
    assert_eq!(metrics.len() as u64, trained.iterations);
    assert!(
        metrics
            .windows(2)
            .all(|m| m[0].iteration + 1 == m[1].iteration
                && m[0].evaluation < m[1].evaluation
                && m[0].loss > m[1].loss)
    );
    let last = metrics.last().unwrap();
    assert_eq!(last.weight_norms, small().weight_norms(&trained.parameters));
    assert!((last.loss - trained.loss).abs() < 1e-300, "the same number");
    assert!((notes.progress.get() - 1.0).abs() < 1e-15);
    // The parameters are those whose loss is reported.
    let mut gradient = vec![0.0; trained.parameters.len()];
    let loss = engine
        .loss_and_gradient(&trained.parameters, &mut gradient)
        .unwrap();
    assert!((loss - trained.loss).abs() < 1e-300, "the same bits");
}

#[test]
fn the_same_seed_gives_the_same_bits() {
    let engine = engine::<f64>(small(), &spiral(60));
    let trained = |seed| {
        let settings = Training { seed, ..settings() };
        run(&engine, &settings, &Notes::default()).unwrap()
    };
    let (a, b, other) = (trained(1), trained(1), trained(2));
    assert_eq!(a, b);
    assert_ne!(a.parameters, other.parameters);
}

#[test]
fn histograms_and_snapshots_come_at_their_evaluations() {
    let engine = engine::<f64>(small(), &spiral(60));
    let notes = Notes::default();
    let settings = Training {
        histogram_evaluations: vec![1, 7],
        snapshot_evaluations: vec![1, 5, 1_000],
        ..settings()
    };
    let start = initial_parameters::<f64>(&small(), 1);
    let mut snapshots = Vec::new();
    let hooks = Hooks {
        observer: &notes,
        snapshot: &mut |evaluation, parameters| {
            snapshots.push((evaluation, parameters.to_vec()));
            Ok(())
        },
        enough: &mut |_, _| Ok(false),
        identity: Identity::default(),
    };
    train(undecayed(&engine), start.clone(), &settings, hooks).unwrap();
    assert_eq!(snapshots.iter().map(|s| s.0).collect::<Vec<_>>(), [1, 5]);
    assert_eq!(snapshots[0].1, start);

    let histograms = notes.histograms.borrow();
    assert_eq!(
        histograms.iter().map(|h| h.evaluation).collect::<Vec<_>>(),
        [1, 7]
    );
    let mut gradient = vec![0.0; start.len()];
    engine.loss_and_gradient(&start, &mut gradient).unwrap();
    for (layer, histogram) in small().layers().iter().zip(&histograms[0].layers) {
        let values = &gradient[layer.weight.clone()];
        assert_eq!(layer.name, histogram.layer);
        assert_eq!(histogram.counts.len(), 100);
        assert_eq!(histogram.counts.iter().sum::<u64>(), values.len() as u64);
        assert!(histogram.counts[0] > 0 && histogram.counts[99] > 0);
        let upper = values
            .iter()
            .filter(|v| **v >= f64::midpoint(histogram.min, histogram.max));
        assert_eq!(
            histogram.counts[50..].iter().sum::<u64>(),
            upper.count() as u64
        );
    }
}

#[test]
fn each_limit_ends_the_run_with_its_name() {
    let engine = engine::<f64>(small(), &spiral(60));
    let end = |settings: Training, cancel_at| {
        let notes = Notes {
            cancel_at,
            ..Notes::default()
        };
        run(&engine, &settings, &notes)
    };
    let cancelled = end(settings(), Some(9)).unwrap();
    assert_eq!(
        (cancelled.termination, cancelled.evaluations),
        (Termination::Cancelled, 8)
    );
    assert!(matches!(end(settings(), Some(1)), Err(Error::Cancelled)));

    let timed = Training {
        time_limit_seconds: 5.0,
        ..settings()
    };
    let timed = end(timed, None).unwrap();
    assert_eq!(
        (timed.termination, timed.evaluations),
        (Termination::TimeLimit, 4)
    );

    for optimizer in [Optimizer::Lbfgs, Optimizer::Adam, Optimizer::AdamLbfgs] {
        for max_evaluations in [1, 2, 20] {
            let limited = Training {
                optimizer,
                max_evaluations,
                adam_evaluations: 10,
                ..settings()
            };
            let limited = end(limited, None).unwrap();
            assert_eq!(limited.termination, Termination::MaxEvaluations);
            assert_eq!(limited.evaluations, max_evaluations, "{optimizer:?}");
        }
    }
    let iterations = Training {
        max_iterations: 4,
        ..settings()
    };
    let iterations = end(iterations, None).unwrap();
    assert_eq!(
        (iterations.termination, iterations.iterations),
        (Termination::MaxIterations, 4)
    );
}

#[test]
fn adam_goes_first_and_lbfgs_goes_on() {
    let engine = engine::<f64>(small(), &spiral(60));
    let notes = Notes::default();
    let both = Training {
        optimizer: Optimizer::AdamLbfgs,
        adam_evaluations: 20,
        ..settings()
    };
    let trained = run(&engine, &both, &notes).unwrap();
    assert_eq!(trained.evaluations, 60);
    let metrics = notes.metrics.borrow();
    let by_adam = |m: &&Metrics| (m.step_length - both.adam_learning_rate).abs() < 1e-300;
    assert_eq!(
        metrics.iter().take_while(by_adam).count(),
        19,
        "and the evaluation at the start"
    );
    assert!(
        metrics[..19]
            .iter()
            .all(|m| m.evaluation == m.iteration + 1)
    );
    assert!(metrics[19..].windows(2).all(|m| m[0].loss > m[1].loss));
    assert!(trained.loss < metrics[18].loss);
}

#[test]
fn training_stops_early_and_keeps_the_best() {
    tch::set_num_threads(1);
    // What is held out contradicts what is trained, so that its loss rises before long.
    let training = spiral(40);
    let mut validation = spiral(7);
    validation.targets.iter_mut().for_each(|y| *y *= -0.1);
    let engine = Libtorch::<f64>::new(small(), &training).unwrap();
    let problem = Problem {
        validation: &validation,
        ..undecayed(&engine)
    };
    // The hold-out is that of the mean of two networks.
    let ensemble = Ensemble {
        architecture: small(),
        members: 2,
    };
    let notes = Notes::default();
    let patient = Training {
        max_evaluations: 1_000,
        patience: 15,
        ..settings()
    };
    let trained = solve(problem, ensemble.initial_parameters(1), &patient, &notes).unwrap();
    assert_eq!(trained.termination, Termination::NoImprovement);
    let waited = trained.evaluations - trained.parameters_evaluation;
    assert!(
        (15..15 + 25).contains(&waited),
        "patience, and at most one search: {waited}"
    );
    let losses: Vec<_> = notes
        .metrics
        .borrow()
        .iter()
        .filter_map(|m| m.validation_loss)
        .collect();
    let best = trained.validation_loss.unwrap();
    assert!(losses.iter().all(|loss| best <= *loss));
    let mut values = vec![0.0; validation.len()];
    let field = problem.field(&trained.parameters).unwrap();
    field.values(&validation.points, &mut values).unwrap();
    let costs = values.iter().enumerate().map(|(i, f)| {
        let [lower, upper] = validation.free_range(i);
        let beyond = (lower - f).max(f - upper).max(0.0);
        validation.weights[i] * beyond * beyond
    });
    let of_parameters = costs.sum::<f64>() / validation.len() as f64;
    assert!((of_parameters - best).abs() < 1e-12 * best);

    let without = Training {
        patience: 0,
        ..settings()
    };
    let start = ensemble.initial_parameters(1);
    let trained = solve(problem, start, &without, &Notes::default()).unwrap();
    assert_eq!(trained.parameters_evaluation, trained.evaluations);
    assert!(trained.validation_loss.unwrap() > best);
}

#[test]
fn divergence_is_an_error() {
    let engine = engine::<f64>(small(), &spiral(60));
    let start = vec![f64::MAX; small().parameter_count()];
    let error = solve(undecayed(&engine), start, &settings(), &Notes::default()).unwrap_err();
    assert_eq!(error.code(), "training_diverged");

    let wild = Training {
        optimizer: Optimizer::Adam,
        adam_learning_rate: 1e200,
        ..settings()
    };
    let error = run(&engine, &wild, &Notes::default()).unwrap_err();
    assert!(matches!(
        error,
        Error::TrainingDiverged { evaluation: 2, .. }
    ));
}

#[test]
fn a_solved_output_layer_is_at_its_minimum_and_needs_fewer_evaluations() {
    let mut samples = spiral(200);
    samples.one_sided.fill(false);
    let engine = engine::<f64>(small(), &samples);
    let train_with = |output_layer| {
        let problem = Problem {
            output_layer,
            ..undecayed(&engine)
        };
        let start = initial_parameters(&small(), 1);
        let settings = Training {
            max_evaluations: 15,
            ..settings()
        };
        solve(problem, start, &settings, &Notes::default()).unwrap()
    };
    let solved = train_with(OutputLayer::Solved);
    let trained = train_with(OutputLayer::Trained);
    assert!(
        solved.loss < 0.5 * trained.loss,
        "{} {}",
        solved.loss,
        trained.loss
    );
    // No other output layer is better: the gradient along it is that of its decay.
    let mut gradient = vec![0.0; solved.parameters.len()];
    engine
        .loss_and_gradient(&solved.parameters, &mut gradient)
        .unwrap();
    let output = small().output_layer();
    let weights = &solved.parameters[output.clone()];
    for (g, weight) in gradient[output].iter().zip(weights) {
        assert!((g + 2e-3 * weight).abs() < 1e-10, "{g} {weight}");
    }
}
