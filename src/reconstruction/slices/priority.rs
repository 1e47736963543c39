//! A uniform choice from a stream of places, in memory that does not grow with the stream.

use std::collections::BinaryHeap;

use super::super::vector::{Vec3, bits};

/// The places with the lowest of random numbers that each gets.
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

    /// Takes a place and its random number into account.
    pub(super) fn offer(&mut self, place: Vec3, number: u64) {
        self.insert((number, bits(place)));
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
        } else if let Some(mut last) = self.heap.peek_mut()
            && entry < *last
        {
            *last = entry;
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::*;
    use crate::reconstruction::random::{Purpose, stream};

    #[test]
    fn a_choice_is_spread_over_the_stream_and_the_same_each_time() {
        let choose = || {
            let mut random = stream(1, Purpose::Slices);
            let mut chosen = Chosen::new(100);
            for i in 0..10_000 {
                chosen.offer([f64::from(i), 0.0, -1.0], random.random());
            }
            chosen.places()
        };
        let places = choose();
        assert_eq!(places.len(), 100);
        assert_eq!(choose(), places);
        let mean = places.iter().map(|p| p[0]).sum::<f64>() / 100.0;
        assert!((4000.0..6000.0).contains(&mean), "{mean}");
    }

    #[test]
    fn fewer_places_than_may_be_chosen_are_all_taken() {
        let mut random = stream(1, Purpose::Slices);
        let mut chosen = Chosen::new(3);
        chosen.offer([1.0; 3], random.random());
        chosen.offer([2.0; 3], random.random());
        let mut places = chosen.places();
        places.sort_by(|a, b| a[0].total_cmp(&b[0]));
        assert_eq!(places, [[1.0; 3], [2.0; 3]]);
    }
}
