//! Loss of measurements.

use super::column::Column;
use super::component::{Component, Draws, Place, component};
use super::context::DisturbanceContext;
use super::sensors::MEASURED;
use super::span::{Span, refuse};
use crate::error::TaskError;
use crate::lane::{Lane, Real, Rows};

component! {
    /// Measurements that are lost; the last one that arrived is held. Losses and arrivals alternate by a Markov chain of two
    /// states. The first measurement of an episode arrives. `[Gil60]`
    pub struct Dropout = "dropout" {
        /// Probability that the measurement of a control instant is lost.
        probability: Span = Span::of(0.1, 0.3), in 0.0, 0.99;
        /// Mean duration of a gap, s; without it losses are independent of each other.
        #[serde(skip_serializing_if = "Option::is_none")]
        gap: Option<Span> = None, in 0.0, 1e4;
    }
}

impl Dropout {
    /// Minimum mean length of a gap, control periods: all instants after a measurement are lost.
    fn shortest(probability: f64) -> f64 {
        (probability / (1.0 - probability)).max(1.0)
    }
}

impl Component for Dropout {
    const STREAM: u32 = 45;
    const MEASURES: bool = true;
    /// Probabilities that a gap begins and ends; 1 where the coming measurement is lost, else 0.
    const ROWS: usize = 3;

    fn check(&self, context: &DisturbanceContext) -> Result<(), TaskError> {
        let shortest = Self::shortest(self.probability.high) * context.period;
        match self.gap {
            Some(Span { low, .. }) if low < shortest * (1.0 - 1e-9) => {
                let high = self.probability.high;
                refuse("dropout.gap", format!("{low} s, but at least {shortest:.3} s at a probability of {high}"))
            }
            _ => Ok(()),
        }
    }

    fn begin<T: Real>(&self, memory: &mut Column<'_, T>, at: Place, draws: &Draws<'_>) {
        let Draws { stream: draw, context, .. } = draws;
        // Draws of control instants follow.
        let lost = self.probability.at(draw.uniform(u32::MAX));
        let gap = self.gap.map_or(1.0 / (1.0 - lost), |gap| gap.at(draw.uniform(u32::MAX - 1)) / context.period);
        memory.set_all(at.row, [lost / (1.0 - lost) / gap, 1.0 / gap, 0.0]);
    }

    fn renew<T: Real>(memory: &mut Column<'_, T>, at: Place, draws: &Draws<'_>) {
        let [begins, ends, lost] = memory.get_all(at.row);
        let draw = draws.stream.uniform(draws.step);
        let loses = if lost > 0.5 { draw >= ends } else { draw < begins };
        memory.set(at.row + 2, f64::from(u8::from(loses)));
    }

    /// Holds the last measurement, a control period older.
    #[inline(always)]
    fn measure<L: Lane>(memory: &Rows<'_, L::Real>, at: Place, last: &[L; MEASURED], seen: &mut [L; MEASURED]) {
        let lost = L::c(0.5).lt(memory.get(at.row + 2));
        for k in 0..MEASURED {
            let held = if k == MEASURED - 1 { last[k] + L::c(1.0) } else { last[k] };
            seen[k] = L::select(lost, held, seen[k]);
        }
    }
}
