//! The `meshway` program.

use std::process::ExitCode;

fn main() -> ExitCode {
    meshway::cli::main()
}
