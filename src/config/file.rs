//! A configuration file as flags of the command line.

use std::ffi::OsString;
use std::num::{IntErrorKind, ParseIntError};

use clap::Command;
use clap::builder::Resettable;
use clap::error::{ContextKind, ContextValue};
use thiserror::Error;
use toml::de::{DeTable, DeValue};

use crate::identity::told;
use crate::nearest::did_you_mean;

/// The parts of the file that are no settings: [`crate::identity::Keyring`] reads them.
const KEYS: [&str; 3] = ["keys", "users", "tenants"];

/// Why a configuration file is refused.
#[derive(Debug, Error)]
pub enum FileError {
    /// Not TOML.
    #[error("{0}")]
    Syntax(String),
    /// Keys that no setting has, and values that their settings do not take: a line for each, with
    /// its line in the file, and what is allowed.
    #[error("{0}")]
    Settings(String),
}

/// Turns the keys of a configuration file into flags of `command`, leaving out those that the
/// environment sets: flags given later on the command line override them.
///
/// # Errors
/// [`FileError`] for text that is no flat TOML, and for unknown keys.
pub fn file_arguments(text: &str, command: &Command) -> Result<Vec<OsString>, FileError> {
    let table = DeTable::parse(text).map_err(|error| FileError::Syntax(told(&error, text)))?;
    // What the environment says is not the file's fault.
    let alone = command
        .clone()
        .no_binary_name(true)
        .mut_args(|argument| argument.env(Resettable::Reset));
    let known = command.get_arguments().filter(|a| a.get_env().is_some());
    let known: Vec<_> = known.map(|a| a.get_id().as_str()).collect();
    let (mut arguments, mut faults) = (Vec::new(), Vec::new());
    for (key, value) in table.get_ref() {
        let name = key.get_ref().as_ref();
        if KEYS.contains(&name) {
            continue;
        }
        match file_argument(name, value.get_ref(), &known, &alone) {
            // The environment wins, also over a value that is fine.
            Ok(_) if in_environment(name, command) => {}
            Ok(flag) => arguments.push(flag.into()),
            Err(detail) => {
                let line = 1 + text[..key.span().start].matches('\n').count();
                faults.push((line, format!("line {line}: {name} {detail}")));
            }
        }
    }
    if faults.is_empty() {
        return Ok(arguments);
    }
    faults.sort();
    let faults: Vec<_> = faults.into_iter().map(|(_, fault)| fault).collect();
    Err(FileError::Settings(faults.join("\n")))
}

fn in_environment(key: &str, command: &Command) -> bool {
    let mut arguments = command.get_arguments();
    let argument = arguments.find(|argument| argument.get_id().as_str() == key);
    let name = argument.and_then(clap::Arg::get_env);
    name.is_some_and(|name| std::env::var_os(name).is_some())
}

/// The flag of a key, or what is wrong with the key or its value.
fn file_argument(
    key: &str,
    value: &DeValue<'_>,
    known: &[&str],
    command: &Command,
) -> Result<String, String> {
    if !known.contains(&key) {
        let meant = did_you_mean(key, known.iter().copied());
        let known = known.join(", ");
        return Err(format!("is unknown; known are: {known}{meant}"));
    }
    let value = match value {
        DeValue::String(text) => text.clone().into_owned(),
        DeValue::Integer(number) => number.to_string(),
        DeValue::Float(number) => number.to_string(),
        DeValue::Boolean(switch) => switch.to_string(),
        _ => return Err("must be a string, a number or a boolean".to_owned()),
    };
    let flag = format!("--{}={value}", key.replace('_', "-"));
    match command.clone().try_get_matches_from([&flag]) {
        Ok(_) => Ok(flag),
        Err(error) => Err(format!("is {value:?}: {}", reason(&error))),
    }
}

/// Why a value is refused, without what is said about flags.
fn reason(error: &clap::Error) -> String {
    let allowed = match error.get(ContextKind::ValidValue) {
        Some(ContextValue::Strings(names)) => Some(format!("must be one of {}", names.join(", "))),
        _ => None,
    };
    let source = || {
        let source = std::error::Error::source(error)?;
        let number = source.downcast_ref::<ParseIntError>();
        match number.map(ParseIntError::kind) {
            Some(IntErrorKind::InvalidDigit | IntErrorKind::Empty) => {
                Some("must be a whole number".to_owned())
            }
            _ => Some(source.to_string()),
        }
    };
    let reason = allowed.or_else(source);
    reason.unwrap_or_else(|| error.kind().to_string())
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::super::Config;
    use super::*;

    #[derive(Debug, Parser)]
    struct Program {
        #[command(flatten)]
        config: Config,
    }

    #[test]
    fn what_is_wrong_in_the_file_is_told_with_its_line() {
        let command = <Program as clap::CommandFactory>::command();
        for (wrong, said) in [
            ("worker = 3", "worker is unknown; known are: listen, "),
            ("worker = 3", "; did you mean workers?"),
            (
                "workers = \"many\"",
                "workers is \"many\": must be a whole number",
            ),
            ("workers = 300", "workers is \"300\": 300 is not in 0..=256"),
            (
                "workers = 1.5",
                "workers is \"1.5\": must be a whole number",
            ),
            ("max_points = 0", "max_points is \"0\": 0 is not in 16.."),
            (
                "workers = [1]",
                "workers must be a string, a number or a boolean",
            ),
            (
                "log_format = \"xml\"",
                "log_format is \"xml\": must be one of text, json",
            ),
            ("listen = \"here\"", "listen is \"here\": must be HOST:PORT"),
            (
                "allow_unauthenticated = 7",
                "allow_unauthenticated is \"7\": ",
            ),
        ] {
            let file = format!("# servers\nqueue_limit = 7\n{wrong}\n");
            let error = file_arguments(&file, &command).unwrap_err().to_string();
            assert!(error.starts_with("line 3: "), "{wrong}: {error}");
            assert!(error.contains(said), "{wrong}: {error}");
        }
        let error = file_arguments("worker = 3\nqueu_limit = 7\n", &command).unwrap_err();
        let lines: Vec<_> = error.to_string().lines().map(str::to_owned).collect();
        assert!(lines[0].starts_with("line 1: worker is unknown"), "{error}");
        assert!(
            lines[1].starts_with("line 2: queu_limit is unknown"),
            "{error}"
        );
        let error = file_arguments("workers = \n", &command).unwrap_err();
        assert!(error.to_string().contains("line 1"), "{error}");
    }
}
