//! Every parameter of a reconstruction: its meaning, its default, its bounds.
//!
//! A parameter is a field here, a value in each of the `presets`, a row of [`BOUNDS`] if it is a
//! number or of [`CHOICES`] if it is a name, and one use. What a user gives is a JSON object that holds only what differs from the
//! preset; [`Settings::resolve`] lays it over the preset and reports every violation at once, each
//! with a JSON pointer. There is no second, all-optional copy of the structs to keep in step.

mod assignments;
mod bounds;
mod domain;
mod error;
mod presets;
mod resolve;

use serde::{Deserialize, Serialize};

pub use assignments::assignments;
pub use bounds::{BOUNDS, Bound, CHOICES, Choice};
pub use domain::MAX_CHOSEN_EVALUATIONS;
pub use error::{Error, Violation};
pub use presets::Preset;
pub(super) use resolve::NO_FUSED_ENGINE;

/// All parameters of a run, complete: what is stored beside a result to make it again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// The network f: R³ → R.
    pub network: Network,
    /// How the network is fitted.
    pub training: Training,
    /// From points to training samples.
    pub sampling: Sampling,
    /// From the network to a mesh.
    pub surface: Surface,
}

/// Residual scheme of the hidden layers; z = W a + b, `∘` element-wise (\[N24\] section 2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scheme {
    /// tanh z.
    Plain,
    /// tanh z + a, from the second hidden layer.
    Resnet,
    /// T∘tanh z + (1-T)∘a with a trained gate T, from the second hidden layer.
    Highway,
    /// tanh z + z, on every `residual_every`-th hidden layer.
    Hw,
    /// tanh z + z∘z, on every `residual_every`-th hidden layer.
    Sqrhw,
    /// (1-tanh z)∘u + tanh z∘v with two encoders u and v, each tanh of an affine map of the point, from the
    /// second hidden layer (Wang, Teng, Perdikaris, arXiv:2001.04536).
    Gated,
}

/// What the networks of blocks are told of the field of the network that fits the whole, the coarse field.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CoarseInput {
    /// Nothing: they fit distances.
    #[default]
    None,
    /// They fit what the coarse field leaves of the distances: the linear part of a multi-fidelity network (Lu,
    /// Dao, Kumar, Ramamurty, Karniadakis, Suresh, 2020), with the coefficient 1.
    Residual,
}

/// Floating-point type of parameters and samples in training.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Precision {
    /// 32 bits.
    F32,
    /// 64 bits: about twice the time.
    F64,
}

/// The network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Network {
    /// Residual scheme of the hidden layers.
    pub scheme: Scheme,
    /// Neurons of each hidden layer of the one network that fits a cloud, unless that is uncertain.
    pub width: usize,
    /// Networks side by side that fit an uncertain cloud: a sparse one, or one whose noise is above a tenth of
    /// its spacing. Their mean is the field and errs less than one. 1: one network of `width` in any case.
    #[serde(default = "one")]
    pub members: usize,
    /// Neurons of each hidden layer of those.
    #[serde(default = "one")]
    pub member_width: usize,
    /// Number of hidden layers.
    pub hidden_layers: usize,
    /// Points of a block, at most: where one network leaves more of a cloud than its noise explains, the cloud is
    /// cut into blocks, each with a network of its own. 0: one network in any case.
    #[serde(default)]
    pub block_points: usize,
    /// Neurons of each hidden layer of the network of a block.
    #[serde(default = "one")]
    pub block_width: usize,
    /// Number of its hidden layers.
    #[serde(default = "one")]
    pub block_layers: usize,
    /// What the networks of blocks are told of the field of the network that fits the whole.
    #[serde(default)]
    pub coarse_input: CoarseInput,
    /// `hw` and `sqrhw` put the residual on hidden layers 1, 1 + n, 1 + 2n, …; 1 puts it on all.
    pub residual_every: usize,
    /// Floating-point type of parameters and samples.
    pub precision: Precision,
}

/// What [`Network::members`] was before there were any, for settings stored then.
fn one() -> usize {
    1
}

/// What [`Training::block_evaluations`] was before there were blocks.
fn one_evaluation() -> u64 {
    1
}

/// What evaluates loss and gradient.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Engine {
    /// The fastest that supports the settings: `fused`, else `libtorch`.
    Auto,
    /// One pass over cache-sized tiles of points with SIMD, several times as fast: f32, every scheme
    /// but `highway` and `gated`.
    Fused,
    /// libtorch's automatic differentiation: the reference.
    Libtorch,
}

/// Which optimiser fits the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Optimizer {
    /// L-BFGS with a strong Wolfe line search.
    Lbfgs,
    /// Adam.
    Adam,
    /// Adam for `adam_evaluations`, then L-BFGS.
    AdamLbfgs,
}

/// How the weights of the output layer are found, in which f is linear.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OutputLayer {
    /// Like all others, by the optimiser (\[N24\]).
    #[default]
    Trained,
    /// By linear least squares at each evaluation (variable projection); trained where samples are
    /// one-sided, as on sparse clouds.
    Solved,
}

/// How the network is fitted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Training {
    /// Seed of all randomness of the run.
    pub seed: u64,
    /// What evaluates loss and gradient.
    pub engine: Engine,
    /// Which optimiser fits the network.
    pub optimizer: Optimizer,
    /// How the output layer is found.
    #[serde(default)]
    pub output_layer: OutputLayer,
    /// First trial step of each L-BFGS line search.
    pub learning_rate: f64,
    /// Most L-BFGS pairs that are kept; of generated samples, no more than one for 64 samples.
    pub history: usize,
    /// Stop when no component of the gradient is larger.
    pub tolerance_gradient: f64,
    /// Stop when neither the loss nor any parameter changes by more.
    pub tolerance_change: f64,
    /// Most accepted iterations of L-BFGS.
    pub max_iterations: u64,
    /// Most evaluations of loss and gradient, over both optimisers.
    pub max_evaluations: u64,
    /// Evaluations of the network of a block; up to three times as many where it still leaves much of its points.
    #[serde(default = "one_evaluation")]
    pub block_evaluations: u64,
    /// Evaluations of Adam before L-BFGS (`adam_lbfgs`).
    pub adam_evaluations: u64,
    /// Step size of Adam.
    pub adam_learning_rate: f64,
    /// How much of the weight decay that the noise of the points asks for is added to the loss; 0: none
    /// (\[N24\]).
    #[serde(default)]
    pub smoothing: f64,
    /// Stop when the validation loss has not improved for so many evaluations, and keep the best
    /// parameters; 0: never, and keep the last. Without a hold-out, as on sparse clouds, stop when the
    /// loss has not fallen by 1 %.
    pub patience: u64,
    /// Stop training after so many seconds; 0: no limit. A run that is stopped by time is not
    /// reproducible.
    pub time_limit_seconds: f64,
    /// Evaluations at which a histogram of the gradient is taken, per layer.
    pub histogram_evaluations: Vec<u64>,
    /// Evaluations at which a mesh is extracted.
    pub snapshot_evaluations: Vec<u64>,
}

/// Coordinates in which the network is trained.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Frame {
    /// Centred, and scaled so that the longest edge of the bounding box is two half extents.
    Normalized,
    /// As they are in the file.
    Given,
}

/// Targets of the least-squares fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Targets {
    /// 1 inside, 0 on the surface, -1 outside (\[N24\]).
    Binary,
    /// Signed distance (positive inside) over `band`, clamped to [-1, 1].
    Graded,
}

/// Where samples off the surface come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OffSurface {
    /// From the labels of the cloud and, besides, generated along the normals and in the box.
    Generated,
    /// From the labels of the cloud only (\[N24\]).
    Labels,
}

/// From points to training samples.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sampling {
    /// Coordinates in which the network is trained.
    pub frame: Frame,
    /// Half the longest edge of the bounding box in the normalised frame.
    pub half_extent: f64,
    /// Targets of the fit.
    pub targets: Targets,
    /// Distance at which graded targets reach ±1, as a share of the bounding-box diagonal.
    pub band: f64,
    /// Where samples off the surface come from.
    pub off_surface: OffSurface,
    /// Surface points that are trained on, at most; the others are held out for validation.
    pub surface_points: usize,
    /// Points labelled interior, and as many labelled exterior, that are trained on, at most.
    pub labelled_points: usize,
    /// Share of the surface points held out for validation when the cloud is within its budget. Sparse
    /// clouds, whose spacing is more than 0.8 bands, need every point and give none.
    pub validation_fraction: f64,
    /// Pairs of samples generated along the normal of each surface point.
    pub near_pairs: usize,
    /// Samples generated in the padded bounding box and on its shell.
    pub far_points: usize,
    /// Nearest neighbours for normals and for the local spacing.
    pub neighbours: usize,
}

/// How the field is evaluated on the grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Evaluation {
    /// Only where the surface can be: costs what the surface costs.
    Sparse,
    /// Everywhere: the reference, and the paper's way.
    Dense,
}

/// Which connected components of the surface are kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Components {
    /// Those with input points near them.
    Supported,
    /// The one with the largest area.
    Largest,
    /// All.
    All,
}

/// What becomes of a surface where no points are near.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Open {
    /// Trimmed where a notable part of the closed surface has no points, otherwise closed.
    Auto,
    /// It stays closed.
    #[default]
    Closed,
    /// It is cut away, and the mesh ends there.
    Trimmed,
}

/// From the network to a mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Surface {
    /// How the field is evaluated on the grid.
    pub evaluation: Evaluation,
    /// Grid points along the longest edge of the padded box, at most. A sparse grid gets more where a body has
    /// little surface for its length, as a tube has, up to as many cells at the surface as for a ball, and where
    /// blocks show more detail: a step for 0.9 of the spacing of the points.
    pub resolution: usize,
    /// Grid steps between neighbouring points of the cloud that are enough: a finer grid makes the mesh larger
    /// and shows nothing more. 0: `resolution` in any case.
    #[serde(default)]
    pub steps_per_spacing: f64,
    /// Margin around the bounding box, as a share of its longest edge.
    pub padding: f64,
    /// Newton steps that move the vertices onto the zero set.
    pub projection_steps: usize,
    /// Which connected components are kept.
    pub components: Components,
    /// What becomes of the surface where no points are near.
    #[serde(default)]
    pub open: Open,
    /// Number of triangles that the mesh is simplified to, at the end. More are left where fewer would move the
    /// surface by more than a twentieth of the spacing of the points and a quarter of their noise. 0: all.
    #[serde(default)]
    pub target_triangles: usize,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_from_before_open_surfaces_stay_closed() {
        let mut stored = serde_json::to_value(Preset::Fine.settings()).unwrap();
        let surface = stored["surface"].as_object_mut().unwrap();
        assert_eq!(surface.remove("open"), Some("closed".into()));
        let settings: Settings = serde_json::from_value(stored).unwrap();
        assert_eq!(settings, Preset::Fine.settings());
    }

    #[test]
    fn settings_from_before_simplification_keep_all_triangles() {
        let mut stored = serde_json::to_value(Preset::Fine.settings()).unwrap();
        let surface = stored["surface"].as_object_mut().unwrap();
        assert_eq!(surface.remove("target_triangles"), Some(0.into()));
        let settings: Settings = serde_json::from_value(stored).unwrap();
        assert_eq!(settings, Preset::Fine.settings());
    }
}
