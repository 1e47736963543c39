//! What the names of columns mean, however programs spell them: `X`, `pos_x`, `Points:0`, `X (mm)`,
//! `Easting`, `NormalX`.

/// Words that may stand before or behind the axis in the name of a coordinate.
const PLACES: &[&str] = &[
    "point", "points", "pos", "position", "positions", "coord", "coords", "coordinate",
    "coordinates", "loc", "location", "vertex", "vertices", "node", "nodes", "center", "centre",
    "centroid", "world", "global", "local", "cartesian", "xyz", "utm", "map", "grid", "axis", "p",
];

/// Words for a normal.
const NORMALS: &[&str] = &["n", "normal", "normals", "norm", "nrm", "nor"];

/// Words of surveyors for the axes, in the order x, y, z.
const SURVEY: [&[&str]; 3] = [
    &["easting", "eastings", "east", "e", "rechtswert", "rechts", "este", "est"],
    &["northing", "northings", "north", "n", "hochwert", "hoch", "norte", "nord"],
    &[
        "elevation", "elev", "height", "hgt", "altitude", "alt", "up", "h", "hoehe", "höhe",
    ],
];

/// Letters that name axes only together: east, north, up; and the axes of anatomy, which are right or
/// left, anterior or posterior, superior, where one triple is the other turned by half a circle.
const TRIPLES: [[&str; 3]; 3] = [["e", "n", "u"], ["r", "a", "s"], ["l", "p", "s"]];

/// Words for degrees on the globe.
const DEGREES: &[&str] = &["lat", "latitude", "lon", "long", "lng", "longitude"];

/// Units that follow a name.
const UNITS: &[&str] = &[
    "mm", "cm", "dm", "m", "km", "um", "µm", "μm", "nm", "in", "inch", "inches", "ft", "feet",
    "meter", "meters", "metre", "metres", "px", "pixel", "pixels", "voxel", "voxels",
];

/// What the names of a table say.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Names {
    /// Columns of x, y and z.
    pub(super) point: Option<[usize; 3]>,
    /// Columns of the normal's components, as far as they are there.
    pub(super) normal: [Option<usize>; 3],
    /// Column of the label.
    pub(super) label: Option<usize>,
    /// Whether other columns could be coordinates as well.
    pub(super) rival: bool,
    /// Whether any column is named as a coordinate.
    pub(super) any_axis: bool,
    /// Whether columns are named as latitude or longitude.
    pub(super) degrees: bool,
}

impl Names {
    /// Reads the names of columns; of two alike the first counts.
    pub(super) fn of<'a>(names: impl IntoIterator<Item = &'a [u8]>) -> Self {
        let names: Vec<Vec<String>> = names.into_iter().map(words).collect();
        let columns: Vec<Option<Column>> = names.iter().map(|words| column(words)).collect();
        let first = |wanted: &Column| columns.iter().position(|c| c.as_ref() == Some(wanted));
        let place = |stem: &str| {
            let axis = |axis| first(&Column::Place(stem.to_owned(), axis));
            Some([axis(0)?, axis(1)?, axis(2)?])
        };
        let mut stems: Vec<&str> = vec![""];
        for column in columns.iter().flatten() {
            if let Column::Place(stem, _) = column
                && !stems.contains(&stem.as_str())
            {
                stems.push(stem);
            }
        }
        let mut places = stems.iter().filter_map(|stem| place(stem));
        let point = places.next();
        let rival = places.next().is_some();
        let normal_stem = columns.iter().flatten().find_map(|column| match column {
            Column::Normal(stem, _) => Some(stem.clone()),
            _ => None,
        });
        let normal = |axis| first(&Column::Normal(normal_stem.clone()?, axis));
        let is = |words: &Vec<String>, name: &str| words.as_slice() == [name];
        let is_degrees = |words: &Vec<String>| words.iter().any(|w| DEGREES.contains(&w.as_str()));
        Self {
            point: point.or_else(|| surveyed(&names)).or_else(|| lettered(&names)),
            normal: [normal(0), normal(1), normal(2)],
            label: names
                .iter()
                .position(|words| is(words, "label") || words.as_slice() == ["scalar", "label"]),
            rival,
            any_axis: columns.iter().flatten().any(|c| matches!(c, Column::Place(..)))
                || names.iter().any(|words| {
                    let long = |word: &&str| word.len() > 3 && is(words, word);
                    SURVEY.iter().any(|known| known.iter().any(|word| long(&word)))
                }),
            degrees: names.iter().any(is_degrees),
        }
    }
}

/// A column of one axis: a group of columns with the same words belongs together.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Column {
    Place(String, usize),
    Normal(String, usize),
}

fn column(words: &[String]) -> Option<Column> {
    let (stem, axis) = split(words)?;
    let known = |list: &[&str], word: &String| list.contains(&word.as_str());
    if stem.iter().all(|word| known(PLACES, word)) {
        return Some(Column::Place(stem.join(" "), axis));
    }
    let others_are_places = stem
        .iter()
        .all(|word| known(NORMALS, word) || known(PLACES, word) || word == "scalar");
    others_are_places.then(|| Column::Normal(stem.join(" "), axis))
}

/// The axis that a name begins or ends with, and its other words.
fn split(words: &[String]) -> Option<(Vec<String>, usize)> {
    let axis = |word: &str| ["x", "y", "z"].iter().position(|axis| *axis == word);
    let digit = |word: &str| ["0", "1", "2"].iter().position(|axis| *axis == word);
    match words {
        [only] => {
            if let Some(axis) = axis(only) {
                return Some((Vec::new(), axis));
            }
            // One word, as in nx, posx, xcoord.
            let is_known = |stem: &&str| PLACES.contains(stem) || NORMALS.contains(stem);
            let end = only.char_indices().last()?.0;
            let start = only.chars().next()?.len_utf8();
            let before = axis(&only[end..]).map(|axis| (&only[..end], axis));
            let behind = || axis(&only[..start]).map(|axis| (&only[start..], axis));
            let found = before.filter(|(stem, _)| is_known(stem));
            let found = found.or_else(|| behind().filter(|(stem, _)| is_known(stem)));
            found.map(|(stem, axis)| (vec![stem.to_owned()], axis))
        }
        [others @ .., last] if axis(last).is_some() => Some((others.to_vec(), axis(last)?)),
        [first, others @ ..] if axis(first).is_some() => Some((others.to_vec(), axis(first)?)),
        [others @ .., last] => Some((others.to_vec(), digit(last)?)),
        [] => None,
    }
}

/// Columns of surveyors, alone or mixed with x, y, z.
fn surveyed(names: &[Vec<String>]) -> Option<[usize; 3]> {
    let find = |word: &str| names.iter().position(|words| words.as_slice() == [word]);
    let axis = |plain: &str, known: &[&str]| {
        find(plain).or_else(|| known.iter().find_map(|word| find(word)))
    };
    Some([
        axis("x", SURVEY[0])?,
        axis("y", SURVEY[1])?,
        axis("z", SURVEY[2])?,
    ])
}

fn lettered(names: &[Vec<String>]) -> Option<[usize; 3]> {
    let find = |word: &str| names.iter().position(|words| words.as_slice() == [word]);
    let mut triples = TRIPLES.iter();
    triples.find_map(|[a, b, c]| Some([find(a)?, find(b)?, find(c)?]))
}

/// The words of a name in small letters, without the unit.
fn words(name: &[u8]) -> Vec<String> {
    let name = String::from_utf8_lossy(name);
    let name = name.trim().trim_matches(['"', '\'']);
    // A unit in brackets, or behind a slash.
    let end = name.char_indices().skip(1).find(|(_, c)| "([{</".contains(*c));
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
    if words.len() > 1 && words.last().is_some_and(|word| UNITS.contains(&word.as_str())) {
        words.pop();
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(header: &str) -> Names {
        Names::of(header.split(',').map(str::as_bytes))
    }

    #[test]
    fn coordinates_are_found_by_any_of_their_names() {
        for (header, point) in [
            ("z,y,X", [2, 1, 0]),
            ("id,pos_x,pos_y,pos_z", [1, 2, 3]),
            ("Normals:0,Normals:1,Normals:2,Points:0,Points:1,Points:2", [3, 4, 5]),
            ("p,U_0,U_1,U_2,Points_0,Points_1,Points_2", [4, 5, 6]),
            ("X (mm),Y [mm],Z/mm", [0, 1, 2]),
            ("x_mm,y_mm,z_mm", [0, 1, 2]),
            ("PositionX,PositionY,PositionZ", [0, 1, 2]),
            ("xcoord,ycoord,zcoord", [0, 1, 2]),
            ("X-Coordinate,Y-Coordinate,Z-Coordinate", [0, 1, 2]),
            ("Point,Easting,Northing,Elevation", [1, 2, 3]),
            ("N,E,H", [1, 0, 2]),
            ("x,y,Height (m)", [0, 1, 2]),
            ("label,l,p,s,defined", [1, 2, 3]),
            ("x,y,z,x,y,z", [0, 1, 2]),
            ("Points:0,x,Points:1,y,Points:2,z", [1, 3, 5]),
        ] {
            assert_eq!(names(header).point, Some(point), "{header}");
        }
    }

    #[test]
    fn other_triples_are_no_coordinates() {
        for header in ["vx,vy,vz", "U:0,U:1,U:2", "rot_0,rot_1,rot_2", "x,y,x", "lat,lon,h", "nx,ny,nz"] {
            assert_eq!(names(header).point, None, "{header}");
        }
        assert!(names("x,y,w").any_axis);
        assert!(!names("a,b,c").any_axis);
        assert!(names("Latitude,Longitude,h").degrees);
    }

    #[test]
    fn normals_and_labels_are_found() {
        for header in ["nx,ny,nz", "Normal_X,Normal_Y,Normal_Z", "NormalX,NormalY,NormalZ",
            "Normals:0,Normals:1,Normals:2", "Nx,Ny,Nz", "scalar_nx,scalar_ny,scalar_nz"] {
            assert_eq!(names(header).normal, [Some(0), Some(1), Some(2)], "{header}");
        }
        assert_eq!(names("x,y,z,nx").normal, [Some(3), None, None]);
        assert_eq!(names("x,y,z,Label").label, Some(3));
        assert_eq!(names("x,y,z,scalar_label").label, Some(3));
        assert_eq!(names("x,y,z,classification").label, None);
        assert!(names("x,y,z,world_x,world_y,world_z").rival);
    }
}
