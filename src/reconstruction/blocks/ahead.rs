//! The surface beside the fits. While others fit blocks, the run does what it would do alone after them: it samples the
//! field and moves vertices where all blocks are fitted.

use std::sync::Mutex;

use super::block::Block;
use super::board::Board;
use super::field::{BlockField, Coarse};
use super::fit::lock;
use super::lookup::Lookup;
use crate::reconstruction::error::Error;
use crate::reconstruction::network::{Engine, Scalar};
use crate::reconstruction::surface::{Begun, Request};

/// The surface goes on once so large a part of the blocks was fitted since it last did: what is done for all of the grid
/// each time costs little then, and little is left in the end.
const PART: usize = 16;

/// The surface of a run, as far as it was begun.
pub(super) struct Ahead<'a, T> {
    begun: Begun,
    /// What is extracted; without a window.
    outline: Request<'static>,
    /// The blocks that each of its parts waits for.
    awaited: Vec<Vec<u32>>,
    blocks: &'a [Block],
    /// Evaluates their networks.
    engine: &'a dyn Engine<T>,
    coarse: Coarse<'a>,
    /// Blocks that were fitted when it was last looked.
    seen: usize,
}

/// Parts of the surface that can be made, and the blocks around them with the parameters of their networks.
pub(super) struct Ready<T> {
    parts: Vec<usize>,
    networks: Vec<(Block, Vec<T>)>,
}

impl<'a, T: Scalar> Ahead<'a, T> {
    /// Nothing is begun yet; the blocks, with their reaches in `lookup`, refine this coarse field.
    ///
    /// # Errors
    /// As for [`extract`](crate::reconstruction::surface::extract).
    pub(super) fn new(
        outline: Request<'static>,
        (blocks, lookup): (&'a [Block], &Lookup),
        engine: &'a dyn Engine<T>,
        coarse: Coarse<'a>,
    ) -> Result<Self, Error> {
        let begun = Begun::new(&outline)?;
        Ok(Self {
            awaited: lookup.meeting_each(&begun.parts(&outline)),
            begun,
            outline,
            blocks,
            engine,
            coarse,
            seen: 0,
        })
    }

    /// What can be sampled now, if others fit blocks meanwhile and it is worth the while.
    pub(super) fn ready(&mut self, board: &Mutex<Board<T>>) -> Option<Ready<T>> {
        let board = lock(board);
        let is_due = board.fitted - self.seen >= self.blocks.len().div_ceil(PART);
        if !board.is_helped || !is_due {
            return None;
        }
        self.seen = board.fitted;
        let is_fitted = |k: &u32| board.done[*k as usize].is_some();
        let parts = (0..self.awaited.len()).filter(|&part| {
            !self.begun.is_sampled(part) && self.awaited[part].iter().all(is_fitted)
        });
        let parts: Vec<usize> = parts.collect();
        let around = parts.iter().flat_map(|&part| &self.awaited[part]);
        let mut around: Vec<usize> = around.map(|k| *k as usize).collect();
        around.sort_unstable();
        around.dedup();
        let networks = around.into_iter().filter_map(|k| {
            let fitted = board.done[k].as_ref()?;
            Some((self.blocks[k], fitted.parameters.clone()))
        });
        let networks = networks.collect();
        (!parts.is_empty()).then_some(Ready { parts, networks })
    }

    /// Samples what is ready; `attend` is called often, and so is `stopped`, which tells whether to end.
    ///
    /// # Errors
    /// As for [`extract`](crate::reconstruction::surface::extract).
    pub(super) fn go_on(
        &mut self,
        ready: &Ready<T>,
        stopped: &dyn Fn() -> bool,
        attend: &dyn Fn(),
    ) -> Result<(), Error> {
        let networks = ready.networks.iter();
        let networks = networks.map(|(block, parameters)| (*block, &parameters[..]));
        let field = BlockField::of_networks(self.coarse.borrowed(), self.engine, networks)?;
        let request = Request {
            cancelled: stopped,
            progress: &|_| attend(),
            ..self.outline
        };
        self.begun.go_on(&ready.parts, &field, &request)
    }

    /// The surface, to be finished.
    pub(super) fn begun(self) -> Begun {
        self.begun
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruction::blocks::input::Fitted;
    use crate::reconstruction::network::{Architecture, initial_parameters, sequential_engine};
    use crate::reconstruction::sampling::{Frame, Samples};
    use crate::reconstruction::settings::{CoarseInput, Engine as Choice, Preset};
    use crate::reconstruction::shapes::Shape;
    use crate::reconstruction::surface::extract;
    use crate::reconstruction::training::Termination;
    use crate::reconstruction::vector::Bounds;

    fn below<'a>() -> Coarse<'a> {
        Coarse {
            field: Box::new(Shape::Sphere { radius: 1.0 }),
            band: 0.5,
            input: CoarseInput::Residual,
        }
    }

    /// Two halves of the ball.
    fn halves() -> [Block; 2] {
        [[-1.5, 0.0], [0.0, 1.5]].map(|[min, max]| {
            let core = Bounds {
                min: [min, -1.5, -1.5],
                max: [max, 1.5, 1.5],
            };
            Block {
                core,
                reach: core.padded(0.1),
                band: 0.1,
                frame: Frame::IDENTITY,
            }
        })
    }

    fn fitted(architecture: &Architecture, seed: u64) -> Fitted<f32> {
        Fitted {
            parameters: initial_parameters(architecture, seed),
            loss: 0.0,
            evaluations: 0,
            iterations: 0,
            points: 0,
            first_loss: 0.0,
            gradient_norm: 0.0,
            step_length: 0.0,
            held_out: None,
            termination: Termination::MaxEvaluations,
        }
    }

    #[test]
    fn the_surface_goes_on_where_all_blocks_are_fitted_once_others_help() {
        let bounds = Bounds {
            min: [-1.6; 3],
            max: [1.6; 3],
        };
        let outline = Request::new(bounds, 80);
        let blocks = halves();
        let lookup = Lookup::new(blocks.iter().map(|block| block.reach).collect());
        let architecture = Architecture::of_block(&Preset::Fast.settings().network);
        let nothing: Samples = [([0.0; 3], 0.0)].into_iter().collect();
        let engine = sequential_engine::<f32>(Choice::Auto, &architecture, &nothing).unwrap();
        let mut ahead = Ahead::new(outline, (&blocks, &lookup), engine.as_ref(), below()).unwrap();
        let parts = ahead.begun.parts(&outline);

        let board = Mutex::new(Board::new(vec![Some(fitted(&architecture, 1)), None]));
        assert!(ahead.ready(&board).is_none());
        lock(&board).is_helped = true;
        let ready = ahead.ready(&board).unwrap();
        let without_the_other = |part: &usize| !blocks[1].reach.meets(&parts[*part]);
        let expected: Vec<usize> = (0..parts.len()).filter(without_the_other).collect();
        assert_eq!(ready.parts, expected);
        assert_eq!(ready.networks.len(), 1);
        ahead.go_on(&ready, &|| false, &|| ()).unwrap();
        assert!(ahead.ready(&board).is_none());

        lock(&board).put(1, fitted(&architecture, 2));
        let ready = ahead.ready(&board).unwrap();
        assert_eq!(ready.parts.len(), parts.len() - expected.len());
        ahead.go_on(&ready, &|| false, &|| ()).unwrap();

        let parts = (1..).zip(blocks).map(|(seed, block)| {
            let parameters = initial_parameters::<f32>(&architecture, seed);
            (block, engine.field(&parameters).unwrap())
        });
        let field = BlockField::new(below(), parts.collect());
        let whole = extract(&field, &outline).unwrap();
        assert!(whole.mesh.triangles.len() > 1000);
        assert_eq!(ahead.begun().finish(&field, &outline).unwrap(), whole);
    }
}
