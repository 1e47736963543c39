//! Colours by distance: which, where they stand in the files, and what the files say of them.

use std::io::ErrorKind;

use meshway::reconstruction::mesh::TriangleMesh;
use meshway::reconstruction::mesh::read::read;
use meshway::reconstruction::mesh::write::{Colors, Format, write_colored};
use serde_json::json;

use super::glb::take_apart;
use super::{moved, sphere};

/// A sphere whose distances go evenly from 0 to 2, and colours up to 1.
fn coloured() -> (TriangleMesh, Colors) {
    let mut mesh = sphere(1.0, 2);
    let last = (mesh.vertices.len() - 1) as f64;
    mesh.distance_to_points = (0..mesh.vertices.len())
        .map(|i| 2.0 * i as f64 / last)
        .collect();
    (mesh, Colors::up_to(1.0).unwrap())
}

fn written(mesh: &TriangleMesh, format: Format, colors: Colors) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_colored(mesh, format, Some(colors), &mut bytes).unwrap();
    bytes
}

/// The colours of a text PLY, and its header.
fn of_text(bytes: Vec<u8>, vertices: usize) -> (String, Vec<[u8; 3]>) {
    let text = String::from_utf8(bytes).unwrap();
    let (header, body) = text.split_once("end_header\n").unwrap();
    let color = |line: &str| -> [u8; 3] {
        let words: Vec<&str> = line.split(' ').collect();
        let channels: Vec<u8> = words[words.len() - 3..]
            .iter()
            .map(|w| w.parse().unwrap())
            .collect();
        channels.try_into().unwrap()
    };
    (
        header.to_owned(),
        body.lines().take(vertices).map(color).collect(),
    )
}

#[test]
fn the_scale_goes_from_dark_blue_on_the_points_to_yellow_where_nothing_was_measured() {
    let (mut mesh, colors) = coloured();
    mesh.distance_to_points[1] = 0.5;
    mesh.distance_to_points[2] = 0.25;
    let (header, found) = of_text(
        written(&mesh, Format::PlyAscii, colors),
        mesh.vertices.len(),
    );
    assert!(
        header.contains("\ncomment colors: cividis of distance_to_points, 0 to 1\n"),
        "{header}"
    );
    let behind = "distance_to_points\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face";
    assert!(header.contains(behind), "{header}");
    // The ends and the middle of cividis, and halfway between two of its steps.
    assert_eq!(found[0], [0x00, 0x22, 0x4e]);
    assert_eq!(found[1], [0x7f, 0x81, 0x76]);
    assert_eq!(found[2], [0x44, 0x51, 0x6c]);
    for (color, distance) in found.iter().zip(&mesh.distance_to_points) {
        assert_eq!(
            *color == [0xfe, 0xe8, 0x38],
            *distance >= 1.0,
            "{distance}: {color:?}"
        );
    }
}

#[test]
fn binary_and_text_have_the_same_colours_and_the_mesh_is_the_same_as_without() {
    let (near, colors) = coloured();
    let far = moved(near.clone(), [1e6, -2e6, 3e5]);
    for mesh in [near, far] {
        let (_, text) = of_text(
            written(&mesh, Format::PlyAscii, colors),
            mesh.vertices.len(),
        );
        let binary = written(&mesh, Format::PlyBinary, colors);
        let end = b"end_header\n";
        let body = binary.windows(end.len()).position(|w| w == end).unwrap() + end.len();
        let coordinate = if mesh.vertices[0][0] > 1e5 { 8 } else { 4 };
        let width = 4 * coordinate + 12 + 3;
        let vertices = binary[body..].chunks(width).take(mesh.vertices.len());
        let found: Vec<[u8; 3]> = vertices
            .map(|v| v[width - 3..].try_into().unwrap())
            .collect();
        assert_eq!(found, text);
        for format in [Format::PlyBinary, Format::PlyAscii, Format::Glb] {
            let mut plain = Vec::new();
            write_colored(&mesh, format, None, &mut plain).unwrap();
            let plain = read(&plain, None).unwrap();
            assert_eq!(
                read(&written(&mesh, format, colors), None).unwrap(),
                plain,
                "{format:?}"
            );
        }
    }
}

#[test]
fn a_glb_has_the_same_colours_in_light_and_the_distances() {
    let (mesh, colors) = coloured();
    let vertices = mesh.vertices.len();
    let parts = take_apart(&written(&mesh, Format::Glb, colors));
    let document = &parts.document;
    let attributes = &document["meshes"][0]["primitives"][0]["attributes"];
    let distances = &attributes["_DISTANCE_TO_POINTS"];
    let expected: Vec<f32> = mesh.distance_to_points.iter().map(|d| *d as f32).collect();
    assert_eq!(parts.floats(distances), expected);
    let accessor = &document["accessors"][attributes["COLOR_0"].as_u64().unwrap() as usize];
    // Glossary of the specification: 5123 is an unsigned short.
    for (name, expected) in [
        ("componentType", json!(5123)),
        ("normalized", json!(true)),
        ("type", json!("VEC4")),
        ("count", json!(vertices)),
    ] {
        assert_eq!(accessor[name], expected, "{accessor}");
    }
    let view = &document["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
    let [start, length] =
        ["byteOffset", "byteLength"].map(|name| view[name].as_u64().unwrap() as usize);
    assert_eq!((start % 4, length), (0, 8 * vertices));
    assert_eq!(start + length, parts.binary.len());
    assert_eq!(document["buffers"][0]["byteLength"], parts.binary.len());
    let legend =
        json!({"attribute": "_DISTANCE_TO_POINTS", "scale": "cividis", "from": 0.0, "to": 1.0});
    assert_eq!(document["meshes"][0]["extras"]["colors"], legend);

    let (_, screen) = of_text(written(&mesh, Format::PlyAscii, colors), vertices);
    let light = parts.binary[start..].as_chunks::<2>().0;
    let light: Vec<f64> = light
        .iter()
        .map(|b| f64::from(u16::from_le_bytes(*b)) / 65535.0)
        .collect();
    let mut brightness = Vec::new();
    for (light, screen) in light.chunks(4).zip(&screen) {
        for (light, screen) in light.iter().zip(screen) {
            // IEC 61966-2-1, from light to screens.
            let shown = if *light <= 0.003_130_8 {
                12.92 * light
            } else {
                1.055 * light.powf(1.0 / 2.4) - 0.055
            };
            // Both were rounded, to halves of 1/255 and of 1/65535.
            assert!(
                (255.0 * shown - f64::from(*screen)).abs() < 0.6,
                "{shown} {screen}"
            );
        }
        assert_eq!(light[3].to_bits(), 1.0f64.to_bits());
        brightness.push(0.2126 * light[0] + 0.7152 * light[1] + 0.0722 * light[2]);
    }
    // Further is brighter, whoever looks.
    for (pair, distance) in brightness.windows(2).zip(&mesh.distance_to_points) {
        assert!(
            pair[1] > pair[0] || *distance > 1.0 - 2.0 / vertices as f64,
            "{distance}"
        );
    }
}

#[test]
fn what_has_no_colours_is_refused() {
    let (mut mesh, colors) = coloured();
    let refused = |mesh: &TriangleMesh, format| {
        write_colored(mesh, format, Some(colors), &mut Vec::new()).map_err(|error| error.kind())
    };
    for format in Format::ALL
        .into_iter()
        .filter(|format| !format.has_colors())
    {
        assert_eq!(
            refused(&mesh, format),
            Err(ErrorKind::InvalidInput),
            "{format:?}"
        );
    }
    mesh.distance_to_points.pop();
    assert_eq!(refused(&mesh, Format::Glb), Err(ErrorKind::InvalidInput));
    for most in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(Colors::up_to(most), None);
    }
}
