//! A task under disturbances, in lanes: what acts on instances, and what sensors make of them.

use super::disturbance::{Forcing, MEASURED, SensorRows, Weather};
use super::kernel::TaskKernel;
use super::pose::PoseError;
use super::stance::Stance;
use crate::control::Actuated;
use crate::lane::{Lane, Real, Rows};

/// What sensors show of a state that is none; beyond any bound of an observation.
const BROKEN: f64 = 1e6;

impl<T: Real> TaskKernel<T> {
    /// What disturbs the coming control period, as `weather` has it.
    #[inline(always)]
    pub fn disturb<L: Lane<Real = T>>(
        &self,
        weather: &Weather<T>,
        memory: &mut Rows<'_, T>,
        stance: &Stance<L>,
    ) -> Forcing<L> {
        let forcing = weather.force(memory, &stance.pose, &stance.twist);
        self.show(weather, memory, &forcing);
        weather.pass::<L>(memory);
        forcing
    }

    /// Leaves of ideal thrusters' thrusts what `forcing` does.
    #[inline(always)]
    pub fn weaken<L: Lane<Real = T>>(&self, forcing: &Forcing<L>, actuated: &mut Actuated<L>) {
        self.actuation.scale_thrusts(actuated, &forcing.gains);
    }

    /// Notes what there is to tell of a disturbance.
    #[inline(always)]
    pub(super) fn show<L: Lane<Real = T>>(&self, weather: &Weather<T>, memory: &mut Rows<'_, T>, forcing: &Forcing<L>) {
        memory.set_all(self.rows().current, &forcing.velocity.0);
        memory.set_all(weather.rows().shown, &forcing.shown());
    }

    /// Takes note of what sensors make of the truth, if they do not show it as it is.
    #[inline(always)]
    pub(super) fn measure<L: Lane<Real = T>>(
        &self,
        memory: &mut Rows<'_, T>,
        stance: &Stance<L>,
        error: &PoseError<L>,
        sound: L::Mask,
    ) {
        if let Some(sensors) = self.sensors() {
            let mut truth = self.truth(stance, error);
            // A broken state never looks like one on target, and what is remembered stays finite.
            for k in 0..sensors.measured {
                truth[k] = L::select(sound, truth[k], L::c(BROKEN));
            }
            sensors.measure(memory, &truth);
        }
    }

    /// What is seen, as [`Self::truth`] has it: the truth itself without sensors of their own.
    #[inline(always)]
    pub(super) fn seen<L: Lane<Real = T>>(
        &self,
        memory: &Rows<'_, T>,
        stance: &Stance<L>,
        error: &PoseError<L>,
    ) -> [L; MEASURED] {
        match self.sensors() {
            Some(sensors) => sensors.seen(memory),
            None => self.truth(stance, error),
        }
    }

    /// What sensors measure: errors of position and attitude, twist, joint coordinates, joint rates, and the direction
    /// against gravity in body axes where it counts.
    #[inline(always)]
    fn truth<L: Lane<Real = T>>(&self, stance: &Stance<L>, error: &PoseError<L>) -> [L; MEASURED] {
        let (twist, n) = (stance.twist, self.rows().joints);
        let up = self.up(stance);
        let mut truth = [L::zero(); MEASURED];
        for k in 0..3 {
            truth[k] = error.position.0[k];
            truth[3 + k] = error.rotation.0[k];
            truth[6 + k] = twist.linear.0[k];
            truth[9 + k] = twist.angular.0[k];
            truth[12 + 2 * n + k] = up.0[k];
        }
        for i in 0..n {
            truth[12 + i] = stance.q[i];
            truth[12 + n + i] = stance.qd[i];
        }
        truth
    }

    #[inline(always)]
    pub(super) fn sensors(&self) -> Option<&SensorRows> {
        match self.weather() {
            Some(weather) => weather.sensors(),
            None => None,
        }
    }
}
