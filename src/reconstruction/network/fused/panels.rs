//! The weights of a network, laid out for the products.

use super::super::Layer;

/// Most rows of a panel. With four vectors of points to each row it takes 24 of the 32 registers of
/// AVX-512, and as many sums hide the latency of the multiply-add many times over.
pub(super) const PANEL_ROWS: usize = 6;

/// Splits `rows` into the fewest runs of at most `most`, as equal as can be: (start, length).
pub(super) fn runs(rows: usize, most: usize) -> impl Iterator<Item = (usize, usize)> {
    let count = rows.div_ceil(most).max(1);
    let (base, longer) = (rows / count, rows % count);
    (0..count).map(move |i| (i * base + i.min(longer), base + usize::from(i < longer)))
}

/// A matrix in panels: those of its [`runs`] of rows, one after the other, each column by column.
/// A product reads it from front to back.
#[derive(Debug)]
pub(super) struct Panels {
    pub(super) rows: usize,
    pub(super) columns: usize,
    elements: Vec<f32>,
}

impl Panels {
    fn new(rows: usize, columns: usize, element: impl Fn(usize, usize) -> f32) -> Self {
        let mut elements = Vec::with_capacity(rows * columns);
        for (start, len) in runs(rows, PANEL_ROWS) {
            for column in 0..columns {
                elements.extend((start..start + len).map(|row| element(row, column)));
            }
        }
        Self {
            rows,
            columns,
            elements,
        }
    }

    /// The panels with the first row and the number of rows of each.
    pub(super) fn iter(&self) -> impl Iterator<Item = (usize, usize, &[f32])> {
        runs(self.rows, PANEL_ROWS).map(|(start, len)| {
            let elements = &self.elements[start * self.columns..][..len * self.columns];
            (start, len, elements)
        })
    }
}

/// One affine map.
#[derive(Debug)]
pub(super) struct Affine {
    pub(super) weight: Panels,
    pub(super) transposed: Panels,
    pub(super) bias: Vec<f32>,
}

impl Affine {
    pub(super) fn new(layer: &Layer, parameters: &[f32]) -> Self {
        let (rows, columns) = (layer.rows, layer.columns);
        let weight = &parameters[layer.weight.clone()];
        Self {
            weight: Panels::new(rows, columns, |row, column| weight[row * columns + column]),
            transposed: Panels::new(columns, rows, |column, row| weight[row * columns + column]),
            bias: parameters[layer.bias.clone()].to_vec(),
        }
    }
}

/// The affine maps of these layers of a network.
pub(super) fn affine_maps(layers: &[Layer], parameters: &[f32]) -> Vec<Affine> {
    layers
        .iter()
        .map(|layer| Affine::new(layer, parameters))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_cover_all_rows_and_differ_by_one_at_most() {
        for rows in 1..=60 {
            for most in 1..=6 {
                let runs: Vec<_> = runs(rows, most).collect();
                let mut next = 0;
                for &(start, len) in &runs {
                    assert_eq!(start, next);
                    assert!((1..=most).contains(&len));
                    assert!(len + 1 >= runs[0].1);
                    next += len;
                }
                assert_eq!(next, rows);
                assert_eq!(runs.len(), rows.div_ceil(most));
            }
        }
    }
}
