//! From undirected normals to outward ones: propagation along a spanning tree, then the sign of
//! the enclosed volume.

use super::contradiction::contradiction;
use crate::reconstruction::sampling::neighbours::Neighbourhoods;
use crate::reconstruction::sampling::winding::Oriented;
use crate::reconstruction::vector::{Vec3, add, along, dot, norm, normalized, scale, sub};

/// Below this share of the largest volume that a piece could enclose, its volume has no clear sign
/// and its extreme point decides: an open, nearly flat piece.
const CLEAR_VOLUME: f64 = 0.02;

/// How the normals at the two ends of an edge are compared.
#[derive(Debug, Clone, Copy)]
enum Rule {
    /// As they are \[H92\]: right where noise exceeds the spacing.
    Parallel,
    /// After a reflection at the plane that halves the edge: exact on circular arcs, hence right on
    /// sharp ridges and across thin parts, but misled by noise.
    Reflected,
}

/// Signs the unit `normals` of `points` so that they point outwards.
///
/// Normals are propagated along a minimum spanning tree of the neighbour graph
/// (\[H92\], consistent tangent plane orientation), each connected piece for itself; each piece is then turned so that it encloses a positive
/// volume.
///
/// # Deviations
/// \[H92\] weighs an edge with 1 - |nᵢ·nⱼ|. Here the reflected normal n' = nⱼ - 2 (e·nⱼ) e, e the unit
/// edge, is tried as well, and both on the whole graph and on its shorter half; the result is taken
/// whose winding number is nearest to 1 on the inner and to 0 on the outer side.
pub(super) fn propagated(
    points: &[Vec3],
    normals: &[Vec3],
    neighbours: &Neighbourhoods,
) -> Vec<Vec3> {
    let spacings = neighbours.spacings(points);
    let mut best = (f64::INFINITY, normals.to_vec());
    for rule in [Rule::Reflected, Rule::Parallel] {
        for reach in [neighbours.count(), neighbours.count().div_ceil(2)] {
            let edges = edges(points, normals, neighbours, (rule, reach));
            let oriented = propagate(points, normals, neighbours, edges);
            let contradiction = contradiction(Oriented {
                points,
                normals: &oriented,
                areas: &neighbours.areas(points, &oriented, &spacings),
                spacings: &spacings,
            })
            .closed;
            if contradiction < best.0 {
                best = (contradiction, oriented);
            }
        }
    }
    best.1
}

/// The unit `normals` of `points`, where those that are not `known` take their side from those that are, along a
/// minimum spanning tree of the neighbour graph.
pub(super) fn grown(
    points: &[Vec3],
    normals: &[Vec3],
    neighbours: &Neighbourhoods,
    known: &[bool],
) -> Vec<Vec3> {
    let mut forest = Forest::new(points.len() + 1);
    let ground = points.len();
    for i in (0..points.len()).filter(|&i| known[i]) {
        forest.join(ground, i, false);
    }
    let of_open = |i: &usize| !known[*i];
    let mut edges = Vec::new();
    for i in (0..points.len()).filter(of_open) {
        edges.extend(
            neighbours
                .of(i)
                .map(|j| edge(points, normals, Rule::Reflected, [i, j])),
        );
    }
    for (_, i, j, opposite) in sorted(edges) {
        forest.join(i as usize, j as usize, opposite);
    }
    let (root, turned) = forest.root(ground);
    let mut grown = normals.to_vec();
    for i in (0..points.len()).filter(of_open) {
        if forest.root(i) == (root, !turned) {
            grown[i] = scale(grown[i], -1.0);
        }
    }
    grown
}

/// An edge of the neighbour graph: cost, ends, and whether its normals should be opposite.
type Edge = (f64, u32, u32, bool);

/// The edges from each point to its nearest `reach` neighbours, cheapest first.
fn edges(
    points: &[Vec3],
    normals: &[Vec3],
    neighbours: &Neighbourhoods,
    (rule, reach): (Rule, usize),
) -> Vec<Edge> {
    let mut edges: Vec<Edge> = Vec::new();
    for i in 0..points.len() {
        // Either end may list the other; of two equal edges the second one changes nothing.
        let near = neighbours.of(i).take(reach);
        edges.extend(near.map(|j| edge(points, normals, rule, [i, j])));
    }
    sorted(edges)
}

fn edge(points: &[Vec3], normals: &[Vec3], rule: Rule, [i, j]: [usize; 2]) -> Edge {
    let agreement = rule.agreement(sub(points[j], points[i]), normals[i], normals[j]);
    let cost = 1.0 - agreement.abs();
    (cost, i.min(j) as u32, i.max(j) as u32, agreement < 0.0)
}

/// Cheapest first.
fn sorted(mut edges: Vec<Edge>) -> Vec<Edge> {
    edges.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    edges
}

/// Normals signed along the minimum spanning trees of `edges`, outwards as far as each tree's volume
/// tells.
fn propagate(
    points: &[Vec3],
    normals: &[Vec3],
    neighbours: &Neighbourhoods,
    edges: Vec<Edge>,
) -> Vec<Vec3> {
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

impl Rule {
    /// Cosine between the normals `a` and `b` at the ends of `edge`, signed as they should agree.
    fn agreement(self, edge: Vec3, a: Vec3, b: Vec3) -> f64 {
        match (self, normalized(edge)) {
            (Self::Reflected, Some(edge)) => dot(a, along(b, -2.0 * dot(edge, b), edge)),
            _ => dot(a, b),
        }
    }
}

/// Whether the normals of a piece point inwards as a whole.
pub(in crate::reconstruction::sampling) fn points_inwards(
    points: &[Vec3],
    normals: &[Vec3],
    piece: &[usize],
    neighbours: &Neighbourhoods,
) -> bool {
    let volume = enclosed(points, normals, piece, neighbours);
    if volume.abs() > CLEAR_VOLUME {
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

/// Volume that the normals of a piece enclose, as a share of the most that it could.
fn enclosed(
    points: &[Vec3],
    normals: &[Vec3],
    piece: &[usize],
    neighbours: &Neighbourhoods,
) -> f64 {
    let centre = scale(
        piece.iter().fold([0.0; 3], |sum, &i| add(sum, points[i])),
        1.0 / piece.len() as f64,
    );
    // ∫ (p - c)·n dA is three times the enclosed volume.
    let (mut volume, mut most) = (0.0, f64::MIN_POSITIVE);
    for &i in piece {
        let arm = sub(points[i], centre);
        let area = neighbours.of(i).last().map_or(0.0, |j| {
            dot(sub(points[j], points[i]), sub(points[j], points[i]))
        });
        volume += area * dot(arm, normals[i]);
        most += area * norm(arm);
    }
    volume / most
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
