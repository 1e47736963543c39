//! `meshway` with workers that do as a script says in place of reconstructing: for tests of the
//! service and for its benchmark. `--script=SCRIPT` chooses the script; without it this is the
//! program itself.

mod script;

use std::ffi::OsString;
use std::process::ExitCode;
use std::sync::Arc;

use meshway::cli::{self, Substitute};
use meshway::jobs::worker::Assignment;
use meshway::reconstruction::Observer;
use script::Script;

const FLAG: &str = "--script=";

fn main() -> ExitCode {
    let (mut scripts, line): (Vec<OsString>, Vec<OsString>) =
        std::env::args_os().partition(|argument| argument.to_string_lossy().starts_with(FLAG));
    let substitute = scripts.pop().map(|flag| {
        let script = flag.to_string_lossy().replacen(FLAG, "", 1);
        let script: Script = script.parse().expect("a script is named");
        Substitute {
            work: Arc::new(move |assignment: &Assignment, observer: &dyn Observer| {
                script.run(assignment.settings.training.seed, observer)
            }),
            flag,
        }
    });
    cli::main_with(&line, substitute.as_ref())
}
