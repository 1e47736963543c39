//! The Gaussian that takes the steps of the pixels out of a mask.

/// Standard deviations to either side beyond which its weights are nothing: below 0.0004.
const REACH: f64 = 4.0;

/// Smooths `values`, row by row of `width`, along rows and then along columns by a standard deviation of `sigma`
/// pixels. Beyond the borders there is nothing.
pub(super) fn gaussian(values: &[f32], width: usize, sigma: f64) -> Vec<f32> {
    let weights = weights(sigma);
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
    let reach = weights.len() / 2;
    let mut out = vec![0.0; values.len()];
    for line in 0..lines {
        let start = line * next.0;
        for i in 0..length {
            let near = i.saturating_sub(reach)..(i + reach + 1).min(length);
            out[start + i * next.1] = near
                .map(|j| weights[j + reach - i] * values[start + j * next.1])
                .sum();
        }
    }
    out
}

/// Weights from one end of the reach to the other; their sum is 1.
fn weights(sigma: f64) -> Vec<f32> {
    let reach = (REACH * sigma).ceil() as usize;
    let bell = |i: usize| (-0.5 * ((i as f64 - reach as f64) / sigma).powi(2)).exp();
    let bells: Vec<f64> = (0..=2 * reach).map(bell).collect();
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
        let smooth = gaussian(&values, 13, 1.0);
        assert!((smooth.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        assert!((smooth[5 * 13 + 6] - 0.159).abs() < 1e-3);
        assert!((smooth[5 * 13 + 5] - smooth[4 * 13 + 6]).abs() < 1e-7);
    }
}
