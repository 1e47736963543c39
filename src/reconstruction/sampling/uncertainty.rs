//! How far samples can be trusted, from the noise and the spacing of the points: what they weigh, and how
//! smooth the field has to be.

/// Spacing over band from which a cloud is sparse: the distance of a place to the surface is then as
/// unsure as the band is wide.
const SPARSE: f64 = 0.8;

/// Error of the distances at near samples, in spacings: that of normals and curvature.
const NEAR_ERROR: f64 = 0.3;

/// Error that surface points are taken to have besides their noise, in spacings, on sparse clouds ...
const LEAST_ERROR_SPARSE: f64 = 0.03;

/// ... and on the others, which converge slowly where weights are far apart.
const LEAST_ERROR: f64 = 0.1;

/// Noise counts for so much more at the surface points of one network alone than in the mean of several. One has
/// room to bend around points that weigh too much: it is near 0 as deep as they scatter, and its zero set is a sponge.
/// Chosen on a torus of two scans that do not quite meet, a sponge up to 3.
const BENT: f64 = 6.0;

/// Up to so many spacings, what fits leave is what they miss of a clean shape: a hand of 3000 points is at 0.018.
const MISSED: f64 = 0.015;

/// Weight decay over the variance of the noise in targets, times the samples. As the negative logarithm
/// of a posterior it would be the inverse variance of the weights, 50 for Xavier's at width 50.
const DECAY: f64 = 60.0;

/// The same on sparse clouds, where no hold-out ends the training.
const DECAY_SPARSE: f64 = 120.0;

/// Noise over spacing from which a cloud is noisy. Clean points stay below a twentieth, points with a noise of
/// 0.5 % of the diagonal are above a fifth where there are 3000.
const NOISY: f64 = 0.1;

/// Share of the view that may be missing from a surface for which the size of residuals tells what a network misses.
/// Closed surfaces of 3000 and 8000 clean points miss 0.07 at most, those with two holes, 40 % of them gone, 0.2 and
/// more.
const MOST_MISSING: f64 = 0.13;

/// Fewer points do not tell noise from shape: the fits that tell it reach around half of a body.
const TELL_NOISE: usize = 64;

/// Noise in spacings that so few points are taken to have. Twice and half as much are worse on balls of 16 and 24
/// points, an ellipsoid of 36 and a torus of 52; without any, the surface of 16 points is their polyhedron.
const NOISE_OF_FEW: f64 = 0.05;

/// The noise that fits to so many points found, or what it is taken to be where they cannot tell.
pub(super) fn believed_noise(found: f64, points: usize, spacing: f64) -> f64 {
    if points < TELL_NOISE {
        NOISE_OF_FEW * spacing
    } else {
        found
    }
}

/// Noise and spacing of a cloud beside the band of its targets, all in the same unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Uncertainty {
    /// Standard deviation of the points from the surface.
    pub noise: f64,
    /// Median spacing of the points that are trained on.
    pub spacing: f64,
    /// Distance at which graded targets reach ±1.
    pub band: f64,
    /// Whether the points lie far apart beside the band ([`Self::is_sparse`]).
    pub sparse: bool,
    /// Share of the view from the points that the surface lacks: 0 where it closes, 1 at a flat sheet. Across holes the
    /// one network has to find the way.
    pub missing: f64,
    /// Points for each place of slices or scan lines that share what one would weigh there; 1 of even clouds.
    pub crowding: f64,
}

impl Uncertainty {
    /// Whether a cloud of this spacing is sparse beside its band.
    pub fn is_sparse(spacing: f64, band: f64) -> bool {
        spacing > SPARSE * band
    }

    /// Whether there are different surfaces that fit the points equally well.
    pub fn leaves_the_surface_open(&self) -> bool {
        self.sparse || self.noise > NOISY * self.spacing
    }

    /// Whether residuals as such tell what a network misses of the shape: the points are all but exact, and the surface
    /// is there.
    pub fn tells_details(&self) -> bool {
        !self.leaves_the_surface_open() && self.missing < MOST_MISSING
    }

    /// Weight of a surface point over that of a near sample: inverse variances, shared by the
    /// points at one place.
    pub fn surface_weight(&self) -> f64 {
        let least = if self.sparse {
            LEAST_ERROR_SPARSE
        } else {
            LEAST_ERROR
        };
        let noise = self.noise / self.spacing;
        let variance = |noise: f64, error: f64| noise * noise + error * error;
        let bent = if self.leaves_the_surface_open() {
            noise
        } else {
            BENT * (noise - MISSED).max(0.0)
        };
        variance(noise, NEAR_ERROR) / (self.crowding * variance(bent, least))
    }

    /// λ of λ/2 |parameters|² beside the mean square error of so many samples.
    pub fn weight_decay(&self, samples: usize) -> f64 {
        let factor = if self.sparse { DECAY_SPARSE } else { DECAY };
        factor * (self.noise / self.band).powi(2) / samples as f64
    }
}
