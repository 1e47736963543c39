//! Whether a mesh can be relied on, by what its points tell.
//!
//! Every threshold is relative to the spacing and the noise of the points. They were chosen on meshes of organs,
//! bones, vessels, terrain and simple bodies whose true surfaces are known, right ones and wrong ones.

use serde::Serialize;
use serde_json::Value;

use crate::reconstruction::cloud::PointCloud;
use crate::reconstruction::mesh::{TriangleMesh, closest_to_each};
use crate::reconstruction::observer::Warning;
use crate::reconstruction::plan::Plan;
use crate::reconstruction::quality::describe;
use crate::reconstruction::sampling::Prepared;

use super::evidence::{Evidence, Fit, Measured};
use super::surface::UNSUPPORTED;
use super::{CloudReport, SurfaceReport};

/// How far a mesh can be relied on; the better, the lower.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// As far as the points tell.
    Good,
    /// In parts: the reasons say why.
    Doubtful,
    /// Not at all: the reasons say why.
    Poor,
}

impl Verdict {
    /// All of them, the best first.
    pub const ALL: [Self; 3] = [Self::Good, Self::Doubtful, Self::Poor];

    /// Its name in reports, in JSON and in headers.
    pub fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Doubtful => "doubtful",
            Self::Poor => "poor",
        }
    }

    /// The verdict of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|verdict| verdict.name() == name)
    }

    /// The verdict of a report; none in those of earlier versions.
    pub fn of(report: &Value) -> Option<Self> {
        report["verdict"].as_str().and_then(Self::from_name)
    }
}

/// Something that speaks against a mesh, and how much.
struct Reason {
    verdict: Verdict,
    warning: Warning,
}

impl Reason {
    fn new(verdict: Verdict, code: &'static str, message: String) -> Self {
        Self {
            verdict,
            warning: Warning::new(code, message),
        }
    }
}

/// The code of sides that are not sure.
const SIDES: &str = "sides_unsure";

/// The verdict on a mesh, with what speaks against it, the worst first.
pub(super) fn judge(evidence: &Evidence<'_>) -> (Verdict, Vec<Warning>) {
    let fit = evidence.fit.as_ref();
    let mut reasons: Vec<Reason> = [
        inside_out(evidence),
        fit.and_then(|fit| points_far(evidence, fit)),
        area_short(evidence),
        fit.and_then(|fit| pieces(evidence, fit)),
        handles(evidence),
        strays(evidence),
        thin(evidence),
        fit.and_then(|fit| beside_points(evidence, fit)),
        unsupported(evidence),
        sides(evidence),
    ]
    .into_iter()
    .flatten()
    .collect();
    // A right mesh can have unsure sides, where it is open or thin; with another fault it is hardly right.
    let others = [SIDES, UNSUPPORTED];
    let faulty = reasons.iter().any(|r| !others.contains(&r.warning.code));
    for reason in &mut reasons {
        if reason.warning.code == SIDES && faulty {
            reason.verdict = Verdict::Poor;
        }
    }
    reasons.sort_by_key(|reason| std::cmp::Reverse(reason.verdict));
    let worst = reasons.first().map_or(Verdict::Good, |r| r.verdict);
    (worst, reasons.into_iter().map(|r| r.warning).collect())
}

/// How far a mesh can be relied on, where the rest of its report is not asked for.
pub(in crate::reconstruction) fn verdict_on(
    cloud: &PointCloud,
    plan: &Plan<'_>,
    prepared: &Prepared,
    mesh: &TriangleMesh,
    surface: &SurfaceReport,
) -> Verdict {
    let points = super::used_points(cloud, prepared);
    let closest = closest_to_each(mesh, &points).unwrap_or_default();
    let measured = Measured {
        points: &points,
        closest: &closest,
        trained: prepared.surface.len(),
    };
    let described = describe(mesh);
    let cloud_report = CloudReport::new(prepared, plan);
    let evidence = Evidence::new((mesh, &described), measured, &cloud_report, surface);
    judge(&evidence).0
}

/// The verdict of a `value` that speaks against a mesh from `doubtful` on, and strongly from `poor` on.
fn above(value: f64, doubtful: f64, poor: f64) -> Option<Verdict> {
    if value >= poor {
        Some(Verdict::Poor)
    } else if value >= doubtful {
        Some(Verdict::Doubtful)
    } else {
        None
    }
}

fn inside_out(evidence: &Evidence<'_>) -> Option<Reason> {
    let volume = evidence.volume.filter(|&volume| volume <= 0.0)?;
    Some(Reason::new(
        Verdict::Poor,
        "inside_out",
        format!(
            "the mesh encloses a volume of {volume:.4}: it is inside out; see that normals point outwards, or try \
             another training.seed"
        ),
    ))
}

/// 95 % of the points of right meshes were within half a spacing beyond twice the noise.
fn points_far(evidence: &Evidence<'_>, fit: &Fit) -> Option<Reason> {
    let misfit = (fit.p95 - 2.0 * evidence.noise) / evidence.spacing;
    let spread = above(misfit, 0.5, 1.0);
    let lost = above(fit.lost, 0.005, 0.05);
    let verdict = spread.max(lost)?;
    Some(Reason::new(
        verdict,
        "points_far",
        format!(
            "the mesh passes its points by: 5 % of them are further than {:.4} from it and {:.1} % further than \
             {:.4}, where they are {:.4} apart; see that they are points of one surface, or try more \
             training.max_evaluations",
            fit.p95,
            100.0 * fit.lost,
            fit.reach,
            evidence.spacing
        ),
    ))
}

/// Right meshes have 0.72 of the area that the points stand for, or more.
fn area_short(evidence: &Evidence<'_>) -> Option<Reason> {
    let share = evidence.area_share()?;
    let verdict = above(-share, -0.5, -0.3)?;
    Some(Reason::new(
        verdict,
        "area_short",
        format!(
            "the mesh has only {:.0} % of the area that its {} points stand for at their spacing of {:.4}: it is \
             shattered or lacks parts; see that the points lie on a surface and do not fill a volume",
            100.0 * share,
            evidence.trained,
            evidence.spacing
        ),
    ))
}

/// A body of its own takes some ten points; a piece for fifty points is more than right clouds had.
fn pieces(evidence: &Evidence<'_>, fit: &Fit) -> Option<Reason> {
    let many = fit.pieces > 1 && 50 * fit.pieces > evidence.trained;
    let bare = fit.pieces > 1 && fit.bare_pieces > 0;
    let verdict = match (many, bare) {
        (true, true) => Verdict::Poor,
        (false, false) => return None,
        _ => Verdict::Doubtful,
    };
    Some(Reason::new(
        verdict,
        "pieces_unsupported",
        format!(
            "the mesh is in {} pieces, {} of them with hardly a point: bodies that the points do not bear out; look \
             at them, or keep the largest with surface.components largest",
            fit.pieces, fit.bare_pieces
        ),
    ))
}

/// The smallest torus that points a spacing apart can show takes some eighty of them.
fn handles(evidence: &Evidence<'_>) -> Option<Reason> {
    let handles = evidence.handles.filter(|&handles| handles > 1)?;
    let of_points = handles as f64 / evidence.trained.max(1) as f64;
    let verdict = above(of_points, 1.0 / 100.0, 1.0 / 40.0)?;
    Some(Reason::new(
        verdict,
        "handles_unsupported",
        format!(
            "the mesh has {handles} handles, more than {} points can show: parts of it are wrongly joined or \
             pierced; try a larger sampling.surface_points, or give normals",
            evidence.trained
        ),
    ))
}

fn strays(evidence: &Evidence<'_>) -> Option<Reason> {
    let verdict = above(evidence.stretch, 10.0, 30.0)?;
    Some(Reason::new(
        verdict,
        "strays_stretch",
        format!(
            "the box of all points is {:.1} times as long as that of 99 % of them: few strays set the scale, and \
             the rest is small in it; remove the strays",
            evidence.stretch
        ),
    ))
}

fn thin(evidence: &Evidence<'_>) -> Option<Reason> {
    let thickness = evidence.thickness()?;
    let verdict = above(-thickness / evidence.spacing, -0.6, -0.3)?;
    Some(Reason::new(
        verdict,
        "body_thin",
        format!(
            "the body is {thickness:.4} thick on average, less than its points, {:.4} apart, can show: it may be a \
             shell around them; take more points",
            evidence.spacing
        ),
    ))
}

/// A mesh that runs beside its points, on one side of them, has the wrong volume.
fn beside_points(evidence: &Evidence<'_>, fit: &Fit) -> Option<Reason> {
    let share = 2.0 * fit.offset.abs() / evidence.thickness().filter(|&t| t > 0.0)?;
    // Less is rounding off of curves, which thin and right plates have as well.
    if fit.offset.abs() < 0.05 * evidence.spacing {
        return None;
    }
    let verdict = above(share, 0.05, 0.25)?;
    let side = if fit.offset > 0.0 {
        "inside"
    } else {
        "outside"
    };
    Some(Reason::new(
        verdict,
        "beside_points",
        format!(
            "the mesh runs {:.4} {side} of its points, which changes its volume by some {:.0} %; try more \
             training.max_evaluations or a larger sampling.surface_points",
            fit.offset.abs(),
            100.0 * share
        ),
    ))
}

/// What closes an open surface is up to half of the mesh, and somewhat more where it bulges.
fn unsupported(evidence: &Evidence<'_>) -> Option<Reason> {
    let verdict = above(evidence.surface.unsupported_area_percent, 0.0, 200.0 / 3.0)?;
    let warning = evidence.surface.warning()?;
    Some(Reason { verdict, warning })
}

/// The sides are asked for a spacing deep, which is through a body that is thinner.
fn sides(evidence: &Evidence<'_>) -> Option<Reason> {
    let confidence = evidence
        .confidence
        .filter(|&confidence| confidence < 0.95)?;
    if evidence.thickness().is_some_and(|t| t < evidence.spacing) {
        return None;
    }
    Some(Reason::new(
        Verdict::Doubtful,
        SIDES,
        format!(
            "which side is inside is unsure at {:.1} % of the points: the winding number contradicts their normals; \
             give normals that point outwards, or points that are known to lie inside",
            100.0 * (1.0 - confidence)
        ),
    ))
}

#[cfg(test)]
mod tests;
