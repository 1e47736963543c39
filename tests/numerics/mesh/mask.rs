//! Masks of meshes, against the formula of a ball.

use std::io::Read;

use flate2::read::GzDecoder;
use meshway::reconstruction::slices::{Grid, write_mask};
use meshway::reconstruction::space::Space;
use meshway::reconstruction::vector::{dot, sub};

use super::{moved, sphere};

#[test]
fn the_mask_of_a_ball_has_the_voxels_that_its_radius_says() {
    const RADIUS: f64 = 20.0;
    // The flat triangles lie a little inside of the ball: by R (1 - cos of half an edge's angle).
    const FLATNESS: f64 = 0.02;
    let centre = [11.0, -7.0, 103.0];
    let mut mesh = moved(sphere(RADIUS, 5), centre);
    mesh.space = Space::PATIENT;
    // Oblique, left-handed, of unequal steps, and cut by the margin of the grid.
    let grid = Grid {
        size: [67, 61, 29],
        affine: [
            [-0.7, 0.05, 0.2, 29.0],
            [0.04, 0.8, -0.1, -33.0],
            [0.1, -0.02, 1.6, 87.0],
        ],
    };
    let mut packed = Vec::new();
    write_mask(&mesh, &grid, &mut packed).unwrap();
    let mut again = Vec::new();
    write_mask(&mesh, &grid, &mut again).unwrap();
    assert_eq!(packed, again);
    let mut file = Vec::new();
    GzDecoder::new(packed.as_slice())
        .read_to_end(&mut file)
        .unwrap();
    assert_eq!(file.len(), 352 + grid.voxels());
    let short = |at: usize| i16::from_le_bytes(file[at..at + 2].try_into().unwrap());
    let float = |at: usize| f32::from_le_bytes(file[at..at + 4].try_into().unwrap());
    assert_eq!(i32::from_le_bytes(file[..4].try_into().unwrap()), 348);
    assert_eq!([40, 42, 44, 46, 48].map(short), [3, 67, 61, 29, 1]);
    assert_eq!([70, 72].map(short), [2, 8]);
    assert_eq!(&file[344..348], b"n+1\0");
    assert_eq!([short(252), short(254)], [0, 2]);
    // RAS: x and y change their signs.
    for (row, sign) in [-1.0, -1.0, 1.0].into_iter().enumerate() {
        for column in 0..4 {
            let expected = sign * grid.affine[row][column];
            let found = f64::from(float(280 + 16 * row + 4 * column));
            assert!((found - expected).abs() < 1e-5, "{row} {column}");
        }
    }

    let mut inside = 0;
    for (voxel, &found) in file[352..].iter().enumerate() {
        let [nx, ny, _] = grid.size;
        let index = [voxel % nx, voxel / nx % ny, voxel / (nx * ny)].map(|i| i as f64);
        let off = sub(grid.centre(index), centre);
        let distance = dot(off, off).sqrt();
        if distance < RADIUS - FLATNESS {
            assert_eq!(found, 1, "{index:?}");
        } else if distance > RADIUS {
            assert_eq!(found, 0, "{index:?}");
        }
        inside += usize::from(found);
    }
    assert!(inside > 20_000, "{inside}");
}
