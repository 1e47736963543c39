//! Smaller triangles where the field shows more detail than the grid.
//!
//! The grid has one step everywhere. Where points lie much closer than elsewhere, the field has details between grid
//! points. Edges of the contour that are too long for them are halved at their middles, which then move onto the zero
//! set like all vertices. Both triangles at an edge are split at the same vertex, so that the mesh stays closed.

use rayon::prelude::*;

use super::marching_cubes::Contour;
use super::{Field, Request};
use crate::reconstruction::error::Error;
use crate::reconstruction::vector::{Vec3, along, distance, sub};

/// Longest edge over the length of the detail. Where points are even, no edge of the contour is longer: the grid has a
/// step to 0.9 of their spacing, a cell's diagonal is √3 steps long, and the spacing of a block is within 13 % of that
/// of all.
const LONGEST: f64 = 1.8;

/// Most times that an edge is halved.
const ROUNDS: usize = 5;

/// Triangles that are looked at between two questions whether to stop.
const AT_A_TIME: usize = 1 << 20;

/// Triangles of whose edges a thread asks at a time.
const PIECE: usize = 1 << 10;

/// Splits the triangles of `contour` until their edges are short enough for the detail of `field`.
///
/// # Errors
/// [`Error::MeshTooLarge`] and [`Error::Cancelled`].
pub(super) fn refine(
    field: &dyn Field,
    request: &Request<'_>,
    contour: &mut Contour,
) -> Result<(), Error> {
    let Some(finest) = field.finest_detail() else {
        return Ok(());
    };
    // Edges between vertices before it are short enough.
    let mut first_new = 0;
    for _ in 0..ROUNDS {
        let mut edges = Vec::new();
        for some in contour.triangles.chunks(AT_A_TIME) {
            if (request.cancelled)() {
                return Err(Error::Cancelled);
            }
            let pieces = some.par_chunks(PIECE);
            edges.par_extend(pieces.flat_map_iter(|triangles| {
                let edges = longer(contour, triangles, LONGEST * finest);
                let new = edges.filter(|[_, last]| *last >= first_new);
                too_long(field, &contour.vertices, new.collect())
            }));
        }
        if edges.is_empty() {
            return Ok(());
        }
        // Both triangles at an edge become one more.
        if contour.triangles.len() + 2 * edges.len() > request.max_triangles {
            return Err(Error::MeshTooLarge {
                limit: request.max_triangles,
            });
        }
        edges.par_sort_unstable();
        first_new = contour.vertices.len() as u32;
        split(contour, &edges);
    }
    Ok(())
}

/// The ends of an edge, the lower number first.
type Edge = [u32; 2];

/// The edges of `triangles` of `contour` that are longer than `length`, each of one of its two triangles. Those of caps
/// are none: they stay where they are.
fn longer<'a>(
    contour: &'a Contour,
    triangles: &'a [[u32; 3]],
    length: f64,
) -> impl Iterator<Item = Edge> + 'a {
    let at = |v: u32| contour.vertices[v as usize];
    let is_cap = |v: u32| contour.caps.binary_search(&v).is_ok();
    triangles
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        // Each edge runs upwards in one of its two triangles.
        .filter(move |&[from, to]| from < to && distance(at(from), at(to)) > length)
        .filter(move |&[from, to]| !is_cap(from) && !is_cap(to))
}

/// Those of `edges` that are too long for the detail at their middles.
fn too_long(field: &dyn Field, vertices: &[Vec3], mut edges: Vec<Edge>) -> Vec<Edge> {
    let middles: Vec<Vec3> = edges.iter().map(|edge| middle(vertices, *edge)).collect();
    let mut detail = vec![f64::INFINITY; middles.len()];
    field.detail(&middles, &mut detail);
    let mut detail = detail.into_iter();
    edges.retain(|[a, b]| {
        let ends = [*a, *b].map(|v| vertices[v as usize]);
        detail
            .next()
            .is_some_and(|detail| distance(ends[0], ends[1]) > LONGEST * detail)
    });
    edges
}

fn middle(vertices: &[Vec3], [a, b]: Edge) -> Vec3 {
    let [a, b] = [a, b].map(|v| vertices[v as usize]);
    along(a, 0.5, sub(b, a))
}

/// Halves `edges`, which ascend, in all triangles that have them.
fn split(contour: &mut Contour, edges: &[Edge]) {
    let first = contour.vertices.len() as u32;
    // Where the edges from each vertex begin.
    let mut begins = vec![0; contour.vertices.len() + 1];
    for [from, _] in edges {
        begins[*from as usize + 1] += 1;
    }
    for v in 1..begins.len() {
        begins[v] += begins[v - 1];
    }
    let middles = edges.iter().map(|edge| middle(&contour.vertices, *edge));
    let middles: Vec<Vec3> = middles.collect();
    contour.vertices.extend(middles);
    let vertices = &contour.vertices;
    let halved = |a: u32, b: u32| {
        let (from, to) = (a.min(b), a.max(b));
        let begin = begins[from as usize];
        let of_vertex = &edges[begin..begins[from as usize + 1]];
        let place = of_vertex.iter().position(|edge| edge[1] == to)?;
        Some(first + (begin + place) as u32)
    };
    contour.triangles = contour
        .triangles
        .par_iter()
        .flat_map_iter(|&[a, b, c]| {
            pieces(
                vertices,
                [a, b, c],
                [halved(a, b), halved(b, c), halved(c, a)],
            )
        })
        .collect();
}

/// The triangles that a triangle becomes, given the vertices at the middles of its edges, where these are halved.
fn pieces(vertices: &[Vec3], [a, b, c]: [u32; 3], middles: [Option<u32>; 3]) -> Vec<[u32; 3]> {
    match middles {
        [None, None, None] => vec![[a, b, c]],
        [Some(m), None, None] => vec![[a, m, c], [m, b, c]],
        [Some(m), Some(n), None] => {
            let at = |v: u32| vertices[v as usize];
            let mut made = vec![[m, b, n]];
            // The rest has four corners: it is cut along its shorter diagonal.
            made.extend(if distance(at(a), at(n)) < distance(at(m), at(c)) {
                [[a, m, n], [a, n, c]]
            } else {
                [[a, m, c], [m, n, c]]
            });
            made
        }
        [Some(m), Some(n), Some(o)] => vec![[a, m, o], [m, b, n], [n, c, o], [m, n, o]],
        // The same, seen from another corner.
        [first, second, third] => pieces(vertices, [b, c, a], [second, third, first]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruction::mesh::{Topology, TriangleMesh};
    use crate::reconstruction::shapes::Shape;
    use crate::reconstruction::surface::extract;
    use crate::reconstruction::vector::{Bounds, norm};

    const BALL: Shape = Shape::Sphere { radius: 1.0 };

    /// It, with fine detail on one side.
    struct Ball;

    impl Field for Ball {
        fn values(&self, points: &[Vec3], values: &mut [f64]) -> Result<(), Error> {
            BALL.values(points, values)
        }

        fn values_and_gradients(
            &self,
            points: &[Vec3],
            values: &mut [f64],
            gradients: &mut [Vec3],
        ) -> Result<(), Error> {
            BALL.values_and_gradients(points, values, gradients)
        }

        fn detail(&self, points: &[Vec3], lengths: &mut [f64]) {
            for (length, p) in lengths.iter_mut().zip(points) {
                *length = if p[0] > 0.5 { 0.01 } else { 0.2 };
            }
        }

        fn finest_detail(&self) -> Option<f64> {
            Some(0.01)
        }
    }

    fn request(max_triangles: usize) -> Request<'static> {
        let bounds = Bounds {
            min: [-1.2; 3],
            max: [1.2; 3],
        };
        Request {
            max_triangles,
            ..Request::new(bounds, 20)
        }
    }

    fn longest_edge(mesh: &TriangleMesh, counts: impl Fn(Vec3) -> bool) -> f64 {
        let edges = mesh
            .triangles
            .iter()
            .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        let ends = edges.map(|edge| edge.map(|v| mesh.vertices[v as usize]));
        ends.filter(|ends| ends.iter().all(|p| counts(*p)))
            .map(|[a, b]| distance(a, b))
            .fold(0.0, f64::max)
    }

    #[test]
    fn triangles_are_small_where_there_is_detail_and_the_mesh_stays_closed() {
        let mesh = extract(&Ball, &request(1_000_000)).unwrap().mesh;
        let topology = Topology::of(&mesh);
        assert!(topology.closed && topology.manifold && topology.oriented);
        assert_eq!(topology.genus, Some(0));
        assert!(longest_edge(&mesh, |p| p[0] > 0.51) < 1.05 * LONGEST * 0.01);
        // There is one cell of the grid to 0.126.
        assert!(longest_edge(&mesh, |p| p[0] < 0.3) > 0.1);
        for (vertex, normal) in mesh.vertices.iter().zip(&mesh.normals) {
            assert!((norm(*vertex) - 1.0).abs() < 1e-6);
            assert!(distance(*normal, *vertex) < 1e-5);
        }
    }

    #[test]
    fn more_triangles_than_allowed_are_not_made() {
        let whole = extract(&Ball, &request(1_000_000))
            .unwrap()
            .mesh
            .triangles
            .len();
        let result = extract(&Ball, &request(whole - 1));
        assert!(matches!(result, Err(Error::MeshTooLarge { limit }) if limit == whole - 1));
    }
}
