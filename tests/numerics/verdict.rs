//! The verdict on meshes of clouds as users bring them.

use meshway::reconstruction::cloud::PointCloud;
use meshway::reconstruction::reconstruct;
use meshway::reconstruction::report::{Report, Verdict};
use meshway::reconstruction::settings::{Preset, Settings};
use meshway::reconstruction::shapes::{Recipe, Shape, sample};
use serde_json::json;

use crate::uncertainty::Silent;

const SPHERE: Shape = Shape::Sphere { radius: 1.0 };

const TORUS: Shape = Shape::Torus {
    major: 1.0,
    minor: 0.4,
};

fn report(cloud: &PointCloud) -> Report {
    let settings = Settings::resolve(
        Preset::Fast,
        &json!({"training": {"max_evaluations": 200}, "surface": {"resolution": 80}}),
    )
    .unwrap();
    tch::set_num_threads(1);
    let made = reconstruct(cloud, &settings, &Silent).unwrap();
    let report = made.report;
    let summary = report.summary();
    let line = format!("verdict: {}", report.verdict.name());
    assert!(summary.lines().any(|said| said == line), "{summary}");
    report
}

fn codes(report: &Report) -> Vec<&'static str> {
    let reasons = report.verdict_reasons.iter();
    reasons.map(|reason| reason.code).collect()
}

#[test]
fn right_meshes_are_good() {
    for (shape, points, noise_percent) in [
        (SPHERE, 300, 0.0),
        (SPHERE, 3_000, 0.5),
        (TORUS, 3_000, 0.0),
        (Shape::Uterus, 3_000, 0.3),
    ] {
        let recipe = Recipe {
            points,
            noise_percent,
            ..Recipe::default()
        };
        let report = report(&sample(&shape, &recipe));
        let reasons = &report.verdict_reasons;
        assert_eq!(report.verdict, Verdict::Good, "{shape}: {reasons:?}");
        assert!(reasons.is_empty());
    }
}

#[test]
fn a_cap_is_doubtful() {
    let mut cap = sample(&SPHERE, &Recipe::default());
    cap.points.retain(|point| point[2] > 0.1);
    let report = report(&PointCloud {
        points: cap.points,
        ..PointCloud::default()
    });
    assert_eq!(report.verdict, Verdict::Doubtful);
    assert!(codes(&report).contains(&"surface_unsupported"));
}
