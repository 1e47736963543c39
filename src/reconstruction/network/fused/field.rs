//! The network as a field.

use pulp::{Arch, Simd};
use rayon::prelude::*;

use super::aligned::Aligned;
use super::batch::fill_rows;
use super::block_points;
use super::dispatch::{Blockwise, dispatch};
use super::pass::{Network, Pass, Rule, Scratch};
use super::pool::Pool;
use crate::reconstruction::error::Error;
use crate::reconstruction::surface::Field;
use crate::reconstruction::vector::Vec3;

/// Points that one thread takes at a time: enough to outweigh handing them out.
const CHUNK: usize = 1024;

/// A network with fixed parameters.
pub(super) struct FusedField<'a> {
    arch: Arch,
    network: Network<'a>,
    block_points: usize,
    workspaces: &'a Pool<Workspace>,
}

/// Memory for one block of points, of any network of an engine. Tens of thousands of networks share a few of them.
#[derive(Debug)]
pub(super) struct Workspace {
    scratch: Scratch,
    points: Aligned,
    gradients: Aligned,
}

impl<'a> FusedField<'a> {
    pub(super) fn new(arch: Arch, network: Network<'a>, workspaces: &'a Pool<Workspace>) -> Self {
        Self {
            arch,
            network,
            block_points: block_points(arch),
            workspaces,
        }
    }

    fn workspace(&self) -> Workspace {
        let rules: &[Rule] = self.network.rules;
        let width = self.network.maps[0].weight.rows;
        Workspace {
            scratch: Scratch::new(rules, width, self.block_points, self.block_points),
            points: Aligned::zeros(3 * self.block_points),
            gradients: Aligned::zeros(3 * self.block_points),
        }
    }

    fn evaluate(&self, points: &[Vec3], values: &mut [f64], gradients: Option<&mut [Vec3]>) {
        self.workspaces.with(
            || self.workspace(),
            |workspace| {
                let work = Evaluate {
                    network: &self.network,
                    workspace,
                    points,
                    values,
                    gradients,
                };
                dispatch(self.arch, work);
            },
        );
    }
}

impl Field for FusedField<'_> {
    fn values(&self, points: &[Vec3], values: &mut [f64]) -> Result<(), Error> {
        points
            .par_chunks(CHUNK)
            .zip(values.par_chunks_mut(CHUNK))
            .for_each(|(points, values)| self.evaluate(points, values, None));
        Ok(())
    }

    fn values_and_gradients(
        &self,
        points: &[Vec3],
        values: &mut [f64],
        gradients: &mut [Vec3],
    ) -> Result<(), Error> {
        points
            .par_chunks(CHUNK)
            .zip(values.par_chunks_mut(CHUNK))
            .zip(gradients.par_chunks_mut(CHUNK))
            .for_each(|((points, values), gradients)| {
                self.evaluate(points, values, Some(gradients));
            });
        Ok(())
    }
}

/// f, and ∇f where it is wanted, at some points.
struct Evaluate<'a> {
    network: &'a Network<'a>,
    workspace: &'a mut Workspace,
    points: &'a [Vec3],
    values: &'a mut [f64],
    gradients: Option<&'a mut [Vec3]>,
}

impl Blockwise for Evaluate<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd, const N: usize>(mut self, simd: S) {
        let Workspace {
            scratch,
            points: rows,
            gradients: slopes,
        } = self.workspace;
        let length = rows.len() / 3;
        let mut pass = Pass {
            simd,
            network: self.network,
            scratch,
        };
        let chunks = self
            .points
            .chunks(length)
            .zip(self.values.chunks_mut(length));
        for (chunk, (points, values)) in chunks.enumerate() {
            fill_rows(rows, points);
            pass.forward::<N>(0, rows);
            for (value, f) in values.iter_mut().zip(&*pass.scratch.values) {
                *value = f64::from(*f);
            }
            if let Some(gradients) = &mut self.gradients {
                pass.scratch.values.fill(1.0);
                pass.backward::<N>(0);
                pass.point_gradient::<N>(0, slopes);
                for (i, gradient) in gradients[chunk * length..]
                    .iter_mut()
                    .take(points.len())
                    .enumerate()
                {
                    *gradient = [0, 1, 2].map(|axis| f64::from(slopes[axis * length + i]));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::reconstruction::network::{Architecture, Engine, Fused, initial_parameters};
    use crate::reconstruction::sampling::Samples;
    use crate::reconstruction::settings::Preset;

    #[test]
    fn fields_of_an_engine_share_their_memory() {
        let architecture = Architecture::of_block(&Preset::Fast.settings().network);
        let samples: Samples = [([0.0; 3], 0.0)].into_iter().collect();
        let engine = Fused::new(architecture.clone(), &samples).unwrap();
        for seed in 0..40 {
            let parameters = initial_parameters(&architecture, seed);
            let field = engine.field(&parameters).unwrap();
            let mut values = [f64::NAN; 2];
            field.values(&[[0.1; 3], [0.2; 3]], &mut values).unwrap();
            assert!(values.iter().all(|value| value.is_finite()));
        }
        let threads = rayon::current_num_threads();
        assert!((1..=threads).contains(&engine.workspaces.idle()));
    }
}
