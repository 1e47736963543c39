//! What the names of columns mean, however programs spell them: `X`, `pos_x`, `Points:0`, `X (mm)`,
//! `Easting`, `NormalX`.

mod words;

use std::collections::HashMap;

use words::{DEGREES, NORMALS, PLACES, SURVEY, TRIPLES, VECTORS, split, words};

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
        let mut table = Table::default();
        for (i, words) in names.iter().enumerate() {
            table.add(words, i);
        }
        let places = table.triples(Kind::Place);
        let unknown = table.triples(Kind::Unknown);
        let guess = unknown.first().copied();
        let known = places
            .first()
            .copied()
            .or_else(|| table.mixed())
            .or_else(|| table.lettered());
        let find = |name: &[&str]| names.iter().position(|words| words.as_slice() == name);
        Self {
            point: known.or_else(|| guess.filter(|_| unknown.len() == 1)),
            normal: table.normal(),
            label: find(&["label"]).or_else(|| find(&["scalar", "label"])),
            rival: places.len() > 1 || known.is_none() && guess.is_some(),
            any_axis: table.stems.iter().any(|(kind, _)| *kind == Kind::Place)
                || names.iter().any(|words| is_surveyed(words)),
            degrees: names
                .iter()
                .flatten()
                .any(|word| DEGREES.contains(&word.as_str())),
        }
    }
}

/// What a column with an axis in its name is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Kind {
    Place,
    Normal,
    /// Other words beside the axis: perhaps a place.
    Unknown,
}

/// The first column of each name.
#[derive(Debug, Default)]
struct Table {
    /// Words beside the axis, in the order of the columns.
    stems: Vec<(Kind, String)>,
    /// By words beside the axis, and axis.
    axes: HashMap<(Kind, String, usize), usize>,
    /// By single words, those for places aside.
    words: HashMap<String, usize>,
}

impl Table {
    fn add(&mut self, words: &[String], column: usize) {
        let others = || words.iter().filter(|word| !PLACES.contains(&word.as_str()));
        if let (Some(word), 1) = (others().next(), others().count()) {
            self.words.entry(word.clone()).or_insert(column);
        } else if let [word] = words {
            self.words.entry(word.clone()).or_insert(column);
        }
        let Some((kind, stem, axis)) = classify(words) else {
            return;
        };
        let key = (kind, stem.clone(), axis);
        if !(0..3).any(|axis| self.axes.contains_key(&(kind, stem.clone(), axis))) {
            self.stems.push((kind, stem));
        }
        self.axes.entry(key).or_insert(column);
    }

    fn axis(&self, kind: Kind, stem: &str, axis: usize) -> Option<usize> {
        self.axes.get(&(kind, stem.to_owned(), axis)).copied()
    }

    fn stems(&self, wanted: Kind) -> impl Iterator<Item = &str> + Clone {
        let of_kind = self.stems.iter().filter(move |(kind, _)| *kind == wanted);
        of_kind.map(|(_, stem)| stem.as_str())
    }

    /// Columns of the same words for all three axes; bare x, y, z first.
    fn triples(&self, kind: Kind) -> Vec<[usize; 3]> {
        let triple = |stem: &str| {
            let axis = |axis| self.axis(kind, stem, axis);
            Some([axis(0)?, axis(1)?, axis(2)?])
        };
        let bare = self.stems(kind).filter(|stem| stem.is_empty());
        let others = self.stems(kind).filter(|stem| !stem.is_empty());
        bare.chain(others).filter_map(triple).collect()
    }

    /// Components of normals, of the words that come first.
    fn normal(&self) -> [Option<usize>; 3] {
        let stem = self.stems(Kind::Normal).next().unwrap_or_default();
        [0, 1, 2].map(|axis| self.axis(Kind::Normal, stem, axis))
    }

    /// An axis each by any words for it, also those of surveyors.
    fn mixed(&self) -> Option<[usize; 3]> {
        let axis = |axis: usize| {
            let mut places = self.stems(Kind::Place);
            let place = places.find_map(|stem| self.axis(Kind::Place, stem, axis));
            let mut words = SURVEY[axis].iter();
            place.or_else(|| words.find_map(|word| self.words.get(*word).copied()))
        };
        Some([axis(0)?, axis(1)?, axis(2)?])
    }

    fn lettered(&self) -> Option<[usize; 3]> {
        let find = |letter: &str| self.words.get(letter).copied();
        let mut triples = TRIPLES.iter();
        triples.find_map(|[a, b, c]| Some([find(a)?, find(b)?, find(c)?]))
    }
}

/// Whether a name is a whole word of surveyors, not only a letter of theirs.
fn is_surveyed(words: &[String]) -> bool {
    let known = |word: &&&str| word.len() > 3 && words == [**word];
    SURVEY
        .iter()
        .any(|axis| axis.iter().any(|word| known(&word)))
}

/// What a column is, the words beside its axis, and the axis.
fn classify(words: &[String]) -> Option<(Kind, String, usize)> {
    let (stem, axis, is_letter) = split(words)?;
    let among = |list: &[&str], word: &String| list.contains(&word.as_str());
    let is_beside = |word: &String| among(PLACES, word);
    let kind = if stem.iter().all(|word| among(PLACES, word)) {
        Kind::Place
    } else if stem
        .iter()
        .all(|word| among(NORMALS, word) || is_beside(word))
    {
        Kind::Normal
    } else if is_letter && !stem.iter().any(|word| among(VECTORS, word)) {
        Kind::Unknown
    } else {
        return None;
    };
    Some((kind, stem.join(" "), axis))
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
            (
                "Normals:0,Normals:1,Normals:2,Points:0,Points:1,Points:2",
                [3, 4, 5],
            ),
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
            ("coords[0],coords[1],coords[2]", [0, 1, 2]),
            ("X_UTM,Y_UTM,Z", [0, 1, 2]),
            ("UTM_E,UTM_N,h (m)", [0, 1, 2]),
            ("lidar_x,lidar_y,lidar_z,vx,vy,vz", [0, 1, 2]),
            ("Xc,Yc,Zc", [0, 1, 2]),
            ("X1,Y1,Z1", [0, 1, 2]),
        ] {
            assert_eq!(names(header).point, Some(point), "{header}");
        }
    }

    #[test]
    fn other_triples_are_no_coordinates() {
        for header in [
            "vx,vy,vz",
            "U:0,U:1,U:2",
            "rot_0,rot_1,rot_2",
            "x,y,x",
            "lat,lon,h",
            "nx,ny,nz",
        ] {
            assert_eq!(names(header).point, None, "{header}");
        }
        assert!(names("x,y,w").any_axis);
        assert!(!names("a,b,c").any_axis);
        assert!(names("Latitude,Longitude,h").degrees);
    }

    #[test]
    fn normals_and_labels_are_found() {
        for header in [
            "nx,ny,nz",
            "Normal_X,Normal_Y,Normal_Z",
            "NormalX,NormalY,NormalZ",
            "Normals:0,Normals:1,Normals:2",
            "Nx,Ny,Nz",
            "scalar_nx,scalar_ny,scalar_nz",
        ] {
            assert_eq!(
                names(header).normal,
                [Some(0), Some(1), Some(2)],
                "{header}"
            );
        }
        assert_eq!(names("x,y,z,nx").normal, [Some(3), None, None]);
        assert_eq!(names("x,y,z,Label").label, Some(3));
        assert_eq!(names("x,y,z,scalar_label").label, Some(3));
        assert_eq!(names("x,y,z,classification").label, None);
        assert!(names("x,y,z,world_x,world_y,world_z").rival);
    }
}
