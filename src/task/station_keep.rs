//! Station keeping: the vehicle holds a pose while its arm follows references and a current pushes.

use super::arm_reference;
use super::bounds::{POSITION_BOUND, shorter};
use super::definition::{ControlInstant, EpisodeStart, TaskDefinition, TaskKernel};
use super::episode::EpisodeRows;
use super::model::TaskModel;
use super::options::{TaskOptions, check_non_negative};
use super::settings::settings;
use crate::error::TaskError;
use crate::lane::{Lane, Real, Rows};
use crate::lie::Vector3;

settings! {
    /// Station keeping.
    pub struct StationKeep {
        /// Maximum amplitude of the arm's reference about home, rad (a quarter of it in metres for prismatic joints).
        arm_amplitude: f64 = 0.4;
    }
}

impl TaskDefinition for StationKeep {
    const NAME: &'static str = "station-keep";
    const ENVIRONMENT: &'static str = "UVMS-StationKeep";

    const MEASURED_INPUTS: usize = 0;

    type Kernel<T: Real> = ();

    fn check(&self, _start_distance: f64) -> Result<(), TaskError> {
        check_non_negative(&[("arm_amplitude", self.arm_amplitude)])
    }

    fn kernel<T: Real>(&self, _options: &TaskOptions, _model: &TaskModel, _rows: &EpisodeRows) {}

    fn sample(&self, kernel: &TaskKernel<f64, Self>, start: &EpisodeStart<'_>, memory: &mut Rows<'_, f64>) {
        arm_reference::sample(kernel, start, self.arm_amplitude, memory);
    }

    #[inline(always)]
    fn in_bounds<L: Lane>(at: &ControlInstant<'_, L, Self>) -> L::Mask {
        let target: [L; 3] = at.memory.get_all(at.kernel.rows.target + 9);
        shorter(at.state.pose.position - Vector3(target), POSITION_BOUND)
    }
}
