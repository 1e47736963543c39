//! What the service does under load: a real server, and clients over HTTP, on the same machine.
//!
//! Prints a Markdown table; fails when a promise is not kept. Takes about two minutes and a half.
#![expect(clippy::unwrap_used, reason = "a benchmark fails by panicking")]

mod events;
mod report;
mod requests;
mod server;
mod streams;
mod uploads;
#[path = "../../tests/service/wire.rs"]
mod wire;

use std::process::ExitCode;
use std::time::Duration;

use report::Report;

/// Longest time of the whole run; it ends with an error then.
const LONGEST: Duration = Duration::from_mins(4);

#[tokio::main]
#[expect(clippy::print_stdout, reason = "the table is the output")]
#[expect(clippy::print_stderr, reason = "failures belong beside the table")]
async fn main() -> ExitCode {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let load = load.split(' ').next().unwrap_or("unknown");
    println!("{cores} cores, shared by server, worker and clients; load before the run: {load}\n");
    let mut report = Report::default();
    let stages = async {
        requests::submits(&mut report).await;
        requests::reads(&mut report).await;
        requests::keys(&mut report).await;
        streams::lag(&mut report).await;
        streams::many(&mut report).await;
        uploads::uploads(&mut report).await;
    };
    let done = tokio::time::timeout(LONGEST, stages).await;
    println!("{}", report.table());
    report.save().unwrap();
    if done.is_err() {
        eprintln!("not done within {LONGEST:?}");
        return ExitCode::FAILURE;
    }
    for broken in report.broken() {
        eprintln!("not kept: {broken}");
    }
    if report.broken().is_empty() {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}
