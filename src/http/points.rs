//! `GET /v1/clouds/{id}/points`: some of the points of a cloud, to look at.

use axum::extract::State;
use axum::http::{HeaderMap, HeaderName, HeaderValue};
use axum::response::Response;
use sha2::{Digest, Sha256};

use super::AppState;
use super::cloud_files;
use super::clouds::find;
use super::download::{Content, Download, hex};
use super::error::{ApiError, Result};
use super::extract::{Id, Query, text};
use super::inspect::{Reading, Stored, parse, read_by, verdict};
use crate::jobs::CloudId;
use crate::reconstruction::cloud::{Format, Limits, PointCloud};
use crate::reconstruction::vector::Bounds;

/// Points of an answer that are enough for a picture.
const ENOUGH: usize = 100_000;

/// Most points of an answer: 16 bytes each.
const MOST: usize = 1_000_000;

/// What the coordinates are counted from.
const ORIGIN: HeaderName = HeaderName::from_static("meshway-origin");

/// `GET /v1/clouds/{id}/points`: at most `max` of them, as binary numbers.
pub(super) async fn subset(
    State(app): State<AppState>,
    mut query: Query,
    Id(id): Id<CloudId>,
    headers: HeaderMap,
) -> Result<Response> {
    let most = query.take("max", |value| match text::<usize>(value) {
        Ok(most @ 1..=MOST) => Ok(most),
        _ => Err(format!("must be a number from 1 to {MOST}")),
    });
    query.finish()?;
    let most = most.unwrap_or(ENOUGH);
    let cloud = find(&app, &id).await?;
    let file = Stored {
        path: cloud_files::path(&app, &cloud.sha256),
        bytes: cloud.bytes,
        hint: Format::from_extension(&format!("cloud.{}", cloud.format)),
    };
    let arguments = [format!("--points={most}")];
    let reading = read_by(
        &app,
        &file,
        &arguments,
        move |bytes, hint, limits: &Limits| {
            let (cloud, _) = parse(bytes, hint, limits)?;
            Ok((cloud.bounds(), rows(&cloud, most)))
        },
    );
    let (bounds, rows) = match reading.await? {
        Reading::Here(read) => read,
        Reading::InChild(said) => {
            let end = said.iter().position(|&byte| byte == b'\n');
            let (line, rows) = said.split_at(end.map_or(said.len(), |end| end + 1));
            (Some(verdict(line)?.bounds), rows.to_vec())
        }
    };
    let [x, y, z] = middle(bounds.as_ref());
    let download = Download {
        sha256: hex(Sha256::digest(&rows)),
        content: Content::Memory(rows.into()),
        media_type: "application/octet-stream",
        file_name: format!("{id}.f32"),
    };
    let mut response = download.respond(&headers).await?;
    let origin = HeaderValue::from_str(&format!("{x},{y},{z}")).map_err(ApiError::internal)?;
    response.headers_mut().insert(ORIGIN, origin);
    Ok(response)
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

fn middle(bounds: Option<&Bounds>) -> [f64; 3] {
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
