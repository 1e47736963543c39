//! Writing clouds: binary PLY, which keeps everything, and plain text.

use std::io::{self, Write};

use super::{Label, PointCloud};

/// Writes binary little-endian PLY: coordinates and normals as doubles, `char label` with 0 on the
/// surface, 1 inside, -1 outside.
///
/// # Errors
/// Those of `out`.
pub fn write_ply(cloud: &PointCloud, out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "ply\nformat binary_little_endian 1.0")?;
    writeln!(out, "element vertex {}", cloud.points.len())?;
    let normals = cloud.normals.as_ref().map(|_| ["nx", "ny", "nz"]);
    for name in ["x", "y", "z"]
        .into_iter()
        .chain(normals.into_iter().flatten())
    {
        writeln!(out, "property double {name}")?;
    }
    if cloud.labels.is_some() {
        writeln!(out, "property char label")?;
    }
    out.write_all(b"end_header\n")?;
    let mut row = Vec::new();
    for i in 0..cloud.points.len() {
        row.clear();
        for value in numbers(cloud, i) {
            row.extend(value.to_le_bytes());
        }
        if cloud.labels.is_some() {
            row.extend(number(cloud.label(i)).to_le_bytes());
        }
        out.write_all(&row)?;
    }
    Ok(())
}

/// Writes one line a point: `x y z`, then `nx ny nz` and `label` where there are any. Labels are read
/// only from a column of that name, so that with them the first line names the columns.
///
/// Numbers have as many digits as give the same f64 back.
///
/// # Errors
/// Those of `out`.
pub fn write_xyz(cloud: &PointCloud, out: &mut dyn Write) -> io::Result<()> {
    if cloud.labels.is_some() {
        let normals = if cloud.normals.is_some() {
            " nx ny nz"
        } else {
            ""
        };
        writeln!(out, "x y z{normals} label")?;
    }
    for i in 0..cloud.points.len() {
        let mut columns: Vec<String> = numbers(cloud, i).map(|x| x.to_string()).collect();
        if cloud.labels.is_some() {
            columns.push(number(cloud.label(i)).to_string());
        }
        writeln!(out, "{}", columns.join(" "))?;
    }
    Ok(())
}

fn numbers(cloud: &PointCloud, i: usize) -> impl Iterator<Item = f64> {
    let normal = cloud.normals.as_ref().map(|normals| normals[i]);
    cloud.points[i]
        .into_iter()
        .chain(normal.into_iter().flatten())
}

fn number(label: Label) -> i8 {
    match label {
        Label::Surface => 0,
        Label::Interior => 1,
        Label::Exterior => -1,
    }
}
