//! The words of names: which ones are known, and how a name is taken apart.

/// Words that may stand before or behind the axis in the name of a coordinate.
pub(super) const PLACES: &[&str] = &[
    "point",
    "points",
    "pos",
    "position",
    "positions",
    "coord",
    "coords",
    "coordinate",
    "coordinates",
    "loc",
    "location",
    "vertex",
    "vertices",
    "node",
    "nodes",
    "center",
    "centre",
    "centroid",
    "world",
    "global",
    "local",
    "cartesian",
    "xyz",
    "utm",
    "map",
    "grid",
    "axis",
    "p",
];

/// Words for a normal.
pub(super) const NORMALS: &[&str] = &["n", "normal", "normals", "norm", "nrm", "nor"];

/// Words of surveyors for the axes, in the order x, y, z.
pub(super) const SURVEY: [&[&str]; 3] = [
    &[
        "easting",
        "eastings",
        "east",
        "e",
        "rechtswert",
        "rechts",
        "este",
        "est",
    ],
    &[
        "northing",
        "northings",
        "north",
        "n",
        "hochwert",
        "hoch",
        "norte",
        "nord",
    ],
    &[
        "elevation",
        "elev",
        "height",
        "hgt",
        "altitude",
        "alt",
        "up",
        "h",
        "hoehe",
        "höhe",
    ],
];

/// Letters that name axes only together: east, north, up; and the axes of anatomy, which are right or
/// left, anterior or posterior, superior, where one triple is the other turned by half a circle.
pub(super) const TRIPLES: [[&str; 3]; 3] = [["e", "n", "u"], ["r", "a", "s"], ["l", "p", "s"]];

/// Words for vectors that are neither places nor normals.
pub(super) const VECTORS: &[&str] = &[
    "v",
    "vel",
    "velocity",
    "velocities",
    "speed",
    "u",
    "w",
    "f",
    "force",
    "forces",
    "a",
    "acc",
    "acceleration",
    "rot",
    "rotation",
    "r",
    "q",
    "quat",
    "quaternion",
    "orientation",
    "euler",
    "angle",
    "angular",
    "gyro",
    "color",
    "colour",
    "rgb",
    "dir",
    "direction",
    "ray",
    "beam",
    "view",
    "grad",
    "gradient",
    "scale",
    "sigma",
    "std",
    "err",
    "error",
    "d",
    "delta",
    "disp",
    "displacement",
    "offset",
    "size",
    "moment",
    "momentum",
    "flow",
    "mag",
    "magnetic",
    "b",
    "tangent",
    "t",
    "tex",
    "texture",
    "uv",
    "vorticity",
    "stress",
    "strain",
    "m",
    "index",
    "idx",
    "i",
];

/// Words for degrees on the globe.
pub(super) const DEGREES: &[&str] = &["lat", "latitude", "lon", "long", "lng", "longitude"];

/// Units that follow a name.
const UNITS: &[&str] = &[
    "mm", "cm", "dm", "m", "km", "um", "µm", "μm", "nm", "in", "inch", "inches", "ft", "feet",
    "meter", "meters", "metre", "metres", "px", "pixel", "pixels", "voxel", "voxels",
];

/// The words of a name in small letters, without the unit.
pub(super) fn words(name: &[u8]) -> Vec<String> {
    let name = String::from_utf8_lossy(name);
    let name = name.trim().trim_matches(['"', '\'']);
    // A unit in brackets, or behind a slash; but an axis in brackets is none.
    let is_unit = |&(i, c): &(usize, char)| {
        let inside = name[i + 1..].trim_end_matches([']', ')', '}', '>', ' ']);
        "([{<,/".contains(c) && !matches!(inside, "0" | "1" | "2" | "x" | "y" | "z")
    };
    let end = name
        .char_indices()
        .skip(1)
        .filter(|(_, c)| c.is_ascii())
        .find(is_unit);
    let name = &name[..end.map_or(name.len(), |(i, _)| i)];
    let mut words = vec![String::new()];
    let mut before = ' ';
    for c in name.chars() {
        let starts_word = before.is_lowercase() && c.is_uppercase()
            || before.is_alphabetic() && c.is_ascii_digit();
        if starts_word || !c.is_alphanumeric() {
            words.push(String::new());
        }
        if c.is_alphanumeric()
            && let Some(word) = words.last_mut()
        {
            word.extend(c.to_lowercase());
        }
        before = c;
    }
    words.retain(|word| !word.is_empty());
    if words.len() > 1
        && words
            .last()
            .is_some_and(|word| UNITS.contains(&word.as_str()))
    {
        words.pop();
    }
    words
}

/// The other words of a name that begins or ends with an axis, the axis, and whether it is a letter.
pub(super) fn split(words: &[String]) -> Option<(Vec<String>, usize, bool)> {
    let axis = |word: &str| ["x", "y", "z"].iter().position(|axis| *axis == word);
    let digit = |word: &str| ["0", "1", "2"].iter().position(|axis| *axis == word);
    match words {
        [only] => {
            if let Some(axis) = axis(only) {
                return Some((Vec::new(), axis, true));
            }
            // One word, as in nx, posx, xcoord.
            let end = only.char_indices().last()?.0;
            let start = only.chars().next()?.len_utf8();
            let is_known = |stem: &str| PLACES.contains(&stem) || NORMALS.contains(&stem);
            let behind = axis(&only[..start]).map(|axis| (&only[start..], axis));
            let before = axis(&only[end..]).map(|axis| (&only[..end], axis));
            let found = match (before, behind) {
                (Some((stem, axis)), _) if is_known(stem) => (stem, axis),
                (_, Some(found)) => found,
                (found, None) => found?,
            };
            Some((vec![found.0.to_owned()], found.1, true))
        }
        // CloudCompare calls what it has no use for a scalar; its coordinates are none.
        [scalar, only] if scalar == "scalar" && axis(only).is_none() => {
            split(std::slice::from_ref(only))
        }
        [others @ .., last] if axis(last).is_some() => Some((others.to_vec(), axis(last)?, true)),
        [first, others @ ..] if axis(first).is_some() => {
            Some((others.to_vec(), axis(first)?, true))
        }
        [others @ .., last] => Some((others.to_vec(), digit(last)?, false)),
        [] => None,
    }
}
