//! Where clouds come from and results go to, and what is found out before the work.

use std::fs;
use std::net::TcpListener;
use std::process::{Command, Stdio};

use tempfile::TempDir;

use crate::command_line::{meshway, quick, strings, succeed};

/// The clouds, and a sphere far from the origin.
fn folder() -> TempDir {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    succeed(at, &["sample", "sphere", "-n", "300", "-o", "a.xyz"]);
    fs::copy(at.join("a.xyz"), at.join("b.xyz")).unwrap();
    let text = fs::read_to_string(at.join("a.xyz")).unwrap();
    let moved = text.lines().filter_map(|line| {
        let mut numbers = line.split_whitespace().map(str::parse::<f64>);
        let (x, y, z) = (
            numbers.next()?.ok()?,
            numbers.next()?.ok()?,
            numbers.next()?.ok()?,
        );
        Some(format!("{} {} {}\n", x + 5e5, y + 5.4e6, z + 300.0))
    });
    fs::write(at.join("far.xyz"), moved.collect::<String>()).unwrap();
    fs::create_dir(at.join("out")).unwrap();
    folder
}

#[test]
fn a_cloud_may_come_from_standard_input() {
    let folder = folder();
    let mut program = Command::new(env!("CARGO_BIN_EXE_meshway"));
    let input = fs::File::open(folder.path().join("a.xyz")).unwrap();
    let output = program
        .args(quick("-", "-", &[]))
        .current_dir(folder.path())
        .stdin(Stdio::from(input))
        .output()
        .unwrap();
    assert!(output.status.success(), "{output:?}");
    assert!(output.stdout.starts_with(b"ply\n"));
}

#[test]
fn several_clouds_have_a_mesh_each() {
    let folder = folder();
    let line = quick("a.xyz", "out", &["b.xyz", "--format=off", "--report=out"]);
    succeed(folder.path(), &strings(&line));
    for name in ["a.off", "b.off"] {
        let mesh = fs::read_to_string(folder.path().join("out").join(name)).unwrap();
        assert!(mesh.starts_with("OFF\n"), "{name}");
    }
    assert!(folder.path().join("out/b.json").is_file());
    fs::copy(folder.path().join("a.xyz"), folder.path().join("out/a.xyz")).unwrap();
    let line = quick("a.xyz", "out", &["out/a.xyz"]);
    let twice = meshway(folder.path(), &strings(&line));
    assert_eq!(twice.status.code(), Some(2), "{twice:?}");
}

#[test]
fn a_place_that_cannot_be_written_is_told_before_the_work() {
    let folder = folder();
    for (output, more) in [
        ("/proc/a.ply", &[][..]),
        ("a.ply", &["--report=/proc/a.json"]),
    ] {
        let mut line = quick("no-such-cloud.xyz", output, more);
        line.retain(|word| word != "--quiet");
        let refused = meshway(folder.path(), &strings(&line));
        // The cloud, which is not there, was not looked for yet.
        assert_eq!(refused.status.code(), Some(1), "{refused:?}");
        let message = String::from_utf8(refused.stderr).unwrap();
        assert!(
            message.contains("/proc/a.") && message.contains("cannot be written"),
            "{message}"
        );
    }
}

#[test]
fn stl_far_from_the_origin_is_refused_before_the_work() {
    let folder = folder();
    let refused = meshway(folder.path(), &strings(&quick("far.xyz", "far.stl", &[])));
    assert_eq!(refused.status.code(), Some(2), "{refused:?}");
    let message = String::from_utf8(refused.stderr).unwrap();
    assert!(
        message.contains("STL") && message.contains("ply"),
        "{message}"
    );
    assert!(!folder.path().join("far.stl").exists());
    succeed(folder.path(), &strings(&quick("far.xyz", "far.ply", &[])));
    let measured = succeed(folder.path(), &["evaluate", "far.ply"]);
    assert!(measured.contains("\"closed\": true"), "{measured}");
}

#[test]
fn shells_and_readers_are_told_of_the_program() {
    let folder = folder();
    let bash = succeed(folder.path(), &["completions", "bash"]);
    assert!(bash.contains("reconstruct") && bash.contains("--preset"));
    assert!(succeed(folder.path(), &["man"]).contains(".TH meshway"));
    succeed(folder.path(), &["man", "out"]);
    assert!(folder.path().join("out/meshway-reconstruct.1").is_file());
}

#[test]
fn health_asks_the_address_that_it_is_given() {
    let folder = TempDir::new().unwrap();
    let Ok(listener) = TcpListener::bind("[::1]:0") else {
        // A machine without IPv6.
        return;
    };
    let address = listener.local_addr().unwrap().to_string();
    let answers = std::thread::Builder::new().spawn(move || {
        use std::io::{Read, Write};
        let (mut stream, _) = listener.accept().unwrap();
        let mut head = [0; 512];
        assert!(stream.read(&mut head).unwrap() > 0);
        stream.write_all(b"HTTP/1.1 200 OK\r\n\r\n").unwrap();
    });
    succeed(folder.path(), &["health", "--listen", &address]);
    answers.unwrap().join().unwrap();
}

#[test]
fn a_reader_ends_with_whoever_started_it() {
    let folder = folder();
    let pipe = folder.path().join("pipe");
    assert!(
        Command::new("mkfifo")
            .arg(&pipe)
            .status()
            .unwrap()
            .success()
    );
    let mut reader = Command::new(env!("CARGO_BIN_EXE_meshway"))
        .args(["inspect", "--until-input-ends"])
        .arg(&pipe)
        .stdin(Stdio::piped())
        .spawn()
        .unwrap();
    // It waits for somebody who writes, and nobody does.
    assert!(reader.try_wait().unwrap().is_none());
    drop(reader.stdin.take());
    assert!(!reader.wait().unwrap().success());
}
