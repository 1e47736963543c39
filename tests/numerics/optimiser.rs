//! L-BFGS, Adam and the loop around them.
#![expect(clippy::unnecessary_wraps, reason = "an objective may be interrupted")]

use std::cell::{Cell, RefCell};

use meshway::reconstruction::network::{Architecture, Engine, Libtorch, initial_parameters};
use meshway::reconstruction::settings::{Optimizer, Preset, Scheme, Training};
use meshway::reconstruction::training::{
    Adam, GradientHistogram, Hooks, Interrupt, Iterate, Lbfgs, Metrics, Options, Termination,
    Trained, train,
};
use meshway::reconstruction::{Error, Event, Observer};

use crate::network::{architecture, engine, spiral};

type Answer = Result<f64, Interrupt>;

fn options() -> Options {
    Options {
        learning_rate: 1.0,
        history: 10,
        tolerance_gradient: 1e-6,
        tolerance_change: 0.0,
        max_iterations: 500,
        max_evaluations: 2_000,
    }
}

/// Steps to the end; the iterate, why it ended, and the state.
fn minimise(
    start: &[f64],
    options: Options,
    objective: &mut dyn FnMut(&[f64], &mut [f64]) -> Answer,
) -> Result<(Iterate<f64>, Termination, Lbfgs<f64>), Interrupt> {
    let mut at = Iterate::new(start.to_vec(), objective)?;
    let mut lbfgs = Lbfgs::new(start.len(), options, 1);
    loop {
        match lbfgs.step(&mut at, objective) {
            Ok(step) => {
                if let Some(termination) = step.termination {
                    return Ok((at, termination, lbfgs));
                }
            }
            Err(Interrupt::Stop(termination)) => return Ok((at, termination, lbfgs)),
            Err(failed) => return Err(failed),
        }
    }
}

/// The function of Rosenbrock in 2n dimensions; its minimum is 0 at (1, 1, …).
fn rosenbrock(x: &[f64], g: &mut [f64]) -> Answer {
    let mut value = 0.0;
    for (x, g) in x.chunks(2).zip(g.chunks_mut(2)) {
        let (a, b) = (1.0 - x[0], x[1] - x[0] * x[0]);
        value += a * a + 100.0 * b * b;
        g[0] = -2.0 * a - 400.0 * x[0] * b;
        g[1] = 200.0 * b;
    }
    Ok(value)
}

/// ½ Σ i xᵢ².
fn quadratic(x: &[f64], g: &mut [f64]) -> Answer {
    let mut value = 0.0;
    for (i, (x, g)) in x.iter().zip(g).enumerate() {
        let curvature = (i + 1) as f64;
        value += 0.5 * curvature * x * x;
        *g = curvature * x;
    }
    Ok(value)
}

#[test]
fn lbfgs_finds_the_minimum_of_rosenbrock() {
    let start: Vec<f64> = [-1.2, 1.0].repeat(20);
    let (at, termination, _) = minimise(&start, options(), &mut rosenbrock).unwrap();
    assert_eq!(termination, Termination::ConvergedGradient);
    // The smallest curvature at the minimum is 0.4, so |x - 1| <= √40 1e-6 / 0.4 = 1.6e-5.
    assert!(at.parameters.iter().all(|x| (x - 1.0).abs() < 1.6e-5));
}

#[test]
fn lbfgs_with_a_pair_for_each_dimension_is_quick_on_a_quadratic() {
    let (at, termination, lbfgs) = minimise(&[1.0; 8], options(), &mut quadratic).unwrap();
    assert_eq!(termination, Termination::ConvergedGradient);
    assert!(at.loss < 1.4e-12, "½ Σ g² / i with g = 1e-6");
    // With exact searches it would be 8; ours are inexact, and the first step is short.
    assert!(lbfgs.iterations() <= 30, "{}", lbfgs.iterations());
}

#[test]
fn lbfgs_drops_the_oldest_pairs() {
    let few = Options {
        history: 2,
        ..options()
    };
    let (at, termination, _) = minimise(&[1.0; 8], few, &mut quadratic).unwrap();
    assert_eq!(termination, Termination::ConvergedGradient);
    assert!(at.loss < 1.4e-12);
}

#[test]
fn lbfgs_backs_away_from_what_is_not_finite() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        // -log(1 - x) + ½ (x - 2)²: the full step from 0 runs past the wall at 1.
        let mut met_the_wall = 0;
        let mut walled = |x: &[f64], g: &mut [f64]| {
            if x[0] >= 1.0 {
                met_the_wall += 1;
                g[0] = f64::NAN;
                return Ok(bad);
            }
            g[0] = 1.0 / (1.0 - x[0]) + x[0] - 2.0;
            Ok(-(1.0 - x[0]).ln() + 0.5 * (x[0] - 2.0).powi(2))
        };
        let steep = Options {
            learning_rate: 10.0,
            ..options()
        };
        let (at, termination, _) = minimise(&[-3.0], steep, &mut walled).unwrap();
        assert_eq!(termination, Termination::ConvergedGradient);
        // (1 - x)(2 - x) = 1; the curvature there is above 1 and the gradient below 1e-6.
        let minimum = (3.0 - 5.0_f64.sqrt()) / 2.0;
        assert!((at.parameters[0] - minimum).abs() < 1e-6);
        assert!(met_the_wall > 0);
    }
}

#[test]
fn nothing_finite_on_the_way_is_divergence() {
    let mut only_the_start = |x: &[f64], g: &mut [f64]| {
        g[0] = 1.0;
        Ok(if x[0] == 0.0 { 1.0 } else { f64::NAN })
    };
    let result = minimise(&[0.0], options(), &mut only_the_start);
    assert!(matches!(
        result,
        // The first evaluation and a whole search.
        Err(Interrupt::Failed(Error::TrainingDiverged { evaluation: 26, loss })) if loss.is_nan()
    ));
    let result = minimise(&[1.0], options(), &mut only_the_start);
    assert!(matches!(
        result,
        Err(Interrupt::Failed(Error::TrainingDiverged {
            evaluation: 1,
            ..
        }))
    ));
}

#[test]
fn lbfgs_tells_why_it_stops() {
    let stop = |options: Options| {
        let (_, termination, lbfgs) = minimise(&[-1.2, 1.0], options, &mut rosenbrock).unwrap();
        (termination, lbfgs)
    };
    let (termination, lbfgs) = stop(Options {
        max_iterations: 3,
        ..options()
    });
    assert_eq!(
        (termination, lbfgs.iterations()),
        (Termination::MaxIterations, 3)
    );
    for limit in 1..30 {
        let (termination, lbfgs) = stop(Options {
            max_evaluations: limit,
            ..options()
        });
        assert_eq!(termination, Termination::MaxEvaluations);
        assert_eq!(lbfgs.evaluations(), limit, "never more than the limit");
    }
    let (termination, _) = stop(Options {
        tolerance_change: 1e-3,
        ..options()
    });
    assert_eq!(termination, Termination::ConvergedChange);
    let (termination, lbfgs) = stop(Options {
        tolerance_gradient: 1e3,
        ..options()
    });
    assert_eq!(
        (termination, lbfgs.iterations()),
        (Termination::ConvergedGradient, 0)
    );
}

#[test]
fn an_interrupted_step_can_be_made_again() {
    let start = [-1.2, 1.0];
    let (expected, _, _) = minimise(&start, options(), &mut rosenbrock).unwrap();

    let mut at = Iterate::new(start.to_vec(), &mut rosenbrock).unwrap();
    let mut lbfgs = Lbfgs::new(2, options(), 1);
    let mut calls = 0;
    let mut interrupted = |x: &[f64], g: &mut [f64]| {
        calls += 1;
        if [2, 5, 6, 11].contains(&calls) {
            return Err(Interrupt::Stop(Termination::Cancelled));
        }
        rosenbrock(x, g)
    };
    loop {
        let before = (at.clone(), lbfgs.clone());
        match lbfgs.step(&mut at, &mut interrupted) {
            Err(Interrupt::Stop(Termination::Cancelled)) => {
                assert_eq!((&before.0, &before.1), (&at, &lbfgs));
            }
            Ok(step) if step.termination.is_none() => {}
            _ => break,
        }
    }
    assert_eq!(at, expected);
}

#[test]
fn a_restored_state_goes_on_bit_by_bit() {
    let architecture = architecture(Scheme::Sqrhw, 8, 3);
    let engine = engine::<f32>(architecture.clone(), &spiral(60));
    let mut objective =
        |p: &[f32], g: &mut [f32]| -> Answer { Ok(engine.loss_and_gradient(p, g)?) };
    let start = initial_parameters::<f32>(&architecture, 8);
    let mut lbfgs = Lbfgs::new(start.len(), options(), 1);
    let mut at = Iterate::new(start, &mut objective).unwrap();
    // Past the point where the ring of 10 pairs begins to overwrite.
    for _ in 0..13 {
        lbfgs.step(&mut at, &mut objective).unwrap();
    }
    let saved = serde_json::to_string(&(&lbfgs, &at)).unwrap();
    let (mut lbfgs2, mut at2): (Lbfgs<f32>, Iterate<f32>) = serde_json::from_str(&saved).unwrap();
    for _ in 0..15 {
        let step = lbfgs.step(&mut at, &mut objective).unwrap();
        assert_eq!(step, lbfgs2.step(&mut at2, &mut objective).unwrap());
        assert_eq!(at, at2);
    }
    assert_eq!(lbfgs, lbfgs2);
}

#[test]
fn adam_makes_the_steps_of_its_paper() {
    // L = ½ x² from x = 1 with rate 0.1, by hand, ε left out (it changes the step by 1e-8):
    // m₁ = 0.1, v₁ = 0.001: both are 1 after correction, so x₁ = 0.9.
    // m₂ = 0.18, v₂ = 0.001809; m̂₂ = 0.18/0.19, v̂₂ = 0.001809/0.001999.
    let x2 = 0.9 - 0.1 * (0.18 / 0.19) / (0.001_809_f64 / 0.001_999).sqrt();
    let m3 = 0.9 * 0.18 + 0.1 * x2;
    let v3 = 0.999 * 0.001_809 + 0.001 * x2 * x2;
    let x3 = x2 - 0.1 * (m3 / 0.271) / (v3 / 0.002_997_001_f64).sqrt();
    let mut at = Iterate::new(vec![1.0], &mut quadratic).unwrap();
    let mut adam = Adam::new(1, 0.1);
    for expected in [0.9, x2, x3] {
        adam.step(&mut at, &mut quadratic).unwrap();
        // Three times 0.1 ε / √v̂, with √v̂ about 1.
        assert!((at.parameters[0] - expected).abs() < 4e-9, "{expected}");
        assert!((at.loss - 0.5 * at.parameters[0].powi(2)).abs() < 1e-16);
    }
}

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
    let hooks = Hooks {
        observer: notes,
        snapshot: &mut |_, _| Ok(()),
    };
    let start = initial_parameters(engine.architecture(), settings.seed);
    train(engine, start, settings, hooks)
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
    };
    train(&engine, start.clone(), &settings, hooks).unwrap();
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
    let engine = Libtorch::<f64>::new(small(), &training, &validation).unwrap();
    let notes = Notes::default();
    let patient = Training {
        max_evaluations: 1_000,
        patience: 15,
        ..settings()
    };
    let trained = run(&engine, &patient, &notes).unwrap();
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
    let of_parameters = engine.validation_loss(&trained.parameters).unwrap();
    assert_eq!(of_parameters, trained.validation_loss);

    let without = Training {
        patience: 0,
        ..settings()
    };
    let trained = run(&engine, &without, &Notes::default()).unwrap();
    assert_eq!(trained.parameters_evaluation, trained.evaluations);
    assert!(trained.validation_loss.unwrap() > best);
}

#[test]
fn divergence_is_an_error() {
    let engine = engine::<f64>(small(), &spiral(60));
    let start = vec![f64::MAX; small().parameter_count()];
    let notes = Notes::default();
    let hooks = Hooks {
        observer: &notes,
        snapshot: &mut |_, _| Ok(()),
    };
    let error = train(&engine, start, &settings(), hooks).unwrap_err();
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
