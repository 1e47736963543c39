//! A plan is made for what is there, and one that is made for counts alone comes close to it.

use meshway::reconstruction::cloud::PointCloud;
use meshway::reconstruction::plan::{Cost, Findings, Plan};
use meshway::reconstruction::sampling::prepare;
use meshway::reconstruction::settings::{Preset, Settings};
use meshway::reconstruction::shapes::{Recipe, sample};

use crate::blocks::{bumpy, run};
use crate::uncertainty::{SPHERE, bare};

fn close(found: usize, expected: usize, share: f64) -> bool {
    found.abs_diff(expected) as f64 <= share * expected as f64
}

fn found(cloud: &PointCloud, settings: &Settings) -> Findings {
    Findings::from(&prepare(cloud, settings, 0.0, &|| false).unwrap())
}

#[test]
fn what_is_assumed_of_counts_is_what_is_found_of_a_ball() {
    let settings = Preset::Balanced.settings();
    for points in [200, 1_500, 8_000] {
        let cloud = sample(&SPHERE, &bare(points));
        let found = found(&cloud, &settings);
        let assumed = Findings::assumed(&settings, &cloud.counts());
        let context = format!("{found:?} {assumed:?}");
        assert_eq!(found.points, assumed.points, "{context}");
        assert!(close(found.samples, assumed.samples, 0.05), "{context}");
        assert_eq!(found.one_sided, assumed.one_sided, "{context}");
        assert_eq!(found.is_uncertain(), assumed.is_uncertain(), "{context}");
        let spacings = [found, assumed].map(|f| f.uncertainty.unwrap().spacing);
        assert!(
            (spacings[0] / spacings[1] - 1.0).abs() < 0.1,
            "{spacings:?}"
        );
    }
    let noisy = Recipe {
        noise_percent: 1.0,
        ..bare(3_000)
    };
    assert!(found(&sample(&SPHERE, &noisy), &settings).is_uncertain());
    let counts = sample(&SPHERE, &noisy).counts();
    assert!(
        Findings::assumed(&settings, &counts)
            .taken_as(true)
            .is_uncertain()
    );
}

#[test]
fn an_estimate_has_the_counts_of_the_run() {
    let mut settings = Preset::Fast.settings();
    settings.training.max_evaluations = 60;
    settings.training.block_evaluations = 30;
    // The bumpy ball needs blocks, the smooth one does not.
    let clouds = [
        bumpy(3_000),
        sample(&SPHERE, &bare(3_000)),
        sample(&SPHERE, &bare(300)),
    ];
    for (cloud, has_blocks) in clouds.iter().zip([true, false, false]) {
        let made = run(cloud, &settings);
        let report = &made.report;
        let cost = Cost::estimated(&settings, &cloud.counts(), 2);
        let blocks = report.blocks.as_ref().map(|blocks| blocks.count as u64);
        assert_eq!(blocks.is_some(), has_blocks);
        assert!(
            blocks.is_none_or(|blocks| blocks == cost.blocks),
            "{blocks:?} {cost:?}"
        );
        assert!(report.training.evaluations <= cost.max_evaluations);
        // What the whole was fitted to; the report counts the samples of blocks where there are any. Between bumps
        // there is less room for samples than around a ball.
        let findings = found(cloud, &settings);
        let plan = Plan::new(&settings, findings);
        assert!(
            close(findings.samples, cost.samples as usize, 0.25),
            "{findings:?} {cost:?}"
        );
        assert_eq!(report.network.parameters, plan.ensemble.parameter_count());
        assert!((report.cloud.weight_decay - plan.weight_decay).abs() < f64::EPSILON);
        assert_eq!(report.engine, "fused");
        // The grid of a ball, in the triangles that come of it: the memory is that of the mesh.
        let triangles = plan.cost(2).triangles as usize;
        assert!(
            close(report.mesh.triangles, triangles, 0.15),
            "{} {triangles}",
            report.mesh.triangles
        );
    }
}
