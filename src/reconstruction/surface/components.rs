//! Which connected components of a mesh are kept.
//!
//! A trained field may have zeros where no sample told it otherwise. Their components have no input
//! points near them, or fewer than the true surface beside them.

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use crate::reconstruction::mesh::{TriangleMesh, components};
use crate::reconstruction::nearby::map_nearby;
use crate::reconstruction::settings::Components;
use crate::reconstruction::vector::{Vec3, distance};

/// Input points that a component needs: as many as the corners of a cube. A bubble beside the surface, as wide as
/// the points are apart, takes fewer from it.
const LEAST_SUPPORT: usize = 8;

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
/// the components with at least eight supporting points, or as many as the best has, so that it
/// returns an empty mesh only if no point supports any.
pub fn keep_components(
    mut mesh: TriangleMesh,
    rule: Components,
    support_points: &[Vec3],
    reach: f64,
) -> (TriangleMesh, Dropped) {
    let (ids, count) = components(&mesh);
    let areas = mesh.component_areas(&ids, count);
    let keep = match rule {
        Components::All => vec![true; count],
        Components::Largest => largest(&areas),
        Components::Supported => supported(&support(&mesh, &ids, count, support_points, reach)),
    };
    let mut dropped = Dropped::default();
    for area in (0..count).filter(|&id| !keep[id]).map(|id| areas[id]) {
        dropped.components += 1;
        dropped.area += area;
    }
    dropped.triangles = ids.iter().filter(|&&id| !keep[id as usize]).count();
    if dropped.components > 0 {
        mesh.retain_components(&keep, &ids);
    }
    (mesh, dropped)
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

/// Points that are looked at by themselves where there is one component.
const LOOKED_AT: usize = 8;

/// How many of the points lie within reach of each component; at least one is enough where there is only one.
fn support(
    mesh: &TriangleMesh,
    ids: &[u32],
    count: usize,
    points: &[Vec3],
    reach: f64,
) -> Vec<usize> {
    let mut support = vec![0; count];
    let near = |p: &Vec3| mesh.vertices.par_iter().any(|v| distance(*p, *v) <= reach);
    if count == 1 && points.iter().take(LOOKED_AT).any(near) {
        return vec![1];
    }
    let mut id_of_vertex = vec![u32::MAX; mesh.vertices.len()];
    for (triangle, &id) in mesh.triangles.iter().zip(ids) {
        for &v in triangle {
            id_of_vertex[v as usize] = id;
        }
    }
    let Ok(tree) = ImmutableKdTree::new_from_slice(&mesh.vertices) else {
        return support;
    };
    if mesh.vertices.is_empty() {
        return support;
    }
    let supported: Vec<Option<u32>> = map_nearby(points, |i| {
        if !points[i].iter().all(|v| v.is_finite()) {
            return None;
        }
        let nearest = tree
            .query(&points[i])
            .nearest_one::<SquaredEuclidean<f64>>()
            .execute();
        (nearest.distance <= reach * reach).then(|| id_of_vertex[nearest.item as usize])
    });
    for id in supported.into_iter().flatten() {
        // A vertex of no triangle belongs to no component.
        if let Some(support) = support.get_mut(id as usize) {
            *support += 1;
        }
    }
    support
}

fn supported(support: &[usize]) -> Vec<bool> {
    let best = support.iter().copied().max().unwrap_or(0);
    let least = LEAST_SUPPORT.min(best).max(1);
    support.iter().map(|support| *support >= least).collect()
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
