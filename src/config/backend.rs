//! What the service stands on besides its folder: where the rows and the bytes are kept.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use clap::Args;
use serde::{Deserialize, Serialize};
use url::{Host, Url};

use super::DatabaseUrl;

/// Settings of what the service stands on besides its folder.
#[derive(Debug, Clone, Default, Serialize, Args)]
pub struct Backend {
    /// Postgres database for the rows, as in `postgres://meshway@db.example/meshway?sslmode=verify-full`;
    /// without it, SQLite in the data folder. The password is best in PGPASSWORD or PGPASSFILE.
    #[arg(long, env = "MESHWAY_DATABASE", hide_env_values = true)]
    pub database: Option<DatabaseUrl>,

    /// Say that a pooler in transaction mode, such as `PgBouncer`, stands before the database: nothing is
    /// asked of a session then that would have to stay the same from one transaction to the next.
    #[arg(long, env = "MESHWAY_DATABASE_POOLED", num_args = 0..=1, require_equals = true,
          default_value_t = false, default_missing_value = "true", action = clap::ArgAction::Set)]
    pub database_pooled: bool,

    /// Object store of the kind of S3 for meshes, networks, checkpoints and clouds, as in
    /// `s3://bucket/prefix?endpoint=https://s3.example&region=eu-1`; without it, they are in the
    /// data folder. The credentials are those of the environment (`AWS_…`).
    #[arg(long, env = "MESHWAY_OBJECTS")]
    pub objects: Option<ObjectsUrl>,

    /// Take a database or an object store on another machine without TLS that knows its name.
    #[arg(long, env = "MESHWAY_INSECURE_BACKEND", num_args = 0..=1, require_equals = true,
          default_value_t = false, default_missing_value = "true", action = clap::ArgAction::Set)]
    pub insecure_backend: bool,
}

impl Backend {
    /// What others could read or change on the way, each in one sentence.
    pub fn exposures(&self) -> Vec<String> {
        if self.insecure_backend {
            return Vec::new();
        }
        let rows = self.database.as_ref().and_then(DatabaseUrl::exposure);
        let bytes = self.objects.as_ref().and_then(ObjectsUrl::exposure);
        rows.into_iter().chain(bytes).collect()
    }
}

/// A bucket of an object store, and the part of it that is ours. It holds no credentials.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct ObjectsUrl {
    text: String,
    /// Name of the bucket.
    pub bucket: String,
    /// What the names of all objects begin with, without slashes at its ends; may be empty.
    pub prefix: String,
    /// Where the store is; none: Amazon's.
    pub endpoint: Option<Url>,
    /// Its region; none: that of the environment.
    pub region: Option<String>,
    /// Whether the bucket is part of the path of an address, not of its host.
    pub path_style: bool,
    /// Authorities of the endpoint, as PEM, besides those that the system knows.
    pub ca: Option<PathBuf>,
}

impl ObjectsUrl {
    /// What a network between here and the store could read.
    fn exposure(&self) -> Option<String> {
        self.is_open_to_others().then(|| {
            format!(
                "--objects {self}: clouds and surfaces would travel unencrypted to another \
                 machine; give an endpoint with https://, or --insecure-backend"
            )
        })
    }

    fn is_open_to_others(&self) -> bool {
        let Some(endpoint) = &self.endpoint else {
            return false;
        };
        let here = match endpoint.host() {
            Some(Host::Domain(name)) => name == "localhost",
            Some(Host::Ipv4(address)) => address.is_loopback(),
            Some(Host::Ipv6(address)) => address.is_loopback(),
            None => false,
        };
        endpoint.scheme() == "http" && !here
    }
}

impl FromStr for ObjectsUrl {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = "must be as s3://bucket/prefix?endpoint=https://s3.example&region=eu-1";
        let url = Url::parse(text).map_err(|error| format!("{form}: {error}"))?;
        if url.scheme() != "s3" {
            return Err(form.to_owned());
        }
        if !url.username().is_empty() || url.password().is_some() || url.port().is_some() {
            let detail = "credentials are taken from the environment, and hosts from endpoint=…";
            return Err(format!("{form}; {detail}"));
        }
        let bucket = url.host_str().unwrap_or_default().to_owned();
        let prefix = url.path().trim_matches('/').to_owned();
        let plain = |text: &str| {
            let fits = |c: char| c.is_ascii_alphanumeric() || "-._".contains(c);
            !["", ".", ".."].contains(&text) && text.chars().all(fits)
        };
        if !plain(&bucket) || !(prefix.is_empty() || prefix.split('/').all(plain)) {
            let detail = "bucket and prefix have letters, digits, - . _ only";
            return Err(format!("{form}; {detail}"));
        }
        let mut objects = Self {
            text: text.to_owned(),
            bucket,
            prefix,
            endpoint: None,
            region: None,
            path_style: false,
            ca: None,
        };
        let mut style = None;
        for (name, value) in url.query_pairs() {
            let value = value.into_owned();
            match &*name {
                "endpoint" => objects.endpoint = Some(endpoint(&value)?),
                "region" => objects.region = Some(value),
                "ca" => objects.ca = Some(value.into()),
                "style" => style = Some(value),
                _ => {
                    return Err(format!(
                        "{name} is unknown; known are endpoint, region, style, ca"
                    ));
                }
            }
        }
        objects.path_style = match style.as_deref() {
            Some("path") => true,
            Some("virtual") => false,
            None => objects.endpoint.is_some(),
            Some(_) => return Err("style must be path or virtual".to_owned()),
        };
        Ok(objects)
    }
}

fn endpoint(text: &str) -> Result<Url, String> {
    let url = Url::parse(text).map_err(|error| format!("endpoint: {error}"))?;
    let bare = url.username().is_empty() && url.password().is_none() && url.query().is_none();
    if !["http", "https"].contains(&url.scheme()) || !bare || url.path() != "/" {
        return Err("endpoint must be as https://s3.example:9000, without credentials".to_owned());
    }
    Ok(url)
}

impl fmt::Display for ObjectsUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl From<ObjectsUrl> for String {
    fn from(url: ObjectsUrl) -> Self {
        url.text
    }
}

impl TryFrom<String> for ObjectsUrl {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_names_bucket_prefix_and_store() {
        let text = "s3://scans/meshway/a?endpoint=http://[::1]:9000&region=eu-1&ca=/etc/ca.pem";
        let url: ObjectsUrl = text.parse().unwrap();
        assert_eq!((&*url.bucket, &*url.prefix), ("scans", "meshway/a"));
        assert_eq!(url.region.as_deref(), Some("eu-1"));
        assert_eq!(url.ca, Some(PathBuf::from("/etc/ca.pem")));
        assert!(url.path_style && !url.is_open_to_others());
        assert_eq!(url.to_string(), text);
        let amazon: ObjectsUrl = "s3://scans".parse().unwrap();
        assert!(!amazon.path_style && amazon.prefix.is_empty() && !amazon.is_open_to_others());
        let style = "s3://a?endpoint=http://s3.example&style=virtual";
        let open: ObjectsUrl = style.parse().unwrap();
        assert!(!open.path_style && open.is_open_to_others());
    }

    #[test]
    fn what_is_no_address_is_refused_with_a_reason() {
        for (text, reason) in [
            ("bucket", "s3://bucket/prefix"),
            ("https://s3.example/bucket", "s3://bucket/prefix"),
            ("s3://key:secret@bucket", "environment"),
            ("s3://bucket/a//b", "letters"),
            ("s3://bucket/..%2fb", "letters"),
            ("s3://", "letters"),
            ("s3://bucket?endpoint=s3.example", "endpoint"),
            ("s3://bucket?endpoint=ftp://s3.example", "https://"),
            ("s3://bucket?style=other", "path or virtual"),
            ("s3://bucket?secret=1", "secret is unknown"),
        ] {
            let refused = text.parse::<ObjectsUrl>().unwrap_err();
            assert!(refused.contains(reason), "{text}: {refused}");
        }
    }
}
