//! Some of the points of a cloud, to look at.

use crate::reconstruction::cloud::PointCloud;
use crate::reconstruction::vector::{Bounds, Vec3};

/// An even subset of a cloud.
#[derive(Debug, Clone, PartialEq)]
pub struct Subset {
    /// What the coordinates are counted from: the middle of the cloud's box.
    pub origin: Vec3,
    /// The points, as [`rows`] has them.
    pub rows: Vec<u8>,
}

/// At most `most` points of a cloud, four little-endian f32 each: x, y, z from the middle of its
/// bounds, where f32 has digits enough, and the number of its label.
///
/// Each is drawn from a stretch of its own of the file, at a place that differs from stretch to
/// stretch: a fixed stride would show the lines of a scan.
pub fn rows(cloud: &PointCloud, most: usize) -> Vec<u8> {
    let count = cloud.points.len();
    let kept = most.min(count);
    let middle = middle(cloud.bounds().as_ref());
    let start = |stretch: usize| (stretch as u128 * count as u128 / kept as u128) as usize;
    let mut rows = Vec::with_capacity(kept * 16);
    for stretch in 0..kept {
        let (first, end) = (start(stretch), start(stretch + 1));
        let i = first + scattered(stretch) % (end - first);
        for (coordinate, middle) in cloud.points[i].iter().zip(middle) {
            rows.extend(((coordinate - middle) as f32).to_le_bytes());
        }
        rows.extend((cloud.label(i).target() as f32).to_le_bytes());
    }
    rows
}

pub(super) fn middle(bounds: Option<&Bounds>) -> [f64; 3] {
    bounds.map_or([0.0; 3], |bounds| {
        std::array::from_fn(|axis| bounds.min[axis] / 2.0 + bounds.max[axis] / 2.0)
    })
}

/// A number that shows nothing of the one it is made from, always the same (the finaliser of
/// `MurmurHash3`).
fn scattered(number: usize) -> usize {
    let mut mixed = number as u64;
    for factor in [0xff51_afd7_ed55_8ccd, 0xc4ce_b9fe_1a85_ec53] {
        mixed = (mixed ^ (mixed >> 33)).wrapping_mul(factor);
    }
    (mixed ^ (mixed >> 33)) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruction::cloud::Label;

    fn read(rows: &[u8]) -> Vec<[f32; 4]> {
        let number = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().unwrap());
        rows.chunks_exact(16)
            .map(|row| std::array::from_fn(|i| number(&row[4 * i..4 * i + 4])))
            .collect()
    }

    #[test]
    fn each_stretch_of_the_file_gives_a_point() {
        let cloud = PointCloud {
            points: (0..1_000).map(|i| [1e9 + f64::from(i), 0.0, 7.0]).collect(),
            labels: Some(vec![Label::Exterior; 1_000]),
            ..PointCloud::default()
        };
        let all = read(&rows(&cloud, 5_000));
        assert_eq!(all.len(), 1_000);
        let doubled = |row: [f32; 4]| row.map(|value| (2.0 * value) as i32);
        assert_eq!(doubled(all[0]), [-999, 0, 0, -2]);
        assert_eq!(doubled(all[999]), [999, 0, 0, -2]);
        let some = read(&rows(&cloud, 100));
        assert_eq!(some.len(), 100);
        for (stretch, row) in some.iter().enumerate() {
            let i = (row[0] + 499.5) as usize;
            assert_eq!(i / 10, stretch, "{i}");
        }
        let strides = some.windows(2).map(|pair| pair[1][0] - pair[0][0]);
        assert!(strides.filter(|stride| (stride - 10.0).abs() > 0.5).count() > 50);
        assert_eq!(rows(&cloud, 100), rows(&cloud, 100));
    }

    #[test]
    fn a_cloud_without_points_has_no_rows() {
        assert!(rows(&PointCloud::default(), 10).is_empty());
    }
}
