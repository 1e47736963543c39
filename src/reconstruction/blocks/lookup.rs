//! Which of many overlapping boxes hold a place.

use rayon::prelude::*;

use crate::reconstruction::sampling::neighbours::median;
use crate::reconstruction::vector::{Bounds, Vec3};

/// Boxes of a leaf.
const LEAF: usize = 4;

/// Places that are looked up together: as many as differ little, a cell of a grid being a fraction of a block.
const TOGETHER: usize = 16;

/// Most nodes that wait on the way through the tree: one a level, and each level halves what may be 2³² boxes.
const DEEPEST: usize = 34;

/// A tree over boxes.
#[derive(Debug)]
pub(super) struct Lookup {
    /// The boxes, those of a node side by side, and their indices.
    boxes: Vec<Bounds>,
    order: Vec<u32>,
    nodes: Vec<Node>,
    /// Median of the longest edges of the boxes.
    median_edge: f64,
}

/// A box around some of the boxes.
#[derive(Debug)]
struct Node {
    bounds: Bounds,
    start: usize,
    end: usize,
    /// The nodes of the two halves; none at a leaf.
    halves: Option<[usize; 2]>,
}

impl Lookup {
    /// A tree over these boxes.
    pub(super) fn new(boxes: Vec<Bounds>) -> Self {
        let mut edges: Vec<f64> = boxes.iter().map(Bounds::longest_edge).collect();
        let mut lookup = Self {
            median_edge: median(&mut edges),
            order: (0..boxes.len() as u32).collect(),
            nodes: Vec::new(),
            boxes,
        };
        if !lookup.boxes.is_empty() {
            lookup.build(0, lookup.boxes.len());
        }
        let placed = lookup.order.iter().map(|&i| lookup.boxes[i as usize]);
        lookup.boxes = placed.collect();
        lookup
    }

    /// Makes the node of `order[start..end]`; its index.
    fn build(&mut self, start: usize, end: usize) -> usize {
        let boxes = &self.boxes;
        let part = &mut self.order[start..end];
        let corners: Vec<Vec3> = part
            .iter()
            .flat_map(|&i| [boxes[i as usize].min, boxes[i as usize].max])
            .collect();
        let bounds = Bounds::of(&corners).expect("a node has boxes");
        let index = self.nodes.len();
        self.nodes.push(Node {
            bounds,
            start,
            end,
            halves: None,
        });
        if end - start > LEAF {
            let extent = bounds.extent();
            let axis = (0..3).fold(0, |a, b| if extent[b] > extent[a] { b } else { a });
            part.sort_by(|&a, &b| {
                let centre = |i: u32| boxes[i as usize].centre()[axis];
                centre(a).total_cmp(&centre(b)).then(a.cmp(&b))
            });
            let middle = usize::midpoint(start, end);
            let halves = [self.build(start, middle), self.build(middle, end)];
            self.nodes[index].halves = Some(halves);
        }
        index
    }

    /// Calls `found` with the index of each box that holds `q`, in a fixed order.
    pub(super) fn holding(&self, q: Vec3, mut found: impl FnMut(usize)) {
        self.among(
            |bounds| bounds.contains(q),
            |place| found(self.order[place] as usize),
        );
    }

    /// Calls `found` with the number of each of `places` and the index of each box that holds it, in a fixed order.
    /// Places that follow each other are looked up together where they are near each other.
    pub(super) fn holding_each(&self, places: &[Vec3], mut found: impl FnMut(usize, usize)) {
        let mut near = Vec::new();
        for (run, some) in places.chunks(TOGETHER).enumerate() {
            let numbered = (run * TOGETHER..).zip(some);
            let around = Bounds::of(some);
            let around = around.filter(|around| around.longest_edge() <= self.median_edge);
            let Some(around) = around else {
                for (i, &q) in numbered {
                    self.holding(q, |k| found(i, k));
                }
                continue;
            };
            near.clear();
            self.among(|bounds| bounds.meets(&around), |place| near.push(place));
            for (i, &q) in numbered {
                let holding = near.iter().filter(|&&place| self.boxes[place].contains(q));
                for &place in holding {
                    found(i, self.order[place] as usize);
                }
            }
        }
    }

    /// Calls `found` with the index of each box that meets `other`, in a fixed order.
    pub(super) fn meeting(&self, other: &Bounds, mut found: impl FnMut(usize)) {
        self.among(
            |bounds| bounds.meets(other),
            |place| found(self.order[place] as usize),
        );
    }

    /// The indices of the boxes that meet each of `others`, in a fixed order; on all threads.
    pub(super) fn meeting_each(&self, others: &[Bounds]) -> Vec<Vec<u32>> {
        let meeting = |other| {
            let mut found = Vec::new();
            self.meeting(other, |k| found.push(k as u32));
            found
        };
        others.par_iter().map(meeting).collect()
    }

    /// Calls `found` with the place of each box that `is_wanted`, as all around it are.
    #[inline]
    fn among(&self, is_wanted: impl Fn(&Bounds) -> bool, mut found: impl FnMut(usize)) {
        let mut open = [0; DEEPEST];
        let mut waiting = usize::from(!self.nodes.is_empty());
        while waiting > 0 {
            waiting -= 1;
            let node = &self.nodes[open[waiting]];
            if !is_wanted(&node.bounds) {
                continue;
            }
            if let Some([low, high]) = node.halves {
                open[waiting] = high;
                open[waiting + 1] = low;
                waiting += 2;
                continue;
            }
            (node.start..node.end)
                .filter(|&place| is_wanted(&self.boxes[place]))
                .for_each(&mut found);
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::*;
    use crate::reconstruction::random::{Purpose, stream};

    #[test]
    fn every_box_that_holds_a_place_or_meets_a_box_is_found_once() {
        let mut random = stream(3, Purpose::Shape);
        for count in [0, 1, 3, 40, 300] {
            let boxes: Vec<Bounds> = (0..count)
                .map(|_| {
                    let min: Vec3 = std::array::from_fn(|_| random.random());
                    let max = min.map(|v| v + 0.3 * random.random::<f64>());
                    Bounds { min, max }
                })
                .collect();
            let lookup = Lookup::new(boxes.clone());
            for _ in 0..200 {
                let q: Vec3 = std::array::from_fn(|_| 1.3 * random.random::<f64>());
                let mut found = Vec::new();
                lookup.holding(q, |i| found.push(i));
                found.sort_unstable();
                let expected: Vec<usize> = (0..count).filter(|&i| boxes[i].contains(q)).collect();
                assert_eq!(found, expected);
                let mut together = Vec::new();
                lookup.holding_each(&[q, q, [7.0; 3]], |at, i| together.push((at, i)));
                together.sort_unstable();
                let both = [0, 1].map(|at| expected.iter().map(move |&i| (at, i)));
                assert!(together.into_iter().eq(both.into_iter().flatten()));
                let near = q.map(|v| v + 0.01);
                let mut together = Vec::new();
                lookup.holding_each(&[q, near], |at, i| together.push((at, i)));
                together.sort_unstable();
                let mut apart = Vec::new();
                lookup.holding(q, |i| apart.push((0, i)));
                lookup.holding(near, |i| apart.push((1, i)));
                apart.sort_unstable();
                assert_eq!(together, apart);
                let other = Bounds {
                    min: q,
                    max: q.map(|v| v + 0.1 * random.random::<f64>()),
                };
                let mut found = Vec::new();
                lookup.meeting(&other, |i| found.push(i));
                found.sort_unstable();
                // Boxes meet where no axis keeps them apart.
                let apart = |a: &Bounds, b: &Bounds| (0..3).any(|axis| a.max[axis] < b.min[axis]);
                let expected: Vec<usize> = (0..count)
                    .filter(|&i| !apart(&boxes[i], &other) && !apart(&other, &boxes[i]))
                    .collect();
                assert_eq!(found, expected);
            }
        }
    }
}
