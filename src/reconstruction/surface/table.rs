//! The triangles of a marching-cubes cell for each of the 256 sign patterns of its corners.
//!
//! The table of \[LC87\] treats a pattern and its complement alike, so that two cells may cut their
//! common face differently and leave a hole. Here the table follows from one rule for faces, which
//! both cells apply alike: walking around a face, each run of inside corners is cut off by one
//! segment; so where two inside corners face each other diagonally, they are separated. The
//! segments of a cell join to loops, each crossed edge having one segment in each of its two faces,
//! and each loop is filled with triangles.
//!
//! The mesh is a closed manifold for every sign pattern: a segment belongs to the loops of the two
//! cells at its face, once in each direction; an edge within a cell belongs to two triangles of its
//! loop, provided that the neighbour cannot have an edge between the same vertices, which is why no
//! diagonal may join two vertices of a common face; and around a vertex the fans of the four cells
//! at its grid edge form one ring.

use std::sync::LazyLock;

/// Axis of a cell's edge, and the coordinates of its lower corner.
///
/// Edge 4a + u + 2v runs along axis a; its corners have the coordinate u along axis a+1 and v along
/// axis a+2, counted modulo 3.
pub(super) const fn edge(number: usize) -> (usize, [usize; 3]) {
    let axis = number / 4;
    let mut corner = [0; 3];
    corner[(axis + 1) % 3] = number & 1;
    corner[(axis + 2) % 3] = number >> 1 & 1;
    (axis, corner)
}

/// Triangles of the sign pattern `case`, as edges of the cell, counter-clockwise seen from outside.
///
/// Bit x + 2y + 4z of `case` says that the corner (x, y, z) is inside.
pub(super) fn triangles(case: u8) -> &'static [[u8; 3]] {
    static TABLE: LazyLock<Vec<Vec<[u8; 3]>>> =
        LazyLock::new(|| (0..=u8::MAX).map(derive).collect());
    &TABLE[usize::from(case)]
}

fn derive(case: u8) -> Vec<[u8; 3]> {
    let mut next = segments(case);
    let mut triangles = Vec::new();
    for start in 0..12 {
        let mut outline = Vec::new();
        let mut at = start;
        while let Some(following) = next[at].take() {
            outline.push(at as u8);
            at = following;
        }
        if !outline.is_empty() {
            let (_, filled) = fill(&outline).expect("every loop has a filling (tested)");
            triangles.extend(filled);
        }
    }
    triangles
}

/// The edge that follows each crossed edge on its loop.
fn segments(case: u8) -> [Option<usize>; 12] {
    let mut next = [None; 12];
    for axis in 0..3 {
        for side in 0..2 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let corner = |i: usize| -> usize {
                // Counter-clockwise seen from outside the cell.
                let i = if side == 1 { i } else { 3 - i } % 4;
                let (at_u, at_v) = [(0, 0), (1, 0), (1, 1), (0, 1)][i];
                side << axis | at_u << u | at_v << v
            };
            let inside = |i: usize| case >> corner(i % 4) & 1 == 1;
            for first in 0..4 {
                if inside(first) || !inside(first + 1) {
                    continue;
                }
                let last = (first + 2..=first + 4)
                    .find(|i| !inside(*i))
                    .expect("`first` is outside");
                let entry = edge_between(corner(first), corner((first + 1) % 4));
                let exit = edge_between(corner((last - 1) % 4), corner(last % 4));
                next[entry] = Some(exit);
            }
        }
    }
    next
}

fn edge_between(one: usize, other: usize) -> usize {
    let axis = (one ^ other).ilog2() as usize;
    let at = |step: usize| one >> ((axis + step) % 3) & 1;
    4 * axis + at(1) + 2 * at(2)
}

/// The triangles that fill a loop with the shortest diagonals, none in a face of the cell, and the
/// sum of the diagonals' squared lengths; `None` if there is no such filling.
fn fill(outline: &[u8]) -> Option<(i32, Vec<[u8; 3]>)> {
    let last = outline.len() - 1;
    if last < 2 {
        return Some((0, Vec::new()));
    }
    (1..last)
        .filter_map(|apex| {
            let (left, mut triangles) = fill(&outline[..=apex])?;
            let (right, others) = fill(&outline[apex..])?;
            let before = if apex > 1 {
                diagonal(outline[0], outline[apex])?
            } else {
                0
            };
            let after = if apex + 1 < last {
                diagonal(outline[apex], outline[last])?
            } else {
                0
            };
            triangles.extend(others);
            triangles.push([outline[0], outline[apex], outline[last]]);
            Some((left + right + before + after, triangles))
        })
        .min_by_key(|(length, _)| *length)
}

/// Squared distance of the middles of two edges in half cells; `None` on a common face.
fn diagonal(one: u8, other: u8) -> Option<i32> {
    let [p, q] = [one, other].map(|number| {
        let (axis, corner) = edge(usize::from(number));
        let mut middle = corner.map(|c| 2 * c as i32);
        middle[axis] = 1;
        middle
    });
    let common_face = (0..3).any(|a| p[a] == q[a] && p[a] != 1);
    (!common_face).then(|| (0..3).map(|a| (p[a] - q[a]).pow(2)).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_crossed_edge_lies_on_one_loop() {
        for case in 0..=u8::MAX {
            let mut used = [false; 12];
            for triangle in triangles(case) {
                for number in triangle {
                    used[usize::from(*number)] = true;
                }
            }
            for (number, used) in used.into_iter().enumerate() {
                let (axis, [x, y, z]) = edge(number);
                let lower = x | y << 1 | z << 2;
                let signs = [lower, lower | 1 << axis].map(|corner| case >> corner & 1);
                assert_eq!(used, signs[0] != signs[1], "case {case}, edge {number}");
            }
        }
    }

    #[test]
    fn one_corner_gives_one_triangle_that_faces_away_from_it() {
        // Edges 0, 4 and 8 leave the corner 0 along x, y and z.
        let [triangle] = triangles(1) else {
            panic!("one triangle")
        };
        let turn = triangle.iter().position(|e| *e == 0).unwrap();
        assert_eq!([triangle[(turn + 1) % 3], triangle[(turn + 2) % 3]], [4, 8]);
    }

    #[test]
    fn diagonal_inside_corners_of_a_face_are_separated() {
        assert_eq!(triangles(0b0000_1001).len(), 2);
        assert_eq!(
            triangles(0b1111_0110).len(),
            4,
            "their complement is one hexagon"
        );
        assert_eq!(triangles(0b0110_1001).len(), 4);
    }
}
