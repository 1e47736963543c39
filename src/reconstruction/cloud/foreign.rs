//! Formats that are not read, told by their marks, and what turns them into one that is.

/// A format by its mark.
struct Foreign {
    name: &'static str,
    /// Where the mark stands, and what it is.
    mark: (usize, &'static [u8]),
    advice: &'static str,
}

const fn foreign(name: &'static str, mark: &'static [u8], advice: &'static str) -> Foreign {
    Foreign {
        name,
        mark: (0, mark),
        advice,
    }
}

const SCANS: &str = "export it as PLY, for instance with CloudCompare or PDAL";
const MESHES: &str = "export it as PLY, OBJ or STL, for instance with MeshLab or Blender";
const IMAGES: &str = "it is an image, not points: segment it and save the surface as PLY or STL, for \
                      instance with 3D Slicer";
const PACKED: &str = "unpack it and give the file inside, which may be gzipped";
const TABLES: &str = "save the sheet as CSV with columns x, y, z";
const ARRAYS: &str = "extract the points and save them as an array [n, 3] in an NPY file";

/// Marks of bytes.
const FOREIGN: &[Foreign] = &[
    foreign("an E57 file", b"ASTM-E57", SCANS),
    foreign("a binary glTF file (GLB)", b"glTF", MESHES),
    foreign("an FBX file", b"Kaydara FBX", MESHES),
    foreign("a Blender file", b"BLENDER", MESHES),
    foreign("a USD file", b"PXR-USDC", MESHES),
    foreign("a USD file", b"#usda", MESHES),
    foreign("a Draco file", b"DRACO", MESHES),
    foreign(
        "a STEP file",
        b"ISO-10303-21",
        "mesh it and export it as STL, for instance with FreeCAD",
    ),
    Foreign {
        name: "a TAR archive",
        mark: (257, b"ustar"),
        advice: PACKED,
    },
    foreign("a 7z archive", b"7z\xbc\xaf", PACKED),
    foreign("a RAR archive", b"Rar!", PACKED),
    foreign("an xz file", b"\xfd7zXZ", PACKED),
    foreign("a bzip2 file", b"BZh", PACKED),
    foreign("a Zstandard file", b"\x28\xb5\x2f\xfd", PACKED),
    foreign("an HDF5 file", b"\x89HDF", ARRAYS),
    foreign("a MATLAB file", b"MATLAB 5.0", ARRAYS),
    foreign(
        "a Parquet file",
        b"PAR1",
        "save the table as CSV with columns x, y, z",
    ),
    foreign("an old Excel file", b"\xd0\xcf\x11\xe0", TABLES),
    foreign("a PNG image", b"\x89PNG", IMAGES),
    foreign("a JPEG image", b"\xff\xd8\xff", IMAGES),
    foreign("a TIFF image", b"II*\0", IMAGES),
    foreign("a TIFF image", b"MM\0*", IMAGES),
    foreign(
        "a PDF file",
        b"%PDF",
        "export the points as PLY or CSV from the program that made it",
    ),
    foreign(
        "a Gmsh file",
        b"$MeshFormat",
        "export it as PLY or STL with Gmsh",
    ),
    foreign(
        "a Surfer grid",
        b"DSAA",
        "save it as XYZ text, for instance with gdal_translate",
    ),
];

/// Words that begin a text, in small letters.
const TEXTS: &[Foreign] = &[
    foreign(
        "VTK XML data other than polygons",
        b"<vtkfile",
        "save it as PLY, for instance with ParaView",
    ),
    foreign("a COLLADA file", b"<collada", MESHES),
    foreign("an X3D file", b"<x3d", MESHES),
    foreign(
        "a web page",
        b"<html",
        "download the file itself, and save it as PLY or XYZ",
    ),
    foreign(
        "a web page",
        b"<!doctype html",
        "download the file itself, and save it as PLY or XYZ",
    ),
    foreign(
        "an ESRI raster",
        b"ncols",
        "save it as XYZ text, for instance with gdal_translate",
    ),
    foreign("a VRML file", b"#vrml", MESHES),
    foreign("an Abaqus deck", b"*node", DECKS),
    foreign("an Abaqus deck", b"*heading", DECKS),
    foreign("an Abaqus deck", b"*part", DECKS),
    foreign("an LS-DYNA deck", b"*keyword", DECKS),
    foreign("a Nastran deck", b"sol ", DECKS),
    foreign("a Nastran deck", b"begin bulk", DECKS),
];

const DECKS: &str =
    "export its surface as STL or PLY, or save the coordinates of the nodes alone as x y z";

/// What is said of a file of a known format that is not read; `None` for all other files.
pub(super) fn refusal(bytes: &[u8]) -> Option<String> {
    let (name, advice) = by_structure(bytes).or_else(|| {
        let marked = |foreign: &&Foreign| {
            let (at, mark) = foreign.mark;
            bytes.get(at..).is_some_and(|rest| rest.starts_with(mark))
        };
        let found = FOREIGN.iter().find(marked).or_else(|| by_text(bytes))?;
        Some((found.name, found.advice))
    })?;
    Some(format!("this is {name}, which is not read; {advice}"))
}

/// Whether a file is text as far as its beginning tells: no zeros, and hardly a control character.
pub(super) fn is_text(bytes: &[u8]) -> bool {
    const LOOKED_AT: usize = 4096;
    let head = &bytes[..bytes.len().min(LOOKED_AT)];
    let controls = head
        .iter()
        .filter(|&&b| b < b' ' && !b.is_ascii_whitespace());
    !head.contains(&0) && 20 * controls.count() <= head.len()
}

/// What is said of a file of no known format.
pub(super) fn unknown(bytes: &[u8]) -> String {
    let detail = if is_text(bytes) {
        "it has no rows of three numbers"
    } else {
        "it holds raw binary numbers or another format without a known mark; save the points as PLY or \
         XYZ text"
    };
    format!(
        "the file is none of PLY, XYZ/CSV text, OBJ, OFF, STL, PCD, NPY, VTK, NIfTI, NRRD, MHA, DICOM: {detail}"
    )
}

fn by_structure(bytes: &[u8]) -> Option<(&'static str, &'static str)> {
    if bytes.starts_with(b"LASF") {
        // Compression is told by the highest bits of the format of the points.
        let is_packed = bytes.get(104).is_some_and(|format| format & 0xc0 != 0);
        let advice = "convert it to PLY, for instance with PDAL (pdal translate in.las out.ply) or \
                      CloudCompare";
        return Some((
            if is_packed {
                "a LAZ file"
            } else {
                "a LAS file"
            },
            advice,
        ));
    }
    if bytes.starts_with(b"PK\x03\x04") || bytes.starts_with(b"PK\x05\x06") {
        let head = &bytes[..bytes.len().min(4096)];
        let holds = |name: &[u8]| head.windows(name.len()).any(|window| window == name);
        return Some(match () {
            () if holds(b".npy") => ("an NPZ file of arrays (a ZIP archive)", ARRAYS),
            () if holds(b"xl/") => ("an Excel file (a ZIP archive)", TABLES),
            () if holds(b"3D/3dmodel") => ("a 3MF file (a ZIP archive)", MESHES),
            () => ("a ZIP archive", PACKED),
        });
    }
    by_json(bytes)
}

/// JSON: a cloud in it may have any form.
fn by_json(bytes: &[u8]) -> Option<(&'static str, &'static str)> {
    let text = bytes.trim_ascii_start();
    if !text.starts_with(b"{") || !text[1..].trim_ascii_start().starts_with(b"\"") {
        return None;
    }
    let head = &text[..text.len().min(1 << 16)];
    let holds = |name: &[u8]| head.windows(name.len()).any(|window| window == name);
    Some(match () {
        () if holds(b"\"asset\"") => ("a glTF file", MESHES),
        () if holds(b"\"markups\"") => (
            "a markups file of 3D Slicer",
            "export the table of its control points as CSV",
        ),
        () => (
            "a JSON file",
            "save the points as CSV with columns x, y, z, or as PLY",
        ),
    })
}

/// By the first word of a text, behind the declaration and the comments of XML.
fn by_text(bytes: &[u8]) -> Option<&'static Foreign> {
    let head = &bytes[..bytes.len().min(4096)];
    let mut text = head.trim_ascii_start();
    while text.starts_with(b"<?") || text.starts_with(b"<!--") || text.starts_with(b"**") {
        let end = if text.starts_with(b"**") { b'\n' } else { b'>' };
        let end = text.iter().position(|&b| b == end)?;
        text = text[end + 1..].trim_ascii_start();
    }
    let begins = |foreign: &&Foreign| {
        let mark = foreign.mark.1;
        let start = text.get(..mark.len());
        start.is_some_and(|start| start.eq_ignore_ascii_case(mark))
    };
    TEXTS.iter().find(begins)
}
