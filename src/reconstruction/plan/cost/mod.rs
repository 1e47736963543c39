//! What a plan costs: time and memory, roughly.
//!
//! All times are those of one thread of x86-64 with AVX-512, and are taken to be shared evenly. They were measured on
//! whole runs of 300 to 500,000 points (docs/benchmarks.md has estimates beside what the runs took), and drift by a
//! factor of two with the kind of machine and its load.

use serde::Serialize;

use super::grid::{BLOCK_STEP, Extent};
use super::{BlockPlan, Findings, Plan};
use crate::reconstruction::cloud::Counts;
use crate::reconstruction::mesh::INDEXED_TRIANGLES;
use crate::reconstruction::network::{Architecture, TILE_POINTS};
use crate::reconstruction::sampling::MANY;
use crate::reconstruction::settings::{
    Engine, Evaluation, Optimizer, OutputLayer, Precision, Settings,
};

/// Seconds of an engine in f32 for each sample of a loss with its gradient.
struct Speed {
    /// For each parameter.
    weight: f64,
    /// What solving for the output layer adds to that.
    solving: f64,
    /// For each neuron: the activation and its slope.
    neuron: f64,
}

/// 2.4 ms for 3500 samples of 3-50×5-1 (`make bench`).
const FUSED: Speed = Speed {
    weight: 4.4e-11,
    solving: 1.0e-11,
    neuron: 8.9e-10,
};

/// 8 ms for the same.
const LIBTORCH: Speed = Speed {
    weight: 2.2e-10,
    solving: 9.2e-11,
    neuron: 0.0,
};

/// Seconds that a pair of L-BFGS takes for each parameter, in f32: 0.6 ms for 100 pairs of 10451.
const SECONDS_PER_PAIR: f64 = 5.7e-10;

/// Seconds of an evaluation of the network of a block besides its samples: its output layer, its pairs.
const SECONDS_PER_BLOCK_EVALUATION: f64 = 1.1e-4;

/// Rounds of the network of a block: most are done after one.
const USUAL_ROUNDS: f64 = 1.3;

/// Samples of blocks for each point of the cloud: one of its own and three generated ones, of which a half lies in
/// the reach of two blocks (measured on 30,000 and 100,000 points).
const BLOCK_SAMPLES_PER_POINT: f64 = 4.5;

/// Seconds for each point whose side is worked out one by one, and for each of the others, whose normals follow those
/// of an even subset.
const SECONDS_PER_ORIENTED_POINT: f64 = 1.5e-4;
const SECONDS_PER_FURTHER_POINT: f64 = 2.8e-5;

/// Evaluations of the field, with and without its gradient, for each cell of the grid that the surface goes through: with
/// one network and with blocks.
const EVALUATIONS_PER_CELL: [f64; 2] = [9.3, 9.8];

/// Triangles for each such cell.
const TRIANGLES_PER_CELL: f64 = 3.0;

/// Seconds of such an evaluation besides the network, and what finding the blocks of its place adds to that. These and
/// [`FIELD_WORK`] were measured for fewer evaluations a cell than there were, and are scaled to these.
const SECONDS_PER_EVALUATION: f64 = 2.1e-7;
const SECONDS_PER_LOOKUP: f64 = 4.2e-7;

/// The network at the grid and at the vertices, for each evaluation of the field, over a loss with its gradient.
const FIELD_WORK: f64 = 0.39;

/// Seconds of the report for each triangle and for each point.
const SECONDS_PER_TRIANGLE: f64 = 2.2e-6;
const SECONDS_PER_REPORTED_POINT: f64 = 1.0e-5;

/// Seconds to start, to read and to write.
const SECONDS_AROUND: f64 = 0.3;

/// Memory of the program and its libraries.
const BASE_BYTES: u64 = 130 << 20;

/// Memory for each triangle while the mesh is measured, for each of those that are indexed at a time, and for each
/// point of the cloud.
const BYTES_PER_TRIANGLE: f64 = 120.0;
const BYTES_PER_INDEXED_TRIANGLE: f64 = 250.0;
const BYTES_PER_POINT: u64 = 300;

/// Numbers that libtorch keeps for each neuron and sample, on the way forwards and back.
const LIBTORCH_NUMBERS: u64 = 5;

/// Bytes that a sample of a block takes: where its place is, what is known of that, and numbers of points in the lists of the
/// blocks.
const BYTES_PER_PLACE: f64 = 15.0;

/// Bytes kept for each point of the sparse grid near the surface.
const BYTES_PER_SAMPLE: u64 = 32;

/// Points of the sparse grid near the surface for each square of its resolution: six faces of the
/// box, some layers thick.
const SAMPLES_PER_SQUARE: u64 = 24;

/// Points of the whole grid for each byte of the table that says where the bits of a set of them are.
const POINTS_PER_TABLE_BYTE: u64 = 64;

/// What a plan costs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Cost {
    /// Trained numbers of the networks that fit the whole.
    pub parameters: u64,
    /// Their training samples.
    pub samples: u64,
    /// Most evaluations of their loss and gradient.
    pub max_evaluations: u64,
    /// Blocks that the cloud is cut into where those networks leave too much of it; 0: none in any case.
    pub blocks: u64,
    /// Points of the whole grid; the sparse evaluation visits few of them.
    pub grid_points: u64,
    /// Memory of the grid.
    pub grid_bytes: u64,
    /// Memory of the training.
    pub training_bytes: u64,
    /// What of it the pairs of L-BFGS take.
    #[serde(skip)]
    pub pairs_bytes: u64,
    /// Longest time of the training: training that converges ends sooner.
    pub max_training_seconds: f64,
    /// Triangles of the mesh.
    pub triangles: u64,
    /// Time of the whole run, as it usually is.
    pub seconds: f64,
    /// Most memory of its process.
    pub memory_bytes: u64,
}

impl Cost {
    /// For a cloud that is only counted. Whether it is uncertain is not known then: what is the most holds either way,
    /// what is usual is that of exact points of a ball.
    pub fn estimated(settings: &Settings, counted: &Counts, threads: usize) -> Self {
        let findings = Findings::assumed(settings, counted);
        let of = |findings| Plan::new(settings, findings).cost(threads);
        let [certain, uncertain] = [false, true].map(|u| of(findings.taken_as(u)));
        let larger = if uncertain.training_bytes > certain.training_bytes {
            uncertain
        } else {
            certain
        };
        let seconds = [certain, uncertain].map(|cost| cost.max_training_seconds);
        Self {
            parameters: certain.parameters.max(uncertain.parameters),
            training_bytes: larger.training_bytes,
            pairs_bytes: larger.pairs_bytes,
            max_training_seconds: seconds[0].max(seconds[1]),
            ..of(findings)
        }
    }
}

impl Plan<'_> {
    /// What the plan costs on so many threads, for a ball of as many points.
    pub fn cost(&self, threads: usize) -> Cost {
        let threads = threads.max(1);
        let surface = &self.settings.surface;
        let parameters = self.ensemble.parameter_count() as u64;
        let pairs_bytes = 4 * self.pairs() * parameters * self.number_bytes();
        let blocks = self.blocks.as_ref();
        let most = self.whole_seconds(self.training.max_evaluations)
            + blocks.map_or(0.0, |b| {
                self.block_seconds(b, b.training.max_evaluations as f64)
            });
        let most = most / threads as f64;
        let limit = self.training.time_limit_seconds;
        let places = blocks.map_or(0.0, |_| self.block_samples() * BYTES_PER_PLACE);
        let training_bytes = self.engine_bytes(threads) + pairs_bytes + places as u64;
        let points = self.findings.points as u64;
        let triangles = self.triangles();
        let mesh_bytes = BYTES_PER_TRIANGLE * triangles
            + BYTES_PER_INDEXED_TRIANGLE * triangles.min(INDEXED_TRIANGLES as f64);
        Cost {
            parameters,
            samples: self.findings.samples as u64,
            max_evaluations: self.training.max_evaluations,
            blocks: blocks.map_or(0, |blocks| blocks.count as u64),
            grid_points: (surface.resolution as u64).pow(3),
            grid_bytes: grid_bytes(self.settings),
            training_bytes,
            pairs_bytes,
            max_training_seconds: if limit > 0.0 { most.min(limit) } else { most },
            triangles: triangles as u64,
            seconds: SECONDS_AROUND + self.usual_seconds() / threads as f64,
            memory_bytes: BASE_BYTES
                + points * BYTES_PER_POINT
                + training_bytes.max(mesh_bytes as u64),
        }
    }

    /// Seconds of all stages on one thread. The more points there are, the less their spacing and noise allow one
    /// network to leave: blocks are as likely as the share of the points that it is not fitted to.
    fn usual_seconds(&self) -> f64 {
        let points = self.findings.points;
        let oriented = points.min(MANY);
        let sampling = SECONDS_PER_ORIENTED_POINT * oriented as f64
            + SECONDS_PER_FURTHER_POINT * (points - oriented) as f64;
        let one = self.whole_seconds(self.training.max_evaluations) + self.mesh_seconds(None);
        let fitting = self.blocks.as_ref().map_or(one, |blocks| {
            let looked = blocks.looks.last().map_or(0, |look| look.evaluations);
            let evaluations = USUAL_ROUNDS * blocks.round as f64;
            let many = self.whole_seconds(looked.min(self.training.max_evaluations))
                + self.block_seconds(blocks, evaluations)
                + self.mesh_seconds(Some(blocks));
            let budget = self.settings.sampling.surface_points;
            let share = points as f64 / (points + budget) as f64;
            share * many + (1.0 - share) * one
        });
        sampling + fitting + SECONDS_PER_REPORTED_POINT * points as f64
    }

    /// Seconds of so many evaluations of the networks that fit the whole.
    fn whole_seconds(&self, evaluations: u64) -> f64 {
        let architecture = &self.ensemble.architecture;
        let sample = self.sample_seconds(architecture, self.output_layer);
        let members = self.ensemble.members as f64;
        let pairs = (self.pairs() * self.ensemble.parameter_count() as u64) as f64;
        let evaluation = members * sample * self.findings.samples as f64
            + SECONDS_PER_PAIR * pairs * self.width();
        evaluation * evaluations as f64
    }

    /// Seconds of all blocks, each with so many evaluations.
    fn block_seconds(&self, blocks: &BlockPlan, evaluations: f64) -> f64 {
        let sample = self.sample_seconds(&blocks.architecture, blocks.training.output_layer);
        let fixed = SECONDS_PER_BLOCK_EVALUATION * blocks.count as f64;
        evaluations * (sample * self.block_samples() + fixed)
    }

    /// Seconds of surface and report, which go with the mesh.
    fn mesh_seconds(&self, blocks: Option<&BlockPlan>) -> f64 {
        let cells = self.cells(blocks.is_some());
        let trained = OutputLayer::Trained;
        let (evaluations, network, lookup) = match blocks {
            Some(blocks) => (
                EVALUATIONS_PER_CELL[1],
                self.sample_seconds(&blocks.architecture, trained),
                SECONDS_PER_LOOKUP,
            ),
            None => (
                EVALUATIONS_PER_CELL[0],
                self.ensemble.members as f64
                    * self.sample_seconds(&self.ensemble.architecture, trained),
                0.0,
            ),
        };
        let evaluation = SECONDS_PER_EVALUATION + lookup + FIELD_WORK * network;
        cells * (evaluations * evaluation + TRIANGLES_PER_CELL * SECONDS_PER_TRIANGLE)
    }

    /// Cells of the grid that the surface of a ball goes through.
    fn cells(&self, blocks: bool) -> f64 {
        let extent = self.findings.extent(self.settings, blocks);
        extent.area.unwrap_or_default() / self.step(&extent, blocks).powi(2)
    }

    /// Triangles of the surface of a ball. Blocks have them split where the grid has its largest size, until they
    /// are as many as with a finer one.
    fn triangles(&self) -> f64 {
        let blocks = self.blocks.is_some();
        let extent = self.findings.extent(self.settings, blocks);
        let mut step = self.step(&extent, blocks);
        if blocks {
            step = step.min(BLOCK_STEP * extent.spacing);
        }
        TRIANGLES_PER_CELL * extent.area.unwrap_or_default() / step.powi(2)
    }

    fn step(&self, extent: &Extent, blocks: bool) -> f64 {
        extent.bounds.longest_edge() / self.resolution(extent, blocks) as f64
    }

    /// Seconds for a sample of a loss with its gradient.
    fn sample_seconds(&self, architecture: &Architecture, output_layer: OutputLayer) -> f64 {
        let speed = match self.engine {
            Engine::Libtorch => LIBTORCH,
            Engine::Auto | Engine::Fused => FUSED,
        };
        let solving = match output_layer {
            OutputLayer::Trained => 0.0,
            OutputLayer::Solved => speed.solving,
        };
        let weights = (speed.weight + solving) * architecture.parameter_count() as f64;
        (weights + speed.neuron * neurons(architecture) as f64) * self.width()
    }

    /// Twice the bytes of a number take twice the time.
    fn width(&self) -> f64 {
        (self.number_bytes() / 4) as f64
    }

    fn number_bytes(&self) -> u64 {
        match self.settings.network.precision {
            Precision::F32 => 4,
            Precision::F64 => 8,
        }
    }

    fn block_samples(&self) -> f64 {
        BLOCK_SAMPLES_PER_POINT * self.findings.points as f64
    }

    /// What the engine keeps besides the samples.
    fn engine_bytes(&self, threads: usize) -> u64 {
        let samples = self.findings.samples as u64;
        let neurons = neurons(&self.ensemble.architecture);
        let numbers = match self.engine {
            Engine::Libtorch => LIBTORCH_NUMBERS * neurons * samples,
            Engine::Auto | Engine::Fused => {
                // Value and slope of each neuron of a tile; each tile has a gradient of its own.
                let tile = TILE_POINTS as u64;
                let in_work = 2 * neurons * tile * threads as u64;
                in_work + samples.div_ceil(tile) * self.ensemble.parameter_count() as u64
            }
        };
        numbers * self.number_bytes()
    }

    /// Pairs that L-BFGS keeps in the end; each is two vectors, and all of them again in a checkpoint.
    fn pairs(&self) -> u64 {
        let training = &self.training;
        let most = training.max_iterations.min(training.max_evaluations);
        match training.optimizer {
            Optimizer::Adam => 0,
            Optimizer::Lbfgs | Optimizer::AdamLbfgs => most.min(training.history as u64),
        }
    }
}

fn neurons(architecture: &Architecture) -> u64 {
    (architecture.width * architecture.hidden_layers) as u64
}

/// Memory of the grid of these settings: the points near the surface, and of each set of them where its bits are.
pub fn grid_bytes(settings: &Settings) -> u64 {
    bytes_of_grid(settings.surface.evaluation, settings.surface.resolution)
}

/// The finest grid below that of the settings that takes no more than `limit_bytes`.
pub fn largest_resolution(settings: &Settings, limit_bytes: u64) -> usize {
    let surface = &settings.surface;
    let mut coarser = (0..surface.resolution).rev();
    let fits = |resolution: &usize| bytes_of_grid(surface.evaluation, *resolution) <= limit_bytes;
    coarser.find(fits).unwrap_or_default()
}

fn bytes_of_grid(evaluation: Evaluation, resolution: usize) -> u64 {
    let resolution = resolution as u64;
    let near = resolution.pow(2) * SAMPLES_PER_SQUARE * BYTES_PER_SAMPLE;
    let sets = match evaluation {
        Evaluation::Sparse => 3,
        Evaluation::Dense => 1,
    };
    near + sets * resolution.pow(3) / POINTS_PER_TABLE_BYTE
}

#[cfg(test)]
mod tests;
