//! A trained network as a file: safetensors, one weight and one bias a layer, as PyTorch names and
//! shapes them; settings and frame are in the file's metadata, so that it says all about itself.

use std::collections::HashMap;
use std::ops::Range;

use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensorError, SafeTensors, serialize};
use serde::{Deserialize, Serialize};
use serde_json::json;
use thiserror::Error;

use super::blocks::{Block, BlockModel};
use super::network::{Architecture, Ensemble, MeanField, PlainNetwork};
use super::sampling::Frame;
use super::settings::{Precision, Settings};
use super::surface::Field;

/// Name of the metadata: a JSON object with `settings`, `ensemble`, `frame` and what else is of use.
const KEY: &str = "meshway";

/// What is read of the metadata.
#[derive(Deserialize)]
struct Record {
    settings: Settings,
    /// What was trained; none in files from before there were members.
    ensemble: Option<Shape>,
    frame: Frame,
    /// None where one network was enough, and in files from before there were blocks.
    #[serde(default)]
    blocks: Option<BlockRecord>,
}

/// What of the blocks is no tensor.
#[derive(Serialize, Deserialize)]
struct BlockRecord {
    coarse_band: f64,
    blocks: Vec<Block>,
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
    /// Parameters of each network in the order of [`Architecture::layers`], one
    /// network after the other; with `f32` settings each is one.
    pub parameters: Vec<f64>,
    /// The networks of blocks that refine the field; none where one network was enough.
    pub blocks: Option<BlockModel>,
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
        let bytes = |values: &[f64]| -> Vec<u8> {
            if f64s {
                values.iter().flat_map(|v| v.to_le_bytes()).collect()
            } else {
                values
                    .iter()
                    .flat_map(|v| (*v as f32).to_le_bytes())
                    .collect()
            }
        };
        let mut tensors: Vec<_> = tensors(&self.ensemble)
            .into_iter()
            .map(|(name, shape, range)| {
                let values = self.parameters.get(range).unwrap_or_default();
                (name, shape, bytes(values))
            })
            .collect();
        if let Some(model) = &self.blocks {
            for (name, shape, range) in block_tensors(&model.architecture, model.blocks.len()) {
                let networks = model
                    .parameters
                    .chunks(model.architecture.parameter_count());
                let values = networks.flat_map(|p| p.get(range.clone()).unwrap_or_default());
                let values: Vec<f64> = values.copied().collect();
                tensors.push((name, shape, bytes(&values)));
            }
        }
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
            "blocks": self.blocks.as_ref().map(|model| BlockRecord {
                coarse_band: model.coarse_band,
                blocks: model.blocks.clone(),
            }),
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
            blocks,
        } = serde_json::from_str(record)?;
        let mut ensemble = Ensemble::new(&settings.network, false);
        if let Some(Shape { members, width }) = shape {
            ensemble.members = members;
            ensemble.architecture.width = width;
        }
        let file = SafeTensors::deserialize(bytes)?;
        let mut parameters = Vec::new();
        for (name, shape, _) in tensors(&ensemble) {
            parameters.extend(values(&file, &name, &shape)?);
        }
        let blocks = blocks
            .map(|record| {
                let architecture = Architecture::of_block(&settings.network);
                let length = architecture.parameter_count();
                let count = record.blocks.len();
                let mut parameters = vec![0.0; count * length];
                for (name, shape, range) in block_tensors(&architecture, count) {
                    let values = values(&file, &name, &shape)?;
                    let networks = parameters.chunks_mut(length);
                    for (network, values) in networks.zip(values.chunks(range.len())) {
                        network[range.clone()].copy_from_slice(values);
                    }
                }
                Ok::<_, ModelError>(BlockModel {
                    architecture,
                    coarse_band: record.coarse_band,
                    coarse_input: settings.network.coarse_input,
                    blocks: record.blocks,
                    parameters,
                })
            })
            .transpose()?;
        Ok(Self {
            settings,
            ensemble,
            frame,
            parameters,
            blocks,
        })
    }

    /// The field in plain Rust; `None` where the number of parameters is not that of the networks.
    pub fn field(&self) -> Option<Box<dyn Field>> {
        let coarse = Box::new(self.coarse()?);
        match &self.blocks {
            Some(blocks) => Some(Box::new(blocks.field(coarse)?)),
            None => Some(coarse),
        }
    }

    /// The field without blocks.
    fn coarse(&self) -> Option<MeanField<'static>> {
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

/// The same of so many blocks: the layers of all of them in one tensor, `blocks.linear.0.weight` and so on, and
/// where they lie in the parameters of each.
fn block_tensors(
    architecture: &Architecture,
    count: usize,
) -> Vec<(String, Vec<usize>, Range<usize>)> {
    let layers = architecture.layers().into_iter();
    layers
        .flat_map(|layer| {
            let weight = vec![count, layer.rows, layer.columns];
            let name = format!("blocks.{}", layer.name);
            [
                (format!("{name}.weight"), weight, layer.weight),
                (format!("{name}.bias"), vec![count, layer.rows], layer.bias),
            ]
        })
        .collect()
}

/// The numbers of a tensor that must have this shape.
fn values(file: &SafeTensors<'_>, name: &str, shape: &[usize]) -> Result<Vec<f64>, ModelError> {
    let tensor = file.tensor(name)?;
    let refused = || ModelError::Shape {
        name: name.to_owned(),
    };
    if tensor.shape() != shape {
        return Err(refused());
    }
    let data = tensor.data();
    match tensor.dtype() {
        Dtype::F32 => {
            let numbers = data.as_chunks().0.iter();
            Ok(numbers.map(|v| f64::from(f32::from_le_bytes(*v))).collect())
        }
        Dtype::F64 => {
            let numbers = data.as_chunks().0.iter();
            Ok(numbers.map(|v| f64::from_le_bytes(*v)).collect())
        }
        _ => Err(refused()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruction::network::initial_parameters;
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
            blocks: None,
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
    fn blocks_survive_it_too_and_refine_the_field() {
        use crate::reconstruction::vector::Bounds;

        let mut model = model(Precision::F32, true);
        let architecture = Architecture::of_block(&model.settings.network);
        let block = |x: f64| {
            let core = Bounds {
                min: [x, 0.0, 0.0],
                max: [x + 1.0, 1.0, 1.0],
            };
            Block {
                core,
                reach: core.padded(0.1),
                band: 0.2,
                frame: Frame {
                    centre: core.centre(),
                    scale: 3.0,
                },
            }
        };
        let networks = [1, 2].map(|seed| initial_parameters::<f32>(&architecture, seed));
        let without = model.field().unwrap();
        model.blocks = Some(BlockModel {
            coarse_band: 0.4,
            coarse_input: model.settings.network.coarse_input,
            blocks: vec![block(0.0), block(1.0)],
            parameters: networks.concat().into_iter().map(f64::from).collect(),
            architecture,
        });
        assert_eq!(Model::decode(&model.encode().unwrap()).unwrap(), model);
        let with = model.field().unwrap();
        let mut values = [[0.0; 2]; 2];
        let places = [[0.5; 3], [9.0; 3]];
        without.values(&places, &mut values[0]).unwrap();
        with.values(&places, &mut values[1]).unwrap();
        assert!((values[0][0] - values[1][0]).abs() > 1e-3);
        assert!((values[0][1] - values[1][1]).abs() < 1e-12);
        model.blocks.as_mut().unwrap().parameters.pop();
        assert!(model.field().is_none());
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
