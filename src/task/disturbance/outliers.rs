//! Outliers among measurements of the pose.

use super::column::Column;
use super::component::{Component, Draws, Place, component};
use super::sensors::MEASURED;
use super::span::Span;
use crate::lane::{Lane, Real, Rows};

component! {
    /// Measured poses that are wrong for one control instant, in a random direction. The first one of an episode is not.
    pub struct Outliers = "outliers" {
        /// Probability at a control instant.
        probability: Span = Span::of(0.01, 0.05), in 0.0, 1.0;
        /// Error of the position, m.
        position: Span = Span::of(0.1, 0.5), in 0.0, 100.0;
        /// Error of the attitude, rad.
        attitude: Span = Span::of(0.0, 0.2), in 0.0, 3.0;
    }
}

/// Draws reserved for a control instant.
const DRAWS: u32 = 8;

impl Component for Outliers {
    const STREAM: u32 = 46;
    const MEASURES: bool = true;
    /// Probability; ranges of the errors of position and attitude; errors of the coming measurement (6).
    const ROWS: usize = 11;

    fn begin<T: Real>(&self, memory: &mut Column<'_, T>, at: Place, draws: &Draws<'_>) {
        let probability = self.probability.at(draws.stream.uniform(u32::MAX));
        let sizes = [self.position, self.attitude].map(<[f64; 2]>::from);
        memory.set_all(at.row, [probability].into_iter().chain(sizes.concat()).chain([0.0; 6]));
    }

    fn renew<T: Real>(memory: &mut Column<'_, T>, at: Place, draws: &Draws<'_>) {
        let [probability, nearest, farthest, least, most] = memory.get_all(at.row);
        let (draw, first) = (draws.stream, draws.step.wrapping_mul(DRAWS));
        let mut errors = [0.0; 6];
        if draw.uniform(first) < probability {
            for (k, size) in [Span::of(nearest, farthest), Span::of(least, most)].into_iter().enumerate() {
                let index = first + 1 + 2 * k as u32;
                let error = draw.unit_vector(index) * size.at(draw.uniform(index + 1));
                errors[3 * k..][..3].copy_from_slice(error.as_slice());
            }
        }
        memory.set_all(at.row + 5, errors);
    }

    /// Adds the errors of the pose.
    #[inline(always)]
    fn measure<L: Lane>(memory: &Rows<'_, L::Real>, at: Place, _last: &[L; MEASURED], seen: &mut [L; MEASURED]) {
        for k in 0..6 {
            seen[k] += memory.get(at.row + 5 + k);
        }
    }
}
