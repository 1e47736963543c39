//! Databases from before content had a file of its own: moves it there, and gives their space back.
//!
//! One object after the other: its bytes are written, then one transaction names them and deletes
//! the old ones. A process that dies in between leaves an object that nobody names, and the next one
//! goes on. Several processes may do it at once; the first to name an object wins.

use bytes::Bytes;
use sqlx::{Row, SqliteConnection};

use super::objects::{Kept, Objects, new_key};
use crate::jobs::Result;

/// Where content was, and how it is named where it is now: `?1` is the row, `?2` the key, `?3` the
/// number of bytes.
struct Place {
    first: &'static str,
    read: &'static str,
    name: &'static str,
    delete: &'static str,
}

const PLACES: [Place; 3] = [
    Place {
        first: "SELECT CAST(id AS TEXT) FROM meshes WHERE object IS NULL LIMIT 1",
        read: "SELECT data FROM mesh_chunks WHERE mesh_id = CAST(?1 AS INTEGER) ORDER BY position",
        name: "UPDATE meshes SET object = ?2
               WHERE id = CAST(?1 AS INTEGER) AND object IS NULL AND ?3 >= 0
               AND NOT EXISTS (SELECT 1 FROM refused WHERE key = ?2)",
        delete: "DELETE FROM mesh_chunks WHERE mesh_id = CAST(?1 AS INTEGER)",
    },
    Place {
        first: "SELECT job_id FROM models_before LIMIT 1",
        read: "SELECT data FROM models_before WHERE job_id = ?1",
        name: "INSERT INTO models (job_id, object, bytes, sha256)
               SELECT job_id, ?2, ?3, sha256 FROM models_before WHERE job_id = ?1
               AND NOT EXISTS (SELECT 1 FROM refused WHERE key = ?2)",
        delete: "DELETE FROM models_before WHERE job_id = ?1",
    },
    Place {
        first: "SELECT job_id FROM checkpoints_before LIMIT 1",
        read: "SELECT data FROM checkpoints_before WHERE job_id = ?1",
        name: "INSERT INTO checkpoints (job_id, attempt, evaluation, object, bytes, created_at)
               SELECT job_id, attempt, evaluation, ?2, ?3, created_at
               FROM checkpoints_before WHERE job_id = ?1
               AND NOT EXISTS (SELECT 1 FROM refused WHERE key = ?2)",
        delete: "DELETE FROM checkpoints_before WHERE job_id = ?1",
    },
];

/// Moves what is left to move.
pub(in crate::jobs::store) async fn lift(
    db: &mut SqliteConnection,
    objects: &Objects,
) -> Result<()> {
    let left = "SELECT EXISTS (SELECT 1 FROM sqlite_schema
                WHERE type = 'table' AND name = 'mesh_chunks')";
    if sqlx::query_scalar(left).fetch_one(&mut *db).await? {
        for place in &PLACES {
            while let Some(row) = first(db, place).await? {
                move_one(db, objects, place, &row).await?;
            }
        }
        drop_tables(db).await?;
    }
    make_shrinkable(db).await
}

/// A row whose content is to be moved; none when a process beside this one has finished.
async fn first(db: &mut SqliteConnection, place: &Place) -> Result<Option<String>> {
    let row = sqlx::query_scalar(place.first).fetch_optional(db).await;
    match row {
        Err(sqlx::Error::Database(error)) if error.message().contains("no such table") => Ok(None),
        row => Ok(row?),
    }
}

async fn move_one(
    db: &mut SqliteConnection,
    objects: &Objects,
    place: &Place,
    row: &str,
) -> Result<()> {
    let mut data = Vec::new();
    for chunk in sqlx::query(place.read)
        .bind(row)
        .fetch_all(&mut *db)
        .await?
    {
        data.extend_from_slice(chunk.try_get::<&[u8], _>(0)?);
    }
    let kept = objects.put(&new_key(), Bytes::from(data)).await?;
    sqlx::query("BEGIN IMMEDIATE").execute(&mut *db).await?;
    let named = name(db, place, row, &kept).await;
    let end = if matches!(named, Ok(true)) {
        "COMMIT"
    } else {
        "ROLLBACK"
    };
    sqlx::query(end).execute(&mut *db).await?;
    if !named? {
        // Another process was first, or took it for garbage. Nobody else knows this key.
        objects.remove(&[kept.key]).await?;
    }
    Ok(())
}

/// Names an object in the place of old content; whether that was still there.
async fn name(db: &mut SqliteConnection, place: &Place, row: &str, kept: &Kept) -> Result<bool> {
    let named = sqlx::query(place.name)
        .bind(row)
        .bind(&kept.key)
        .bind(kept.bytes as i64)
        .execute(&mut *db)
        .await?;
    sqlx::query(place.delete).bind(row).execute(db).await?;
    Ok(named.rows_affected() == 1)
}

async fn drop_tables(db: &mut SqliteConnection) -> Result<()> {
    for statement in [
        "BEGIN IMMEDIATE",
        "DROP TABLE IF EXISTS mesh_chunks",
        "DROP TABLE IF EXISTS models_before",
        "DROP TABLE IF EXISTS checkpoints_before",
        "COMMIT",
    ] {
        sqlx::query(statement).execute(&mut *db).await?;
    }
    Ok(())
}

/// Lets the database give free pages back, which one from before cannot; it is written anew once.
async fn make_shrinkable(db: &mut SqliteConnection) -> Result<()> {
    const NONE: i64 = 0;
    let mode: i64 = sqlx::query_scalar("PRAGMA auto_vacuum")
        .fetch_one(&mut *db)
        .await?;
    if mode == NONE {
        // The mode that is wanted was set when the connection was made.
        if let Err(error) = sqlx::query("VACUUM").execute(db).await {
            tracing::warn!(error.message = %error,
                "the database keeps the space of erased rows until the next start");
        }
    }
    Ok(())
}
