//! A uniform choice from a stream of places, in memory that does not grow with the stream.

use std::collections::BinaryHeap;

use rand::RngExt;

use super::super::random::Generator;
use super::super::vector::{Vec3, bits};

/// The places with the lowest of random numbers that each gets. Two choices join to a choice from both streams.
#[derive(Debug, Clone)]
pub(super) struct Chosen {
    most: usize,
    heap: BinaryHeap<(u64, [u64; 3])>,
}

impl Chosen {
    /// Chooses up to `most` places.
    pub(super) fn new(most: usize) -> Self {
        Self {
            most,
            heap: BinaryHeap::new(),
        }
    }

    /// Takes a place into account.
    pub(super) fn offer(&mut self, place: Vec3, random: &mut Generator) {
        self.insert((random.random(), bits(place)));
    }

    /// Takes the places of `other` into account.
    pub(super) fn join(&mut self, other: Self) {
        for entry in other.heap {
            self.insert(entry);
        }
    }

    /// The places, in the order of their random numbers.
    pub(super) fn places(self) -> Vec<Vec3> {
        let sorted = self.heap.into_sorted_vec();
        let place = |(_, bits): (u64, [u64; 3])| bits.map(f64::from_bits);
        sorted.into_iter().map(place).collect()
    }

    fn insert(&mut self, entry: (u64, [u64; 3])) {
        if self.heap.len() < self.most {
            self.heap.push(entry);
        } else if let Some(mut last) = self.heap.peek_mut() {
            if entry < *last {
                *last = entry;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruction::random::{Purpose, stream};

    #[test]
    fn parts_of_a_stream_join_to_the_choice_from_the_whole() {
        let mut random = stream(1, Purpose::Slices);
        let (mut whole, mut even, mut odd) = (Chosen::new(10), Chosen::new(10), Chosen::new(10));
        for i in 0..1000 {
            let mut same = random.clone();
            whole.offer([f64::from(i), 0.0, -1.0], &mut random);
            let part = if i % 2 == 0 { &mut even } else { &mut odd };
            part.offer([f64::from(i), 0.0, -1.0], &mut same);
        }
        even.join(odd);
        let places = whole.places();
        assert_eq!(places.len(), 10);
        assert_eq!(even.places(), places);
        let mean = places.iter().map(|p| p[0]).sum::<f64>() / 10.0;
        assert!((250.0..750.0).contains(&mean), "{mean}");
    }
}
