//! The way to the fewest triangles that are sound: what the collapses may err by, and what they must keep.

use super::check::Check;
use super::{Found, Limits, Original, Part, Shapes};
use crate::reconstruction::error::Error;

/// Results that are looked at, at most.
const ROUNDS: usize = 24;

/// First tolerance of the collapses over the error that is allowed: mostly more than it takes.
const START: f64 = 4.0;

/// Share of the tolerance that one step leaves, at least and at most.
const STEP: [f64; 2] = [0.5, 0.9];

/// Share of the error that a step aims at.
const AIM: f64 = 0.95;

/// Share of the error from which on a result is as simple as is worth looking for.
const ENOUGH: f64 = 0.8;

/// Share of the triangles that may be wrong for vertices to be kept there.
const FEW: f64 = 0.005;

/// As many may be wrong in any case.
const SOME: usize = 4;

/// How many times in a row vertices are kept, each time twice as many at a triangle.
const REPAIRS: u32 = 6;

/// A search and what it has found so far.
pub(super) struct Search<'a> {
    original: &'a Original<'a>,
    limits: Limits,
    shapes: Shapes,
    /// Vertices that are not there from the start: none of these can be kept.
    absent: Vec<bool>,
    /// These, and the vertices that must stay.
    kept: Vec<bool>,
    /// How many times in a row some were added.
    repairs: u32,
    /// Largest tolerance that gave a sound mesh, that mesh, and the least error of collapses that gave none.
    sound: Option<(f64, Found)>,
    unsound: Option<f64>,
}

impl<'a> Search<'a> {
    pub(super) fn new(original: &'a Original<'a>, limits: Limits, shapes: Shapes) -> Self {
        Self {
            original,
            limits,
            shapes,
            absent: Vec::new(),
            kept: Vec::new(),
            repairs: 0,
            sound: None,
            unsound: None,
        }
    }

    /// The simplest sound mesh that is found by collapsing edges of `triangles`, a sound part of the original; none
    /// where none is.
    pub(super) fn run(
        mut self,
        triangles: &[[u32; 3]],
        stopped: &dyn Fn() -> bool,
    ) -> Result<Option<Found>, Error> {
        self.absent = vec![true; self.original.mesh.vertices.len()];
        for v in triangles.as_flattened() {
            self.absent[*v as usize] = false;
        }
        self.forget();
        let mut limits = Limits {
            error: START * self.limits.error,
            ..self.limits
        };
        for _ in 0..ROUNDS {
            if stopped() {
                return Err(Error::Cancelled);
            }
            let how = (limits, self.shapes);
            let (part, reached) = self.original.collapsed(triangles, how, &self.kept);
            let next = match Check::of(self.original, &part, self.limits.error) {
                Some(check) if check.sound => {
                    let error = check.error;
                    self.found(Found { part, error }, limits.error)
                }
                Some(check) if self.repair(&part, &check) => Some(limits.error),
                Some(check) => self.missed(reached, check.error),
                None => self.missed(reached, f64::INFINITY),
            };
            let Some(tolerance) = next else {
                break;
            };
            limits.error = tolerance;
        }
        Ok(self.sound.map(|(_, found)| found))
    }

    /// Takes note of a sound mesh, which a tolerance gave; the next tolerance, if a simpler one may be found.
    fn found(&mut self, found: Found, tolerance: f64) -> Option<f64> {
        let simple = found.part.mesh.triangles.len() <= self.limits.triangles;
        let share = found.error / self.limits.error;
        self.sound = Some((tolerance, found));
        self.forget();
        if simple || share >= ENOUGH {
            return None;
        }
        match self.unsound {
            None => Some(tolerance * (AIM / share).min(1.0 / STEP[0])),
            Some(unsound) => between(tolerance, unsound),
        }
    }

    /// Takes note of collapses that gave no sound mesh; the next tolerance.
    fn missed(&mut self, reached: f64, error: f64) -> Option<f64> {
        self.forget();
        self.unsound = Some(reached);
        match &self.sound {
            None if reached > 0.0 => {
                Some(reached * (AIM * self.limits.error / error).clamp(STEP[0], STEP[1]))
            }
            None => None,
            Some((sound, _)) => between(*sound, reached),
        }
    }

    fn forget(&mut self) {
        self.kept.clone_from(&self.absent);
        self.repairs = 0;
    }

    /// Where little is wrong, has some vertices kept there; whether it did.
    fn repair(&mut self, part: &Part, check: &Check) -> bool {
        let few = (FEW * part.mesh.triangles.len() as f64) as usize;
        let repaired = self.repairs < REPAIRS
            && check.wrong() <= few.max(SOME)
            && check.keep_more(part, &mut self.kept, 1 << self.repairs);
        self.repairs += u32::from(repaired);
        repaired
    }
}

/// A tolerance between one that is sound and one that is not, where they differ enough.
fn between(sound: f64, unsound: f64) -> Option<f64> {
    (sound < STEP[1] * unsound).then(|| (sound * unsound).sqrt())
}
