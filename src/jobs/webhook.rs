//! Webhooks: addresses that are told of what happens to the jobs of a tenant, and the messages to them.

use serde_json::Value;

use super::{DeliveryId, WebhookId};

/// What a webhook can be told of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum News {
    /// A job has a result.
    JobSucceeded,
    /// A job failed.
    JobFailed,
    /// A job was cancelled.
    JobCancelled,
    /// The last job of a batch has ended.
    BatchEnded,
    /// Somebody wants to see a message arrive.
    Test,
}

impl News {
    /// Those that a webhook can ask for; a test is sent to any.
    pub const ALL: [Self; 4] = [
        Self::JobSucceeded,
        Self::JobFailed,
        Self::JobCancelled,
        Self::BatchEnded,
    ];

    /// Its name in messages and in the database.
    pub fn name(self) -> &'static str {
        match self {
            Self::JobSucceeded => "job.succeeded",
            Self::JobFailed => "job.failed",
            Self::JobCancelled => "job.cancelled",
            Self::BatchEnded => "batch.ended",
            Self::Test => "webhook.test",
        }
    }

    /// The one of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        let mut all = Self::ALL.into_iter().chain([Self::Test]);
        all.find(|news| news.name() == name)
    }
}

/// Whether messages go to a webhook.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WebhookState {
    /// They do.
    Enabled,
    /// Its owner does not want any for now. They wait.
    Disabled,
    /// Its receiver answered 410. They wait.
    Gone,
}

impl WebhookState {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Enabled => "enabled",
            Self::Disabled => "disabled",
            Self::Gone => "gone",
        }
    }

    /// The one of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        let mut all = [Self::Enabled, Self::Disabled, Self::Gone].into_iter();
        all.find(|state| state.name() == name)
    }
}

/// A webhook that is to be made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NewWebhook {
    /// Where messages go.
    pub url: String,
    /// What it is told of.
    pub events: Vec<News>,
    /// What messages are signed with.
    pub secret: Vec<u8>,
}

/// A webhook, without its secret. Times are milliseconds since the epoch.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Webhook {
    /// Its name.
    pub id: WebhookId,
    /// Where messages go.
    pub url: String,
    /// What it is told of.
    pub events: Vec<News>,
    /// Whether messages go to it.
    pub state: WebhookState,
    /// When it was made.
    pub created_at: i64,
    /// Nothing is sent before: the receiver was not there.
    pub wait_until: i64,
}

/// What is to be changed of a webhook; what is left out stays.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct WebhookChange {
    /// Where messages go.
    pub url: Option<String>,
    /// What it is told of.
    pub events: Option<Vec<News>>,
    /// Whether messages go to it.
    pub enabled: Option<bool>,
    /// A new secret. For the given time, in milliseconds, messages are signed with the old one too.
    pub secret: Option<(Vec<u8>, i64)>,
}

/// Where a message stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeliveryState {
    /// It is sent when its time comes.
    Waiting,
    /// The receiver took it.
    Delivered,
    /// No try succeeded, and none follows.
    Failed,
}

impl DeliveryState {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Waiting => "waiting",
            Self::Delivered => "delivered",
            Self::Failed => "failed",
        }
    }
}

/// A message to a webhook. Times are milliseconds since the epoch.
#[derive(Debug, Clone, PartialEq)]
pub struct Delivery {
    /// Its name, the same over all tries.
    pub id: DeliveryId,
    /// The webhook.
    pub webhook_id: WebhookId,
    /// What it tells of.
    pub news: News,
    /// What it tells.
    pub data: Value,
    /// When that happened.
    pub created_at: i64,
    /// When the next try is due; none when it is over.
    pub due_at: Option<i64>,
    /// Number of tries.
    pub tries: u32,
    /// When the last one was made.
    pub tried_at: Option<i64>,
    /// Status of the last answer.
    pub status: Option<u16>,
    /// Why the last try failed.
    pub error: Option<String>,
}

impl Delivery {
    /// Where it stands.
    pub fn state(&self) -> DeliveryState {
        match (self.due_at, &self.error) {
            (Some(_), _) => DeliveryState::Waiting,
            (None, None) => DeliveryState::Delivered,
            (None, Some(_)) => DeliveryState::Failed,
        }
    }
}

/// A message that is to be sent now.
#[derive(Debug, Clone, PartialEq)]
pub struct Due {
    /// The message.
    pub delivery: Delivery,
    /// Where it goes.
    pub url: String,
    /// What it is signed with: the secret, and for a while the one before it.
    pub secrets: Vec<Vec<u8>>,
}

/// How a try to send a message went.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tried {
    /// Status of the answer, if there was one.
    pub status: Option<u16>,
    /// Why it failed; none: it did not.
    pub error: Option<String>,
    /// What comes next.
    pub next: Next,
}

/// What comes after a try. Times are milliseconds since the epoch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Next {
    /// Nothing: it succeeded, or it was the last one.
    Nothing,
    /// Another try.
    Again {
        /// When.
        due_at: i64,
        /// Until when no message goes to the webhook.
        wait_until: i64,
    },
    /// Nothing, also for all other messages to the webhook, until its owner enables it.
    Gone,
}
