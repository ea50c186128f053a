//! Battery whose voltage falls.

use super::column::Column;
use super::component::{Component, Draws, Forcing, Moment, Place, component};
use super::span::Span;
use crate::lane::{Lane, Real, Rows};

component! {
    /// Battery of all thrusters, whose voltage falls with time and sags under load. Voltages are relative to the scene's supply
    /// voltage V, and thrusts change by `V^1.25`: the exponents of the T200's table are 1.1 to 1.5 between 10 and 16 V.
    pub struct Battery = "battery" {
        /// Voltage without load at the start.
        charge: Span = Span::of(0.85, 1.05), in 0.0, 1.5;
        /// Voltage lost per hour.
        drain: Span = Span::of(0.1, 0.3), in 0.0, 1e3;
        /// Voltage lost under full load, all thrusters at full thrust; it rises with the power, the mean of `|T / T_max|^1.5`.
        sag: Span = Span::of(0.1, 0.3), in 0.0, 1.0;
    }
}

/// One hour, s.
const HOUR: f64 = 3600.0;

impl Battery {
    /// Sets the power of the commands of the coming control period, relative to full power.
    #[inline(always)]
    pub fn load<L: Lane>(memory: &mut Rows<'_, L::Real>, at: Place, power: L) {
        memory.set(at.row + Self::ROWS - 1, power);
    }
}

impl Component for Battery {
    const STREAM: u32 = 44;
    /// Voltage at the start, voltage lost per control period, voltage lost under full load; power.
    const ROWS: usize = 4;

    fn begin<T: Real>(&self, memory: &mut Column<'_, T>, at: Place, draws: &Draws<'_>) {
        let Draws { stream: draw, context, .. } = draws;
        let drain = self.drain.at(draw.uniform(1)) * context.period / HOUR;
        memory.set_all(at.row, [self.charge.at(draw.uniform(0)), drain, self.sag.at(draw.uniform(2)), 0.0]);
    }

    #[inline(always)]
    fn add<L: Lane>(memory: &Rows<'_, L::Real>, at: Place, moment: &Moment<'_, L>, forcing: &mut Forcing<L>) {
        let [charge, drain, sag, power]: [L; Self::ROWS] = memory.get_all(at.row);
        let voltage = sag.neg_mul_add(power, drain.neg_mul_add(moment.now, charge)).max(L::zero());
        let factor = voltage * voltage.sqrt().sqrt();
        for k in 0..moment.thrusters {
            forcing.gains[k] = forcing.gains[k] * factor;
        }
    }
}
