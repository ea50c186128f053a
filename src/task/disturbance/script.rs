//! Time series given by the user.

use super::column::Column;
use super::component::{Component, Draws, Forcing, Moment, Place, component};
use super::context::DisturbanceContext;
use super::span::refuse;
use crate::error::TaskError;
use crate::lane::{Lane, Real, Rows};
use crate::lie::{Vector3, Vector6};

component! {
    /// A current and a wrench for every control period, added to the other disturbances. After its end both are zero.
    pub struct Script = "script" {
        /// Velocity of the water in world axes, m/s, per control period.
        current: Vec<[f64; 3]> = Vec::new(), in -5.0, 5.0;
        /// Wrench on the vehicle at its origin, body axes, N and N m, per control period.
        wrench: Vec<[f64; 6]> = Vec::new(), in -1e7, 1e7;
        /// True where it repeats.
        repeat: bool = false;
    }
}

/// Most control periods of a script.
const LONGEST: usize = 100_000;

impl Script {
    /// Rows: length, repetition (0 or 1); current (3) and wrench (6) now; then both of every period.
    const COMMON: usize = 2 + Self::EACH;
    /// Count of numbers of a control period.
    const EACH: usize = 9;

    /// Sets current and wrench of a control period.
    fn turn_to<T: Real>(memory: &mut Column<'_, T>, row: usize, step: u32) {
        let [length, repeats] = memory.get_all(row).map(|x: f64| x as usize);
        let entry = if repeats > 0 && length > 0 { step as usize % length } else { step as usize };
        let now: [f64; Self::EACH] =
            if entry < length { memory.get_all(row + Self::COMMON + Self::EACH * entry) } else { [0.0; Self::EACH] };
        memory.set_all(row + 2, now);
    }
}

impl Component for Script {
    const SIZE: &'static str = "script";

    fn check(&self, _context: &DisturbanceContext) -> Result<(), TaskError> {
        if self.size() > LONGEST {
            return refuse("script", format!("{} control periods, but at most {LONGEST} are taken", self.size()));
        }
        Ok(())
    }

    fn size(&self) -> usize {
        self.current.len().max(self.wrench.len())
    }

    fn rows(length: usize, _context: &DisturbanceContext) -> usize {
        Self::COMMON + Self::EACH * length
    }

    fn begin<T: Real>(&self, memory: &mut Column<'_, T>, at: Place, _draws: &Draws<'_>) {
        memory.set_all(at.row, [self.size() as f64, f64::from(u8::from(self.repeat))]);
        for k in 0..self.size() {
            let current = self.current.get(k).copied().unwrap_or_default();
            let wrench = self.wrench.get(k).copied().unwrap_or_default();
            memory.set_all(at.row + Self::COMMON + Self::EACH * k, current.into_iter().chain(wrench));
        }
        Self::turn_to(memory, at.row, 0);
    }

    fn renew<T: Real>(memory: &mut Column<'_, T>, at: Place, draws: &Draws<'_>) {
        Self::turn_to(memory, at.row, draws.step);
    }

    #[inline(always)]
    fn add<L: Lane>(memory: &Rows<'_, L::Real>, at: Place, _moment: &Moment<'_, L>, forcing: &mut Forcing<L>) {
        forcing.velocity = forcing.velocity + Vector3(memory.get_all(at.row + 2));
        forcing.wrench = forcing.wrench + Vector6::from_array(memory.get_all(at.row + 5));
    }
}
