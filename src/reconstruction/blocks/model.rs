//! The networks of blocks as a model keeps them.

use super::block::Block;
use super::field::{BlockField, Coarse};
use crate::reconstruction::network::{Architecture, PlainNetwork};
use crate::reconstruction::settings::CoarseInput;
use crate::reconstruction::surface::Field;

/// Trained networks of blocks.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockModel {
    /// The shape of each.
    pub architecture: Architecture,
    /// Distance at which the targets of the coarse network reach ±1, in the frame of the run.
    pub coarse_band: f64,
    /// What the networks were told of the coarse one.
    pub coarse_input: CoarseInput,
    /// Where each is.
    pub blocks: Vec<Block>,
    /// Parameters of each in the order of [`Architecture::layers`], one block after the other.
    pub parameters: Vec<f64>,
}

impl BlockModel {
    /// The field of the blocks over a coarse one, in plain Rust; `None` where the number of parameters is not that
    /// of the blocks.
    pub(in crate::reconstruction) fn field(
        &self,
        coarse: Box<dyn Field>,
    ) -> Option<BlockField<'static>> {
        let length = self.architecture.parameter_count();
        if self.parameters.len() != length * self.blocks.len() {
            return None;
        }
        let networks = self.parameters.chunks(length);
        let parts = self.blocks.iter().zip(networks).map(|(block, parameters)| {
            let network = PlainNetwork::new(self.architecture.clone(), parameters.to_vec())?;
            Some((*block, Box::new(network) as Box<dyn Field>))
        });
        let parts = parts.collect::<Option<_>>()?;
        Some(BlockField::new(
            Coarse {
                field: coarse,
                band: self.coarse_band,
                input: self.coarse_input,
            },
            parts,
        ))
    }
}
