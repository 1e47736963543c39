//! One field of many networks: a partition of unity.
//!
//! f = (Σ wₖ fₖ bₖ + r f₀ b₀) / (Σ wₖ + r) / b₀, with the weights w of the blocks, their bands b, and what they
//! leave, r, to the coarse field f₀. Like f₀, it is a signed distance in units of b₀. Weights and their slopes are
//! continuous, and so are f and ∇f. Where the networks fit what f₀ leaves, each has fₖ bₖ + f₀ b₀ for fₖ bₖ.

use rayon::prelude::*;

use super::block::{Block, rest};
use super::lookup::Lookup;
use crate::reconstruction::error::Error;
use crate::reconstruction::nearby::Walk;
use crate::reconstruction::network::{Engine, Scalar};
use crate::reconstruction::sampling::selection::pick;
use crate::reconstruction::settings::CoarseInput;
use crate::reconstruction::surface::Field;
use crate::reconstruction::vector::{Vec3, along, scale};

/// Points that a thread works at: networks are asked about no more at a time than engines take in one piece.
const PIECE: usize = 1024;

/// The field below the blocks.
pub(super) struct Coarse<'a> {
    pub(super) field: Box<dyn Field + 'a>,
    /// Distance at which its targets reach ±1.
    pub(super) band: f64,
    /// What the networks of blocks were told of it.
    pub(super) input: CoarseInput,
}

impl Coarse<'_> {
    /// The same field, lent.
    pub(super) fn borrowed(&self) -> Coarse<'_> {
        Coarse {
            field: Box::new(self.field.as_ref()),
            ..*self
        }
    }

    /// How much of it is in what each block says.
    fn in_blocks(&self) -> f64 {
        match self.input {
            CoarseInput::None => 0.0,
            CoarseInput::Residual => 1.0,
        }
    }
}

/// A coarse field, and the networks of blocks that refine it.
pub(in crate::reconstruction) struct BlockField<'a> {
    coarse: Coarse<'a>,
    parts: Vec<(Block, Box<dyn Field + 'a>)>,
    lookup: Lookup,
}

/// The sums at a place, or what a block adds to them.
#[derive(Clone, Copy, Default)]
struct Sums {
    weight: f64,
    value: f64,
    weight_gradient: Vec3,
    value_gradient: Vec3,
}

impl Sums {
    fn add(&mut self, other: &Self) {
        self.weight += other.weight;
        self.value += other.value;
        self.weight_gradient = along(self.weight_gradient, 1.0, other.weight_gradient);
        self.value_gradient = along(self.value_gradient, 1.0, other.value_gradient);
    }
}

impl<'a> BlockField<'a> {
    /// The field of `parts` over `coarse`. Each part is a network in the frame of its block.
    pub(super) fn new(coarse: Coarse<'a>, parts: Vec<(Block, Box<dyn Field + 'a>)>) -> Self {
        Self {
            coarse,
            lookup: Lookup::new(parts.iter().map(|(block, _)| block.reach).collect()),
            parts,
        }
    }

    /// The same, of the parameters of the networks.
    ///
    /// # Errors
    /// What the engine reports.
    pub(super) fn of_networks<'p, T: Scalar>(
        coarse: Coarse<'a>,
        engine: &'a dyn Engine<T>,
        networks: impl Iterator<Item = (Block, &'p [T])>,
    ) -> Result<Self, Error> {
        let parts = networks.map(|(block, parameters)| Ok((block, engine.field(parameters)?)));
        Ok(Self::new(coarse, parts.collect::<Result<_, Error>>()?))
    }

    /// Sums of the blocks at each of `points`.
    fn sums(&self, points: &[Vec3], with_gradients: bool) -> Result<Vec<Sums>, Error> {
        // Neighbours lie in the same blocks, whose networks are asked about many points at once then.
        let order: Vec<usize> = Walk::along(points).order().collect();
        let found = order
            .par_chunks(PIECE)
            .with_max_len(1)
            .map(|some| self.sums_of_some(&pick(points, some), with_gradients))
            .collect::<Result<Vec<_>, _>>()?;
        let mut sums = vec![Sums::default(); points.len()];
        for (i, found) in order.into_iter().zip(found.into_iter().flatten()) {
            sums[i] = found;
        }
        Ok(sums)
    }

    /// The same on the calling thread.
    fn sums_of_some(&self, points: &[Vec3], with_gradients: bool) -> Result<Vec<Sums>, Error> {
        // Which block holds which point.
        let mut pairs: Vec<(u32, u32)> = Vec::new();
        let found = |i, k| pairs.push((k as u32, i as u32));
        self.lookup.holding_each(points, found);
        pairs.sort_unstable();
        let mut sums = vec![Sums::default(); points.len()];
        for of_block in pairs.chunk_by(|a, b| a.0 == b.0) {
            let added = self.of_block(points, of_block, with_gradients)?;
            for ((_, i), added) in of_block.iter().zip(&added) {
                sums[*i as usize].add(added);
            }
        }
        Ok(sums)
    }

    /// What one block adds at the points of the pairs.
    fn of_block(
        &self,
        points: &[Vec3],
        pairs: &[(u32, u32)],
        with_gradients: bool,
    ) -> Result<Vec<Sums>, Error> {
        let Some(&(k, _)) = pairs.first() else {
            return Ok(Vec::new());
        };
        let (block, field) = &self.parts[k as usize];
        let places: Vec<Vec3> = pairs.iter().map(|(_, i)| points[*i as usize]).collect();
        let inner: Vec<Vec3> = places.iter().map(|q| block.frame.to_unit(*q)).collect();
        let mut values = vec![0.0; inner.len()];
        if !with_gradients {
            field.values(&inner, &mut values)?;
            let added = places.iter().zip(values).map(|(q, f)| {
                let weight = block.weight(*q);
                Sums {
                    weight,
                    value: weight * f * block.band,
                    ..Sums::default()
                }
            });
            return Ok(added.collect());
        }
        let mut gradients = vec![[0.0; 3]; inner.len()];
        field.values_and_gradients(&inner, &mut values, &mut gradients)?;
        let added = places.iter().zip(values).zip(gradients);
        let added = added.map(|((q, f), slope)| {
            let (weight, weight_gradient) = block.weight_and_gradient(*q);
            let value = f * block.band;
            let slope = scale(slope, weight * block.frame.scale * block.band);
            Sums {
                weight,
                value: weight * value,
                weight_gradient,
                value_gradient: along(slope, value, weight_gradient),
            }
        });
        Ok(added.collect())
    }

    /// The points at which the coarse field is asked for.
    fn on_coarse(&self, sums: &[Sums]) -> Vec<usize> {
        let everywhere = self.coarse.in_blocks() > 0.0;
        let asked = |i: &usize| everywhere || sums[*i].weight < 1.0;
        (0..sums.len()).filter(asked).collect()
    }
}

impl Field for BlockField<'_> {
    fn values(&self, points: &[Vec3], values: &mut [f64]) -> Result<(), Error> {
        let mut sums = self.sums(points, false)?;
        let open = self.on_coarse(&sums);
        let places: Vec<Vec3> = open.iter().map(|&i| points[i]).collect();
        let mut coarse = vec![0.0; places.len()];
        self.coarse.field.values(&places, &mut coarse)?;
        let (band, in_blocks) = (self.coarse.band, self.coarse.in_blocks());
        for (&i, f) in open.iter().zip(coarse) {
            let (rest, _) = rest(sums[i].weight);
            sums[i].value += (rest + in_blocks * sums[i].weight) * f * band;
            sums[i].weight += rest;
        }
        for (value, sums) in values.iter_mut().zip(sums) {
            *value = sums.value / (sums.weight * band);
        }
        Ok(())
    }

    fn values_and_gradients(
        &self,
        points: &[Vec3],
        values: &mut [f64],
        gradients: &mut [Vec3],
    ) -> Result<(), Error> {
        let mut sums = self.sums(points, true)?;
        let open = self.on_coarse(&sums);
        let places: Vec<Vec3> = open.iter().map(|&i| points[i]).collect();
        let mut coarse = vec![0.0; places.len()];
        let mut slopes = vec![[0.0; 3]; places.len()];
        let field = &self.coarse.field;
        field.values_and_gradients(&places, &mut coarse, &mut slopes)?;
        let (band, in_blocks) = (self.coarse.band, self.coarse.in_blocks());
        for ((&i, f), slope) in open.iter().zip(coarse).zip(slopes) {
            let (rest, falls) = rest(sums[i].weight);
            let value = f * band;
            // The blocks have it as well where they add it to theirs.
            let share = rest + in_blocks * sums[i].weight;
            let share_gradient = scale(sums[i].weight_gradient, falls + in_blocks);
            let slope = scale(slope, share * band);
            let weight_gradient = scale(sums[i].weight_gradient, falls);
            sums[i].add(&Sums {
                weight: rest,
                value: share * value,
                weight_gradient,
                value_gradient: along(slope, value, share_gradient),
            });
        }
        for ((value, gradient), sums) in values.iter_mut().zip(gradients).zip(sums) {
            let f = sums.value / sums.weight;
            let slope = along(sums.value_gradient, -f, sums.weight_gradient);
            *value = f / band;
            *gradient = scale(slope, 1.0 / (sums.weight * band));
        }
        Ok(())
    }

    /// The spacing of the points that a block was fitted to.
    fn detail(&self, points: &[Vec3], lengths: &mut [f64]) {
        let some = lengths.par_chunks_mut(PIECE);
        some.zip(points.par_chunks(PIECE))
            .for_each(|(lengths, points)| {
                self.lookup.holding_each(points, |i, k| {
                    lengths[i] = lengths[i].min(self.parts[k].0.spacing());
                });
            });
    }

    fn finest_detail(&self) -> Option<f64> {
        let spacings = self.parts.iter().map(|(block, _)| block.spacing());
        spacings.reduce(f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruction::sampling::Frame;
    use crate::reconstruction::vector::Bounds;

    /// A wave of some phase.
    struct Wave(f64);

    impl Field for Wave {
        fn values(&self, points: &[Vec3], values: &mut [f64]) -> Result<(), Error> {
            for (value, p) in values.iter_mut().zip(points) {
                *value = (p[0] + 2.0 * p[1] - p[2] + self.0).sin();
            }
            Ok(())
        }

        fn values_and_gradients(
            &self,
            points: &[Vec3],
            values: &mut [f64],
            gradients: &mut [Vec3],
        ) -> Result<(), Error> {
            self.values(points, values)?;
            for (gradient, p) in gradients.iter_mut().zip(points) {
                let slope = (p[0] + 2.0 * p[1] - p[2] + self.0).cos();
                *gradient = [slope, 2.0 * slope, -slope];
            }
            Ok(())
        }
    }

    fn field(input: CoarseInput) -> BlockField<'static> {
        let part = |x: f64, phase: f64| {
            let core = Bounds {
                min: [x, 0.0, 0.0],
                max: [x + 1.0, 1.0, 1.0],
            };
            let reach = core.padded(0.2);
            let block = Block {
                core,
                reach,
                band: 0.3,
                frame: Frame::normalized(&reach, 2.0).unwrap(),
            };
            (block, Box::new(Wave(phase)) as Box<dyn Field>)
        };
        let parts = vec![part(0.0, 0.3), part(1.0, -0.4), part(2.5, 1.0)];
        let coarse = Coarse {
            field: Box::new(Wave(2.0)),
            band: 0.5,
            input,
        };
        BlockField::new(coarse, parts)
    }

    fn places() -> Vec<Vec3> {
        (0..4000)
            .map(|i| {
                let t = f64::from(i);
                [
                    (0.137 * t) % 5.0 - 0.7,
                    (0.0713 * t) % 1.6 - 0.3,
                    (0.0517 * t) % 1.6 - 0.3,
                ]
            })
            .collect()
    }

    #[test]
    fn the_gradients_are_those_of_the_values() {
        for input in [CoarseInput::None, CoarseInput::Residual] {
            gradients_are_those_of_values(&field(input));
        }
    }

    fn gradients_are_those_of_values(field: &BlockField<'_>) {
        let places = places();
        let mut values = vec![0.0; places.len()];
        let mut gradients = vec![[0.0; 3]; places.len()];
        field
            .values_and_gradients(&places, &mut values, &mut gradients)
            .unwrap();
        let at = |places: &[Vec3]| {
            let mut values = vec![0.0; places.len()];
            field.values(places, &mut values).unwrap();
            values
        };
        let alone = at(&places);
        let step = 1e-6;
        for axis in 0..3 {
            let moved = |h: f64| -> Vec<Vec3> {
                let mut places = places.clone();
                for p in &mut places {
                    p[axis] += h;
                }
                places
            };
            let (low, high) = (at(&moved(-step)), at(&moved(step)));
            for i in 0..places.len() {
                assert!((values[i] - alone[i]).abs() < 1e-12);
                let slope = (high[i] - low[i]) / (2.0 * step);
                let error = (slope - gradients[i][axis]).abs();
                // The slope is continuous, its own slope is not.
                assert!(error < 1e-4, "{:?} {axis}: {slope} {error}", places[i]);
            }
        }
    }

    #[test]
    fn detail_is_that_of_the_finest_block_around() {
        let field = field(CoarseInput::None);
        let spacing = field.parts[0].0.spacing();
        let mut lengths = [9.0; 2];
        field.detail(&[[0.5, 0.5, 0.5], [9.0, 9.0, 9.0]], &mut lengths);
        assert!((lengths[0] - spacing).abs() < 1e-12 && lengths[1] > 8.0);
        assert_eq!(field.finest_detail(), Some(spacing));
    }

    #[test]
    fn blocks_rule_in_their_cores_and_the_coarse_field_beyond() {
        let at = |input| {
            let mut values = [0.0; 2];
            let field = field(input);
            field
                .values(&[[0.5, 0.5, 0.5], [9.0, 9.0, 9.0]], &mut values)
                .unwrap();
            values
        };
        let values = at(CoarseInput::None);
        let field = field(CoarseInput::None);
        let (block, wave) = &field.parts[0];
        let mut inner = [0.0; 2];
        wave.values(&[block.frame.to_unit([0.5; 3])], &mut inner[..1])
            .unwrap();
        Wave(2.0).values(&[[9.0; 3]], &mut inner[1..]).unwrap();
        assert!((values[0] - inner[0] * 0.3 / 0.5).abs() < 1e-12);
        assert!((values[1] - inner[1]).abs() < 1e-12);

        let over_coarse = at(CoarseInput::Residual);
        let mut below = [0.0];
        Wave(2.0).values(&[[0.5; 3]], &mut below).unwrap();
        assert!((over_coarse[0] - (inner[0] * 0.3 / 0.5 + below[0])).abs() < 1e-12);
        assert!((over_coarse[1] - inner[1]).abs() < 1e-12);
    }
}
