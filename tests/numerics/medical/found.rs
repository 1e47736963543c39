//! What Meshway finds in a file, in the words of `scripts/medical.py read`.

use std::path::Path;

use meshway::reconstruction::cloud::{Error, Format, Limits, Opened, Options, open};
use meshway::reconstruction::medical::{Affine, Contents};
use meshway::reconstruction::slices::{Content, Geometry, Mask, Plane};
use meshway::reconstruction::vector::{Vec3, add, along, cross, dot, sub};

/// An item with the sums that do not depend on an order.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FoundItem {
    pub(super) number: i64,
    pub(super) voxels: u64,
    /// Over the indices of the file, or over column, row and slice where there is no grid.
    pub(super) sum: u64,
    pub(super) contours: usize,
    pub(super) points: usize,
    pub(super) total: Vec3,
}

/// All that a file holds.
#[derive(Debug)]
pub(super) struct Found {
    pub(super) contents: Contents,
    pub(super) geometry: Geometry,
    pub(super) items: Vec<FoundItem>,
}

/// Whether a file is DICOM, by its name.
pub(super) fn is_dicom(name: &str) -> bool {
    Path::new(name)
        .extension()
        .is_some_and(|ending| ending == "dcm")
}

pub(super) fn found(bytes: &[u8], name: &str, assume_orientation: bool) -> Result<Found, Error> {
    let options = Options {
        hint: Format::from_extension(name),
        limits: &Limits::default(),
        assume_orientation,
    };
    let (found, _) = open(bytes, &options, |opened, _| {
        let Opened::Slices(segmentation) = opened else {
            panic!("{name} is no segmentation");
        };
        let contents = segmentation.contents().clone();
        let items = contents.parts.items.iter().enumerate().map(|(i, item)| {
            let geometry = segmentation.geometry(i);
            // Of DICOM the oracle knows frames, of the others the indices of the file.
            let grid = contents.affine.filter(|_| !is_dicom(name));
            summed(
                item.number,
                &geometry,
                grid.as_ref(),
                segmentation.planes(i),
            )
        });
        let items = items.collect();
        let geometry = segmentation.geometry(0);
        Ok(Found {
            contents,
            geometry,
            items,
        })
    })?;
    Ok(found)
}

fn summed(
    number: i64,
    geometry: &Geometry,
    grid: Option<&Affine>,
    planes: impl Iterator<Item = Plane>,
) -> FoundItem {
    let mut item = FoundItem {
        number,
        voxels: 0,
        sum: 0,
        contours: 0,
        points: 0,
        total: [0.0; 3],
    };
    let mut last = None;
    for Plane { slice, content } in planes {
        assert!(last < Some(slice), "slices come in order, each once");
        last = Some(slice);
        let origin = geometry.origins[slice];
        match content {
            Content::Mask(mask) => {
                for [column, row] in half_full(&mask) {
                    let index = grid.map_or([column as u64, row as u64, slice as u64], |affine| {
                        let place = along(origin, column as f64, geometry.column);
                        index(affine, along(place, row as f64, geometry.row))
                    });
                    item.voxels += 1;
                    item.sum = item.sum.wrapping_add(mixed(index));
                }
            }
            Content::Polygons(polygons) => {
                item.contours += polygons.len();
                for [x, y] in polygons.into_iter().flatten() {
                    item.points += 1;
                    let place = along(along(origin, x, geometry.column), y, geometry.row);
                    item.total = add(item.total, place);
                }
            }
        }
    }
    item
}

/// Columns and rows of the pixels that are at least half full.
fn half_full(mask: &Mask) -> impl Iterator<Item = [usize; 2]> + '_ {
    assert_eq!(mask.filled.len() % mask.width, 0);
    assert!(mask.left + mask.width <= mask.slice_size[0]);
    assert!(mask.top + mask.filled.len() / mask.width <= mask.slice_size[1]);
    let full = mask
        .filled
        .iter()
        .enumerate()
        .filter(|(_, filled)| **filled >= 128);
    full.map(|(i, _)| [mask.left + i % mask.width, mask.top + i / mask.width])
}

/// The index of the voxel whose centre is there.
fn index(affine: &Affine, place: Vec3) -> [u64; 3] {
    let [a, b, c] = affine.steps;
    let away = sub(place, affine.origin);
    let volume = dot(cross(a, b), c);
    let along = [cross(b, c), cross(c, a), cross(a, b)].map(|normal| dot(normal, away) / volume);
    along.map(|i| {
        assert!(
            (i - i.round()).abs() < 1e-3,
            "{place:?} is no centre of a voxel: {along:?}"
        );
        i.round() as u64
    })
}

fn mixed([i, j, k]: [u64; 3]) -> u64 {
    let mut mixed = (i + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    mixed ^= (j + 1).wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
    mixed ^= (k + 1).wrapping_mul(0x1656_67B1_9E37_79F9);
    mixed = mixed.wrapping_mul(0xFF51_AFD7_ED55_8CCD);
    mixed ^ mixed >> 32
}
