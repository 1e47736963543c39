//! The folder of a service: which ones are taken, and what in them is removed.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, SystemTime};

use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection};
use tempfile::TempDir;

use crate::http::support::sphere_xyz;
use crate::server::{Folder, PROGRAM, Server};
use crate::wire::Connection as Client;

/// All files below a folder, with their content.
fn content(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(content(&path));
        } else {
            found.insert(path.clone(), fs::read(&path).unwrap());
        }
    }
    found
}

fn write(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(&path, text).unwrap();
    path
}

/// A server that is to refuse the folder.
fn refused(folder: &Path) -> Output {
    Command::new(PROGRAM)
        .args(["serve", "--listen=127.0.0.1:0", "--data-dir"])
        .arg(folder)
        .output()
        .unwrap()
}

/// Starts a server in the folder and ends it.
async fn serve_once(folder: &Path) -> String {
    let logs = tempfile::tempdir().unwrap();
    let log = logs.path().join("log");
    let server = Server::start(folder, log.clone(), &["--script=instant"]).await;
    server.terminate().await;
    fs::read_to_string(log).unwrap()
}

fn place() -> TempDir {
    tempfile::tempdir().unwrap()
}

/// A file that changed after the database was made.
fn later(path: &Path) {
    let time = SystemTime::now() + Duration::from_mins(1);
    File::options()
        .write(true)
        .open(path)
        .unwrap()
        .set_modified(time)
        .unwrap();
}

#[tokio::test]
async fn a_folder_with_other_things_is_refused_and_stays_as_it_is() {
    let hash = "5".repeat(64);
    for names in [
        &[
            "tmp/thesis.tex",
            "clouds/scan.ply",
            "cache/pip/deep/x",
            "lock",
            "Documents/a",
        ][..],
        &["lock"],
        &["cache/pip/x"],
        &["notes.txt"],
        // Clouds whose database is elsewhere.
        &[&format!("clouds/{hash}")],
        &["meshway.db", "notes.txt"],
    ] {
        let place = place();
        for name in names {
            write(place.path(), name, "precious");
        }
        let before = content(place.path());
        let output = refused(place.path());
        let message = String::from_utf8(output.stderr).unwrap();
        assert!(
            matches!(output.status.code(), Some(1 | 2)),
            "{names:?}: {message}"
        );
        assert!(
            message.contains(&*place.path().to_string_lossy()),
            "{message}"
        );
        assert_eq!(content(place.path()), before, "{message}");
    }
}

#[tokio::test]
async fn the_refusal_says_what_is_there_and_what_to_do() {
    let place = place();
    for name in ["tmp/a", "clouds/b", "cache/c", "lock"] {
        write(place.path(), name, "precious");
    }
    let output = refused(place.path());
    assert_eq!(output.status.code(), Some(2));
    let message = String::from_utf8(output.stderr).unwrap();
    for part in [
        "(cache, clouds, lock, …)",
        "nothing was changed",
        "empty",
        "put its meshway.db back",
    ] {
        assert!(message.contains(part), "{message}");
    }
}

#[tokio::test]
async fn the_database_of_another_program_is_none_of_ours() {
    let place = place();
    let file = place.path().join("meshway.db");
    let options = SqliteConnectOptions::new()
        .filename(&file)
        .create_if_missing(true);
    let mut db = options.connect().await.unwrap();
    sqlx::query("CREATE TABLE jobs (id TEXT)")
        .execute(&mut db)
        .await
        .unwrap();
    db.close().await.unwrap();
    let before = content(place.path());
    let output = refused(place.path());
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    assert_eq!(content(place.path()), before);
}

#[tokio::test]
async fn empty_folders_and_those_of_a_start_that_failed_are_taken() {
    let place = place();
    serve_once(&place.path().join("new/deep")).await;
    let empty = place.path().join("empty");
    fs::create_dir_all(empty.join("lost+found")).unwrap();
    serve_once(&empty).await;
    let failed = place.path().join("failed");
    for folder in ["tmp", "clouds", "cache"] {
        fs::create_dir_all(failed.join(folder)).unwrap();
    }
    write(&failed, "lock", "");
    write(&failed, "meshway.db", "");
    serve_once(&failed).await;
    // And once more, now that they are known.
    serve_once(&failed).await;
}

#[tokio::test]
async fn only_files_that_the_service_makes_are_removed() {
    let place = place();
    let folder = place.path();
    serve_once(folder).await;
    let hash = "5".repeat(64);
    let foreign = [
        "tmp/thesis.tex".to_owned(),
        "tmp/.tmpfile".to_owned(),
        format!("tmp/{hash}"),
        format!("tmp/folder/{hash}"),
        "clouds/scan.ply".to_owned(),
        "clouds/.tmpAb12Cd".to_owned(),
        format!("clouds/{hash}.ply"),
        format!("clouds/folder/{hash}"),
        "cache/pip".to_owned(),
        format!("cache/{hash}.zip"),
        format!("cache/folder/{hash}.obj"),
        "lock".to_owned(),
        "other/file".to_owned(),
    ];
    for name in &foreign {
        later(&write(folder, name, "precious"));
    }
    let ours = [
        "tmp/.tmpAb12Cd".to_owned(),
        format!("clouds/{hash}"),
        format!("cache/{hash}.obj"),
        "cache/.tmpAb12Cd".to_owned(),
    ];
    for name in &ours {
        later(&write(folder, name, "left behind"));
    }
    serve_once(folder).await;
    for name in &foreign {
        assert_eq!(fs::read(folder.join(name)).unwrap(), b"precious", "{name}");
    }
    for name in &ours {
        assert!(!folder.join(name).exists(), "{name}");
    }
}

#[tokio::test]
async fn clouds_that_are_older_than_the_database_stay() {
    let place = place();
    let folder = place.path();
    serve_once(folder).await;
    let cloud = write(folder, &format!("clouds/{}", "5".repeat(64)), "precious");
    for name in ["meshway.db", "meshway.db-wal", "meshway.db-shm"] {
        drop(fs::remove_file(folder.join(name)));
    }
    // Not at the first start, which makes the database, and not at the next.
    for _ in 0..2 {
        let log = serve_once(folder).await;
        assert!(log.contains("put the database back"), "{log}");
        assert_eq!(fs::read(&cloud).unwrap(), b"precious");
    }
}

#[tokio::test]
async fn a_folder_of_the_first_version_is_taken_and_swept() {
    // Its database, folders and lock, and no mark.
    let folder = Folder::new().await;
    let path = folder.path();
    for name in ["tmp", "cache"] {
        fs::create_dir(path.join(name)).unwrap();
    }
    write(path, "lock", "");
    assert!(!path.join("meshway-folder").exists());
    let orphan = write(path, &format!("clouds/{}", "5".repeat(64)), "left behind");
    later(&orphan);
    let server = folder.serve(&["--script=instant"]).await;
    assert!(path.join("meshway-folder").exists());
    assert!(!orphan.exists());
    let kept = fs::read_to_string(path.join("clouds").join("a".repeat(64))).unwrap();
    assert!(kept.starts_with(&sphere_xyz(300, 0.0)), "{kept}");
    let mut client = Client::open(server.address()).await.unwrap();
    let clouds = client.ask("GET /v1/clouds", "", &[]).await.unwrap();
    assert_eq!(clouds.json()["items"][0]["id"], folder.cloud_id().as_str());
}
