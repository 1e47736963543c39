//! Addresses of a command line, which may have a password in them: what refuses one does not repeat it.

use std::ffi::OsStr;
use std::marker::PhantomData;
use std::str::FromStr;

use clap::builder::{TypedValueParser, ValueParserFactory};
use clap::error::ErrorKind;
use clap::{Arg, Command, Error};

use super::{DatabaseUrl, ObjectsUrl};

/// Reads an address; its errors tell the flag and the reason.
#[derive(Debug)]
pub struct Quiet<T>(PhantomData<fn() -> T>);

impl<T> Clone for Quiet<T> {
    fn clone(&self) -> Self {
        Self(PhantomData)
    }
}

impl<T> TypedValueParser for Quiet<T>
where
    T: FromStr<Err = String> + Clone + Send + Sync + 'static,
{
    type Value = T;

    fn parse_ref(&self, command: &Command, arg: Option<&Arg>, text: &OsStr) -> Result<T, Error> {
        let text = text.to_str().ok_or_else(|| "is not UTF-8".to_owned());
        text.and_then(str::parse).map_err(|reason| {
            let flag = arg.and_then(Arg::get_long).unwrap_or("address");
            let sentence = format!("--{flag} {reason}\n");
            Error::raw(ErrorKind::ValueValidation, sentence).with_cmd(command)
        })
    }
}

impl ValueParserFactory for DatabaseUrl {
    type Parser = Quiet<Self>;

    fn value_parser() -> Self::Parser {
        Quiet(PhantomData)
    }
}

impl ValueParserFactory for ObjectsUrl {
    type Parser = Quiet<Self>;

    fn value_parser() -> Self::Parser {
        Quiet(PhantomData)
    }
}
