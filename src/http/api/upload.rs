//! An upload that may go on.

use serde::Serialize;

use super::{Problem, Time};
use crate::jobs::{self, CloudId, UploadEnd, UploadId};

/// An upload: how far it is, and what came of it.
#[derive(Debug, Serialize)]
pub(in crate::http) struct Upload<'a> {
    id: &'a UploadId,
    offset: u64,
    length: Option<u64>,
    complete: bool,
    cloud_id: Option<&'a CloudId>,
    error: Option<Problem>,
    created_at: Time,
    expires_at: Time,
    links: Links,
}

#[derive(Debug, Serialize)]
struct Links {
    #[serde(rename = "self")]
    own: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    cloud: Option<String>,
}

impl<'a> From<&'a jobs::Upload> for Upload<'a> {
    fn from(upload: &'a jobs::Upload) -> Self {
        let (cloud_id, error) = match &upload.end {
            Some(UploadEnd::Cloud(id)) => (Some(id), None),
            Some(UploadEnd::Refused(problem)) => (None, Some(Problem::from(problem))),
            None => (None, None),
        };
        Self {
            id: &upload.id,
            offset: upload.bytes,
            length: upload.length,
            complete: upload.complete,
            cloud_id,
            error,
            created_at: Time(upload.created_at),
            expires_at: Time(upload.expires_at),
            links: Links {
                own: format!("/v1/uploads/{}", upload.id),
                cloud: cloud_id.map(|id| format!("/v1/clouds/{id}")),
            },
        }
    }
}
