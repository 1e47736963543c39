//! Colours of vertices by their distance to the points: dark where the surface was measured, bright where it was
//! guessed.

/// The scale cividis in eleven steps, with straight lines between them: it looks even, and also those read it
/// who do not tell red from green (Nuñez, Anderton, Renslow, doi:10.1371/journal.pone.0199239). The dashboard
/// has the same.
const STEPS: [[u8; 3]; 11] = [
    [0x00, 0x22, 0x4e],
    [0x0f, 0x30, 0x6d],
    [0x37, 0x47, 0x6b],
    [0x51, 0x5b, 0x6c],
    [0x69, 0x6e, 0x71],
    [0x7f, 0x81, 0x76],
    [0x97, 0x96, 0x76],
    [0xb1, 0xac, 0x70],
    [0xcd, 0xc4, 0x62],
    [0xe8, 0xdc, 0x4c],
    [0xfe, 0xe8, 0x38],
];

/// Colours by [`distance_to_points`](super::TriangleMesh::distance_to_points), from dark blue at 0 to yellow at the
/// largest distance that counts, and beyond.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Colors {
    most: f64,
}

impl Colors {
    /// Name of the scale in files.
    pub const SCALE: &str = "cividis";

    /// Colours that end at a distance, in the unit of the mesh: its
    /// [`support_distance`](crate::reconstruction::report::SurfaceReport::support_distance), so that yellow is what was
    /// guessed. None where that is no positive number.
    pub fn up_to(most: f64) -> Option<Self> {
        (most > 0.0 && most.is_finite()).then_some(Self { most })
    }

    /// Where the colours end.
    pub fn most(self) -> f64 {
        self.most
    }

    /// Red, green and blue from 0 to 1, as screens have them (sRGB).
    fn of(self, distance: f64) -> [f64; 3] {
        let place = (distance / self.most).clamp(0.0, 1.0) * (STEPS.len() - 1) as f64;
        let low = (place as usize).min(STEPS.len() - 2);
        std::array::from_fn(|channel| {
            let [from, to] =
                [STEPS[low], STEPS[low + 1]].map(|step| f64::from(step[channel]) / 255.0);
            from + (to - from) * (place - low as f64)
        })
    }

    /// The same in eight bits each.
    pub(super) fn bytes(self, distance: f64) -> [u8; 3] {
        self.of(distance).map(|share| (255.0 * share).round() as u8)
    }

    /// The same in light and not as screens have it, and full opacity, in sixteen bits each: the dark end of
    /// the scale would have six steps in eight.
    pub(super) fn linear(self, distance: f64) -> [u16; 4] {
        let [red, green, blue] = self.of(distance).map(|share| {
            // IEC 61966-2-1.
            let light = if share <= 0.04045 {
                share / 12.92
            } else {
                ((share + 0.055) / 1.055).powf(2.4)
            };
            (f64::from(u16::MAX) * light).round() as u16
        });
        [red, green, blue, u16::MAX]
    }
}
