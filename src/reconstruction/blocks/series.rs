//! The training series of all blocks together.

use super::fit::Done;
use super::input::Fitted;
use crate::reconstruction::observer::{Event, Observer};
use crate::reconstruction::training::{Metrics, Trained};

/// Rows of the series at most, however many blocks there are.
const ROWS: usize = 32;

/// Tells of the blocks in their order: a row is due where the first ones up to a share of all are fitted, whatever
/// else is. So the rows are the same for any number of threads, and over interruptions.
pub(super) struct Series {
    iterations: u64,
    evaluations: u64,
    blocks: usize,
    /// So many blocks, the first ones, are known to be fitted.
    first: usize,
    /// Rows that were told.
    told: usize,
}

impl Series {
    /// Goes on from the network of the whole; what is done already was told before.
    pub(super) fn new<T>(coarse: &Trained<T>, done: &Done<T>) -> Self {
        let mut series = Self {
            iterations: coarse.iterations,
            evaluations: coarse.evaluations,
            blocks: done.len(),
            first: 0,
            told: 0,
        };
        series.told = series.due(done);
        series
    }

    /// Tells the rows that have become due.
    pub(super) fn tell<T>(&mut self, done: &Done<T>, observer: &dyn Observer) {
        while self.told < self.due(done) {
            self.told += 1;
            observer.event(Event::Metrics(&self.row(done)));
        }
    }

    fn rows(&self) -> usize {
        self.blocks.min(ROWS)
    }

    /// Blocks of the first `rows` rows.
    fn blocks_of(&self, rows: usize) -> usize {
        rows * self.blocks / self.rows().max(1)
    }

    /// Rows whose blocks are all fitted.
    fn due<T>(&mut self, done: &Done<T>) -> usize {
        let more = done[self.first..].iter();
        self.first += more.take_while(|fitted| fitted.is_some()).count();
        (0..=self.rows())
            .rev()
            .find(|&rows| self.blocks_of(rows) <= self.first)
            .unwrap_or_default()
    }

    /// The row told last.
    fn row<T>(&self, done: &Done<T>) -> Metrics {
        let count = self.blocks_of(self.told);
        let fitted: Vec<&Fitted<T>> = done[..count].iter().flatten().collect();
        let mean = |value: &dyn Fn(&Fitted<T>) -> f64| {
            fitted.iter().map(|fitted| value(fitted)).sum::<f64>() / count.max(1) as f64
        };
        let sum = |value: &dyn Fn(&Fitted<T>) -> u64| fitted.iter().map(|f| value(f)).sum::<u64>();
        let held_out: Vec<f64> = fitted.iter().filter_map(|fitted| fitted.held_out).collect();
        Metrics {
            iteration: self.iterations + sum(&|fitted| fitted.iterations),
            evaluation: self.evaluations + sum(&|fitted| fitted.evaluations),
            loss: mean(&|fitted| fitted.loss),
            validation_loss: (!held_out.is_empty())
                .then(|| held_out.iter().sum::<f64>() / held_out.len() as f64),
            gradient_norm: mean(&|fitted| fitted.gradient_norm.powi(2)).sqrt(),
            step_length: mean(&|fitted| fitted.step_length),
            weight_norms: Vec::new(),
            blocks: Some(count as u64),
        }
    }
}
