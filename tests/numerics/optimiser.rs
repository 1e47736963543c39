//! L-BFGS and Adam.
#![expect(clippy::unnecessary_wraps, reason = "an objective may be interrupted")]

use meshway::reconstruction::Error;
use meshway::reconstruction::network::{Engine, initial_parameters};
use meshway::reconstruction::settings::Scheme;
use meshway::reconstruction::training::{Adam, Interrupt, Iterate, Lbfgs, Options, Termination};

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
    objective: &mut dyn FnMut(&mut [f64], &mut [f64]) -> Answer,
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
fn rosenbrock(x: &mut [f64], g: &mut [f64]) -> Answer {
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
fn quadratic(x: &mut [f64], g: &mut [f64]) -> Answer {
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
        let mut walled = |x: &mut [f64], g: &mut [f64]| {
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
    let mut only_the_start = |x: &mut [f64], g: &mut [f64]| {
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
    let mut interrupted = |x: &mut [f64], g: &mut [f64]| {
        calls += 1;
        if [2, 5, 6, 11].contains(&calls) {
            return Err(Interrupt::Stop(Termination::Cancelled));
        }
        rosenbrock(x, g)
    };
    loop {
        let before = at.clone();
        match lbfgs.step(&mut at, &mut interrupted) {
            Err(Interrupt::Stop(Termination::Cancelled)) => assert_eq!(at, before),
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
        |p: &mut [f32], g: &mut [f32]| -> Answer { Ok(engine.loss_and_gradient(p, g)?) };
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
