//! `meshway key`: keys for a service, which keeps only their hashes.

use std::path::Path;

use clap::{Args, Subcommand};
use ipnet::IpNet;
use toml::value::Datetime;

use super::Failure;
use super::files::Sink;
use crate::identity::{Keyring, Scope, Secret, Tenant, file};

/// Arguments of `meshway key`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Make a key: print it, this once, and what the file of `serve --config` gets of it.
    New(New),
}

#[derive(Debug, Args)]
struct New {
    /// Its name in lists and in the audit trail.
    #[arg(long)]
    name: String,
    /// Whose clouds and jobs it opens.
    #[arg(long, default_value = Tenant::DEFAULT)]
    tenant: Tenant,
    /// What it allows, with commas between: read, write, delete, audit, admin.
    #[arg(long, value_delimiter = ',', required = true)]
    scopes: Vec<Scope>,
    /// Its last day, in UTC, as in 2027-12-31, or a moment, as in 2027-12-31T12:00:00Z.
    #[arg(long, value_parser = moment)]
    expires: Option<String>,
    /// The only networks that it may come from, with commas between, as in 10.20.0.0/16.
    #[arg(long, value_delimiter = ',', value_parser = network)]
    networks: Vec<IpNet>,
}

fn moment(text: &str) -> Result<String, String> {
    let form = "must be a day, as in 2027-12-31, or a moment, as in 2027-12-31T12:00:00Z";
    let written = text.parse::<Datetime>().map_err(|_| form)?;
    file::moment(&written).map_err(|_| form)?;
    Ok(text.to_owned())
}

fn network(text: &str) -> Result<IpNet, String> {
    let form = "must be a network, as in 10.20.0.0/16 or fd00::/8";
    text.parse().map_err(|_| form.to_owned())
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let What::New(new) = &arguments.what;
    let secret = Secret::generate()
        .map_err(|error| Failure::Output(format!("no random numbers: {error}")))?;
    let block = new.block(&secret);
    // What is printed is what a service will take.
    Keyring::of_file(&block).map_err(|fault| Failure::Usage(fault.to_string()))?;
    Sink::new(Path::new("-"))?.write(|out| write!(out, "{}\n\n{block}", secret.reveal()))
}

/// A text in TOML.
pub(super) fn quoted(text: &str) -> String {
    toml::Value::from(text).to_string()
}

/// Texts in TOML.
pub(super) fn list(items: &[String]) -> String {
    let items: Vec<_> = items.iter().map(|item| quoted(item)).collect();
    format!("[{}]", items.join(", "))
}

impl New {
    fn block(&self, secret: &Secret) -> String {
        let scopes: Vec<_> = self.scopes.iter().map(ToString::to_string).collect();
        let mut lines = vec![
            "[[keys]]".to_owned(),
            format!("name = {}", quoted(&self.name)),
            format!("tenant = {}", quoted(self.tenant.as_str())),
            format!("hash = {}", quoted(&secret.hash().to_string())),
            format!("scopes = {}", list(&scopes)),
        ];
        lines.extend(self.expires.as_ref().map(|end| format!("expires = {end}")));
        if !self.networks.is_empty() {
            let networks: Vec<_> = self.networks.iter().map(ToString::to_string).collect();
            lines.push(format!("networks = {}", list(&networks)));
        }
        lines.join("\n") + "\n"
    }
}
