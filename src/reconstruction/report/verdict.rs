//! Whether a mesh can be relied on, by what its points tell.
//!
//! Every threshold is relative to the spacing and the noise of the points. They were chosen on meshes of organs,
//! bones, vessels, terrain and simple bodies whose true surfaces are known, right ones and wrong ones.

use serde::Serialize;
use serde_json::Value;

use crate::reconstruction::observer::Warning;

use super::evidence::{Evidence, Fit};
use super::surface::UNSUPPORTED;

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
mod tests {
    use super::super::{CloudReport, SurfaceReport};
    use super::*;
    use crate::reconstruction::mesh::TriangleMesh;
    use crate::reconstruction::quality::describe;
    use crate::reconstruction::vector::{Vec3, add, scale};

    const SPACING: f64 = 0.1;

    /// Points even on the unit sphere, about [`SPACING`] apart.
    fn points() -> Vec<Vec3> {
        let turn = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
        let place = |i: u32| {
            let z = (2.0 * f64::from(i) + 1.0) / 1_200.0 - 1.0;
            let (sine, cosine) = (turn * f64::from(i)).sin_cos();
            let radius = (1.0 - z * z).sqrt();
            [radius * cosine, radius * sine, z]
        };
        (0..1_200).map(place).collect()
    }

    /// Adds a ball to `mesh`: a cube whose faces have `steps`² squares each, blown up.
    fn ball(mesh: &mut TriangleMesh, centre: Vec3, radius: f64, steps: u32) {
        let place = |axis: usize, side: f64, i: u32, j: u32| {
            let along = |k: u32| 2.0 * f64::from(k) / f64::from(steps) - 1.0;
            let mut on_cube = [side; 3];
            on_cube[(axis + 1) % 3] = side * along(i);
            on_cube[(axis + 2) % 3] = along(j);
            let length = on_cube.iter().map(|c| c * c).sum::<f64>().sqrt();
            add(centre, scale(on_cube, radius / length))
        };
        let first = mesh.vertices.len();
        let mut number = |vertex: Vec3| {
            let same = |v: &Vec3| (0..3).all(|k| (v[k] - vertex[k]).abs() < 1e-9 * radius);
            let known = mesh.vertices[first..].iter().position(same);
            let place = known.map_or(mesh.vertices.len(), |place| first + place);
            if known.is_none() {
                mesh.vertices.push(vertex);
            }
            u32::try_from(place).unwrap()
        };
        for axis in 0..3 {
            for side in [-1.0, 1.0] {
                for (i, j) in (0..steps).flat_map(|i| (0..steps).map(move |j| (i, j))) {
                    let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
                    let [a, b, c, d] = corners.map(|(i, j)| number(place(axis, side, i, j)));
                    mesh.triangles.extend([[a, b, c], [a, c, d]]);
                }
            }
        }
    }

    fn one_ball(radius: f64) -> TriangleMesh {
        let mut mesh = TriangleMesh::default();
        ball(&mut mesh, [0.0; 3], radius, 16);
        mesh
    }

    fn surface(unsupported_area_percent: f64) -> SurfaceReport {
        SurfaceReport {
            grid_points: [64; 3],
            grid_spacing: 0.04,
            field_evaluations: 1,
            closing_vertices: 0,
            dropped_components: 0,
            dropped_triangles: 0,
            dropped_area: 0.0,
            support_distance: 3.0 * SPACING,
            unsupported_area_percent,
        }
    }

    /// The verdict on `mesh`, and the codes of the reasons; `change` is made to what was measured.
    fn judged(
        mesh: &TriangleMesh,
        points: &[Vec3],
        percent: f64,
        change: impl FnOnce(&mut Evidence<'_>),
    ) -> (Verdict, Vec<&'static str>) {
        let cloud = CloudReport {
            spacing: SPACING,
            noise: Some(0.0),
            orientation_confidence: Some(1.0),
            weight_decay: 0.0,
        };
        let surface = surface(percent);
        let described = describe(mesh);
        let about = (points, points.len());
        let mut evidence = Evidence::new((mesh, &described), about, &cloud, &surface);
        change(&mut evidence);
        let (verdict, reasons) = judge(&evidence);
        for reason in &reasons {
            assert!(!reason.message.contains('\n') && !reason.message.contains("NaN"));
        }
        (verdict, reasons.iter().map(|reason| reason.code).collect())
    }

    #[test]
    fn a_mesh_through_its_points_is_good() {
        let found = judged(&one_ball(1.0), &points(), 0.0, |_| {});
        assert_eq!(found, (Verdict::Good, vec![]));
    }

    #[test]
    fn a_mesh_beside_its_points_is_not() {
        let (verdict, codes) = judged(&one_ball(0.98), &points(), 0.0, |_| {});
        assert_eq!((verdict, codes), (Verdict::Doubtful, vec!["beside_points"]));
        for radius in [0.8, 1.2] {
            let (verdict, codes) = judged(&one_ball(radius), &points(), 0.0, |_| {});
            assert_eq!(verdict, Verdict::Poor);
            assert!(codes.contains(&"points_far") && codes.contains(&"beside_points"));
        }
        // A body that the mesh lost.
        let mut points = points();
        points.extend((0..80).map(|i| [3.0, 0.1 * f64::from(i % 9), 0.1 * f64::from(i / 9)]));
        let (verdict, codes) = judged(&one_ball(1.0), &points, 0.0, |_| {});
        assert_eq!((verdict, codes), (Verdict::Poor, vec!["points_far"]));
    }

    #[test]
    fn bubbles_around_the_points_are_poor() {
        let points = points();
        let mut mesh = TriangleMesh::default();
        for &point in points.iter().step_by(2) {
            ball(&mut mesh, point, 0.02, 2);
        }
        let (verdict, codes) = judged(&mesh, &points, 0.0, |_| {});
        assert_eq!(verdict, Verdict::Poor);
        for code in ["area_short", "pieces_unsupported", "body_thin"] {
            assert!(codes.contains(&code), "{codes:?}");
        }
    }

    #[test]
    fn a_piece_without_points_is_told() {
        let mut mesh = one_ball(1.0);
        ball(&mut mesh, [0.5, 0.0, 0.0], 0.2, 4);
        let found = judged(&mesh, &points(), 0.0, |_| {});
        assert_eq!(found, (Verdict::Doubtful, vec!["pieces_unsupported"]));
    }

    #[test]
    fn a_mesh_inside_out_is_poor() {
        let mut mesh = one_ball(1.0);
        for triangle in &mut mesh.triangles {
            triangle.swap(1, 2);
        }
        let found = judged(&mesh, &points(), 0.0, |_| {});
        assert_eq!(found, (Verdict::Poor, vec!["inside_out"]));
    }

    #[test]
    fn a_shell_around_the_points_is_poor() {
        let mut mesh = one_ball(0.987);
        for triangle in &mut mesh.triangles {
            triangle.swap(1, 2);
        }
        ball(&mut mesh, [0.0; 3], 1.01, 16);
        let (verdict, codes) = judged(&mesh, &points(), 0.0, |_| {});
        assert_eq!(verdict, Verdict::Poor);
        assert!(codes.contains(&"body_thin"), "{codes:?}");
    }

    #[test]
    fn strays_that_set_the_scale_are_told() {
        for (far, verdict) in [(20.0, Verdict::Doubtful), (90.0, Verdict::Poor)] {
            let mut points = points();
            points.push([far, far, far]);
            let found = judged(&one_ball(1.0), &points, 0.0, |_| {});
            assert_eq!(found, (verdict, vec!["strays_stretch"]));
        }
    }

    #[test]
    fn handles_count_against_points() {
        for (handles, expected) in [
            (8, (Verdict::Good, vec![])),
            (20, (Verdict::Doubtful, vec!["handles_unsupported"])),
            (60, (Verdict::Poor, vec!["handles_unsupported"])),
        ] {
            let found = judged(&one_ball(1.0), &points(), 0.0, |evidence| {
                evidence.handles = Some(handles);
            });
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn what_is_filled_in_is_doubtful_unless_it_is_most() {
        for (percent, expected) in [
            (9.0, (Verdict::Good, vec![])),
            (50.0, (Verdict::Doubtful, vec!["surface_unsupported"])),
            (80.0, (Verdict::Poor, vec!["surface_unsupported"])),
        ] {
            // What is left of the area is as much as the points stand for.
            let found = judged(&one_ball(1.0), &points(), percent, |evidence| {
                evidence.area /= 1.0 - percent / 100.0;
            });
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn unsure_sides_weigh_with_other_faults() {
        let unsure = |evidence: &mut Evidence<'_>| evidence.confidence = Some(0.8);
        let found = judged(&one_ball(1.0), &points(), 0.0, unsure);
        assert_eq!(found, (Verdict::Doubtful, vec!["sides_unsure"]));
        let (verdict, _) = judged(&one_ball(0.98), &points(), 0.0, unsure);
        assert_eq!(verdict, Verdict::Poor);
        // The sides of a plate thinner than the spacing cannot be sure.
        let found = judged(&one_ball(1.0), &points(), 0.0, |evidence| {
            unsure(evidence);
            evidence.volume = Some(0.4 * SPACING * evidence.area);
        });
        assert_eq!(found, (Verdict::Good, vec![]));
    }

    #[test]
    fn nothing_measured_is_no_panic() {
        let empty = TriangleMesh::default();
        judged(&empty, &[], 0.0, |_| {});
        judged(&one_ball(1.0), &[], 0.0, |evidence| evidence.spacing = 0.0);
        judged(&one_ball(1.0), &points(), 0.0, |e| e.spacing = 0.0);
    }
}
