//! The report of a run: its quality, and the record that makes it again.

mod blocks;
mod evidence;
mod field;
mod slices;
mod stopwatch;
mod surface;
mod verdict;

use serde::{Deserialize, Serialize};

use crate::reconstruction::cloud::{PointCloud, Source};
use crate::reconstruction::error::Error;
use crate::reconstruction::mesh::TriangleMesh;
use crate::reconstruction::network::Ensemble;
use crate::reconstruction::observer::Warning;
use crate::reconstruction::plan::Plan;
use crate::reconstruction::quality::{self, Comparison, Judge, MeshReport};
use crate::reconstruction::sampling::{Counts, NormalSource, Prepared};
use crate::reconstruction::settings::Settings;
use crate::reconstruction::slices::{Grid, Identifiers};
use crate::reconstruction::space::Space;
use crate::reconstruction::surface::Field;
use crate::reconstruction::training::{Termination, Trained};
use crate::reconstruction::vector::{Bounds, Vec3};

pub use blocks::{BlocksReport, EachBlock};
pub use field::FieldAtPoints;
pub use slices::SlicesReport;
pub use stopwatch::Seconds;
pub(super) use stopwatch::Stopwatch;
pub use surface::{Simplification, SurfaceReport};
pub use verdict::Verdict;
pub(super) use verdict::verdict_on;

use evidence::{Evidence, Measured};

/// Percent of the area without points below which the summary is silent about it.
const NEGLIGIBLE_PERCENT: f64 = 1.0;

/// A file that a run read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Input {
    /// Its name, without folders; empty where it is not kept.
    pub name: String,
    /// SHA-256 of its bytes, hexadecimal.
    pub sha256: String,
    /// Its length in bytes.
    pub bytes: u64,
    /// Points read from it.
    pub points: usize,
}

/// How the training ended.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrainingReport {
    /// Why it ended.
    pub termination: Termination,
    /// Accepted iterations.
    pub iterations: u64,
    /// Evaluations of loss and gradient.
    pub evaluations: u64,
    /// Evaluation at which the parameters that were kept had been reached.
    pub kept_evaluation: u64,
    /// Mean weighted squared error on the training samples, of the parameters that were kept.
    pub loss: f64,
    /// The same on the validation samples; none without a hold-out.
    pub validation_loss: Option<f64>,
}

impl TrainingReport {
    pub(super) fn new<T>(trained: &Trained<T>) -> Self {
        Self {
            termination: trained.termination,
            iterations: trained.iterations,
            evaluations: trained.evaluations,
            kept_evaluation: trained.parameters_evaluation,
            loss: trained.loss,
            validation_loss: trained.validation_loss,
        }
    }
}

/// What was trained.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct NetworkReport {
    /// Networks whose mean is the field: 1, or `network.members` of the settings for an uncertain cloud.
    pub members: usize,
    /// Neurons of each of their hidden layers.
    pub width: usize,
    /// Trained numbers in all.
    pub parameters: usize,
}

impl NetworkReport {
    fn new(ensemble: &Ensemble) -> Self {
        Self {
            members: ensemble.members,
            width: ensemble.architecture.width,
            parameters: ensemble.parameter_count(),
        }
    }
}

/// What the points tell of themselves; lengths in units of the input.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CloudReport {
    /// Median distance between neighbouring points that were trained on.
    pub spacing: f64,
    /// Standard deviation of the points from the surface, as local fits see it; none where nothing was
    /// generated from the points.
    pub noise: Option<f64>,
    /// Share of the points whose normal the winding number of all of them bears out, 0 to 1: above one half
    /// one local spacing inside of the point, below it as far outside. Near 1 where the sides are sure; wrong
    /// normals and noise above the spacing lower it. None where no normals were needed.
    pub orientation_confidence: Option<f64>,
    /// How many times farther apart the points are across slices or scan lines than along them; 1 where they are
    /// even. The spacing is then that across.
    pub anisotropy: f64,
    /// Area of the surface that the points stand for; none where nothing was generated from the points.
    pub area: Option<f64>,
    /// λ of the weight decay that training added to the loss.
    pub weight_decay: f64,
}

impl CloudReport {
    fn new(prepared: &Prepared, plan: &Plan<'_>) -> Self {
        let to_world = |length| prepared.frame.length_to_world(length);
        Self {
            spacing: to_world(prepared.spacing),
            noise: prepared.noise().map(to_world),
            orientation_confidence: prepared.orientation_confidence,
            anisotropy: prepared.anisotropy,
            area: prepared.area.map(|area| area * to_world(1.0).powi(2)),
            weight_decay: plan.weight_decay,
        }
    }
}

/// Versions of what computed the run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Versions {
    /// This program.
    pub meshway: String,
    /// The tensor library.
    pub libtorch: String,
}

/// Quality of a mesh, and the record needed to make it again.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// How far the mesh can be relied on.
    pub verdict: Verdict,
    /// What speaks against it, the worst first.
    pub verdict_reasons: Vec<Warning>,
    /// Versions of what computed it.
    pub versions: Versions,
    /// The files; filled in by the caller, who read them.
    pub inputs: Vec<Input>,
    /// The slices that the cloud was made of; none of a cloud that was given as points.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slices: Option<SlicesReport>,
    /// What the coordinates of cloud and mesh mean.
    #[serde(flatten)]
    pub space: Space,
    /// The voxels of the label map that the cloud was made of.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub grid: Option<Grid>,
    /// Patient and study, where the user had them kept.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub identifiers: Option<Identifiers>,
    /// Complete settings, seed included.
    pub settings: Settings,
    /// What was trained.
    pub network: NetworkReport,
    /// The networks of blocks that refine its field; none where it was enough.
    pub blocks: Option<BlocksReport>,
    /// What evaluated loss and gradient.
    pub engine: &'static str,
    /// Threads of the run.
    pub threads: usize,
    /// Where the normals came from; none where none were needed.
    pub normals: Option<NormalSource>,
    /// Samples of each kind.
    pub samples: Counts,
    /// What the points tell of themselves.
    pub cloud: CloudReport,
    /// How the training ended.
    pub training: TrainingReport,
    /// How the surface was extracted.
    pub surface: SurfaceReport,
    /// What the mesh is; lengths in units of the input.
    pub mesh: MeshReport,
    /// Distances between the mesh and the surface points trained on.
    pub distances: Option<Comparison>,
    /// The same for the surface points held out.
    pub validation_distances: Option<Comparison>,
    /// |f| at the surface points, held-out ones included.
    pub field_at_points: FieldAtPoints,
    /// Mean cosine between given normals and those of the mesh, where normals were given.
    pub normal_agreement: Option<f64>,
    /// Seconds of each stage.
    pub seconds: Seconds,
    /// What the user was warned of.
    pub warnings: Vec<Warning>,
}

/// What a report is about.
pub(super) struct Subject<'a> {
    pub(super) cloud: &'a PointCloud,
    pub(super) plan: &'a Plan<'a>,
    pub(super) prepared: &'a Prepared,
    pub(super) mesh: &'a TriangleMesh,
    pub(super) blocks: Option<BlocksReport>,
    pub(super) field: &'a dyn Field,
    pub(super) engine: &'static str,
}

impl Report {
    /// Adds what the cloud was read from, and the warnings of its readers, which came first.
    /// `mesh` is held against the slices that it was made of.
    pub fn read_from(&mut self, inputs: Vec<Input>, source: Source, mesh: &TriangleMesh) {
        self.inputs = inputs;
        self.slices = source
            .slices
            .map(|record| SlicesReport::new(&record, mesh, self.mesh.volume));
        self.grid = source.grid;
        self.identifiers = source.identifiers;
        self.warnings.splice(0..0, source.warnings);
    }

    /// Measures the subject; the caller fills in `inputs` and `seconds`.
    pub(super) fn new(
        subject: &Subject<'_>,
        training: TrainingReport,
        surface: SurfaceReport,
    ) -> Result<Self, Error> {
        let Subject {
            cloud,
            plan,
            prepared,
            mesh,
            ..
        } = *subject;
        let settings = plan.settings;
        let trained_on = prepared.surface.len();
        let points = used_points(cloud, prepared);
        // Parts of either are work for one thread.
        let (described, judge) = rayon::join(
            || quality::describe(mesh),
            || Judge::new(mesh, &points, settings.training.seed),
        );
        let whole = Bounds::of(prepared.measured(cloud));
        let compare = |those| judge.as_ref()?.compare(those, whole);
        let normal_agreement = cloud.normals.as_ref().and_then(|normals| {
            let normals: Vec<Vec3> = prepared.surface.iter().map(|&i| normals[i]).collect();
            judge.as_ref()?.normal_agreement(&normals)
        });
        let mut warnings = prepared.warnings.clone();
        warnings.extend(surface.warnings());
        let cloud_report = CloudReport::new(prepared, plan);
        let closest = judge.as_ref().map_or(&[][..], Judge::closest);
        let (verdict, verdict_reasons) = verdict::judge(&Evidence::new(
            (mesh, &described),
            Measured {
                points: &points,
                closest,
                trained: trained_on,
            },
            &cloud_report,
            &surface,
        ));
        Ok(Self {
            verdict,
            verdict_reasons,
            versions: Versions::current(),
            inputs: Vec::new(),
            slices: None,
            space: cloud.space,
            grid: None,
            identifiers: None,
            settings: settings.clone(),
            network: NetworkReport::new(&plan.ensemble),
            blocks: subject.blocks.clone(),
            engine: subject.engine,
            threads: rayon::current_num_threads(),
            normals: prepared.normals,
            samples: prepared.counts,
            cloud: cloud_report,
            training,
            surface,
            mesh: described,
            distances: compare(0..trained_on),
            validation_distances: compare(trained_on..points.len()),
            field_at_points: FieldAtPoints::measure(subject)?,
            normal_agreement,
            seconds: Seconds::default(),
            warnings,
        })
    }

    /// The report in a few lines for people.
    pub fn summary(&self) -> String {
        let mesh = &self.mesh;
        let topology = &mesh.topology;
        let closed = if topology.closed { "closed" } else { "open" };
        let mut lines = vec![
            format!(
                "{} triangles, {} component(s), {closed}{}",
                mesh.triangles,
                topology.components,
                topology
                    .genus
                    .map_or_else(String::new, |genus| format!(", genus {genus}"))
            ),
            mesh.volume.map_or_else(
                || format!("area {:.6}", mesh.area),
                |volume| format!("area {:.6}, volume {volume:.6}", mesh.area),
            ),
            format!(
                "loss {:.3e} after {} evaluations ({})",
                self.training.loss,
                self.training.evaluations,
                name(&self.training.termination)
            ),
        ];
        for (what, comparison) in [
            ("points", &self.distances),
            ("held-out points", &self.validation_distances),
        ] {
            if let Some(comparison) = comparison {
                let d = &comparison.cloud_to_mesh;
                lines.push(format!(
                    "{what} to mesh: mean {:.4} %, 95 % within {:.4} %, max {:.4} % of the diagonal",
                    d.mean_percent, d.p95_percent, d.max_percent
                ));
            }
        }
        lines.extend(self.slices.iter().map(SlicesReport::line));
        let told = |code| {
            self.verdict_reasons
                .iter()
                .any(|reason| reason.code == code)
        };
        let unsupported = self.surface.unsupported(NEGLIGIBLE_PERCENT);
        lines.extend(unsupported.filter(|_| !told(surface::UNSUPPORTED)));
        lines.extend(self.surface.simplification.map(|made| made.summary()));
        let s = &self.seconds;
        lines.push(format!(
            "{:.1} s (sampling {:.1}, training {:.1}, surface {:.1}, report {:.1})",
            s.total, s.sampling, s.training, s.surface, s.report
        ));
        lines.push(format!("verdict: {}", self.verdict.name()));
        let reasons = self.verdict_reasons.iter();
        lines.extend(reasons.map(|reason| format!("  {}", reason.message)));
        lines.join("\n")
    }
}

/// The surface points trained on, and then those held out.
fn used_points(cloud: &PointCloud, prepared: &Prepared) -> Vec<Vec3> {
    let used = prepared.surface.iter().chain(&prepared.held_out);
    used.map(|&i| cloud.points[i]).collect()
}

/// The name of a value as it stands in JSON.
fn name(value: &impl Serialize) -> String {
    serde_json::to_value(value)
        .ok()
        .and_then(|value| value.as_str().map(str::to_owned))
        .unwrap_or_default()
}

impl Versions {
    fn current() -> Self {
        Self {
            meshway: env!("CARGO_PKG_VERSION").to_owned(),
            libtorch: LIBTORCH_VERSION.to_owned(),
        }
    }
}

/// The libtorch that tch's bindings are made for; the build refuses another.
const LIBTORCH_VERSION: &str = "2.13.0";
