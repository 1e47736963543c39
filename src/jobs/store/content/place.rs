//! Which place a database has its content in: once it is an object store it stays one.

use std::path::Path;
use std::sync::Arc;

use super::bring;
use super::bucket::Bucket;
use super::embedded::Embedded;
use super::objects::Objects;
use crate::jobs::store::Options;
use crate::jobs::store::postgres::home;
use crate::jobs::store::sql::{Db, query, scalar};
use crate::jobs::{Error, Result};

/// Opens the content where the options have it. A service finds that the place is the right one, and takes
/// what is in the folder along.
///
/// # Errors
/// `ContentRefused` if it is not; `Elsewhere` if it is another folder than this one.
pub(in crate::jobs::store) async fn open(
    db: &mut Db<'_>,
    data_dir: &Path,
    options: &Arc<Options>,
) -> Result<Objects> {
    let select = "SELECT value FROM meta WHERE name = 'objects'";
    let used: Option<String> = scalar(select).fetch_optional(&mut *db).await?;
    let Some(url) = &options.objects else {
        if let (Some(used), false) = (used, options.rows_only) {
            return Err(Error::ContentRefused(format!(
                "the content of this folder is in the object store {used}; name it with --objects"
            )));
        }
        if matches!(db, Db::Postgres(..)) && !options.rows_only {
            home::settle(db, data_dir).await?;
        }
        return Ok(Objects::Embedded(Embedded::open(data_dir, options).await?));
    };
    let bucket = Bucket::new(url, options)?;
    // Who started a worker process has looked.
    if options.process.is_empty() && !options.rows_only {
        if used.is_none() && options.only_works {
            return Err(Error::ContentRefused(
                "no service has used this database with an object store yet; start one first"
                    .to_owned(),
            ));
        }
        let select = "SELECT value FROM meta WHERE name = 'id'";
        let id: String = scalar(select).fetch_one(&mut *db).await?;
        bucket.take(&id, used.is_some()).await?;
        if !options.only_works {
            let on_server = matches!(db, Db::Postgres(..));
            if on_server {
                home::check(db, data_dir).await?;
            }
            let upsert = "INSERT INTO meta (name, value) VALUES ('objects', ?1)
                          ON CONFLICT (name) DO UPDATE SET value = excluded.value";
            let url = bucket.url().to_string();
            query(upsert).bind(url).execute(&mut *db).await?;
            bring::all(db, data_dir, options, &bucket).await?;
            if on_server {
                home::leave(db).await?;
            }
        }
    }
    Ok(Objects::Bucket(Box::new(bucket)))
}
