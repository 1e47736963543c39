//! A trained network as a file: safetensors, one weight and one bias a layer, as PyTorch names and
//! shapes them; settings and frame are in the file's metadata, so that it says all about itself.

use std::collections::HashMap;
use std::ops::Range;

use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensorError, SafeTensors, serialize};
use serde::{Deserialize, Serialize};
use serde_json::json;
use thiserror::Error;

use super::{Ensemble, MeanField, PlainNetwork};
use crate::reconstruction::sampling::Frame;
use crate::reconstruction::settings::{Precision, Settings};
use crate::reconstruction::surface::Field;

/// Name of the metadata: a JSON object with `settings`, `ensemble`, `frame` and what else is of use.
const KEY: &str = "meshway";

/// What is read of the metadata.
#[derive(Deserialize)]
struct Record {
    settings: Settings,
    /// What was trained; none in files from before there were members.
    ensemble: Option<Shape>,
    frame: Frame,
}

/// What of an ensemble the settings leave open.
#[derive(Serialize, Deserialize)]
struct Shape {
    members: usize,
    width: usize,
}

/// A trained network, or several whose mean is the field, and what is needed to use them.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// Settings of the run that trained it.
    pub settings: Settings,
    /// How many networks there are, and their shape.
    pub ensemble: Ensemble,
    /// From the coordinates of the cloud to those that it was trained in.
    pub frame: Frame,
    /// Parameters of each network in the order of [`Architecture::layers`](super::Architecture::layers), one
    /// network after the other; with `f32` settings each is one.
    pub parameters: Vec<f64>,
}

/// Why bytes are no model.
#[derive(Debug, Error)]
pub enum ModelError {
    /// Not a file of tensors, or damaged.
    #[error("tensors of the model: {0}")]
    Tensors(#[from] SafeTensorError),
    /// Settings or frame are missing or damaged.
    #[error("metadata of the model: {0}")]
    Metadata(#[from] serde_json::Error),
    /// A tensor has another type or shape than the settings ask for.
    #[error("tensor {name} of the model has another shape than the settings ask for")]
    Shape {
        /// Name of the tensor.
        name: String,
    },
}

impl Model {
    /// The file.
    ///
    /// # Errors
    /// When the number of parameters is not that of the settings.
    pub fn encode(&self) -> Result<Vec<u8>, ModelError> {
        let f64s = self.settings.network.precision == Precision::F64;
        let dtype = if f64s { Dtype::F64 } else { Dtype::F32 };
        let tensors: Vec<_> = tensors(&self.ensemble)
            .into_iter()
            .map(|(name, shape, range)| {
                let values = self.parameters.get(range).unwrap_or_default().iter();
                let bytes: Vec<u8> = if f64s {
                    values.flat_map(|v| v.to_le_bytes()).collect()
                } else {
                    values.flat_map(|v| (*v as f32).to_le_bytes()).collect()
                };
                (name, shape, bytes)
            })
            .collect();
        let views = tensors
            .iter()
            .map(|(name, shape, bytes)| {
                Ok((name.as_str(), TensorView::new(dtype, shape.clone(), bytes)?))
            })
            .collect::<Result<Vec<_>, SafeTensorError>>()?;
        let record = json!({
            "settings": self.settings,
            "ensemble": Shape {
                members: self.ensemble.members,
                width: self.ensemble.architecture.width,
            },
            "frame": self.frame,
        });
        let metadata = HashMap::from([(KEY.to_owned(), record.to_string())]);
        Ok(serialize(views, Some(metadata))?)
    }

    /// What [`Self::encode`] wrote.
    ///
    /// # Errors
    /// What is missing or damaged.
    pub fn decode(bytes: &[u8]) -> Result<Self, ModelError> {
        let (_, metadata) = SafeTensors::read_metadata(bytes)?;
        let entries = metadata.metadata().clone().unwrap_or_default();
        let record = entries.get(KEY).map_or("", String::as_str);
        let Record {
            settings,
            ensemble: shape,
            frame,
        } = serde_json::from_str(record)?;
        let mut ensemble = Ensemble::new(&settings.network, false);
        if let Some(Shape { members, width }) = shape {
            ensemble.members = members;
            ensemble.architecture.width = width;
        }
        let file = SafeTensors::deserialize(bytes)?;
        let mut parameters = Vec::new();
        for (name, shape, _) in tensors(&ensemble) {
            let tensor = file.tensor(&name)?;
            if tensor.shape() != shape {
                return Err(ModelError::Shape { name });
            }
            match tensor.dtype() {
                Dtype::F32 => parameters.extend(
                    tensor
                        .data()
                        .as_chunks()
                        .0
                        .iter()
                        .map(|v| f64::from(f32::from_le_bytes(*v))),
                ),
                Dtype::F64 => parameters.extend(
                    tensor
                        .data()
                        .as_chunks()
                        .0
                        .iter()
                        .map(|v| f64::from_le_bytes(*v)),
                ),
                _ => return Err(ModelError::Shape { name }),
            }
        }
        Ok(Self {
            settings,
            ensemble,
            frame,
            parameters,
        })
    }

    /// The field in plain Rust; `None` where the number of parameters is not that of the ensemble.
    pub fn field(&self) -> Option<MeanField<'static>> {
        let architecture = &self.ensemble.architecture;
        if self.parameters.len() != self.ensemble.parameter_count() {
            return None;
        }
        let members = architecture.members(&self.parameters).map(|parameters| {
            let network = PlainNetwork::new(architecture.clone(), parameters.to_vec())?;
            Some(Box::new(network) as Box<dyn Field>)
        });
        Some(MeanField::new(members.collect::<Option<_>>()?))
    }
}

/// Name, shape and place of every tensor: `linear.0.weight`, …, with `member.0.` and so on before it where
/// there are several networks.
fn tensors(ensemble: &Ensemble) -> Vec<(String, Vec<usize>, Range<usize>)> {
    let layers = ensemble.architecture.layers();
    let length = ensemble.architecture.parameter_count();
    let mut tensors = Vec::new();
    for member in 0..ensemble.members {
        let prefix = match ensemble.members {
            1 => String::new(),
            _ => format!("member.{member}."),
        };
        let moved =
            |range: &Range<usize>| range.start + member * length..range.end + member * length;
        for layer in &layers {
            let name = format!("{prefix}{}", layer.name);
            let shape = vec![layer.rows, layer.columns];
            tensors.push((format!("{name}.weight"), shape, moved(&layer.weight)));
            tensors.push((format!("{name}.bias"), vec![layer.rows], moved(&layer.bias)));
        }
    }
    tensors
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruction::settings::Preset;

    fn model(precision: Precision, uncertain: bool) -> Model {
        let mut settings = Preset::Fast.settings();
        settings.network.precision = precision;
        settings.network.width = 4;
        settings.network.member_width = 3;
        let ensemble = Ensemble::new(&settings.network, uncertain);
        let parameters = match precision {
            Precision::F32 => ensemble
                .initial_parameters::<f32>(1)
                .into_iter()
                .map(f64::from)
                .collect(),
            Precision::F64 => ensemble.initial_parameters(1),
        };
        Model {
            settings,
            ensemble,
            frame: Frame {
                centre: [1.0, -2.0, 0.1],
                scale: 0.3,
            },
            parameters,
        }
    }

    #[test]
    fn a_model_survives_its_file_bit_for_bit() {
        for precision in [Precision::F32, Precision::F64] {
            for uncertain in [false, true] {
                let model = model(precision, uncertain);
                assert_eq!(Model::decode(&model.encode().unwrap()).unwrap(), model);
            }
        }
    }

    #[test]
    fn the_same_model_has_the_same_bytes() {
        // Every hash map is seeded anew: an order that depended on one would change.
        let first = model(Precision::F32, true).encode().unwrap();
        for _ in 0..20 {
            assert_eq!(model(Precision::F32, true).encode().unwrap(), first);
        }
    }

    #[test]
    fn damaged_files_are_refused() {
        let bytes = model(Precision::F32, false).encode().unwrap();
        for length in [0, 7, 100, bytes.len() - 1] {
            assert!(Model::decode(&bytes[..length]).is_err(), "{length}");
        }
        let mut short = model(Precision::F32, true);
        short.parameters.pop();
        assert!(short.encode().is_err());
    }
}
