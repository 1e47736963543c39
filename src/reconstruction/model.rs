//! The trained network as a file: safetensors, which every tensor library reads.
//!
//! One tensor for each weight `[rows, columns]` and bias `[rows]`, by the names of the layers
//! (`linear.0.weight`, …). The metadata has one key, `meshway`: a JSON object with `version` of this
//! program, the complete `settings`, and `frame`, which takes a point p of the cloud into the
//! network: (p - centre) · scale.

use std::collections::HashMap;

use safetensors::serialize;
use safetensors::tensor::TensorView;
use serde_json::json;

use super::network::{Architecture, Scalar};
use super::sampling::Frame;
use super::settings::Settings;

/// A network with its parameters, and the coordinates it is trained in.
#[derive(Debug, Clone, Copy)]
pub struct Network<'a, T> {
    /// Its shape.
    pub architecture: &'a Architecture,
    /// Its parameters, in the order of [`Architecture::layers`].
    pub parameters: &'a [T],
    /// The way from the cloud into the network.
    pub frame: &'a Frame,
}

/// Writes the file. The same network gives the same bytes.
///
/// # Panics
/// When there are not as many parameters as the architecture has.
pub fn encode<T: Scalar>(network: &Network<'_, T>, settings: &Settings) -> Vec<u8> {
    let mut tensors: Vec<(String, Vec<usize>, Vec<u8>)> = Vec::new();
    for layer in network.architecture.layers() {
        let bytes = |range| {
            let mut bytes = Vec::new();
            let values: &[T] = &network.parameters[range];
            values.iter().for_each(|value| value.write(&mut bytes));
            bytes
        };
        let (weight, bias) = (bytes(layer.weight), bytes(layer.bias));
        tensors.push((format!("{}.weight", layer.name), vec![layer.rows, layer.columns], weight));
        tensors.push((format!("{}.bias", layer.name), vec![layer.rows], bias));
    }
    let views = tensors.iter().map(|(name, shape, bytes)| {
        let view = TensorView::new(T::DTYPE, shape.clone(), bytes);
        (name, view.expect("a layer's range has its shape's length"))
    });
    let record = json!({
        "version": env!("CARGO_PKG_VERSION"),
        "frame": network.frame,
        "settings": settings,
    });
    // One key, because the order of several would be that of a hash map.
    let metadata = HashMap::from([("meshway".to_owned(), record.to_string())]);
    serialize(views, Some(metadata)).expect("the views have the lengths of their shapes")
}
