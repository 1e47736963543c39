//! A cloud.

use serde::Serialize;

use super::Time;
use crate::intake::Notice;
use crate::jobs::{self, CloudId};
use crate::reconstruction::cloud::{Counts, Format};
use crate::reconstruction::medical::Contents;
use crate::reconstruction::space::Space;
use crate::reconstruction::vector::Bounds;

/// A cloud: its row, and what the upload found.
#[derive(Debug, Serialize)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is a member of its own in the contract"
)]
pub(in crate::http) struct Cloud<'a> {
    id: &'a CloudId,
    sha256: &'a str,
    bytes: u64,
    format: Format,
    gzipped: bool,
    points: u64,
    bounds: Bounds,
    normals: bool,
    labels: Counts,
    #[serde(flatten)]
    space: Space,
    dropped_non_finite: u64,
    warnings: &'a [Notice],
    keeps_identifiers: bool,
    dropped_texts: u64,
    segmentation: Option<&'a Contents>,
    created_at: Time,
    expires_at: Option<Time>,
    hold: bool,
    links: Links,
}

#[derive(Debug, Serialize)]
struct Links {
    #[serde(rename = "self")]
    own: String,
    content: String,
    points: String,
    jobs: String,
}

impl<'a> From<&'a jobs::Cloud> for Cloud<'a> {
    fn from(cloud: &'a jobs::Cloud) -> Self {
        let summary = &cloud.summary;
        let own = format!("/v1/clouds/{}", cloud.id);
        Self {
            id: &cloud.id,
            sha256: &cloud.sha256,
            bytes: cloud.bytes,
            format: summary.format,
            gzipped: summary.gzipped,
            points: summary.points,
            bounds: summary.bounds,
            normals: summary.normals,
            labels: summary.labels,
            space: summary.space,
            dropped_non_finite: summary.dropped_non_finite,
            warnings: &summary.warnings,
            keeps_identifiers: summary.keeps_identifiers,
            dropped_texts: summary.dropped_texts,
            segmentation: summary.segmentation.as_deref(),
            created_at: Time(cloud.created_at),
            expires_at: cloud.expires_at.map(Time),
            hold: cloud.hold,
            links: Links {
                content: format!("{own}/content"),
                points: format!("{own}/points"),
                jobs: format!("/v1/jobs?cloud_id={}", cloud.id),
                own,
            },
        }
    }
}
