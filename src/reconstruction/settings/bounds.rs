//! The intervals that numbers must lie in, and the names that the others must be one of.

/// The allowed interval of a number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bound {
    /// JSON pointer of the parameter.
    pub pointer: &'static str,
    /// Smallest allowed value.
    pub min: f64,
    /// Largest allowed value.
    pub max: f64,
}

const fn bound(pointer: &'static str, min: f64, max: f64) -> Bound {
    Bound { pointer, min, max }
}

/// Largest integer that JSON numbers carry exactly.
const MAX_SAFE_INTEGER: f64 = 9_007_199_254_740_991.0;

/// The bounds of every numeric parameter, both ends included.
pub const BOUNDS: &[Bound] = &[
    bound("/network/width", 1.0, 512.0),
    bound("/network/members", 1.0, 16.0),
    bound("/network/member_width", 1.0, 512.0),
    bound("/network/hidden_layers", 1.0, 32.0),
    bound("/network/block_points", 0.0, 1e6),
    bound("/network/block_width", 1.0, 512.0),
    bound("/network/block_layers", 1.0, 32.0),
    bound("/network/residual_every", 1.0, 32.0),
    bound("/training/seed", 0.0, MAX_SAFE_INTEGER),
    bound("/training/learning_rate", 1e-6, 10.0),
    bound("/training/history", 1.0, 1_000.0),
    bound("/training/tolerance_gradient", 0.0, 1.0),
    bound("/training/tolerance_change", 0.0, 1.0),
    bound("/training/max_iterations", 1.0, 1e6),
    bound("/training/max_evaluations", 1.0, 1e6),
    bound("/training/block_evaluations", 1.0, 1e6),
    bound("/training/adam_evaluations", 0.0, 1e6),
    bound("/training/adam_learning_rate", 1e-6, 1.0),
    bound("/training/smoothing", 0.0, 100.0),
    bound("/training/patience", 0.0, 1e6),
    bound("/training/time_limit_seconds", 0.0, 86_400.0),
    bound("/sampling/half_extent", 0.01, 100.0),
    bound("/sampling/band", 1e-4, 10.0),
    bound("/sampling/surface_points", 16.0, 1e6),
    bound("/sampling/labelled_points", 0.0, 1e6),
    bound("/sampling/validation_fraction", 0.0, 0.5),
    bound("/sampling/near_pairs", 0.0, 4.0),
    bound("/sampling/far_points", 0.0, 1e6),
    bound("/sampling/neighbours", 3.0, 100.0),
    bound("/surface/resolution", 8.0, 1_024.0),
    bound("/surface/steps_per_spacing", 0.0, 100.0),
    bound("/surface/padding", 0.0, 1.0),
    bound("/surface/projection_steps", 0.0, 10.0),
    bound("/surface/target_triangles", 0.0, 4e7),
];

/// The allowed names of a parameter that is no number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Choice {
    /// JSON pointer of the parameter.
    pub pointer: &'static str,
    /// What it may be.
    pub names: &'static [&'static str],
}

const fn choice(pointer: &'static str, names: &'static [&'static str]) -> Choice {
    Choice { pointer, names }
}

/// The names that every parameter that is no number is one of.
pub const CHOICES: &[Choice] = &[
    choice(
        "/network/scheme",
        &["plain", "resnet", "highway", "hw", "sqrhw", "gated"],
    ),
    choice("/network/coarse_input", &["none", "residual"]),
    choice("/network/precision", &["f32", "f64"]),
    choice("/training/engine", &["auto", "fused", "libtorch"]),
    choice("/training/optimizer", &["lbfgs", "adam", "adam_lbfgs"]),
    choice("/training/output_layer", &["trained", "solved"]),
    choice("/sampling/frame", &["normalized", "given"]),
    choice("/sampling/targets", &["binary", "graded"]),
    choice("/sampling/off_surface", &["generated", "labels"]),
    choice("/surface/evaluation", &["sparse", "dense"]),
    choice("/surface/components", &["supported", "largest", "all"]),
    choice("/surface/open", &["auto", "closed", "trimmed"]),
];
