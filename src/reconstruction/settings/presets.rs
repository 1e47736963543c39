//! Named starting points of the settings.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

use super::{
    CoarseInput, Components, Engine, Evaluation, Frame, Network, OffSurface, Open, Optimizer,
    OutputLayer, Precision, Sampling, Scheme, Settings, Surface, Targets, Training,
};

/// A named set of settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// A look at the result in a few seconds.
    Fast,
    /// The default: a good mesh in well under a minute.
    #[default]
    Balanced,
    /// More points, more training, a finer grid.
    Fine,
    /// The paper's runs (arXiv:2407.08134): coordinates as given, binary targets on labelled
    /// points, dense 70³ grid.
    Paper,
}

impl Preset {
    /// All presets, the default one first.
    pub const ALL: [Self; 4] = [Self::Balanced, Self::Fast, Self::Fine, Self::Paper];

    /// Its name in JSON, on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::Balanced => "balanced",
            Self::Fine => "fine",
            Self::Paper => "paper",
        }
    }

    /// The complete settings of the preset.
    pub fn settings(self) -> Settings {
        let balanced = balanced();
        match self {
            Self::Balanced => balanced,
            Self::Fast => Settings {
                training: Training {
                    max_evaluations: 300,
                    block_evaluations: 60,
                    patience: 100,
                    ..balanced.training
                },
                sampling: Sampling {
                    surface_points: 2_000,
                    far_points: 1_000,
                    ..balanced.sampling
                },
                surface: Surface {
                    resolution: 128,
                    ..balanced.surface
                },
                ..balanced
            },
            Self::Fine => Settings {
                training: Training {
                    max_evaluations: 3_000,
                    block_evaluations: 300,
                    patience: 600,
                    ..balanced.training
                },
                sampling: Sampling {
                    surface_points: 20_000,
                    far_points: 5_000,
                    ..balanced.sampling
                },
                surface: Surface {
                    resolution: 384,
                    ..balanced.surface
                },
                ..balanced
            },
            Self::Paper => paper(balanced),
        }
    }
}

fn balanced() -> Settings {
    Settings {
        network: Network {
            scheme: Scheme::Sqrhw,
            width: 50,
            members: 6,
            member_width: 16,
            hidden_layers: 5,
            block_points: 110,
            block_width: 24,
            block_layers: 3,
            coarse_input: CoarseInput::None,
            residual_every: 2,
            precision: Precision::F32,
        },
        training: Training {
            seed: 1,
            engine: Engine::Auto,
            optimizer: Optimizer::Lbfgs,
            output_layer: OutputLayer::Solved,
            learning_rate: 1.0,
            history: 100,
            tolerance_gradient: 1e-9,
            tolerance_change: 1e-11,
            max_iterations: 100_000,
            max_evaluations: 800,
            block_evaluations: 120,
            adam_evaluations: 200,
            adam_learning_rate: 1e-3,
            smoothing: 1.0,
            patience: 300,
            time_limit_seconds: 0.0,
            histogram_evaluations: Vec::new(),
            snapshot_evaluations: Vec::new(),
        },
        sampling: Sampling {
            frame: Frame::Normalized,
            half_extent: 3.0,
            targets: Targets::Graded,
            band: 0.03,
            off_surface: OffSurface::Generated,
            surface_points: 5_000,
            labelled_points: 5_000,
            validation_fraction: 0.1,
            near_pairs: 1,
            far_points: 2_000,
            neighbours: 16,
        },
        surface: Surface {
            evaluation: Evaluation::Sparse,
            resolution: 256,
            steps_per_spacing: 8.0,
            padding: 0.1,
            projection_steps: 2,
            components: Components::Supported,
            open: Open::Closed,
            target_triangles: 0,
        },
    }
}

/// \[N24\] and the script of its authors: lr 0.1, history 100, both tolerances 1e-11, 70³ grid.
fn paper(base: Settings) -> Settings {
    Settings {
        network: Network {
            members: 1,
            block_points: 0,
            ..base.network
        },
        training: Training {
            output_layer: OutputLayer::Trained,
            learning_rate: 0.1,
            history: 100,
            tolerance_gradient: 1e-11,
            tolerance_change: 1e-11,
            max_evaluations: 3_000,
            smoothing: 0.0,
            patience: 0,
            ..base.training
        },
        sampling: Sampling {
            frame: Frame::Given,
            targets: Targets::Binary,
            off_surface: OffSurface::Labels,
            surface_points: 10_000,
            labelled_points: 10_000,
            validation_fraction: 0.0,
            ..base.sampling
        },
        surface: Surface {
            evaluation: Evaluation::Dense,
            resolution: 70,
            steps_per_spacing: 0.0,
            projection_steps: 0,
            components: Components::All,
            ..base.surface
        },
    }
}
