//! The winding number of oriented points: about 1 inside, about 0 outside.

use crate::reconstruction::nearby::map_nearby;
use crate::reconstruction::vector::{Bounds, Vec3, add, along, distance, dot, norm, scale, sub};

/// Points of a leaf, summed one by one.
const LEAF: usize = 16;

/// A cluster is taken as one dipole from beyond so many of its radii. \[B18\] uses 2 with a
/// second-order expansion; with the first order, 3 keeps the error below 0.02.
const FAR: f64 = 3.0;

/// Radius within which a point's kernel is regularised, in local spacings. A sheet of points on a
/// lattice then gives 0.39 instead of 0.5 at 0.3 spacings above a point, instead of beyond 1.
const SOFTENING: f64 = 0.5;

/// w(q) = Σᵢ Aᵢ (pᵢ - q)·nᵢ / (4π |pᵢ - q|³), with the distance bounded below near each point
/// (\[B18\], for point clouds), and far clusters taken as one dipole (its first order).
pub struct Winding {
    sources: Vec<Source>,
    nodes: Vec<Node>,
}

#[derive(Clone, Copy)]
struct Source {
    position: Vec3,
    /// A n / 4π.
    moment: Vec3,
    softening: f64,
}

struct Node {
    centre: Vec3,
    radius: f64,
    moment: Vec3,
    start: usize,
    end: usize,
    /// Index of the second child; the first one follows its parent. 0 for a leaf.
    second: usize,
}

/// The oriented points of which a winding number is taken.
#[derive(Clone, Copy)]
pub struct Oriented<'a> {
    /// Positions.
    pub points: &'a [Vec3],
    /// Unit normals.
    pub normals: &'a [Vec3],
    /// Areas that the points stand for.
    pub areas: &'a [f64],
    /// Local spacings.
    pub spacings: &'a [f64],
}

impl Winding {
    /// The winding number of the given points.
    pub fn new(oriented: Oriented<'_>) -> Self {
        let mut sources: Vec<Source> = (0..oriented.points.len())
            .map(|i| Source {
                position: oriented.points[i],
                moment: scale(
                    oriented.normals[i],
                    oriented.areas[i] / (4.0 * std::f64::consts::PI),
                ),
                softening: SOFTENING * oriented.spacings[i],
            })
            .collect();
        let mut nodes = Vec::new();
        if !sources.is_empty() {
            let end = sources.len();
            build(&mut sources, &mut nodes, 0, end);
        }
        Self { sources, nodes }
    }

    /// The winding number at `q`.
    pub fn at(&self, q: Vec3) -> f64 {
        let mut sum = 0.0;
        let mut open = if self.nodes.is_empty() {
            vec![]
        } else {
            vec![0]
        };
        while let Some(index) = open.pop() {
            let node = &self.nodes[index];
            let away = sub(node.centre, q);
            let length = norm(away);
            if length > FAR * node.radius && node.second != 0 {
                sum += dot(away, node.moment) / (length * length * length);
            } else if node.second == 0 {
                for source in &self.sources[node.start..node.end] {
                    sum += source.kernel(q);
                }
            } else {
                open.push(node.second);
                open.push(index + 1);
            }
        }
        sum
    }

    /// The winding number at each of `queries`.
    pub fn at_all(&self, queries: &[Vec3]) -> Vec<f64> {
        map_nearby(queries, |i| self.at(queries[i]))
    }

    /// The winding number at `q`, summed over every point: what the clusters approximate.
    pub fn direct(&self, q: Vec3) -> f64 {
        self.sources.iter().map(|source| source.kernel(q)).sum()
    }
}

impl Source {
    fn kernel(&self, q: Vec3) -> f64 {
        let away = sub(self.position, q);
        let length = norm(away).max(self.softening);
        dot(away, self.moment) / (length * length * length).max(f64::MIN_POSITIVE)
    }
}

/// Appends the tree over `sources[start..end]` to `nodes`, halved along the longest edge of its box.
fn build(sources: &mut [Source], nodes: &mut Vec<Node>, start: usize, end: usize) {
    let part = &mut sources[start..end];
    let bounds = Bounds::of(part.iter().map(|s| &s.position)).expect("a node holds points");
    let (mut weight, mut centre, mut moment) = (0.0, [0.0; 3], [0.0; 3]);
    for source in part.iter() {
        let size = norm(source.moment);
        weight += size;
        centre = along(centre, size, source.position);
        moment = add(moment, source.moment);
    }
    let centre = if weight > 0.0 {
        scale(centre, 1.0 / weight)
    } else {
        bounds.centre()
    };
    let radius = part
        .iter()
        .map(|s| distance(s.position, centre) + s.softening)
        .fold(0.0, f64::max);
    let index = nodes.len();
    nodes.push(Node {
        centre,
        radius,
        moment,
        start,
        end,
        second: 0,
    });
    if end - start <= LEAF {
        return;
    }
    let extent = bounds.extent();
    let axis = (0..3).fold(0, |best, i| if extent[i] > extent[best] { i } else { best });
    let middle = (end - start) / 2;
    part.select_nth_unstable_by(middle, |a, b| a.position[axis].total_cmp(&b.position[axis]));
    build(sources, nodes, start, start + middle);
    nodes[index].second = nodes.len();
    build(sources, nodes, start + middle, end);
}
