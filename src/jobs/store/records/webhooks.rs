//! Webhooks: made, found, listed, changed, removed.

use super::act::Act;
use super::row::{Columns, to_json};
use crate::jobs::store::sql::{Row, query};
use crate::jobs::store::{Acts, Records};
use crate::jobs::{NewWebhook, News, Result, Webhook, WebhookChange, WebhookId, WebhookState};

impl Acts<'_> {
    /// Makes a webhook of the caller's tenant. None where the tenant has as many as `most` already.
    pub async fn create_webhook(self, new: NewWebhook, most: u32) -> Result<Option<Webhook>> {
        let caller = self.caller.clone();
        self.store
            .write(move |mut tx| {
                Box::pin(async move {
                    let id = WebhookId::at(tx.now);
                    let row = query(
                        "INSERT INTO webhooks (id, tenant, url, events, secret, created_at)
                         SELECT ?1, ?2, ?3, ?4, ?5, ?6
                         WHERE (SELECT COUNT(*) FROM webhooks WHERE tenant = ?2) < ?7
                         RETURNING *",
                    )
                    .bind(id.as_str())
                    .bind(caller.tenant.as_str())
                    .bind(&new.url)
                    .bind(names(&new.events))
                    .bind(&new.secret)
                    .bind(tx.now)
                    .bind(most)
                    .fetch_optional(&mut tx.db)
                    .await?;
                    if row.is_some() {
                        tx.witness(&caller, Act::WebhookCreate, id.as_str()).await?;
                    }
                    row.as_ref().map(webhook_of).transpose()
                })
            })
            .await
    }

    /// Changes a webhook of the caller's tenant; none where there is none. One that is enabled, or goes
    /// elsewhere, is tried at once.
    pub async fn change_webhook(
        self,
        id: &WebhookId,
        change: WebhookChange,
    ) -> Result<Option<Webhook>> {
        let (caller, id) = (self.caller.clone(), id.clone());
        self.store
            .write(move |mut tx| {
                Box::pin(async move {
                    let state = change.enabled.map(|enabled| {
                        if enabled {
                            WebhookState::Enabled
                        } else {
                            WebhookState::Disabled
                        }
                    });
                    let tried_anew = change.url.is_some() || change.enabled == Some(true);
                    let (secret, old_ms) = change.secret.unzip();
                    let row = query(
                        "UPDATE webhooks SET
                             url = COALESCE(?3, url),
                             events = COALESCE(?4, events),
                             state = COALESCE(?5, state),
                             wait_until = CASE WHEN ?6 = 1 THEN 0 ELSE wait_until END,
                             old_secret = CASE WHEN ?7 IS NULL THEN old_secret ELSE secret END,
                             old_until = COALESCE(?8, old_until),
                             secret = COALESCE(?7, secret)
                         WHERE id = ?1 AND tenant = ?2
                         RETURNING *",
                    )
                    .bind(id.as_str())
                    .bind(caller.tenant.as_str())
                    .bind(change.url)
                    .bind(change.events.as_deref().map(names))
                    .bind(state.map(WebhookState::name))
                    .bind(tried_anew)
                    .bind(secret)
                    .bind(old_ms.map(|ms| tx.now + ms))
                    .fetch_optional(&mut tx.db)
                    .await?;
                    if row.is_some() {
                        tx.witness(&caller, Act::WebhookChange, id.as_str()).await?;
                    }
                    row.as_ref().map(webhook_of).transpose()
                })
            })
            .await
    }

    /// Removes a webhook of the caller's tenant with its messages. `false` where there is none.
    pub async fn delete_webhook(self, id: &WebhookId) -> Result<bool> {
        let (caller, id) = (self.caller.clone(), id.clone());
        self.store
            .write(move |mut tx| {
                Box::pin(async move {
                    let removed = query("DELETE FROM webhooks WHERE id = ?1 AND tenant = ?2")
                        .bind(id.as_str())
                        .bind(caller.tenant.as_str())
                        .execute(&mut tx.db)
                        .await?;
                    if removed.rows_affected() == 0 {
                        return Ok(false);
                    }
                    tx.witness(&caller, Act::WebhookDelete, id.as_str()).await?;
                    Ok(true)
                })
            })
            .await
    }
}

impl Records<'_> {
    /// The webhook of the given name.
    pub async fn webhook(self, id: &WebhookId) -> Result<Option<Webhook>> {
        let row = query("SELECT * FROM webhooks WHERE id = ?1 AND tenant = ?2")
            .bind(id.as_str())
            .bind(self.tenant.as_str())
            .fetch_optional(self.readers())
            .await?;
        row.as_ref().map(webhook_of).transpose()
    }

    /// All webhooks of the tenant, oldest first.
    pub async fn webhooks(self) -> Result<Vec<Webhook>> {
        let rows = query("SELECT * FROM webhooks WHERE tenant = ?1 ORDER BY id")
            .bind(self.tenant.as_str())
            .fetch_all(self.readers())
            .await?;
        rows.iter().map(webhook_of).collect()
    }
}

fn names(events: &[News]) -> String {
    let names: Vec<_> = events.iter().map(|news| news.name()).collect();
    to_json(&names)
}

fn webhook_of(row: &Row) -> Result<Webhook> {
    let columns = Columns::new("webhooks", row);
    let events: Vec<String> = columns.json("events")?;
    let events = events
        .iter()
        .map(|name| columns.required(News::from_name(name), "events"));
    Ok(Webhook {
        id: columns.parsed("id")?,
        url: columns.get("url")?,
        events: events.collect::<Result<_>>()?,
        state: columns.required(WebhookState::from_name(columns.get("state")?), "state")?,
        created_at: columns.get("created_at")?,
        wait_until: columns.get("wait_until")?,
    })
}
