//! Points that lie off the surface of all the others: strays of a scanner, clumps in the air, wrong coordinates.
//!
//! They are found before anything else is worked out, so that they decide neither frame nor grid.

use rayon::prelude::*;

use super::evenness::even_scale;
use super::neighbours::{Neighbourhoods, Tree, median};
use super::selection::pick;
use crate::reconstruction::nearby::is_many;
use crate::reconstruction::symmetric::{covariance, eigen};
use crate::reconstruction::vector::{Vec3, add, distance, dot, norm, sub};

/// Neighbours to which a point may be tied, and of which planes are fitted; at most as many as a `u16` has bits.
const NEAR: usize = 12;

/// A point is tied to a neighbour within so many local spacings of either: gaps of a random sampling are
/// smaller but for one in some thousands.
const TIE: f64 = 2.5;

/// Fewest points that make a piece of a surface.
const PIECE: usize = 16;

/// Least over middle extent of neighbourhoods from which on they fill space. Random points in a volume are near
/// 0.65, a ball of 30 points near 0.4.
const FILLS_SPACE: f64 = 0.5;

/// Spacing over the median one of the cloud from which on points may be scattered beside it.
const WIDE: f64 = 2.0;

/// A point that is this far, in local spacings of the surface, is on no part of it.
const FAR: f64 = 10.0;

/// A nearer one is off the surface from a height above its plane of so many local spacings ...
const HIGH: f64 = 1.0;

/// ... and of so many times what the points of the plane are off it themselves.
const ROUGH: f64 = 5.0;

/// Points of smaller clouds are strays only where they are far: a plane says little of them.
const FEW: usize = 64;

/// Where more than this share seems to be strays, the surface is not understood and all points are kept.
const MOST: f64 = 0.2;

/// Positions in `points`, all different, of strays; ascending. Of many even points also the neighbours of each, so many
/// as are wanted or more.
pub(super) fn strays(points: &[Vec3], wanted: usize) -> (Vec<usize>, Option<Neighbourhoods>) {
    let tree = Tree::new(points);
    let Some(even) = even_scale(points, &tree, 0.0) else {
        let is_many = is_many(points.len());
        let count = if is_many { NEAR.max(wanted) } else { NEAR };
        let near = Neighbourhoods::new(&tree, points, count);
        return (of_even(points, &near), is_many.then_some(near));
    };
    // A point of a slice goes with the nearest one of the even subset.
    let some: Vec<Vec3> = even.iter().map(|&i| points[i]).collect();
    let tree = Tree::new(&some);
    let strays = of_even(&some, &Neighbourhoods::new(&tree, &some, NEAR));
    let goes = |p: &Vec3| strays.binary_search(&tree.nearest(*p).0).is_ok();
    let strays = (0..points.len()).filter(|&i| goes(&points[i]));
    (strays.collect(), None)
}

/// The strays among even points, at least [`NEAR`] neighbours of which are known.
fn of_even(points: &[Vec3], near: &Neighbourhoods) -> Vec<usize> {
    let spacings = near.spacings(points);
    let kept = on_pieces(points, near, &spacings);
    let base: Vec<usize> = (0..points.len()).filter(|&i| kept[i]).collect();
    // Where all are kept, their neighbours are known.
    let base_tree = (base.len() < points.len()).then(|| Tree::new(&pick(points, &base)));
    let around = |i: usize| -> Vec<(usize, f64)> {
        let Some(tree) = &base_tree else {
            let near = near.of(i).take(NEAR);
            return near.map(|j| (j, distance(points[i], points[j]))).collect();
        };
        // Without the point itself.
        let near = tree.nearest_n(points[i], NEAR + 1).into_iter();
        let near = near.map(|(k, distance)| (base[k], distance));
        near.filter(|&(j, _)| j != i).take(NEAR).collect()
    };
    let is_stray = near.map(|i| {
        let around = around(i);
        let mut theirs: Vec<f64> = around.iter().map(|&(j, _)| spacings[j]).collect();
        let spacing = median(&mut theirs);
        let distance = around.first().map_or(0.0, |nearest| nearest.1);
        let beside: Vec<Vec3> = around.iter().map(|&(j, _)| points[j]).collect();
        distance > FAR * spacing || points.len() >= FEW && is_off(points[i], &beside, spacing)
    });
    let found: Vec<usize> = (0..points.len()).filter(|&i| is_stray[i]).collect();
    if found.len() as f64 > MOST * points.len() as f64 {
        return Vec::new();
    }
    found
}

/// Whether `p` is clearly above the plane of the points `beside` it.
fn is_off(p: Vec3, beside: &[Vec3], spacing: f64) -> bool {
    let arms: Vec<Vec3> = beside.iter().map(|q| sub(*q, p)).collect();
    let count = arms.len() as f64;
    // It is no higher above their plane than it is away from their middle.
    if norm(arms.iter().copied().fold([0.0; 3], add)) <= HIGH * spacing * count {
        return false;
    }
    let (values, vectors) = eigen(covariance(&arms));
    let height = arms.iter().map(|arm| dot(*arm, vectors[0])).sum::<f64>() / count;
    height.abs() > (HIGH * spacing).max(ROUGH * values[0].max(0.0).sqrt())
}

/// Which points lie on the largest piece of the cloud or on another one that is a surface.
fn on_pieces(points: &[Vec3], near: &Neighbourhoods, spacings: &[f64]) -> Vec<bool> {
    let scattered = scattered(points, near, spacings);
    let pieces = pieces(points, near, spacings, &scattered);
    let largest = pieces.iter().map(Vec::len).max().unwrap_or(0);
    let mut kept = vec![false; points.len()];
    for piece in &pieces {
        let is_surface = || piece.len() >= PIECE && !fills_space(points, piece);
        if !scattered[piece[0]] && (piece.len() == largest || is_surface()) {
            for &i in piece {
                kept[i] = true;
            }
        }
    }
    kept
}

/// Which points lie far apart beside the others, and scattered through space.
fn scattered(points: &[Vec3], near: &Neighbourhoods, spacings: &[f64]) -> Vec<bool> {
    let wide = WIDE * median(&mut spacings.to_vec());
    (0..points.len())
        .into_par_iter()
        .map(|i| spacings[i] > wide && spread(points, i, near.of(i).take(NEAR)) > FILLS_SPACE)
        .collect()
}

/// Least over middle extent of point `i` and those `beside` it: 0 where they lie in a plane.
fn spread(points: &[Vec3], i: usize, beside: impl Iterator<Item = usize>) -> f64 {
    let mut arms: Vec<Vec3> = beside.map(|j| sub(points[j], points[i])).collect();
    arms.push([0.0; 3]);
    let (values, _) = eigen(covariance(&arms));
    (values[0].max(0.0) / values[1].max(f64::MIN_POSITIVE)).sqrt()
}

/// The points in groups whose members are tied to each other by way of their neighbours; those that are
/// `scattered` each for itself.
fn pieces(
    points: &[Vec3],
    near: &Neighbourhoods,
    spacings: &[f64],
    scattered: &[bool],
) -> Vec<Vec<usize>> {
    // Bit k of point i: it is tied to its neighbour k.
    let ties: Vec<u16> = near.map(|i| {
        let others = near.of(i).take(NEAR).enumerate().filter(|&(_, j)| {
            let reach = TIE * spacings[i].min(spacings[j]);
            let arm = sub(points[j], points[i]);
            !scattered[i] && !scattered[j] && dot(arm, arm) <= reach * reach
        });
        others.fold(0, |ties, (k, _)| ties | 1 << k)
    });
    let mut parents: Vec<u32> = (0..points.len() as u32).collect();
    for i in near.order() {
        for (k, j) in near.of(i).take(NEAR).enumerate() {
            if ties[i] >> k & 1 == 1 {
                let (a, b) = (root(&mut parents, i), root(&mut parents, j));
                parents[a.max(b)] = a.min(b) as u32;
            }
        }
    }
    // The root of a piece is its first point.
    let mut pieces: Vec<Vec<usize>> = Vec::new();
    let mut piece_of = vec![0; points.len()];
    for i in 0..points.len() {
        let root = root(&mut parents, i);
        if root == i {
            piece_of[i] = pieces.len() as u32;
            pieces.push(Vec::new());
        }
        pieces[piece_of[root] as usize].push(i);
    }
    pieces
}

fn root(parents: &mut [u32], mut i: usize) -> usize {
    while parents[i] as usize != i {
        parents[i] = parents[parents[i] as usize];
        i = parents[i] as usize;
    }
    i
}

/// Whether the points of a piece are spread through space, not over a sheet.
fn fills_space(points: &[Vec3], piece: &[usize]) -> bool {
    let own: Vec<Vec3> = piece.iter().map(|&i| points[i]).collect();
    let tree = Tree::new(&own);
    let near = Neighbourhoods::new(&tree, &own, NEAR);
    let mut spreads = near.map(|i| spread(&own, i, near.of(i)));
    median(&mut spreads) > FILLS_SPACE
}
