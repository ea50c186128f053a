//! Metrics of an episode at a control instant: the entries of `info`.

use crate::lane::Lane;

/// Declares a struct of metrics in lanes, with the names and the array of its fields in their order.
macro_rules! metrics {
    ($(#[$meta:meta])* $visibility:vis struct $name:ident { $($(#[$doc:meta])* $field:ident),* $(,)? }) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, Default)]
        $visibility struct $name<L> {
            $($(#[$doc])* pub $field: L,)*
        }

        impl $name<()> {
            /// Names of the fields, in order.
            pub const NAMES: [&'static str; [$(stringify!($field)),*].len()] = [$(stringify!($field)),*];
        }

        impl<L: $crate::lane::Lane> $name<L> {
            /// Zero in every field.
            #[inline(always)]
            pub fn zero() -> Self {
                Self { $($field: L::zero(),)* }
            }

            /// The fields in the order of `NAMES`.
            #[inline(always)]
            pub fn to_array(self) -> [L; $name::<()>::NAMES.len()] {
                [$(self.$field),*]
            }
        }
    };
}

pub(super) use metrics;

metrics! {
    /// Metrics of all tasks, with the reward's terms. Running means extend over the episode's control instants so far, the
    /// start excluded.
    pub struct Metrics {
        /// Distance of the task's frame (vehicle or end effector) from its target, m.
        position_error,
        /// Angle between the task's frame and its target, rad.
        attitude_error,
        /// Pose error of the task's frame, m: `sqrt(position_error^2 + (ATTITUDE_LEVER attitude_error)^2)`.
        pose_error,
        /// Distance of the end effector from its target, m.
        end_effector_position_error,
        /// Angle between the end effector and its target, rad.
        end_effector_attitude_error,
        /// Mean over thrusters and driven joints of the squared relative thrust or torque `(T_i / T_max)^2`.
        effort,
        /// Mean over thrusters and driven joints of `(|T_i| / T_max)^1.5`: shaft power relative to full power.
        power,
        /// Fraction of thrusters and driven joints at their limit.
        saturation,
        /// Mean over the entries of the action of their squared change.
        action_rate,
        /// Root mean square of `position_error`, m.
        rms_position_error,
        /// Root mean square of `attitude_error`, rad.
        rms_attitude_error,
        /// Root mean square of `end_effector_position_error`, m.
        rms_end_effector_position_error,
        /// Root mean square of `end_effector_attitude_error`, rad.
        rms_end_effector_attitude_error,
        /// Mean of `power`.
        mean_power,
        /// Mean of `saturation`.
        mean_saturation,
        /// Current, world x axis, m/s.
        current_x,
        /// Current, world y axis, m/s.
        current_y,
        /// Current, world z axis, m/s.
        current_z,
        /// Weighted reward term of the pose error.
        reward_pose,
        /// Weighted reward term of `effort`.
        reward_effort,
        /// Weighted reward term of `action_rate`.
        reward_action_rate,
        /// 1 where both errors are within their tolerances, else 0.
        success,
        /// Mean of `success`.
        mean_success,
        /// Duration of the current, or of the last, departure from the tolerances, s. The approach at an episode's start
        /// counts as a departure.
        recovery_time,
        /// 1 where the state left its bounds or is not finite, else 0.
        diverged,
        /// Weighted reward term of divergence.
        reward_diverged,
        /// Force of disturbances other than the water, N.
        disturbance_force,
        /// Payload, kg.
        payload,
        /// Remaining thrust gain of the weakest thruster, in [0, 1].
        thruster_gain,
        /// Age of the observed measurement, s.
        measurement_age,
    }
}

/// Number of metrics that all tasks share.
pub const METRICS: usize = Metrics::NAMES.len();
/// Maximum number of a task's own metrics.
pub const OWN_METRICS: usize = 8;
/// Maximum number of metrics of a task.
pub const INFO: usize = METRICS + OWN_METRICS;

/// A task's own metrics, padded with zeros.
#[inline(always)]
#[expect(clippy::manual_memcpy, reason = "a copy of slices is a call in kernels")]
pub(super) fn padded<L: Lane, const K: usize>(own: [L; K]) -> [L; OWN_METRICS] {
    let mut padded = [L::zero(); OWN_METRICS];
    for k in 0..K {
        padded[k] = own[k];
    }
    padded
}

/// Instances in bounds whose episode continues: with `ends`, up to success.
#[inline(always)]
pub(super) fn continues<L: Lane>(metrics: &Metrics<L>, in_bounds: L::Mask, ends: bool) -> L::Mask {
    if ends { L::and(in_bounds, metrics.success.lt(L::c(0.5))) } else { in_bounds }
}

/// Result of a control period for a group of instances.
#[derive(Debug, Clone, Copy)]
pub struct Evaluation<L: Lane> {
    /// Sum of the reward's terms.
    pub reward: L,
    /// Metrics of all tasks.
    pub metrics: Metrics<L>,
    /// The task's own metrics; zeros past the last.
    pub own: [L; OWN_METRICS],
    /// Instances whose state is finite and within its bounds.
    pub in_bounds: L::Mask,
    /// Instances whose episode continues.
    pub continues: L::Mask,
}

/// [`Evaluation`] of one instance.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Sum of the reward's terms.
    pub reward: f64,
    /// End of the episode. Truncation by time belongs to the driver of the episodes.
    pub terminated: bool,
    /// The state left its bounds or is not finite.
    pub diverged: bool,
    /// Metrics of all tasks.
    pub metrics: Metrics<f64>,
    /// The task's own metrics.
    pub own: Vec<f64>,
}

impl Outcome {
    /// With this number of the task's own metrics.
    pub(super) fn new(evaluation: &Evaluation<f64>, own: usize) -> Self {
        let &Evaluation { reward, metrics, in_bounds, continues, .. } = evaluation;
        Self { reward, terminated: !continues, diverged: !in_bounds, metrics, own: evaluation.own[..own].to_vec() }
    }

    /// All metrics, in the order of [`super::Task::metric_names`].
    pub fn info(&self) -> Vec<f64> {
        self.metrics.to_array().into_iter().chain(self.own.iter().copied()).collect()
    }
}
