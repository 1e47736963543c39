//! Distances on a lattice of pixels, in linear time (Felzenszwalb, Huttenlocher: Distance Transforms of Sampled
//! Functions, Theory of Computing 2012).

/// Distance of each pixel to the nearest one of the other side; `steps` are the distances of pixels in a row and of
/// rows. Infinite where all pixels are on one side.
pub(super) fn to_other_side(inside: &[bool], width: usize, steps: [f64; 2]) -> Vec<f32> {
    let of = |side: bool| squared(inside, side, width, steps);
    let (to_inside, to_outside) = (of(true), of(false));
    to_inside
        .iter()
        .zip(&to_outside)
        .map(|(a, b)| a.max(*b).sqrt())
        .collect()
}

/// Squared distance of each pixel to the nearest one on `side`.
fn squared(inside: &[bool], side: bool, width: usize, steps: [f64; 2]) -> Vec<f32> {
    let mut values: Vec<f32> = inside
        .iter()
        .map(|&i| if i == side { 0.0 } else { f32::INFINITY })
        .collect();
    let height = values.len() / width.max(1);
    for row in values.chunks_mut(width.max(1)) {
        transform(row, steps[0]);
    }
    let mut column = vec![0.0; height];
    for x in 0..width {
        for (y, value) in column.iter_mut().enumerate() {
            *value = values[y * width + x];
        }
        transform(&mut column, steps[1]);
        for (y, value) in column.iter().enumerate() {
            values[y * width + x] = *value;
        }
    }
    values
}

/// min over j of f(j) + (step (i - j))² in place of f(i): the lower envelope of parabolas.
fn transform(f: &mut [f32], step: f64) {
    // Parabolas of the envelope: where they stand, and from where on they are the lowest.
    let mut envelope: Vec<(usize, f64)> = Vec::with_capacity(f.len());
    let height = |j: usize| f64::from(f[j]) / (step * step);
    for j in (0..f.len()).filter(|&j| f[j].is_finite()) {
        let meeting = |&(i, _): &(usize, f64)| {
            let (a, b) = (i as f64, j as f64);
            (height(j) + b * b - height(i) - a * a) / (2.0 * (b - a))
        };
        while envelope.last().is_some_and(|top| meeting(top) <= top.1) {
            envelope.pop();
        }
        let from = envelope.last().map_or(f64::NEG_INFINITY, meeting);
        envelope.push((j, from));
    }
    if envelope.is_empty() {
        return;
    }
    let before = f.to_vec();
    let mut at = 0;
    for (i, value) in f.iter_mut().enumerate() {
        while envelope.get(at + 1).is_some_and(|next| next.1 < i as f64) {
            at += 1;
        }
        let j = envelope[at].0;
        let away = step * (i as f64 - j as f64);
        *value = before[j] + (away * away) as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_of_a_search_over_all_pixels() {
        let (width, height, steps) = (17, 13, [0.5, 1.25]);
        let inside: Vec<bool> = (0..width * height)
            .map(|i| i * i % 7 == 2 && i % 5 == 0)
            .collect();
        let found = to_other_side(&inside, width, steps);
        for i in 0..width * height {
            let away = |j: usize| {
                let [dx, dy] = [
                    (i % width).abs_diff(j % width),
                    (i / width).abs_diff(j / width),
                ];
                (steps[0] * dx as f64).hypot(steps[1] * dy as f64)
            };
            let others = (0..width * height).filter(|&j| inside[j] != inside[i]);
            let nearest = others.map(away).fold(f64::INFINITY, f64::min);
            assert!((f64::from(found[i]) - nearest).abs() < 1e-5, "pixel {i}");
        }
    }

    #[test]
    fn without_another_side_distances_are_infinite() {
        assert!(
            to_other_side(&[true; 6], 3, [1.0, 1.0])
                .iter()
                .all(|d| d.is_infinite())
        );
    }
}
