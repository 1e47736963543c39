//! Line search for the strong Wolfe conditions with cubic interpolation.
//!
//! Follows `_strong_wolfe` of `torch.optim.lbfgs` test by test, which goes back to minFunc and is
//! a practical form of algorithms 3.5 and 3.6 of \[NW06\]. Deviations:
//!
//! - A trial whose loss or slope is not finite counts as infinitely high, so that the bracket
//!   closes in from the finite side; PyTorch would go on with NaN.
//! - Where the cubic has no finite minimum the interval is halved.
//! - The scalars are f64 whatever the precision of the parameters.
//! - `budget` counts every evaluation; PyTorch leaves the first one out of its limit.

use super::iterate::{Interrupt, Iterate, Objective};
use super::linear_algebra::{add_scaled, dot, max_norm};
use crate::reconstruction::network::Scalar;

/// Sufficient decrease: L(t) <= L(0) + c₁ t L'(0).
const C1: f64 = 1e-4;
/// Curvature: |L'(t)| <= c₂ |L'(0)|.
const C2: f64 = 0.9;
/// The search gives up when the parameters differ by less across the bracket.
const SMALLEST_BRACKET: f64 = 1e-9;

/// The half-line x + t d, t >= 0, on which the loss falls at first.
pub(super) struct Line<'a, T> {
    /// x, with loss and gradient there.
    pub(super) start: &'a Iterate<T>,
    /// d.
    pub(super) direction: &'a [T],
    /// L'(0) = ∇L · d, negative.
    pub(super) slope: f64,
}

/// A point on the line.
pub(super) struct Trial<T> {
    /// t.
    pub(super) step: f64,
    /// L(t), or +∞ where it is not finite.
    pub(super) loss: f64,
    /// L'(t).
    slope: f64,
    /// x + t d, as the objective leaves it.
    pub(super) parameters: Vec<T>,
    /// ∇L there.
    pub(super) gradient: Vec<T>,
}

/// What a search found.
pub(super) struct Found<T> {
    /// The point to go to; t = 0 when nothing lower was found.
    pub(super) trial: Trial<T>,
    /// Evaluations that were made.
    pub(super) evaluations: u64,
    /// Loss of the last trial if none was finite.
    pub(super) diverged: Option<f64>,
}

impl<T: Scalar> Line<'_, T> {
    /// x + t d.
    fn at(&self, step: f64) -> Vec<T> {
        let mut parameters = self.start.parameters.clone();
        add_scaled(&mut parameters, step, self.direction);
        parameters
    }

    fn origin(&self) -> Trial<T> {
        Trial {
            step: 0.0,
            loss: self.start.loss,
            slope: self.slope,
            parameters: self.start.parameters.clone(),
            gradient: self.start.gradient.clone(),
        }
    }

    fn decreases_enough(&self, trial: &Trial<T>) -> bool {
        trial.loss <= self.start.loss + C1 * trial.step * self.slope
    }

    fn flat_enough(&self, trial: &Trial<T>) -> bool {
        trial.slope.abs() <= -C2 * self.slope
    }
}

/// Searches the line from `first_step` with at most `budget` evaluations (at least one is made).
///
/// # Errors
/// What the objective reports.
pub(super) fn strong_wolfe<T: Scalar>(
    line: &Line<'_, T>,
    first_step: f64,
    budget: u64,
    objective: &mut Objective<'_, T>,
) -> Result<Found<T>, Interrupt> {
    let mut search = Search {
        line,
        budget,
        objective,
        evaluations: 0,
        any_finite: false,
        last_loss: f64::NAN,
    };
    let trial = match search.bracket(first_step)? {
        Bracketing::Done(trial) => trial,
        Bracketing::Between(bracket) => search.zoom(bracket)?,
    };
    Ok(Found {
        trial,
        evaluations: search.evaluations,
        diverged: (!search.any_finite).then_some(search.last_loss),
    })
}

enum Bracketing<T> {
    /// The Wolfe conditions hold, or the budget is spent.
    Done(Trial<T>),
    /// A point that satisfies them lies between these.
    Between([Trial<T>; 2]),
}

struct Search<'a, 'b, T> {
    line: &'a Line<'a, T>,
    budget: u64,
    objective: &'a mut Objective<'b, T>,
    evaluations: u64,
    any_finite: bool,
    last_loss: f64,
}

impl<T: Scalar> Search<'_, '_, T> {
    fn evaluate(&mut self, step: f64) -> Result<Trial<T>, Interrupt> {
        let mut gradient = vec![T::ZERO; self.line.direction.len()];
        let mut parameters = self.line.at(step);
        let loss = (self.objective)(&mut parameters, &mut gradient)?;
        let slope = dot(&gradient, self.line.direction);
        // A component that is not finite makes the slope so: 0 ∞ and ∞ - ∞ are NaN.
        let finite = loss.is_finite() && slope.is_finite();
        self.any_finite |= finite;
        self.last_loss = loss;
        self.evaluations += 1;
        Ok(Trial {
            step,
            loss: if finite { loss } else { f64::INFINITY },
            slope,
            parameters,
            gradient,
        })
    }

    /// Lengthens the step until a point that satisfies the conditions is enclosed (\[NW06\]
    /// algorithm 3.5).
    fn bracket(&mut self, first_step: f64) -> Result<Bracketing<T>, Interrupt> {
        let line = self.line;
        let mut previous = line.origin();
        let mut trial = self.evaluate(first_step)?;
        while self.evaluations < self.budget {
            // As in PyTorch, a rise from one trial to the next counts from the third trial on.
            let rises = self.evaluations > 2 && trial.loss >= previous.loss;
            if !line.decreases_enough(&trial) || rises {
                return Ok(Bracketing::Between([previous, trial]));
            }
            if line.flat_enough(&trial) {
                return Ok(Bracketing::Done(trial));
            }
            if trial.slope >= 0.0 {
                return Ok(Bracketing::Between([previous, trial]));
            }
            let longer = (
                trial.step + 0.01 * (trial.step - previous.step),
                10.0 * trial.step,
            );
            let step = cubic_minimum(&previous, &trial, longer);
            previous = trial;
            trial = self.evaluate(step)?;
        }
        let origin = line.origin();
        Ok(Bracketing::Done(if origin.loss <= trial.loss {
            origin
        } else {
            trial
        }))
    }

    /// Narrows the bracket and returns its lower end (\[NW06\] algorithm 3.6).
    fn zoom(&mut self, mut bracket: [Trial<T>; 2]) -> Result<Trial<T>, Interrupt> {
        let line = self.line;
        let longest = max_norm(line.direction);
        let lower = |bracket: &[Trial<T>; 2]| usize::from(bracket[0].loss > bracket[1].loss);
        let mut low = lower(&bracket);
        let mut near_the_end = false;
        while self.evaluations < self.budget {
            let left = bracket[0].step.min(bracket[1].step);
            let right = bracket[0].step.max(bracket[1].step);
            if (right - left) * longest < SMALLEST_BRACKET {
                break;
            }
            let mut step = cubic_minimum(&bracket[0], &bracket[1], (left, right));
            // Twice in a row close to an end, or on it: go a tenth of the bracket inwards.
            let margin = 0.1 * (right - left);
            let close = (right - step).min(step - left) < margin;
            let move_inwards = close && (near_the_end || step >= right || step <= left);
            if move_inwards {
                step = if (step - right).abs() < (step - left).abs() {
                    right - margin
                } else {
                    left + margin
                };
            }
            near_the_end = close && !move_inwards;

            let trial = self.evaluate(step)?;
            let high = 1 - low;
            if !line.decreases_enough(&trial) || trial.loss >= bracket[low].loss {
                bracket[high] = trial;
                low = lower(&bracket);
                continue;
            }
            let done = line.flat_enough(&trial);
            if !done && trial.slope * (bracket[high].step - bracket[low].step) >= 0.0 {
                bracket.swap(low, high);
            }
            bracket[low] = trial;
            if done {
                break;
            }
        }
        let [first, second] = bracket;
        Ok(if low == 0 { first } else { second })
    }
}

/// Where the cubic through two trials and their slopes is lowest, within `bounds` (\[NW06\]
/// equation 3.59); the middle of the bounds where there is no such point.
fn cubic_minimum<T>(a: &Trial<T>, b: &Trial<T>, bounds: (f64, f64)) -> f64 {
    let (left, right) = if a.step <= b.step { (a, b) } else { (b, a) };
    let width = right.step - left.step;
    let d1 = left.slope + right.slope - 3.0 * (left.loss - right.loss) / (left.step - right.step);
    let square = d1 * d1 - left.slope * right.slope;
    let d2 = square.sqrt();
    let minimum =
        right.step - width * ((right.slope + d2 - d1) / (right.slope - left.slope + 2.0 * d2));
    if minimum.is_finite() {
        minimum.max(bounds.0).min(bounds.1)
    } else {
        f64::midpoint(bounds.0, bounds.1)
    }
}
