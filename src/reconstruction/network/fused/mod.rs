//! The fast engine: loss and gradient in one pass over cache-sized tiles of points, in f32.
//!
//! A block of points goes through all layers forward and back while its activations are in the
//! cache; the weight gradients follow tile by tile, with their sums in registers. The vectors run
//! along the points, so that any width works. The same code is compiled for AVX-512, AVX2 with FMA,
//! NEON and plain arithmetic, and the best that the processor has is chosen when it runs
//! ([`pulp`]).
//!
//! # Determinism
//! Tiles depend on the number of samples only, and their sums are added in order: the bits are the
//! same for any number of threads. Another instruction set rounds differently.

#![expect(
    clippy::inline_always,
    reason = "code compiles for an instruction set only inside the function that enables it"
)]

mod aligned;
mod batch;
mod dispatch;
mod field;
mod output;
mod panels;
mod pass;
mod pool;
mod products;
mod unit;

use std::ops::Range;

use pulp::{Arch, Simd};
use rayon::prelude::*;

use super::output_layer::set_output_layer;
use super::{Architecture, Engine, Layer, OutputEquations, solve_then_evaluate};
use crate::reconstruction::error::Error;
use crate::reconstruction::sampling::Samples;
use crate::reconstruction::surface::Field;
use batch::Batch;
pub(in crate::reconstruction) use batch::TILE_POINTS;
use dispatch::{Blockwise, dispatch};
use field::{FusedField, Workspace};
use output::OutputSums;
use panels::affine_maps;
use pass::{Network, Pass, Rule, Scratch, rules};
use pool::Pool;

/// Which threads evaluate a loss.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Threads {
    /// Those of the pool.
    All,
    /// The one that asks.
    One,
}

impl Threads {
    /// Shares that the work is cut into. More than these threads take would sum up each of them for nothing.
    fn shares(self) -> usize {
        match self {
            Self::All => 4,
            Self::One => 1,
        }
    }
}

/// Most samples whose hidden layers are kept from the equations of the output layer to the loss: 8 bytes a neuron and
/// sample, 1 MB for 3 layers of 24.
const MAX_WHOLE_POINTS: usize = 2048;

/// A network and its samples in blocks of points.
#[derive(Debug)]
pub struct Fused {
    arch: Arch,
    threads: Threads,
    architecture: Architecture,
    layers: Vec<Layer>,
    rules: Vec<Rule>,
    batch: Batch,
    scratch: Pool<Scratch>,
    /// Those of its fields.
    workspaces: Pool<Workspace>,
}

impl Fused {
    /// Its name in settings and reports.
    pub const NAME: &str = "fused";

    /// Whether there is this engine for the architecture: for every scheme but `highway` and `gated`.
    pub fn supports(architecture: &Architecture) -> bool {
        rules(architecture).is_some()
    }

    /// An engine over these samples for the processor at hand; `None` where it does not support the
    /// architecture.
    pub fn new(architecture: Architecture, samples: &Samples) -> Option<Self> {
        Self::on(Arch::new(), architecture, samples)
    }

    /// The same for one of the [`instruction_sets`].
    pub fn on(arch: Arch, architecture: Architecture, samples: &Samples) -> Option<Self> {
        let rules = rules(&architecture)?;
        let block_points = block_points(arch);
        Some(Self {
            arch,
            threads: Threads::All,
            layers: architecture.layers(),
            architecture,
            rules,
            batch: Batch::new(samples, block_points),
            scratch: Pool::new(),
            workspaces: Pool::new(),
        })
    }

    /// The same engine, working on these threads.
    #[must_use]
    pub fn on_threads(self, threads: Threads) -> Self {
        Self { threads, ..self }
    }

    fn network(&self, parameters: &[f32]) -> Network<'_> {
        Network {
            rules: &self.rules,
            maps: affine_maps(&self.layers, parameters),
        }
    }

    /// Memory for any of these tiles, or for all samples where they are worked through at once.
    fn new_scratch(&self, tiles: &[Range<usize>]) -> Scratch {
        let block_points = block_points(self.arch);
        let longest = tiles.iter().map(Range::len).max().unwrap_or(0);
        let blocks = if self.is_whole() {
            self.batch.blocks()
        } else {
            longest
        };
        let points = blocks * block_points;
        Scratch::new(&self.rules, self.architecture.width, points, block_points)
    }

    /// Whether all samples are worked through at once: where one thread does it, and what it keeps of them stays in
    /// the cache.
    fn is_whole(&self) -> bool {
        let points = self.batch.blocks() * block_points(self.arch);
        self.threads == Threads::One && points <= MAX_WHOLE_POINTS
    }

    /// Runs `work` on the tiles; adds up what it returns, and what it writes into the `length` zeros that it
    /// is given, in the order of the tiles.
    fn sum_over_tiles(
        &self,
        length: usize,
        work: impl Fn(Range<usize>, &mut Scratch, &mut [f32]) -> f64 + Sync,
    ) -> (f64, Vec<f64>) {
        let tiles = self.batch.tiles(self.threads.shares());
        let scratch = || self.new_scratch(&tiles);
        let tile = |blocks| {
            let mut sums = vec![0.0; length];
            let returned = self
                .scratch
                .with(scratch, |scratch| work(blocks, scratch, &mut sums));
            (returned, sums)
        };
        let tiles: Vec<(f64, Vec<f32>)> = match self.threads {
            Threads::All => tiles
                .clone()
                .into_par_iter()
                .with_max_len(1)
                .map(tile)
                .collect(),
            Threads::One => tiles.iter().cloned().map(tile).collect(),
        };
        let sum = |i: usize| tiles.iter().map(|(_, part)| f64::from(part[i])).sum();
        (
            tiles.iter().map(|(returned, _)| returned).sum(),
            (0..length).map(sum).collect(),
        )
    }
}

/// Points that are computed with at once on the processor at hand. Sums follow it: where it is the same, so are their
/// bits.
pub(in crate::reconstruction) fn vector_width() -> usize {
    block_points(Arch::new())
}

/// What the processor at hand can run, the best one first.
pub fn instruction_sets() -> Vec<Arch> {
    #[cfg(target_arch = "x86_64")]
    let narrower = pulp::x86::V3::try_new().map(Arch::V3);
    #[cfg(not(target_arch = "x86_64"))]
    let narrower = None;
    let mut all = vec![Arch::new()];
    all.extend(narrower);
    all.push(Arch::Scalar);
    all.dedup_by_key(|arch| std::mem::discriminant(arch));
    all
}

impl Engine<f32> for Fused {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn architecture(&self) -> &Architecture {
        &self.architecture
    }

    fn training_samples(&self) -> usize {
        self.batch.count
    }

    fn loss_and_gradient(&self, parameters: &[f32], gradient: &mut [f32]) -> Result<f64, Error> {
        // Where vectors have no NaN of their own to pass on, the clamp of tanh would hide one.
        if !parameters.iter().all(|p| p.is_finite()) {
            gradient.fill(f32::NAN);
            return Ok(f64::NAN);
        }
        let network = self.network(parameters);
        let (loss, sums) = self.sum_over_tiles(parameters.len(), |blocks, scratch, gradient| {
            let tile = Tile {
                network: &network,
                batch: &self.batch,
                blocks,
                scratch,
                gradient,
                hidden_known: false,
            };
            dispatch(self.arch, tile)
        });
        for (g, sum) in gradient.iter_mut().zip(sums) {
            *g = sum as f32;
        }
        Ok(loss)
    }

    fn solved_loss_and_gradient(
        &self,
        parameters: &mut [f32],
        gradient: &mut [f32],
        decay: f64,
    ) -> Result<f64, Error> {
        if !self.is_whole() {
            return solve_then_evaluate(self, parameters, gradient, decay);
        }
        let all = 0..self.batch.blocks();
        let length = OutputSums::length(self.architecture.width);
        self.scratch.with(
            || self.new_scratch(&[]),
            |scratch| {
                let mut network = self.network(parameters);
                let mut sums = vec![0.0; length];
                let work = OutputSums {
                    network: &network,
                    batch: &self.batch,
                    blocks: all.clone(),
                    scratch,
                    sums: &mut sums,
                };
                dispatch(self.arch, work);
                let sums: Vec<f64> = sums.into_iter().map(f64::from).collect();
                let equations = OutputSums::equations(&sums, &self.batch);
                set_output_layer(&self.architecture, parameters, equations.solve(decay));
                if !parameters.iter().all(|p| p.is_finite()) {
                    gradient.fill(f32::NAN);
                    return Ok(f64::NAN);
                }
                network.set_output(&self.layers, parameters);
                gradient.fill(0.0);
                let tile = Tile {
                    network: &network,
                    batch: &self.batch,
                    blocks: all.clone(),
                    scratch,
                    gradient,
                    hidden_known: true,
                };
                Ok(dispatch(self.arch, tile))
            },
        )
    }

    fn output_equations(&self, parameters: &[f32]) -> Result<OutputEquations, Error> {
        let network = self.network(parameters);
        let length = OutputSums::length(self.architecture.width);
        let (_, sums) = self.sum_over_tiles(length, |blocks, scratch, sums| {
            let work = OutputSums {
                network: &network,
                batch: &self.batch,
                blocks,
                scratch,
                sums,
            };
            dispatch(self.arch, work);
            0.0
        });
        Ok(OutputSums::equations(&sums, &self.batch))
    }

    fn field(&self, parameters: &[f32]) -> Result<Box<dyn Field + '_>, Error> {
        Ok(Box::new(FusedField::new(
            self.arch,
            self.network(parameters),
            &self.workspaces,
        )))
    }
}

/// Points of a block on this instruction set.
fn block_points(arch: Arch) -> usize {
    struct BlockPoints;
    impl Blockwise for BlockPoints {
        type Output = usize;
        #[inline(always)]
        fn run<S: Simd, const N: usize>(self, _: S) -> usize {
            S::F32_LANES * N
        }
    }
    dispatch(arch, BlockPoints)
}

/// The part of some blocks in the loss and in its gradient.
struct Tile<'a> {
    network: &'a Network<'a>,
    batch: &'a Batch,
    blocks: Range<usize>,
    scratch: &'a mut Scratch,
    gradient: &'a mut [f32],
    /// Whether the scratch has the hidden layers of each block, in its slot.
    hidden_known: bool,
}

impl Blockwise for Tile<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<S: Simd, const N: usize>(self, simd: S) -> f64 {
        let mut pass = Pass {
            simd,
            network: self.network,
            scratch: self.scratch,
        };
        let count = self.batch.count as f64;
        let scale = (2.0 / count) as f32;
        let mut sum = 0.0;
        let mut kept = 0;
        for block in self.blocks {
            let points = self.batch.points(block);
            if !self.hidden_known {
                pass.hidden::<N>(kept, points);
            }
            pass.output::<N>(kept);
            let [lower, upper, weights] = self.batch.targets(block);
            let values = pass.scratch.values[kept * weights.len()..].iter_mut();
            let mut at_rest = true;
            for (((f, lower), upper), weight) in values.zip(lower).zip(upper).zip(weights) {
                // Not the sum of what is beyond either end: that would hide a NaN.
                let residual = *f - f.max(*lower).min(*upper);
                let weighted = weight * residual;
                sum += f64::from(weighted) * f64::from(residual);
                *f = scale * weighted;
                at_rest &= weighted == 0.0;
            }
            // Where all bounds hold there is no gradient, and no way back. Known layers stay in their slots.
            if self.hidden_known || !at_rest {
                pass.keep_points(kept, points);
                pass.backward::<N>(kept);
                kept += 1;
            }
        }
        if kept > 0 {
            pass.weight_gradients::<N>(kept, self.gradient);
        }
        sum / count
    }
}
