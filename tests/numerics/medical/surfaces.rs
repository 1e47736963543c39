//! From a file to points in the patient: what the builder of slices makes of each reader's planes.

use meshway::reconstruction::cloud::{Format, Label, Limits, Options, PointCloud, read_part};
use meshway::reconstruction::medical::Choice;
use meshway::reconstruction::vector::{Bounds, distance, dot};

use super::file;

fn cloud(name: &str, choice: &str) -> PointCloud {
    let options = Options {
        hint: Format::from_extension(name),
        limits: &Limits::default(),
        assume_orientation: false,
    };
    let choice = Choice::parse(choice).unwrap();
    read_part(&file(name), &options, Some(&choice)).unwrap().0
}

/// Bounds of the points on the surface.
fn surface(cloud: &PointCloud) -> Bounds {
    let points: Vec<_> = cloud
        .indices(Label::Surface)
        .map(|i| cloud.points[i])
        .collect();
    Bounds::of(&points).unwrap()
}

#[test]
fn the_same_label_gives_points_at_the_same_places() {
    let first = surface(&cloud("plain.nrrd", "label:1"));
    for (name, choice) in [
        ("ras.nrrd", "label:1"),
        ("nifti1_u1.nii.gz", "label:1"),
        ("nifti2_little.nii.gz", "label:1"),
        ("nifti1_turned.nii.gz", "label:1"),
        ("packed.mha", "label:1"),
        ("layers.seg.nrrd", "segment:bone"),
        ("binary.dcm", "segment:bone"),
        ("labelmap.dcm", "label:1"),
    ] {
        let points = cloud(name, choice);
        let counts = points.counts();
        assert!(
            counts.surface > 10 && counts.exterior > 0,
            "{name}: {counts:?}"
        );
        let found = surface(&points);
        // Thinning may leave another point of the same contour: within a pixel or so.
        let off = distance(found.centre(), first.centre());
        assert!(off < 1.0, "{name}: {off}");
        let grown = distance(found.extent(), first.extent());
        assert!(grown < 2.0, "{name}: {grown}");
    }
    // The mirror image lies elsewhere.
    let mirrored = surface(&cloud("nifti1_mirrored.nii.gz", "label:1"));
    assert!(distance(mirrored.centre(), first.centre()) > 5.0);
}

#[test]
fn contours_lie_in_their_oblique_planes() {
    let points = cloud("structures.dcm", "roi:Tilted");
    // The middle of the squares, 5 and 2 along them and 2 up, in the turned frame.
    let middle = [0.8 * 5.0 + 0.6 * 2.0, 2.0, -0.6 * 5.0 + 0.8 * 2.0];
    let centre = surface(&points).centre();
    assert!(distance(centre, middle) < 1.0, "{centre:?} {middle:?}");
    let normal = [0.6, 0.0, 0.8];
    for i in points.indices(Label::Surface) {
        let height = dot(points.points[i], normal);
        let nearest = [0.0, 2.0, 4.0].map(|plane| (height - plane).abs());
        assert!(
            nearest.into_iter().fold(f64::INFINITY, f64::min) < 1e-3,
            "{height}"
        );
    }
}
