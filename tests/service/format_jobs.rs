//! Clouds in every format and packing, from their upload to the mesh of a worker.

use std::fmt::Write as _;

use meshway::reconstruction::mesh::read;
use serde_json::{Value, json};

use crate::helpers::bumpy;
use crate::http::contract::expect_named;
use crate::http::support::{gzip, sphere, sphere_xyz};
use crate::server::{Folder, Server, job_ended};
use crate::wire::{Answer, Connection};

const POINTS: usize = 200;

#[tokio::test]
async fn clouds_of_every_format_and_packing_become_meshes() {
    let folder = Folder::new().await;
    let server = folder.serve(&[]).await;
    for (name, bytes) in files() {
        let plain = cloud_of(&server, "", &bytes, name).await;
        assert_eq!(plain["points"], POINTS, "{name}");
        let packed = gzip(&bytes);
        let kept_packed = cloud_of(&server, "", &packed, name).await;
        assert_eq!(kept_packed["gzipped"], true, "{name}");
        // What the transfer packs is unpacked before it is kept.
        for (encoding, sent, kept) in [
            ("gzip", gzip(&bytes), &plain),
            ("zstd", zstd::encode_all(&bytes[..], 3).unwrap(), &plain),
            (
                "zstd",
                zstd::encode_all(&packed[..], 3).unwrap(),
                &kept_packed,
            ),
        ] {
            let header = format!("Content-Encoding: {encoding}\r\n");
            let cloud = cloud_of(&server, &header, &sent, name).await;
            assert_eq!(cloud["id"], kept["id"], "{name} {encoding}");
        }
        for cloud in [&plain, &kept_packed] {
            let what = format!("{name}, gzipped {}", cloud["gzipped"]);
            becomes_a_mesh(&server, cloud, &what).await;
        }
    }
}

/// A job that needs blocks.
#[tokio::test]
async fn a_job_of_blocks_tells_their_series() {
    let folder = Folder::new().await;
    let server = folder.serve(&[]).await;
    let text = bumpy();
    let cloud = cloud_of(&server, "", text.as_bytes(), "xyz").await;
    let request = json!({
        "cloud_id": cloud["id"],
        "preset": "fast",
        "settings": {
            "training": {"max_evaluations": 30, "block_evaluations": 15},
            "surface": {"resolution": 48},
        },
    });
    let mut connection = Connection::open(server.address()).await.unwrap();
    let answer = connection.post("/v1/jobs", "", &request).await.unwrap();
    let job = job_ended(&mut connection, &answer.json()).await;
    assert_eq!(job["status"], "succeeded", "{job}");
    let metrics = job["links"]["metrics"].as_str().unwrap();
    let of = async |query: &str| {
        let path = format!("GET {metrics}{query}");
        let mut connection = Connection::open(server.address()).await.unwrap();
        let answer = connection.ask(&path, "", &[]).await.unwrap();
        assert_eq!(answer.status, 200, "{query}");
        answer.json()
    };
    let all = of("").await;
    expect_named("MetricSeries", &all);
    let column = |name: &str| all["series"][name].as_array().unwrap().clone();
    let evaluations: Vec<u64> = column("evaluation")
        .iter()
        .filter_map(Value::as_u64)
        .collect();
    assert!(evaluations.is_sorted_by(|a, b| a < b), "{evaluations:?}");
    let counts: Vec<u64> = column("blocks").iter().filter_map(Value::as_u64).collect();
    assert!((2..=32).contains(&counts.len()), "{counts:?}");
    assert!(counts.is_sorted_by(|a, b| a < b), "{counts:?}");

    let blocks = of("?blocks=true").await;
    expect_named("BlockSeries", &blocks);
    let count = blocks["blocks"].as_u64().unwrap();
    assert_eq!(counts.last(), Some(&count));
    for (name, list) in blocks["series"].as_object().unwrap() {
        assert_eq!(list.as_array().unwrap().len() as u64, count, "{name}");
    }
    let of_blocks = blocks["series"]["evaluations"].as_array().unwrap();
    let sum: u64 = of_blocks.iter().filter_map(Value::as_u64).sum();
    let before = evaluations[evaluations.len() - counts.len() - 1];
    assert_eq!(evaluations.last(), Some(&(before + sum)));
}

/// Runs a job on the cloud and fetches its mesh.
async fn becomes_a_mesh(server: &Server, cloud: &Value, what: &str) {
    let request = json!({
        "cloud_id": cloud["id"],
        "preset": "fast",
        "settings": {"training": {"max_evaluations": 40}, "surface": {"resolution": 32}},
    });
    let mut connection = Connection::open(server.address()).await.unwrap();
    let answer = connection.post("/v1/jobs", "", &request).await.unwrap();
    let job = job_ended(&mut connection, &answer.json()).await;
    assert_eq!(job["status"], "succeeded", "{what}: {job}");
    let path = format!("GET {}.ply", job["links"]["mesh"].as_str().unwrap());
    let mesh = connection.ask(&path, "", &[]).await.unwrap();
    assert_eq!(mesh.status, 200, "{what}");
    let mesh = read::read(&mesh.body, None).unwrap();
    assert!(mesh.triangles.len() > 100, "{what}");
}

/// Uploads the bytes as they are; their format shows in them.
async fn cloud_of(server: &Server, headers: &str, bytes: &[u8], name: &str) -> Value {
    let mut connection = Connection::open(server.address()).await.unwrap();
    let answer: Answer = connection
        .ask("POST /v1/clouds", headers, &[bytes])
        .await
        .unwrap();
    let cloud = answer.json();
    assert!(
        matches!(answer.status, 200 | 201),
        "{name} {headers}: {cloud}"
    );
    let format = name.rsplit('.').next().unwrap();
    let format = if format == "csv" { "xyz" } else { format };
    assert_eq!(cloud["format"], format, "{name}");
    cloud
}

/// The same sphere in every format.
fn files() -> Vec<(&'static str, Vec<u8>)> {
    let points = sphere(POINTS, 0.0);
    let lines = |separator: &str, head: &str| {
        let line =
            |point: &[f64; 3]| head.to_owned() + &point.map(|v| v.to_string()).join(separator);
        points.iter().map(line).collect::<Vec<_>>().join("\n") + "\n"
    };
    let floats: Vec<u8> = points
        .iter()
        .flatten()
        .flat_map(|&v| (v as f32).to_le_bytes())
        .collect();
    let with_head = |head: String| [head.into_bytes(), floats.clone()].concat();
    let ply = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {POINTS}\nproperty float x\n\
         property float y\nproperty float z\nend_header\n"
    );
    let pcd = |data: &str| {
        format!(
            "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH {POINTS}\nHEIGHT 1\n\
             POINTS {POINTS}\nDATA {data}\n"
        )
    };
    vec![
        ("cloud.ply", with_head(ply)),
        ("cloud.xyz", sphere_xyz(POINTS, 0.0).into_bytes()),
        (
            "cloud.csv",
            ("x,y,z\n".to_owned() + &lines(",", "")).into_bytes(),
        ),
        ("cloud.obj", lines(" ", "v ").into_bytes()),
        (
            "cloud.off",
            format!("OFF\n{POINTS} 0 0\n{}", lines(" ", "")).into_bytes(),
        ),
        ("cloud.stl", stl(&points)),
        ("cloud.pcd", with_head(pcd("binary"))),
        (
            "compressed.pcd",
            compressed(pcd("binary_compressed"), &points),
        ),
        ("cloud.npy", npy(&floats)),
    ]
}

/// Triangles over the points; their size and order do not matter.
fn stl(points: &[[f64; 3]]) -> Vec<u8> {
    let mut file = "solid cloud\n".to_owned();
    for facet in points.windows(3) {
        file += "facet normal 0 0 1\nouter loop\n";
        for [x, y, z] in facet {
            writeln!(file, "vertex {x} {y} {z}").unwrap();
        }
        file += "endloop\nendfacet\n";
    }
    (file + "endsolid cloud\n").into_bytes()
}

/// One coordinate after the other, in literals.
fn compressed(head: String, points: &[[f64; 3]]) -> Vec<u8> {
    let column = |k: usize| points.iter().flat_map(move |p| (p[k] as f32).to_le_bytes());
    let table: Vec<u8> = (0..3).flat_map(column).collect();
    let packed: Vec<u8> = table
        .chunks(32)
        .flat_map(|chunk| [&[chunk.len() as u8 - 1], chunk].concat())
        .collect();
    let sizes = [packed.len(), table.len()].map(|size| (size as u32).to_le_bytes());
    [head.into_bytes(), sizes.concat(), packed].concat()
}

fn npy(floats: &[u8]) -> Vec<u8> {
    let mut head = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({POINTS}, 3), }}");
    head += &" ".repeat(117 - head.len());
    head.push('\n');
    let length = (head.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], head.as_bytes(), floats].concat()
}
