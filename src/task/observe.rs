//! Sensing and observing: the layout of an observation, the sensors' reading, and the entries.

use std::f64::consts::PI;

use super::bounds::POSITION_BOUND;
use super::definition::{ControlInstant, Frame, LEAK, TaskDefinition, TaskKernel};
use super::disturbance::{MEASURED, SensorRows};
use super::model::TaskModel;
use super::observation::{
    INTEGRAL_SCALE, ObservationLayout, ObservationWriter, POSE_ERROR, TWIST, UNIT_BOUND, joint_entries,
};
use super::options::TaskOptions;
use crate::lane::{Lane, Real};
use crate::lie::Vector3;

/// Sensor reading of an invalid state; beyond any bound of an observation.
const INVALID: f64 = 1e6;

/// Layout of an observation of task `K`, in the order of [`ControlInstant::observe`].
pub(super) fn layout<K: TaskDefinition>(task: &K, options: &TaskOptions, model: &TaskModel) -> ObservationLayout {
    let [coordinates, rates] = joint_entries(&model.joints);
    let [position, attitude] = match K::FRAME {
        Frame::Vehicle => ["R^T (r - r_d), body axes", "rotation vector log(R_d^T R), body axes"],
        Frame::EndEffector => {
            ["R_e^T (r_e - r_d), end-effector axes", "rotation vector log(R_d^T R_e), end-effector axes"]
        }
    };
    let mut layout = ObservationLayout::default();
    layout.push("position_error", "m", position, &[POSE_ERROR[0]; 3]);
    layout.push("attitude_error", "rad", attitude, &[POSE_ERROR[1]; 3]);
    let [(linear, linear_description), (angular, angular_description)] = K::TWIST;
    layout.push(linear, "m/s", linear_description, &[TWIST[0]; 3]);
    layout.push(angular, "rad/s", angular_description, &[TWIST[1]; 3]);
    if K::OBSERVES_UP {
        layout.push("up", "1", "direction against gravity, body axes", &[(1.0, UNIT_BOUND); 3]);
    }
    layout.push("joint_position", "rad or m", "joint coordinates relative to home", &coordinates);
    layout.push("joint_rate", "rad/s or m/s", "joint rates", &rates);
    task.layout(options, model, &mut layout);
    let actions = model.actions.len();
    layout.push("previous_action", "1", "the last action, as clipped", &vec![(1.0, 1.0); actions]);
    let integral = [[(INTEGRAL_SCALE, POSITION_BOUND / LEAK); 3], [(INTEGRAL_SCALE, PI / LEAK); 3]].concat();
    layout.push("error_integral", "m s and rad s", "leaky integral of both errors, I' = e - 0.1 I", &integral);
    layout
}

impl<L: Lane, K: TaskDefinition> ControlInstant<'_, L, K> {
    /// Writes the observation, entry by entry, each of all lanes: always finite and within [`ObservationLayout::bound`].
    #[inline(always)]
    pub fn observe(&self, entries: &mut [f32]) {
        self.observe_as(&self.measured(), entries);
    }

    /// As [`Self::observe`], from given values of the measured quantities.
    #[inline(always)]
    pub fn observe_as(&self, measured: &[L; MEASURED], entries: &mut [f32]) {
        let (rows, memory, n) = (&self.kernel.rows, &self.memory, self.kernel.rows.joints);
        let mut writer = ObservationWriter::new(&self.kernel.scaling, entries, L::LANES);
        for k in 0..12 {
            writer.put(measured[k]);
        }
        if K::OBSERVES_UP {
            for k in 0..3 {
                writer.put(measured[12 + 2 * n + k]);
            }
        }
        for i in 0..n {
            writer.put(measured[12 + i] - L::splat(self.kernel.home[i]));
        }
        for i in 0..n {
            writer.put(measured[12 + n + i]);
        }
        K::observe(self, measured, &mut writer);
        for k in 0..rows.actions {
            writer.put(memory.get::<L>(rows.action + k));
        }
        for k in 0..6 {
            writer.put(memory.get::<L>(rows.integral + k));
        }
    }

    /// Records a measurement of the sensors, if they have noise or delay.
    #[inline(always)]
    pub(super) fn measure(&mut self, in_bounds: L::Mask) {
        if let Some(disturbance) = self.kernel.disturbance()
            && let Some(sensors) = disturbance.sensors()
        {
            let mut truth = self.true_values();
            // An invalid state never reads like one on target, and the memory stays finite.
            for k in 0..sensors.measured {
                truth[k] = L::select(in_bounds, truth[k], L::c(INVALID));
            }
            disturbance.measure(&mut self.memory, &truth);
        }
    }

    /// Reading of the sensors, in the order of [`Self::true_values`]: the true values without noise and delay.
    #[inline(always)]
    pub fn measured(&self) -> [L; MEASURED] {
        match self.kernel.sensors() {
            Some(sensors) => sensors.reading(&self.memory),
            None => self.true_values(),
        }
    }

    /// True values of the measured quantities: errors of position and attitude, twist, joint coordinates, joint rates, and
    /// the direction against gravity in body axes.
    #[inline(always)]
    pub fn true_values(&self) -> [L; MEASURED] {
        let Self { kernel, state, error, .. } = self;
        let (twist, n) = (K::twist(self), kernel.rows.joints);
        let [x, y, z] = kernel.up;
        let up = state.pose.rotation.apply_transposed(Vector3([L::splat(x), L::splat(y), L::splat(z)]));
        let mut truth = [L::zero(); MEASURED];
        for k in 0..3 {
            truth[k] = error.position.0[k];
            truth[3 + k] = error.rotation.0[k];
            truth[6 + k] = twist.linear.0[k];
            truth[9 + k] = twist.angular.0[k];
            truth[12 + 2 * n + k] = up.0[k];
        }
        for i in 0..n {
            truth[12 + i] = state.q[i];
            truth[12 + n + i] = state.qd[i];
        }
        truth
    }
}

impl<T: Real, K: TaskDefinition> TaskKernel<T, K> {
    /// Sensors with noise or delay, if any.
    #[inline(always)]
    pub(super) fn sensors(&self) -> Option<&SensorRows> {
        match self.disturbance() {
            Some(disturbance) => disturbance.sensors(),
            None => None,
        }
    }
}
