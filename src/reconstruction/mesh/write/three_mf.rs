//! 3MF for printing (3MF Consortium, Core Specification 1.3): a package in the open packaging
//! conventions, that is a zip archive with a list of types, a relation that names the model, and the
//! model in XML.

use std::io::{self, Write};

use super::zip::Archive;
use super::{fits_f32, to_f32};
use crate::reconstruction::mesh::TriangleMesh;
use crate::reconstruction::space::Unit;

const TYPES: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
</Types>
"#;

const RELATIONS: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
<Relationship Id="model" Target="/3D/3dmodel.model" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>
"#;

pub(super) fn write(mesh: &TriangleMesh, out: &mut impl Write) -> io::Result<()> {
    let mut archive = Archive::new(out);
    archive.file("[Content_Types].xml", |out| out.write_all(TYPES.as_bytes()))?;
    archive.file("_rels/.rels", |out| out.write_all(RELATIONS.as_bytes()))?;
    archive.file("3D/3dmodel.model", |out| model(mesh, out))?;
    archive.finish()
}

/// The model. Where no unit is known it is millimetres, as printers take them.
fn model(mesh: &TriangleMesh, out: &mut dyn Write) -> io::Result<()> {
    let unit = match mesh.space.unit {
        Unit::Micrometre => "micron",
        Unit::Millimetre | Unit::Unknown => "millimeter",
        Unit::Centimetre => "centimeter",
        Unit::Metre => "meter",
    };
    write!(
        out,
        r#"<?xml version="1.0" encoding="UTF-8"?>
<model unit="{unit}" xml:lang="en-US" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">
<metadata name="Application">Meshway</metadata>
"#
    )?;
    let tags = mesh.space.tags().collect::<Vec<_>>().join(" ");
    if !tags.is_empty() {
        writeln!(out, r#"<metadata name="Description">{tags}</metadata>"#)?;
    }
    // An object must have triangles.
    if mesh.triangles.is_empty() {
        return out.write_all(b"<resources/>\n<build/>\n</model>\n");
    }
    out.write_all(b"<resources>\n<object id=\"1\" type=\"model\">\n<mesh>\n<vertices>\n")?;
    let short = fits_f32(mesh);
    for &vertex in &mesh.vertices {
        if short {
            let [x, y, z] = to_f32(vertex);
            writeln!(out, r#"<vertex x="{x}" y="{y}" z="{z}"/>"#)?;
        } else {
            let [x, y, z] = vertex;
            writeln!(out, r#"<vertex x="{x}" y="{y}" z="{z}"/>"#)?;
        }
    }
    out.write_all(b"</vertices>\n<triangles>\n")?;
    for [a, b, c] in &mesh.triangles {
        writeln!(out, r#"<triangle v1="{a}" v2="{b}" v3="{c}"/>"#)?;
    }
    out.write_all(
        b"</triangles>\n</mesh>\n</object>\n</resources>\n<build>\n<item objectid=\"1\"/>\n</build>\n</model>\n",
    )
}
