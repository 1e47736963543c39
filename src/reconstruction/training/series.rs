//! The training series as a table.

use serde_json::{Value, json};

use super::Metrics;

/// A column of the series.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Column {
    /// Evaluations of loss and gradient.
    Evaluation,
    /// Accepted iterations.
    Iteration,
    /// Training loss.
    Loss,
    /// Loss on the validation samples.
    ValidationLoss,
    /// Norm of the gradient.
    GradientNorm,
    /// Accepted step length.
    StepLength,
    /// Norm of the weights of each layer.
    WeightNorms,
    /// Number of fitted blocks.
    Blocks,
}

impl Column {
    /// All of them, in the order of a table.
    pub const ALL: [Self; 8] = [
        Self::Evaluation,
        Self::Iteration,
        Self::Loss,
        Self::ValidationLoss,
        Self::GradientNorm,
        Self::StepLength,
        Self::WeightNorms,
        Self::Blocks,
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Evaluation => "evaluation",
            Self::Iteration => "iteration",
            Self::Loss => "loss",
            Self::ValidationLoss => "validation_loss",
            Self::GradientNorm => "gradient_norm",
            Self::StepLength => "step_length",
            Self::WeightNorms => "weight_norms",
            Self::Blocks => "blocks",
        }
    }

    /// Its value in JSON; what is not finite is null.
    pub fn value(self, row: &Metrics) -> Value {
        match self {
            Self::Evaluation => json!(row.evaluation),
            Self::Iteration => json!(row.iteration),
            Self::WeightNorms => json!(row.weight_norms),
            Self::Blocks => json!(row.blocks),
            _ => json!(self.number(row)),
        }
    }

    /// Its value as a point of a curve. None for counters, for columns with a value a layer, and for
    /// what is not finite.
    pub fn number(self, row: &Metrics) -> Option<f64> {
        match self {
            Self::Loss => Some(row.loss),
            Self::ValidationLoss => row.validation_loss,
            Self::GradientNorm => Some(row.gradient_norm),
            Self::StepLength => Some(row.step_length),
            Self::Evaluation | Self::Iteration | Self::WeightNorms | Self::Blocks => None,
        }
        .filter(|number| number.is_finite())
    }
}

/// The series as CSV: a head and a line a row. The weight norms have a column a layer; what is
/// missing or not finite is an empty cell.
pub fn csv(columns: &[Column], rows: &[Metrics]) -> String {
    let layers = rows.iter().map(|row| row.weight_norms.len()).max();
    let layers = layers.unwrap_or(0);
    let head: Vec<String> = columns
        .iter()
        .flat_map(|column| match column {
            Column::WeightNorms => (0..layers).map(|k| format!("weight_norm_{k}")).collect(),
            column => vec![column.name().to_owned()],
        })
        .collect();
    let mut out = head.join(",");
    for row in rows {
        out.push('\n');
        let cells: Vec<String> = columns
            .iter()
            .flat_map(|column| match column {
                Column::WeightNorms => (0..layers)
                    .map(|k| {
                        row.weight_norms
                            .get(k)
                            .map_or(String::new(), f64::to_string)
                    })
                    .collect(),
                column => match column.value(row) {
                    Value::Null => vec![String::new()],
                    value => vec![value.to_string()],
                },
            })
            .collect();
        out.push_str(&cells.join(","));
    }
    out.push('\n');
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_has_a_column_a_layer_and_gaps_for_what_is_missing() {
        let columns = [
            Column::Evaluation,
            Column::Loss,
            Column::ValidationLoss,
            Column::StepLength,
            Column::WeightNorms,
        ];
        let row = Metrics {
            iteration: 3,
            evaluation: 3,
            loss: 0.5,
            validation_loss: None,
            gradient_norm: 1.0,
            step_length: f64::INFINITY,
            weight_norms: vec![1.0, 2.5],
            blocks: None,
        };
        assert_eq!(
            csv(&columns, &[row]),
            "evaluation,loss,validation_loss,step_length,weight_norm_0,weight_norm_1\n\
             3,0.5,,,1,2.5\n"
        );
    }
}
