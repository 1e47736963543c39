//! The bodies of answers, as types: what `openapi.yaml` describes.
//!
//! They borrow what they show. Nothing is decided here; only names, order and links of members are.
#![expect(
    clippy::struct_field_names,
    reason = "members are named as the contract names them"
)]

mod batch;
mod cloud;
mod event;
mod job;
mod problem;
mod result;
mod system;
mod time;
mod trust;
mod upload;
mod webhook;

use serde::Serialize;

pub(in crate::http) use batch::Batch;
pub(in crate::http) use cloud::Cloud;
pub(in crate::http) use event::{
    AllReset, BatchReset, EventItem, EventPage, JobReset, SucceededLinks,
};
pub(in crate::http) use job::{Cancelled, DryRun, Erased, Job, Place};
pub(in crate::http) use problem::Problem;
pub(in crate::http) use result::{Blocks, JobItems, Series, Snapshot};
pub(in crate::http) use system::{Check, Limits, Live, PresetItem, Range, Ready, Version};
pub(in crate::http) use time::{Time, milliseconds};
pub(in crate::http) use trust::{AuditRow, Key, NewKey, Session};
pub(in crate::http) use upload::Upload;
pub(in crate::http) use webhook::{Delivery, SecretWebhook, Webhook};

/// A page of a list.
#[derive(Debug, Serialize)]
pub(in crate::http) struct Page<T> {
    /// The items, newest first.
    pub(in crate::http) items: Vec<T>,
    /// What the next page is asked for with; none at the end.
    pub(in crate::http) next_cursor: Option<String>,
}

/// A list that is given whole.
#[derive(Debug, Serialize)]
pub(in crate::http) struct Items<T> {
    /// The items.
    pub(in crate::http) items: Vec<T>,
}
