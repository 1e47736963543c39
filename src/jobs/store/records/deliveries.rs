//! Messages to webhooks: written with what they tell of, sent when they are due, tried again.

use serde_json::{Value, json};

use super::act::Act;
use super::queue::DAY_MS;
use super::row::{Columns, to_json};
use crate::jobs::store::Transaction;
use crate::jobs::store::sql::{Row, query, scalar};
use crate::jobs::store::{Acts, Records, Store};
use crate::jobs::{
    Delivery, DeliveryId, Due, JobId, NewEvent, News, Next, Result, Tried, WebhookId,
};

/// Days that messages are kept.
const KEEP_DAYS: i64 = 30;

impl Acts<'_> {
    /// Writes a test to a webhook of the caller's tenant; none where there is none.
    pub async fn test_webhook(self, id: &WebhookId) -> Result<Option<Delivery>> {
        let (caller, id) = (self.caller.clone(), id.clone());
        self.store
            .write(move |mut tx| {
                Box::pin(async move {
                    let select = "SELECT id FROM webhooks WHERE id = ?1 AND tenant = ?2";
                    let known: Option<String> = scalar(select)
                        .bind(id.as_str())
                        .bind(caller.tenant.as_str())
                        .fetch_optional(&mut tx.db)
                        .await?;
                    let Some(webhook) = known else {
                        return Ok(None);
                    };
                    let data = json!({"webhook_id": webhook});
                    let tenant = caller.tenant.as_str();
                    let made = tx
                        .insert_delivery((tenant, &webhook), News::Test, &data)
                        .await?;
                    tx.call_at_once(&webhook).await?;
                    tx.witness(&caller, Act::WebhookSend, id.as_str()).await?;
                    Ok(Some(made))
                })
            })
            .await
    }

    /// Has a message of the caller's tenant sent again, now, with all tries before it; none where there
    /// is none.
    pub async fn redeliver(self, id: &DeliveryId) -> Result<Option<Delivery>> {
        let (caller, id) = (self.caller.clone(), id.clone());
        self.store
            .write(move |mut tx| {
                Box::pin(async move {
                    let row = query(
                        "UPDATE deliveries SET due_at = ?3, tries = 0, status = NULL, error = NULL
                         WHERE id = ?1 AND tenant = ?2 RETURNING *",
                    )
                    .bind(id.as_str())
                    .bind(caller.tenant.as_str())
                    .bind(tx.now)
                    .fetch_optional(&mut tx.db)
                    .await?;
                    let Some(row) = row else {
                        return Ok(None);
                    };
                    let delivery = delivery_of(&row)?;
                    tx.call_at_once(delivery.webhook_id.as_str()).await?;
                    tx.witness(&caller, Act::WebhookSend, id.as_str()).await?;
                    Ok(Some(delivery))
                })
            })
            .await
    }
}

impl Records<'_> {
    /// The message of the given name.
    pub async fn delivery(self, id: &DeliveryId) -> Result<Option<Delivery>> {
        let row = query("SELECT * FROM deliveries WHERE id = ?1 AND tenant = ?2")
            .bind(id.as_str())
            .bind(self.tenant.as_str())
            .fetch_optional(self.readers())
            .await?;
        row.as_ref().map(delivery_of).transpose()
    }

    /// A page of the messages to a webhook, newest first; `before` is the last one of the page before it.
    pub async fn deliveries(
        self,
        webhook: &WebhookId,
        before: Option<&DeliveryId>,
        limit: u32,
    ) -> Result<Vec<Delivery>> {
        let select = "SELECT * FROM deliveries
                      WHERE webhook_id = ?1 AND tenant = ?2 AND (?3 IS NULL OR id < ?3)
                      ORDER BY id DESC LIMIT ?4";
        let rows = query(select)
            .bind(webhook.as_str())
            .bind(self.tenant.as_str())
            .bind(before.map(DeliveryId::as_str))
            .bind(limit)
            .fetch_all(self.readers())
            .await?;
        rows.iter().map(delivery_of).collect()
    }
}

impl Store {
    /// Of each webhook of any tenant that is not waited for, the message that is due longest.
    pub async fn due_deliveries(&self) -> Result<Vec<Due>> {
        let rows = query(
            "SELECT deliveries.*, url, secret,
                 CASE WHEN old_until > ?1 THEN old_secret END AS old_secret
             FROM webhooks JOIN deliveries ON deliveries.id =
                 (SELECT id FROM deliveries WHERE webhook_id = webhooks.id AND due_at <= ?1
                  ORDER BY due_at, id LIMIT 1)
             WHERE state = 'enabled' AND wait_until <= ?1",
        )
        .bind(self.now())
        .fetch_all(self.readers())
        .await?;
        let due = |row: &Row| {
            let columns = Columns::new("webhooks", row);
            let old: Option<Vec<u8>> = columns.get("old_secret")?;
            Ok(Due {
                delivery: delivery_of(row)?,
                url: columns.get("url")?,
                secrets: [columns.get("secret")?].into_iter().chain(old).collect(),
            })
        };
        rows.iter().map(due).collect()
    }

    /// When the next message is due, in milliseconds since the epoch; none while none waits.
    pub async fn next_delivery(&self) -> Result<Option<i64>> {
        let row = query(
            "SELECT MIN(MAX(wait_until, (SELECT MIN(due_at) FROM deliveries
                                         WHERE webhook_id = webhooks.id AND due_at IS NOT NULL)))
             FROM webhooks WHERE state = 'enabled'",
        )
        .fetch_one(self.readers())
        .await?;
        row.at(0)
    }

    /// Notes how a try to send a message went.
    pub async fn delivery_tried(&self, due: &Due, tried: Tried) -> Result<()> {
        let (id, webhook) = (due.delivery.id.clone(), due.delivery.webhook_id.clone());
        self.write(move |mut tx| {
            Box::pin(async move {
                let (due_at, wait_until, state) = match tried.next {
                    Next::Nothing => (None, 0, None),
                    Next::Again { due_at, wait_until } => (Some(due_at), wait_until, None),
                    Next::Gone => (None, 0, Some("gone")),
                };
                query(
                    "UPDATE deliveries SET tries = tries + 1, tried_at = ?2, status = ?3,
                         error = ?4, due_at = ?5
                     WHERE id = ?1",
                )
                .bind(id.as_str())
                .bind(tx.now)
                .bind(tried.status)
                .bind(tried.error)
                .bind(due_at)
                .execute(&mut tx.db)
                .await?;
                query(
                    "UPDATE webhooks SET wait_until = ?2, state = COALESCE(?3, state)
                     WHERE id = ?1",
                )
                .bind(webhook.as_str())
                .bind(wait_until)
                .bind(state)
                .execute(&mut tx.db)
                .await?;
                Ok(())
            })
        })
        .await
    }

    /// Forgets messages that are old, whether or not they were taken.
    pub async fn forget_deliveries(&self) -> Result<()> {
        self.write(|mut tx| {
            Box::pin(async move {
                query("DELETE FROM deliveries WHERE created_at < ?1")
                    .bind(tx.now - KEEP_DAYS * DAY_MS)
                    .execute(&mut tx.db)
                    .await?;
                Ok(())
            })
        })
        .await
    }
}

impl Transaction<'_> {
    /// Writes the messages that tell of an event of a job: of its end, and of that of its batch.
    pub(in crate::jobs::store) async fn tell_webhooks(
        &mut self,
        tenant: &str,
        id: &JobId,
        event: &NewEvent,
    ) -> Result<()> {
        let (news, mut data) = match event {
            NewEvent::Succeeded { assessment, .. } => {
                (News::JobSucceeded, json!({"verdict": assessment.verdict}))
            }
            NewEvent::Failed { error } => (
                News::JobFailed,
                json!({"error": {"code": error.code, "retryable": error.retryable}}),
            ),
            NewEvent::Cancelled {} => (News::JobCancelled, json!({})),
            _ => return Ok(()),
        };
        let any: bool = scalar("SELECT EXISTS (SELECT 1 FROM webhooks WHERE tenant = ?1)")
            .bind(tenant)
            .fetch_one(&mut self.db)
            .await?;
        if !any {
            return Ok(());
        }
        let batch: Option<String> = scalar("SELECT batch_id FROM jobs WHERE id = ?1")
            .bind(id.as_str())
            .fetch_one(&mut self.db)
            .await?;
        data["job_id"] = json!(id);
        data["batch_id"] = json!(batch);
        self.insert_deliveries(tenant, news, &data).await?;
        let Some(batch) = batch else {
            return Ok(());
        };
        let counts = query(
            "SELECT COUNT(CASE WHEN finished_at IS NULL THEN 1 END) AS open,
                 COUNT(CASE WHEN status = 'succeeded' THEN 1 END) AS succeeded,
                 COUNT(CASE WHEN status = 'failed' THEN 1 END) AS failed,
                 COUNT(CASE WHEN status = 'cancelled' THEN 1 END) AS cancelled
             FROM jobs WHERE batch_id = ?1",
        )
        .bind(&batch)
        .fetch_one(&mut self.db)
        .await?;
        let count = |column| Columns::new("jobs", &counts).count(column);
        if count("open")? > 0 {
            return Ok(());
        }
        let data = json!({
            "batch_id": batch,
            "succeeded": count("succeeded")?,
            "failed": count("failed")?,
            "cancelled": count("cancelled")?,
        });
        self.insert_deliveries(tenant, News::BatchEnded, &data)
            .await
    }

    async fn insert_deliveries(&mut self, tenant: &str, news: News, data: &Value) -> Result<()> {
        let webhooks = query("SELECT id, events FROM webhooks WHERE tenant = ?1 ORDER BY id")
            .bind(tenant)
            .fetch_all(&mut self.db)
            .await?;
        for row in &webhooks {
            let columns = Columns::new("webhooks", row);
            let wanted: Vec<String> = columns.json("events")?;
            if wanted.iter().any(|name| name == news.name()) {
                self.insert_delivery((tenant, columns.get("id")?), news, data)
                    .await?;
            }
        }
        Ok(())
    }

    async fn insert_delivery(
        &mut self,
        (tenant, webhook): (&str, &str),
        news: News,
        data: &Value,
    ) -> Result<Delivery> {
        let row = query(
            "INSERT INTO deliveries (id, webhook_id, tenant, event, data, created_at, due_at)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?6) RETURNING *",
        )
        .bind(DeliveryId::at(self.now).as_str())
        .bind(webhook)
        .bind(tenant)
        .bind(news.name())
        .bind(to_json(data))
        .bind(self.now)
        .fetch_one(&mut self.db)
        .await?;
        delivery_of(&row)
    }

    /// A webhook that somebody looks at is not waited for.
    async fn call_at_once(&mut self, webhook: &str) -> Result<()> {
        query("UPDATE webhooks SET wait_until = 0 WHERE id = ?1")
            .bind(webhook)
            .execute(&mut self.db)
            .await?;
        Ok(())
    }
}

fn delivery_of(row: &Row) -> Result<Delivery> {
    let columns = Columns::new("deliveries", row);
    Ok(Delivery {
        id: columns.parsed("id")?,
        webhook_id: columns.parsed("webhook_id")?,
        news: columns.required(News::from_name(columns.get("event")?), "event")?,
        data: columns.json("data")?,
        created_at: columns.get("created_at")?,
        due_at: columns.get("due_at")?,
        tries: columns.count("tries")? as u32,
        tried_at: columns.get("tried_at")?,
        status: columns
            .get::<Option<i64>>("status")?
            .map(|status| status as u16),
        error: columns.get("error")?,
    })
}
