use clap::Parser;

use std::ffi::OsString;

use super::*;

#[derive(Debug, Parser)]
#[command(args_override_self = true)]
struct Program {
    #[command(flatten)]
    config: Config,
}

fn parse(file: &str, flags: &[&str]) -> Config {
    let command = <Program as clap::CommandFactory>::command();
    let mut arguments = vec![OsString::from("meshway")];
    arguments.extend(file_arguments(file, &command).unwrap());
    arguments.extend(flags.iter().map(OsString::from));
    Program::try_parse_from(arguments).unwrap().config
}

#[test]
fn flags_win_over_the_file_and_the_file_over_defaults() {
    let config = parse(
        "workers = 3\nqueue_limit = 7\nallow_unauthenticated = true",
        &["--workers=2"],
    );
    assert_eq!(
        (config.workers, config.queue_limit, config.work.max_events),
        (2, 7, 100_000)
    );
    assert!(config.allow_unauthenticated);
}

#[test]
fn an_address_may_have_a_name() {
    for (text, expected) in [
        ("localhost:8080", "127.0.0.1:8080"),
        ("[::1]:80", "[::1]:80"),
    ] {
        assert_eq!(address(text), Ok(expected.parse().unwrap()), "{text}");
    }
    for wrong in ["8080", ":8080", "localhost", "localhost:http"] {
        assert!(address(wrong).unwrap_err().contains("HOST:PORT"), "{wrong}");
    }
}

#[test]
fn a_base_path_may_be_there_or_not() {
    let config = parse("base_path = '/a/b/'", &[]);
    assert_eq!(config.address("/v1/jobs"), "/a/b/v1/jobs");
    for (path, expected) in [
        ("/a/b/v1/jobs", "/v1/jobs"),
        ("/v1/jobs", "/v1/jobs"),
        ("/a/b", "/"),
        ("/a/bc", "/a/bc"),
    ] {
        assert_eq!(config.below_base(path), expected);
    }
    let without = parse("", &["--base-path=/"]);
    assert_eq!(without.address("/v1/jobs"), "/v1/jobs");
    assert_eq!(without.below_base("/v1/jobs"), "/v1/jobs");
    for wrong in ["a", "/a//b", "/a/../b", "/a b", "http://a/b"] {
        assert!(base_path(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn the_printed_configuration_reads_back() {
    let config = parse("", &["--workers", "2", "--log-format", "json"]);
    let text = config.to_toml().unwrap();
    assert_eq!(parse(&text, &[]).to_toml().unwrap(), text);
}

#[test]
fn an_open_address_too_many_threads_and_too_little_memory_are_problems() {
    let config = parse(
        "",
        &[
            "--listen=0.0.0.0:80",
            "--workers=2",
            "--threads-per-worker=4",
        ],
    );
    assert_eq!(config.problems(2).len(), 2);
    let small = parse("", &["--worker-memory-mib=287"]).problems(1);
    assert!(small[0].contains("at least 288"), "{small:?}");
    for enough in ["--worker-memory-mib=288", "--worker-memory-mib=0"] {
        assert!(parse("", &[enough]).problems(1).is_empty());
    }
    assert_eq!(parse("", &["--workers=2"]).work.threads(8, 2), 4);
}

#[test]
fn a_database_elsewhere_is_refused_without_its_certificate_and_shown_without_its_password() {
    let far = "--database=postgres://a:secret@db.example/c";
    let config = parse("", &[far]);
    let problems = config.problems(4);
    assert_eq!(problems.len(), 1, "{problems:?}");
    assert!(problems[0].contains("verify-full"), "{problems:?}");
    let config = parse("", &[far, "--insecure-backend"]);
    assert!(config.problems(4).is_empty());
    let printed = config.to_toml().unwrap();
    assert!(!printed.contains("secret"), "{printed}");
    let again = parse(&printed, &[]).backend.database.unwrap();
    assert_eq!(again.to_string(), "postgres://a@db.example/c");
    let near = "--database=postgres://a@localhost/c?sslmode=disable";
    assert!(parse("", &[near]).problems(4).is_empty());
}
