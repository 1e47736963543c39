//! What the report says of the networks of blocks.

use serde::Serialize;

use crate::reconstruction::training::Termination;

/// Each block, a list a quantity: a thousand of them take some 60 kB.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct EachBlock {
    /// Points of the cloud that its network was fitted to, those near its neighbours included.
    pub points: Vec<usize>,
    /// Evaluations of its loss and gradient.
    pub evaluations: Vec<u64>,
    /// Its loss after the first step.
    pub first_loss: Vec<f64>,
    /// Its loss at the end.
    pub loss: Vec<f64>,
    /// Root mean square distance of the points held out there from the surface of its network, in units of the input;
    /// none where there are none.
    pub held_out_error: Vec<Option<f64>>,
    /// Why its training ended: `handed_over` where it left no more than it may.
    pub termination: Vec<Termination>,
}

/// The networks of blocks.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BlocksReport {
    /// How many there are.
    pub count: usize,
    /// Neurons of each of their hidden layers.
    pub width: usize,
    /// Their hidden layers.
    pub hidden_layers: usize,
    /// Trained numbers of all of them.
    pub parameters: usize,
    /// Evaluations of loss and gradient of all of them.
    pub evaluations: u64,
    /// Mean of their losses, each over the samples of its block.
    pub loss: f64,
    /// Each of them.
    pub each: EachBlock,
}
