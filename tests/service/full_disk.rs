//! A disk that is really full: a small file system in memory.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use meshway::jobs::Status;
use serde_json::json;

use crate::http::support::sphere_xyz;
use crate::server::{Folder, PATIENCE, until};
use crate::wire::Connection;

/// A mounted tmpfs; unmounted when it is dropped.
struct SmallDisk<'a>(&'a Path);

impl<'a> SmallDisk<'a> {
    /// None where this process may not mount.
    fn mount(folder: &'a Path) -> Option<Self> {
        let mounted = Command::new("mount")
            .args(["-t", "tmpfs", "-o", "size=24m", "meshway-test"])
            .arg(folder)
            .output();
        match mounted {
            Ok(output) if output.status.success() => Some(Self(folder)),
            _ => None,
        }
    }
}

impl Drop for SmallDisk<'_> {
    fn drop(&mut self) {
        // Lazily: a server that a failed test leaves still has files open.
        drop(Command::new("umount").arg("-l").arg(self.0).output());
    }
}

/// Writes until no more than so many bytes are free.
fn fill(disk: &Path, leave: u64) -> PathBuf {
    let ballast = disk.join(format!("ballast-{leave}"));
    let mut file = File::create(&ballast).unwrap();
    let free = || {
        let space = rustix::fs::statvfs(disk).unwrap();
        space.f_bavail * space.f_frsize
    };
    while free() > leave && file.write_all(&[1; 4_096]).is_ok() {}
    ballast
}

#[expect(clippy::print_stderr, reason = "a test that was not made is said so")]
fn skip() {
    eprintln!("skipped: no file system can be mounted here");
}

#[tokio::test]
async fn a_full_disk_refuses_new_work_corrupts_nothing_and_passes() {
    let place = tempfile::tempdir().unwrap();
    let Some(_disk) = SmallDisk::mount(place.path()) else {
        skip();
        return;
    };
    let folder = Folder::at(tempfile::tempdir_in(place.path()).unwrap()).await;
    let server = folder
        .serve(&["--script=sleep:3", "--disk-reserve-mib=4"])
        .await;
    let mut connection = Connection::open(server.address()).await.unwrap();
    let ended = folder.submit(json!({})).await;
    assert_eq!(folder.end(&ended).await.status, Status::Succeeded);
    let running = folder.submit(json!({})).await;
    let waiting = folder.submit(json!({})).await;
    let unwanted = folder.submit(json!({})).await;
    folder.running(&running).await;

    // Below the reserve: nothing new, all the rest.
    let first = fill(place.path(), 2 << 20);
    let job = json!({ "cloud_id": folder.cloud_id() });
    until("new work is refused", PATIENCE, async || {
        let answer = connection.post("/v1/jobs", "", &job).await.unwrap();
        (answer.status == 507).then_some(())
    })
    .await;
    let upload = sphere_xyz(2_000, 0.0);
    for (line, body, status) in [
        ("POST /v1/clouds".to_owned(), upload.as_bytes(), 507),
        (format!("POST /v1/jobs/{unwanted}/cancel"), b"", 200),
        (format!("DELETE /v1/jobs/{unwanted}"), b"", 204),
    ] {
        // A connection for each: that of a refused upload is closed.
        let mut connection = Connection::open(server.address()).await.unwrap();
        let answer = connection.ask(&line, "", &[body]).await.unwrap();
        assert_eq!(answer.status, status, "{line}: {}", answer.json());
    }
    // Not a byte left: what is there can be read.
    let second = fill(place.path(), 0);
    for path in ["/v1/jobs".to_owned(), format!("/v1/jobs/{ended}/report")] {
        let read = connection.ask(&format!("GET {path}"), "", &[]).await;
        assert_eq!(read.unwrap().status, 200, "{path}");
    }
    for mesh in ["mesh.ply", "mesh.obj", "mesh.stl"] {
        let line = format!("GET /v1/jobs/{ended}/{mesh}");
        let read = connection.ask(&line, "", &[]).await.unwrap();
        assert_eq!(read.status, 200, "{line}: {}", read.json());
    }
    let refused = connection.post("/v1/jobs", "", &job).await.unwrap();
    assert_eq!(refused.status, 507, "{}", refused.json());
    // What is asked for by the 507 can be done.
    let line = format!("DELETE /v1/jobs/{ended}");
    let erased = connection.ask(&line, "", &[]).await;
    let erased = erased.unwrap_or_else(|error| panic!("{error}: {}", server.log()));
    assert_eq!(erased.status, 204, "{}", server.log());

    fs::remove_file(second).unwrap();
    fs::remove_file(first).unwrap();
    until("new work is taken again", PATIENCE, async || {
        let answer = connection.post("/v1/jobs", "", &job).await.unwrap();
        (answer.status == 202).then_some(())
    })
    .await;
    for id in [&running, &waiting] {
        let job = folder.end(id).await;
        assert_eq!(job.status, Status::Succeeded, "{}", server.log());
        folder.events(id).await;
    }
    let sound: String = sqlx::query_scalar("PRAGMA integrity_check")
        .fetch_one(&mut folder.connection().await)
        .await
        .unwrap();
    assert_eq!(sound, "ok");
}
