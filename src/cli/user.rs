//! `meshway user`: people for a service, which keeps only hashes of their passwords.

use std::io::{IsTerminal, Read};
use std::path::Path;

use clap::{Args, Subcommand};

use super::Failure;
use super::files::Sink;
use super::key::{list, quoted};
use crate::identity::{Keyring, MOST_PASSWORD, Password, Scope, Tenant};

/// Arguments of `meshway user`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Ask for a password, and print what the file of `serve --config` gets of it. Without a terminal it
    /// is read from standard input.
    Passwd(Passwd),
}

#[derive(Debug, Args)]
struct Passwd {
    /// The name to sign in with.
    name: String,
    /// Whose clouds and jobs are shown.
    #[arg(long, default_value = Tenant::DEFAULT)]
    tenant: Tenant,
    /// What is allowed, with commas between: read, write, delete, audit, admin.
    #[arg(long, value_delimiter = ',', default_value = "read,write")]
    scopes: Vec<Scope>,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let What::Passwd(new) = &arguments.what;
    let password = Password::of(&ask(&new.name)?).map_err(Failure::Usage)?;
    let block = new.block(&password);
    // What is printed is what a service will take.
    Keyring::of_file(&block).map_err(|fault| Failure::Usage(fault.to_string()))?;
    Sink::new(Path::new("-"))?.write(|out| out.write_all(block.as_bytes()))
}

/// The password: twice from a terminal, which does not show it, or the first line of what is piped.
fn ask(name: &str) -> Result<String, Failure> {
    let unread =
        |error: std::io::Error| Failure::Usage(format!("the password was not read: {error}"));
    if std::io::stdin().is_terminal() {
        let prompt = |text: String| rpassword::prompt_password(text).map_err(unread);
        let first = prompt(format!("Password of {name}: "))?;
        if prompt("Again: ".to_owned())? == first {
            return Ok(first);
        }
        return Err(Failure::Usage(
            "the two passwords differ; nothing is changed".to_owned(),
        ));
    }
    let mut text = String::new();
    let most = MOST_PASSWORD as u64 + 2;
    std::io::stdin()
        .take(most)
        .read_to_string(&mut text)
        .map_err(unread)?;
    Ok(text.lines().next().unwrap_or_default().to_owned())
}

impl Passwd {
    fn block(&self, password: &Password) -> String {
        let scopes: Vec<_> = self.scopes.iter().map(ToString::to_string).collect();
        format!(
            "[[users]]\nname = {}\ntenant = {}\npassword = {}\nscopes = {}\n",
            quoted(&self.name),
            quoted(self.tenant.as_str()),
            quoted(&password.to_string()),
            list(&scopes),
        )
    }
}
