//! The winding number of oriented points: about 1 inside, about 0 outside.

#![expect(
    clippy::inline_always,
    reason = "code compiles for an instruction set only inside the function that enables it"
)]

use pulp::{Arch, NullaryFnOnce};

use crate::reconstruction::nearby::{Threads, Walk};
use crate::reconstruction::vector::{Bounds, Vec3, add, along, distance, dot, norm, scale, sub};

/// Points of a leaf, summed one by one.
const LEAF: usize = 16;

/// Places that go through the tree together: as many as the widest registers hold.
const LANES: usize = 8;

/// Points of a node from which on its halves are made side by side.
const SIDE_BY_SIDE: usize = 1 << 14;

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

#[derive(Clone, Default)]
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
        let mut nodes = vec![Node::default(); nodes_of(sources.len())];
        build(&mut sources, &mut nodes, 0, 0);
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

    /// The winding number at each of `queries`, the same as one by one, on all threads.
    pub fn at_all(&self, queries: &[Vec3]) -> Vec<f64> {
        self.at_each(queries, Threads::All)
    }

    /// The same on these threads.
    pub(super) fn at_each(&self, queries: &[Vec3], threads: Threads) -> Vec<f64> {
        let arch = Arch::new();
        Walk::on(threads, queries).map_together(|at: [usize; LANES]| {
            let queries = Queries {
                x: at.map(|i| queries[i][0]),
                y: at.map(|i| queries[i][1]),
                z: at.map(|i| queries[i][2]),
            };
            let winding = self;
            arch.dispatch(AtSome { winding, queries })
        })
    }

    /// The winding numbers at neighbouring places, which go through the tree together: a node is looked at once for all
    /// of them that need it. Each sum is that of [`Self::at`], in its order.
    #[inline(always)]
    fn at_some(&self, queries: &Queries) -> [f64; LANES] {
        let mut sums = [0.0; LANES];
        let mut open = Vec::with_capacity(64);
        if !self.nodes.is_empty() {
            open.push((0, [true; LANES]));
        }
        while let Some((index, asks)) = open.pop() {
            let node = &self.nodes[index];
            if node.second == 0 {
                for source in &self.sources[node.start..node.end] {
                    source.add_kernels(queries, asks, &mut sums);
                }
                continue;
            }
            let [x, y, z] = node.centre;
            let [u, v, w] = node.moment;
            let reach = FAR * node.radius;
            let mut wholes = [0.0; LANES];
            let mut far = [false; LANES];
            for l in 0..LANES {
                let away = [x - queries.x[l], y - queries.y[l], z - queries.z[l]];
                let length = norm(away);
                wholes[l] = dot(away, [u, v, w]) / (length * length * length);
                far[l] = length > reach;
            }
            let mut nearer = [false; LANES];
            for l in 0..LANES {
                sums[l] += if asks[l] && far[l] { wholes[l] } else { 0.0 };
                nearer[l] = asks[l] && !far[l];
            }
            if nearer != [false; LANES] {
                open.push((node.second, nearer));
                open.push((index + 1, nearer));
            }
        }
        sums
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

    /// Adds the kernel at those of several places that ask for it.
    #[inline(always)]
    fn add_kernels(&self, queries: &Queries, asks: [bool; LANES], sums: &mut [f64; LANES]) {
        let [x, y, z] = self.position;
        for l in 0..LANES {
            let away = [x - queries.x[l], y - queries.y[l], z - queries.z[l]];
            let length = norm(away).max(self.softening);
            let kernel = dot(away, self.moment) / (length * length * length).max(f64::MIN_POSITIVE);
            sums[l] += if asks[l] { kernel } else { 0.0 };
        }
    }
}

/// [`Winding::at_some`], to be compiled for an instruction set.
struct AtSome<'a> {
    winding: &'a Winding,
    queries: Queries,
}

impl NullaryFnOnce for AtSome<'_> {
    type Output = [f64; LANES];

    #[inline(always)]
    fn call(self) -> [f64; LANES] {
        self.winding.at_some(&self.queries)
    }
}

/// Coordinates of several places.
struct Queries {
    x: [f64; LANES],
    y: [f64; LANES],
    z: [f64; LANES],
}

/// Nodes of the tree over so many sources.
fn nodes_of(sources: usize) -> usize {
    match sources {
        0 => 0,
        1..=LEAF => 1,
        _ => 1 + nodes_of(sources / 2) + nodes_of(sources - sources / 2),
    }
}

/// Makes the tree over `sources`, halved along the longest edge of their box: the `nodes` from number `first` on, of sources
/// from number `start` on. Both halves of many at a time.
fn build(sources: &mut [Source], nodes: &mut [Node], first: usize, start: usize) {
    let Some((node, below)) = nodes.split_first_mut() else {
        return;
    };
    let bounds = Bounds::of(sources.iter().map(|s| &s.position)).expect("a node holds points");
    let (mut weight, mut centre, mut moment) = (0.0, [0.0; 3], [0.0; 3]);
    for source in sources.iter() {
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
    let radius = sources
        .iter()
        .map(|s| distance(s.position, centre) + s.softening)
        .fold(0.0, f64::max);
    *node = Node {
        centre,
        radius,
        moment,
        start,
        end: start + sources.len(),
        second: 0,
    };
    if below.is_empty() {
        return;
    }
    let extent = bounds.extent();
    let axis = (0..3).fold(0, |best, i| if extent[i] > extent[best] { i } else { best });
    let middle = sources.len() / 2;
    sources.select_nth_unstable_by(middle, |a, b| a.position[axis].total_cmp(&b.position[axis]));
    let is_large = sources.len() >= SIDE_BY_SIDE;
    let (lower, upper) = sources.split_at_mut(middle);
    let (lower_nodes, upper_nodes) = below.split_at_mut(nodes_of(middle));
    let second = first + 1 + lower_nodes.len();
    node.second = second;
    let mut lower = || build(lower, lower_nodes, first + 1, start);
    let mut upper = || build(upper, upper_nodes, second, start + middle);
    if is_large {
        rayon::join(lower, upper);
    } else {
        lower();
        upper();
    }
}
