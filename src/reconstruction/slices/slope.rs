//! Which way is out at a contour, and how it bends.

/// Change of values from pixel to pixel, first and second.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Slope {
    /// Along columns and rows.
    pub(super) first: [f64; 2],
    /// Along columns twice, along both, along rows twice.
    second: [f64; 3],
}

impl Slope {
    /// At a place between pixels, at least one of them from the border.
    pub(super) fn at(values: &[f32], width: usize, place: [f64; 2]) -> Self {
        let [x, y] = place.map(|v| v.floor() as usize);
        let share = [place[0] - x as f64, place[1] - y as f64];
        let mut slope = Self::default();
        for [dx, dy] in [[0, 0], [1, 0], [0, 1], [1, 1]] {
            let along = |d: usize, share: f64| if d == 1 { share } else { 1.0 - share };
            let weight = along(dx, share[0]) * along(dy, share[1]);
            if weight > 0.0 {
                slope.add(weight, values, width, (y + dy) * width + x + dx);
            }
        }
        slope
    }

    fn add(&mut self, weight: f64, values: &[f32], width: usize, pixel: usize) {
        let at = |dx: usize, dy: usize| f64::from(values[pixel + dx + dy * width - 1 - width]);
        let here = at(1, 1);
        let first = [0.5 * (at(2, 1) - at(0, 1)), 0.5 * (at(1, 2) - at(1, 0))];
        let second = [
            at(2, 1) + at(0, 1) - 2.0 * here,
            0.25 * (at(2, 2) + at(0, 0) - at(2, 0) - at(0, 2)),
            at(1, 2) + at(1, 0) - 2.0 * here,
        ];
        for (sum, value) in self.first.iter_mut().zip(first) {
            *sum += weight * value;
        }
        for (sum, value) in self.second.iter_mut().zip(second) {
            *sum += weight * value;
        }
    }

    /// The way in which values fall, of length 1; none where they do not.
    pub(super) fn outward(&self) -> Option<[f64; 2]> {
        let length = self.first[0].hypot(self.first[1]);
        (length > 1e-6).then(|| self.first.map(|v| -v / length))
    }

    /// Curvature of the line of equal values: that of a disc of higher values is one over its radius, in pixels.
    pub(super) fn curvature(&self) -> f64 {
        let ([x, y], [xx, xy, yy]) = (self.first, self.second);
        let length = x.hypot(y).max(1e-6);
        (2.0 * x * y * xy - x * x * yy - y * y * xx) / length.powi(3)
    }
}

#[cfg(test)]
mod tests {
    use super::super::blur;
    use super::*;

    #[test]
    fn a_disc_is_as_bent_as_its_radius_says_and_falls_outwards() {
        let (width, centre, radius) = (41, 20.0, 9.0);
        let disc: Vec<f32> = (0..width * width)
            .map(|i| {
                let away = ((i % width) as f64 - centre).hypot((i / width) as f64 - centre);
                f32::from(u8::from(away < radius))
            })
            .collect();
        let wide = blur::gaussian(&disc, width, 2.0);
        let bends = (0..60).map(|i| {
            let angle = std::f64::consts::TAU * f64::from(i) / 60.0;
            let way = [angle.cos(), angle.sin()];
            let slope = Slope::at(&wide, width, way.map(|w| centre + radius * w));
            let outward = slope.outward().unwrap();
            assert!(outward[0] * way[0] + outward[1] * way[1] > 0.98);
            slope.curvature()
        });
        let mean = bends.sum::<f64>() / 60.0;
        assert!((mean * radius - 1.0).abs() < 0.05, "{mean}");
    }
}
