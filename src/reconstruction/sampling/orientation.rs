//! From undirected normals to outward ones: propagation along a spanning tree, then the sign of
//! the enclosed volume.
//!
//! Everything else sees only [`orient`], so that a better method can take its place.

use super::neighbours::Neighbourhoods;
use crate::reconstruction::vector::{Vec3, add, along, dot, normalized, scale, sub};

/// Below this share of the largest volume that a piece could enclose, its volume has no clear sign
/// and its extreme point decides: an open, nearly flat piece.
const CLEAR_VOLUME: f64 = 0.02;

/// Signs the unit `normals` of `points` so that they point outwards.
///
/// Normals are propagated along a minimum spanning tree of the neighbour graph \[H92, section 3.3\],
/// each connected piece for itself; each piece is then turned so that it encloses a positive
/// volume.
///
/// # Deviations
/// \[H92\] weighs an edge with 1 - |nᵢ·nⱼ|. Here nⱼ is first reflected at the plane that halves the
/// edge, n' = nⱼ - 2 (e·nⱼ) e, e the unit edge: that is exact on any circular arc, so that sharp
/// ridges and the two sides of a thin part are told apart.
pub fn orient(points: &[Vec3], normals: &[Vec3], neighbours: &Neighbourhoods) -> Vec<Vec3> {
    let mut edges: Vec<(f64, u32, u32, bool)> = Vec::new();
    for i in 0..points.len() {
        for j in neighbours.of(i) {
            // Either end may list the other; equal edges meet in the forest, where one is idle.
            let agreement = agreement(points, normals, i, j);
            edges.push((
                1.0 - agreement.abs(),
                i.min(j) as u32,
                i.max(j) as u32,
                agreement < 0.0,
            ));
        }
    }
    edges.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut forest = Forest::new(points.len());
    for (_, i, j, opposite) in edges {
        forest.join(i as usize, j as usize, opposite);
    }
    let mut pieces: Vec<Vec<usize>> = vec![Vec::new(); points.len()];
    let mut oriented = normals.to_vec();
    for (i, normal) in oriented.iter_mut().enumerate() {
        let (root, opposite) = forest.root(i);
        pieces[root].push(i);
        if opposite {
            *normal = scale(*normal, -1.0);
        }
    }
    for piece in pieces.iter().filter(|piece| !piece.is_empty()) {
        if points_inwards(points, &oriented, piece, neighbours) {
            for &i in piece {
                oriented[i] = scale(oriented[i], -1.0);
            }
        }
    }
    oriented
}

/// Cosine between the normal at `i` and the one at `j`, reflected at the middle of the edge.
fn agreement(points: &[Vec3], normals: &[Vec3], i: usize, j: usize) -> f64 {
    let plain = dot(normals[i], normals[j]);
    normalized(sub(points[j], points[i])).map_or(plain, |edge| {
        let reflected = along(normals[j], -2.0 * dot(edge, normals[j]), edge);
        dot(normals[i], reflected)
    })
}

/// Whether the normals of a piece point inwards as a whole.
pub(super) fn points_inwards(
    points: &[Vec3],
    normals: &[Vec3],
    piece: &[usize],
    neighbours: &Neighbourhoods,
) -> bool {
    let centre = scale(
        piece.iter().fold([0.0; 3], |sum, &i| add(sum, points[i])),
        1.0 / piece.len() as f64,
    );
    // ∫ (p - c)·n dA is three times the enclosed volume.
    let (mut volume, mut most) = (0.0, 0.0);
    for &i in piece {
        let arm = sub(points[i], centre);
        let area = neighbours.of(i).last().map_or(0.0, |j| {
            dot(sub(points[j], points[i]), sub(points[j], points[i]))
        });
        volume += area * dot(arm, normals[i]);
        most += area * dot(arm, arm).sqrt();
    }
    if volume.abs() > CLEAR_VOLUME * most {
        return volume < 0.0;
    }
    let votes = (0..3).map(|axis| {
        let extreme = |sign: f64| {
            let top = piece
                .iter()
                .copied()
                .max_by(|&a, &b| (sign * points[a][axis]).total_cmp(&(sign * points[b][axis])));
            top.map_or(0.0, |i| sign * normals[i][axis])
        };
        extreme(1.0) + extreme(-1.0)
    });
    votes.sum::<f64>() < 0.0
}

/// Disjoint trees whose members know whether their normal is opposite to their root's.
struct Forest {
    parent: Vec<(u32, bool)>,
    size: Vec<u32>,
}

impl Forest {
    fn new(len: usize) -> Self {
        Self {
            parent: (0..len).map(|i| (i as u32, false)).collect(),
            size: vec![1; len],
        }
    }

    /// Root of `i`, and whether `i` is opposite to it. Union by size keeps the way short.
    fn root(&self, mut i: usize) -> (usize, bool) {
        let mut opposite = false;
        while self.parent[i].0 as usize != i {
            opposite ^= self.parent[i].1;
            i = self.parent[i].0 as usize;
        }
        (i, opposite)
    }

    fn join(&mut self, i: usize, j: usize, opposite: bool) {
        let ((a, from_a), (b, from_b)) = (self.root(i), self.root(j));
        if a == b {
            return;
        }
        let (small, large) = if self.size[a] < self.size[b] {
            (a, b)
        } else {
            (b, a)
        };
        self.parent[small] = (large as u32, from_a ^ from_b ^ opposite);
        self.size[large] += self.size[small];
    }
}
