//! The Gaussian that takes the steps of the pixels out of a mask.

/// Standard deviation in pixels: the least that leaves contours right to a tenth of a pixel.
const SIGMA: f64 = 1.0;

/// Pixels to either side beyond which its weights are below 0.0001.
pub(super) const REACH: usize = 4;

/// Smooths `values`, row by row of `width`, along rows and then along columns. Beyond the borders there is nothing.
pub(super) fn gaussian(values: &[f32], width: usize) -> Vec<f32> {
    let weights = weights();
    let height = values.len() / width.max(1);
    let along_rows = blurred(values, &weights, (height, width), (width, 1));
    blurred(&along_rows, &weights, (width, height), (1, width))
}

/// Smooths each of `lines` lines of `length` values, whose starts and values are `next.0` and `next.1` apart.
fn blurred(
    values: &[f32],
    weights: &[f32],
    (lines, length): (usize, usize),
    next: (usize, usize),
) -> Vec<f32> {
    let mut out = vec![0.0; values.len()];
    for line in 0..lines {
        let start = line * next.0;
        for i in 0..length {
            let near = i.saturating_sub(REACH)..(i + REACH + 1).min(length);
            out[start + i * next.1] = near
                .map(|j| weights[j + REACH - i] * values[start + j * next.1])
                .sum();
        }
    }
    out
}

/// Weights from -REACH to REACH; their sum is 1.
fn weights() -> Vec<f32> {
    let bell = |i: usize| (-0.5 * ((i as f64 - REACH as f64) / SIGMA).powi(2)).exp();
    let bells: Vec<f64> = (0..=2 * REACH).map(bell).collect();
    let sum: f64 = bells.iter().sum();
    bells.iter().map(|bell| (bell / sum) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_is_spread_over_its_neighbourhood_and_nothing_is_lost() {
        let mut values = vec![0.0; 13 * 11];
        values[5 * 13 + 6] = 1.0;
        let smooth = gaussian(&values, 13);
        assert!((smooth.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        assert!((smooth[5 * 13 + 6] - 0.159).abs() < 1e-3);
        assert!((smooth[5 * 13 + 5] - smooth[4 * 13 + 6]).abs() < 1e-7);
    }
}
