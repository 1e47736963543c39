//! Webhooks and the messages to them.

use serde::Serialize;
use serde_json::Value;

use super::Time;
use crate::jobs;

/// A webhook, without its secret.
#[derive(Debug, Serialize)]
pub(in crate::http) struct Webhook<'a> {
    id: &'a str,
    url: &'a str,
    events: Vec<&'static str>,
    state: &'static str,
    created_at: Time,
}

impl<'a> From<&'a jobs::Webhook> for Webhook<'a> {
    fn from(webhook: &'a jobs::Webhook) -> Self {
        Self {
            id: webhook.id.as_str(),
            url: &webhook.url,
            events: webhook.events.iter().map(|news| news.name()).collect(),
            state: webhook.state.name(),
            created_at: Time(webhook.created_at),
        }
    }
}

/// A webhook whose secret was just made, with it, this once.
#[derive(Debug, Serialize)]
pub(in crate::http) struct SecretWebhook<'a> {
    /// The secret.
    pub(in crate::http) secret: String,
    /// What it is.
    #[serde(flatten)]
    pub(in crate::http) what: Webhook<'a>,
}

/// A message to a webhook.
#[derive(Debug, Serialize)]
pub(in crate::http) struct Delivery<'a> {
    id: &'a str,
    webhook_id: &'a str,
    event: &'static str,
    data: &'a Value,
    state: &'static str,
    created_at: Time,
    tries: u32,
    tried_at: Option<Time>,
    next_try_at: Option<Time>,
    status: Option<u16>,
    error: Option<&'a str>,
}

impl<'a> From<&'a jobs::Delivery> for Delivery<'a> {
    fn from(delivery: &'a jobs::Delivery) -> Self {
        Self {
            id: delivery.id.as_str(),
            webhook_id: delivery.webhook_id.as_str(),
            event: delivery.news.name(),
            data: &delivery.data,
            state: delivery.state().name(),
            created_at: Time(delivery.created_at),
            tries: delivery.tries,
            tried_at: delivery.tried_at.map(Time),
            next_try_at: delivery.due_at.map(Time),
            status: delivery.status,
            error: delivery.error.as_deref(),
        }
    }
}
