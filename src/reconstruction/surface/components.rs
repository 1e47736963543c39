//! Which connected components of a mesh are kept.
//!
//! A trained field may have zeros where no sample told it otherwise. Their components have no input
//! points near them, or fewer than the true surface beside them.

use kiddo::{ImmutableKdTree, SquaredEuclidean};

use crate::reconstruction::mesh::TriangleMesh;
use crate::reconstruction::settings::Components;
use crate::reconstruction::vector::{Vec3, cross, norm, sub};

/// Input points that a component needs: as many as span a piece of surface. One stray point may lie
/// next to a spurious sheet.
const LEAST_SUPPORT: usize = 3;

/// What [`keep_components`] left out.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Dropped {
    /// Connected components.
    pub components: usize,
    /// Their triangles.
    pub triangles: usize,
    /// Their area, in squared units of the mesh.
    pub area: f64,
}

/// Keeps the connected components of `mesh` that `rule` asks for.
///
/// Each of `support_points` supports the component of the vertex nearest to it, if that is within
/// `reach`; `reach` should not be less than the spacing of the grid. [`Components::Supported`] keeps
/// the components with at least three supporting points, or as many as the best has, so that it
/// returns an empty mesh only if no point supports any.
pub fn keep_components(
    mesh: TriangleMesh,
    rule: Components,
    support_points: &[Vec3],
    reach: f64,
) -> (TriangleMesh, Dropped) {
    let (labels, count) = components(&mesh);
    let kept = match rule {
        Components::All => return (mesh, Dropped::default()),
        Components::Largest => largest(&areas(&mesh, &labels, count)),
        Components::Supported => supported(&support(&mesh, &labels, count, support_points, reach)),
    };
    if kept.iter().all(|kept| *kept) {
        return (mesh, Dropped::default());
    }
    let mut dropped = Dropped {
        components: kept.iter().filter(|kept| !**kept).count(),
        ..Dropped::default()
    };
    let of = |triangle: &[u32; 3]| kept[labels[triangle[0] as usize] as usize];
    for triangle in mesh.triangles.iter().filter(|triangle| !of(triangle)) {
        dropped.triangles += 1;
        dropped.area += area(&mesh.vertices, *triangle);
    }
    let keep: Vec<bool> = labels.iter().map(|label| kept[*label as usize]).collect();
    (part(&mesh, &keep), dropped)
}

/// A label for each vertex, numbered by first vertex, and the number of labels.
fn components(mesh: &TriangleMesh) -> (Vec<u32>, usize) {
    let mut parents: Vec<u32> = (0..mesh.vertices.len() as u32).collect();
    for [a, b, c] in &mesh.triangles {
        unite(&mut parents, *a, *b);
        unite(&mut parents, *a, *c);
    }
    let mut count = 0;
    let mut labels = vec![0; parents.len()];
    for vertex in 0..parents.len() as u32 {
        let root = root(&mut parents, vertex);
        // The root is the smallest vertex of its component, so it is met first.
        labels[vertex as usize] = if root == vertex {
            count += 1;
            count - 1
        } else {
            labels[root as usize]
        };
    }
    (labels, count as usize)
}

fn unite(parents: &mut [u32], one: u32, other: u32) {
    let (one, other) = (root(parents, one), root(parents, other));
    parents[one.max(other) as usize] = one.min(other);
}

fn root(parents: &mut [u32], mut vertex: u32) -> u32 {
    while parents[vertex as usize] != vertex {
        let above = parents[parents[vertex as usize] as usize];
        parents[vertex as usize] = above;
        vertex = above;
    }
    vertex
}

fn areas(mesh: &TriangleMesh, labels: &[u32], count: usize) -> Vec<f64> {
    let mut areas = vec![0.0; count];
    for triangle in &mesh.triangles {
        areas[labels[triangle[0] as usize] as usize] += area(&mesh.vertices, *triangle);
    }
    areas
}

fn area(vertices: &[Vec3], triangle: [u32; 3]) -> f64 {
    let [a, b, c] = triangle.map(|v| vertices[v as usize]);
    0.5 * norm(cross(sub(b, a), sub(c, a)))
}

fn largest(areas: &[f64]) -> Vec<bool> {
    let largest = (0..areas.len()).reduce(|best, next| {
        if areas[next] > areas[best] {
            next
        } else {
            best
        }
    });
    (0..areas.len()).map(|c| Some(c) == largest).collect()
}

fn support(
    mesh: &TriangleMesh,
    labels: &[u32],
    count: usize,
    points: &[Vec3],
    reach: f64,
) -> Vec<usize> {
    let mut support = vec![0; count];
    let Ok(tree) = ImmutableKdTree::new_from_slice(&mesh.vertices) else {
        return support;
    };
    if mesh.vertices.is_empty() {
        return support;
    }
    for point in points.iter().filter(|p| p.iter().all(|v| v.is_finite())) {
        let nearest = tree
            .query(point)
            .nearest_one::<SquaredEuclidean<f64>>()
            .execute();
        if nearest.distance <= reach * reach {
            support[labels[nearest.item as usize] as usize] += 1;
        }
    }
    support
}

fn supported(support: &[usize]) -> Vec<bool> {
    let best = support.iter().copied().max().unwrap_or(0);
    let least = LEAST_SUPPORT.min(best).max(1);
    support.iter().map(|support| *support >= least).collect()
}

/// The part of the mesh on the vertices to `keep`, in the same order.
fn part(mesh: &TriangleMesh, keep: &[bool]) -> TriangleMesh {
    let mut numbers = Vec::with_capacity(keep.len());
    let mut next = 0;
    for keep in keep {
        numbers.push(next);
        next += u32::from(*keep);
    }
    let chosen = |values: &[Vec3]| -> Vec<Vec3> {
        let pairs = values.iter().zip(keep);
        pairs.filter(|(_, keep)| **keep).map(|(v, _)| *v).collect()
    };
    TriangleMesh {
        vertices: chosen(&mesh.vertices),
        normals: chosen(&mesh.normals),
        triangles: mesh
            .triangles
            .iter()
            .filter(|triangle| keep[triangle[0] as usize])
            .map(|triangle| triangle.map(|v| numbers[v as usize]))
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tetrahedron of edge `size` at `x`.
    fn tetrahedra(of: &[(f64, f64)]) -> TriangleMesh {
        let mut mesh = TriangleMesh::default();
        for (x, size) in of {
            let first = mesh.vertices.len() as u32;
            mesh.vertices.extend([
                [*x, 0.0, 0.0],
                [x + size, 0.0, 0.0],
                [*x, *size, 0.0],
                [*x, 0.0, *size],
            ]);
            let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
            mesh.triangles
                .extend(faces.map(|face| face.map(|v| first + v)));
        }
        mesh.normals = vec![[0.0, 0.0, 1.0]; mesh.vertices.len()];
        mesh
    }

    #[test]
    fn largest_keeps_one_and_counts_the_others() {
        let mesh = tetrahedra(&[(0.0, 1.0), (5.0, 2.0), (9.0, 1.0)]);
        let (kept, dropped) = keep_components(mesh, Components::Largest, &[], 0.0);
        assert_eq!(kept, tetrahedra(&[(5.0, 2.0)]));
        assert_eq!((dropped.components, dropped.triangles), (2, 8));
        let area = 2.0 * (1.5 + 3.0_f64.sqrt() / 2.0);
        // A few roundings of numbers near 1.
        assert!((dropped.area - area).abs() < 1e-14);
    }

    #[test]
    fn support_counts_only_within_reach_and_for_the_nearest() {
        let mesh = tetrahedra(&[(0.0, 1.0), (5.0, 2.0), (9.0, 1.0)]);
        let near = |x: f64| [x, 0.1, 0.0];
        let points = [
            near(0.0),
            near(0.0),
            near(1.0),
            near(9.0),
            near(5.5),
            [f64::NAN; 3],
        ];
        let (kept, dropped) = keep_components(mesh.clone(), Components::Supported, &points, 0.2);
        assert_eq!(kept, tetrahedra(&[(0.0, 1.0)]));
        assert_eq!(dropped.components, 2);
        let (kept, _) = keep_components(mesh.clone(), Components::Supported, &points[3..4], 0.2);
        assert_eq!(kept, tetrahedra(&[(9.0, 1.0)]));
        let (kept, _) = keep_components(mesh.clone(), Components::Supported, &[], 0.2);
        assert!(kept.triangles.is_empty());
        let (kept, dropped) = keep_components(mesh.clone(), Components::All, &[], 0.2);
        assert_eq!((kept, dropped), (mesh, Dropped::default()));
    }
}
