//! Networks of one architecture side by side, whose mean is the field.
//!
//! Fitted to the same samples from different first weights, networks agree where there are samples and err
//! independently of each other elsewhere; their mean errs less than any of them.

use std::slice::Chunks;

use super::initialisation::draw;
use super::{Architecture, Engine, Scalar};
use crate::reconstruction::error::Error;
use crate::reconstruction::random::{Purpose, stream};
use crate::reconstruction::settings::Network;
use crate::reconstruction::surface::Field;
use crate::reconstruction::vector::Vec3;

/// How many networks there are, and the shape of each; at least one. Their parameters stand one after the
/// other.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ensemble {
    /// The shape of each.
    pub architecture: Architecture,
    /// How many there are.
    pub members: usize,
}

impl Ensemble {
    /// What fits a cloud, uncertain or not ([`Findings::is_uncertain`](crate::reconstruction::plan::Findings::is_uncertain)).
    pub fn new(network: &Network, uncertain: bool) -> Self {
        let architecture = Architecture::new(network);
        if uncertain && network.members > 1 {
            Self {
                architecture: Architecture {
                    width: network.member_width,
                    ..architecture
                },
                members: network.members,
            }
        } else {
            Self {
                architecture,
                members: 1,
            }
        }
    }

    /// Length of all parameters.
    pub fn parameter_count(&self) -> usize {
        self.members * self.architecture.parameter_count()
    }

    /// First parameters of each ([`initial_parameters`](super::initial_parameters)), one drawn after the
    /// other.
    pub fn initial_parameters<T: Scalar>(&self, seed: u64) -> Vec<T> {
        let mut generator = stream(seed, Purpose::Initialisation);
        (0..self.members)
            .flat_map(|_| draw(&self.architecture, &mut generator))
            .collect()
    }
}

impl Architecture {
    /// The parameters of each member of an ensemble of this architecture; the last are too few where their
    /// number fits no ensemble, which engines refuse.
    pub fn members<'a, P>(&self, parameters: &'a [P]) -> Chunks<'a, P> {
        parameters.chunks(self.parameter_count())
    }
}

/// The mean of the fields of an ensemble.
pub struct MeanField<'a> {
    members: Vec<Box<dyn Field + 'a>>,
}

impl<'a> MeanField<'a> {
    /// The mean of at least one field.
    pub fn new(members: Vec<Box<dyn Field + 'a>>) -> Self {
        Self { members }
    }

    /// The mean of the fields of all networks of these parameters.
    ///
    /// # Errors
    /// What the engine reports.
    pub fn of<T: Scalar>(engine: &'a dyn Engine<T>, parameters: &[T]) -> Result<Self, Error> {
        let members = engine.architecture().members(parameters);
        let fields = members.map(|parameters| engine.field(parameters));
        Ok(Self::new(fields.collect::<Result<_, _>>()?))
    }
}

impl Field for MeanField<'_> {
    fn values(&self, points: &[Vec3], values: &mut [f64]) -> Result<(), Error> {
        let mut of_member = vec![0.0; values.len()];
        values.fill(0.0);
        for member in &self.members {
            member.values(points, &mut of_member)?;
            add(values, &of_member, self.members.len());
        }
        Ok(())
    }

    fn values_and_gradients(
        &self,
        points: &[Vec3],
        values: &mut [f64],
        gradients: &mut [Vec3],
    ) -> Result<(), Error> {
        let mut of_member = vec![0.0; values.len()];
        let mut slopes = vec![[0.0; 3]; gradients.len()];
        values.fill(0.0);
        gradients.fill([0.0; 3]);
        for member in &self.members {
            member.values_and_gradients(points, &mut of_member, &mut slopes)?;
            add(values, &of_member, self.members.len());
            add(
                gradients.as_flattened_mut(),
                slopes.as_flattened(),
                self.members.len(),
            );
        }
        Ok(())
    }
}

/// Adds the share of one of so many members.
fn add(sums: &mut [f64], of_member: &[f64], members: usize) {
    for (sum, value) in sums.iter_mut().zip(of_member) {
        *sum += value / members as f64;
    }
}
