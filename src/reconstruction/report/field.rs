//! How well the network fits the points.

use serde::Serialize;

use super::Subject;
use crate::reconstruction::error::Error;
use crate::reconstruction::nearby::Walk;
use crate::reconstruction::sampling::selection::pick;
use crate::reconstruction::vector::Vec3;

/// Points that the field is asked about at a time.
const AT_A_TIME: usize = 1 << 15;

/// |f| at the surface points: 0 where the network fits them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FieldAtPoints {
    /// Mean of |f|.
    pub mean: f64,
    /// Root of the mean of f².
    pub rms: f64,
    /// Largest |f|.
    pub max: f64,
}

impl FieldAtPoints {
    pub(super) fn measure(subject: &Subject<'_>) -> Result<Self, Error> {
        let Subject {
            cloud,
            prepared,
            field,
            ..
        } = *subject;
        let points: Vec<Vec3> = prepared
            .measured(cloud)
            .map(|p| prepared.frame.to_unit(p))
            .collect();
        // Neighbours lie in the same blocks, whose networks are asked about many points at once then.
        let order: Vec<usize> = Walk::along(&points).order().collect();
        let mut values = vec![0.0; points.len()];
        for some in order.chunks(AT_A_TIME) {
            let mut found = vec![0.0; some.len()];
            field.values(&pick(&points, some), &mut found)?;
            for (&i, found) in some.iter().zip(found) {
                values[i] = found;
            }
        }
        let count = values.len().max(1) as f64;
        Ok(Self {
            mean: values.iter().map(|v| v.abs()).sum::<f64>() / count,
            rms: (values.iter().map(|v| v * v).sum::<f64>() / count).sqrt(),
            max: values.iter().fold(0.0, |max, v| max.max(v.abs())),
        })
    }
}
