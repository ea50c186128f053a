//! Steps of a task in lanes: one group of instances at a control instant.

use std::f64::consts::PI;

use super::arm_reference;
use super::bounds::{POSITION_BOUND, bounded_length, in_bounds};
use super::definition::{ControlInstant, TaskDefinition, TaskKernel};
use super::disturbance::{DisturbanceKernel, Forcing, MEASURED};
use super::episode::EpisodeRows;
use super::metrics::{Evaluation, Metrics, OWN_METRICS};
use super::reward::{RewardKernel, squared_pose_error};
use crate::control::{ACTIONS, Actuated, Actuation};
use crate::lane::{Lane, Real, Routine, Rows};
use crate::system::JOINTS;

/// Inputs of the physics over one control period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command<L> {
    /// Thrusts and their wrench.
    pub actuated: Actuated<L>,
    /// Joint servo targets: per joint the cubic `c0 + c1 t + c2 t^2 + c3 t^3` in the time t since the period's start. It
    /// meets the reference's value and rate at both ends of the period. Zeros where no joint follows one.
    pub joints: [[L; 4]; JOINTS],
}

impl<L: Lane> Command<L> {
    /// Zeros, as memory for [`ActionKernel::act`].
    #[inline(always)]
    pub fn none() -> Self {
        Self { actuated: Actuated::none(), joints: [[L::zero(); 4]; JOINTS] }
    }
}

/// The numbers of a task that apply actions, the same for all tasks.
#[derive(Debug, Clone, Copy)]
pub struct ActionKernel<'a, T> {
    pub(super) rows: &'a EpisodeRows,
    pub(super) actuation: &'a Actuation<T>,
    /// Control periods per second.
    pub(super) frequency: T,
    /// Maximum correction to the base controller's action, with residual actions.
    pub(super) residual: Option<T>,
    /// Disturbances that change within episodes, if any.
    pub disturbance: Option<&'a DisturbanceKernel<T>>,
    /// [`TaskDefinition::DRIVES_JOINTS`]
    pub drives_joints: bool,
}

impl<'a, T: Real> ActionKernel<'a, T> {
    /// Rows of an episode's memory.
    pub fn rows(&self) -> &'a EpisodeRows {
        self.rows
    }

    /// Applies an action over the coming control period. Entries beyond [-1, 1] are clipped, NaN counts as 0. With residual
    /// actions, `base` is the base controller's action. `action` becomes the applied action.
    #[inline(always)]
    pub fn act<L: Lane<Real = T>>(
        &self,
        memory: &mut Rows<'_, T>,
        action: &mut [L; ACTIONS],
        base: Option<&[L; ACTIONS]>,
        command: &mut Command<L>,
    ) {
        let rows = &self.rows;
        let mut change = L::zero();
        for k in 0..rows.actions {
            // Clips to [-1, 1]. NaN becomes 0: the two orders of the clips give 1 and -1.
            let (a, one) = (action[k], L::c(1.0));
            action[k] = (a.min(one).max(-one) + a.max(-one).min(one)) * L::c(0.5);
            let by = action[k] - memory.get(rows.action + k);
            change = by.mul_add(by, change);
            memory.set(rows.action + k, action[k]);
        }
        if let (Some(limit), Some(base)) = (self.residual, base) {
            for k in 0..rows.actions {
                let one = L::c(1.0);
                action[k] = action[k].mul_add(L::splat(limit), base[k]).min(one).max(-one);
            }
        }
        let Command { actuated, joints } = command;
        self.actuation.act_into(action, actuated);
        memory.set(rows.change, change);
        memory.set_all(rows.effort, &[actuated.square, actuated.power, actuated.saturation]);
        match &rows.task.joints {
            Some(references) if !self.drives_joints => references.targets(memory, L::splat(self.frequency), joints),
            _ => {}
        }
    }

    /// Scales ideal thrusters' thrusts by their remaining gains.
    #[inline(always)]
    pub fn scale_thrusts<L: Lane<Real = T>>(&self, forcing: &Forcing<L>, actuated: &mut Actuated<L>) {
        self.actuation.scale_thrusts(actuated, &forcing.gains);
    }
}

impl<T: Real, K: TaskDefinition> TaskKernel<T, K> {
    /// Sets the target and the references of the first control instant, at an episode's start.
    #[inline(always)]
    pub fn begin<L: Lane<Real = T>>(&self, memory: &mut Rows<'_, T>) {
        K::begin::<L>(self, memory);
    }

    /// Moves the target and the references to the next control instant.
    #[inline(always)]
    pub fn advance<L: Lane<Real = T>>(&self, memory: &mut Rows<'_, T>) {
        K::advance::<L>(self, memory);
    }
}

impl<L: Lane, K: TaskDefinition> ControlInstant<'_, L, K> {
    /// Evaluates the state after [`TaskKernel::advance`]: metrics, reward and end of the episode. `share` is one over the number
    /// of completed control periods, this one included.
    ///
    /// Errors beyond the bounds or not finite count as the bounds, so that all results are finite.
    #[inline(always)]
    pub fn evaluate(&mut self, share: L) -> Evaluation<L> {
        let (rows, zero) = (&self.kernel.rows, L::zero());
        let in_bounds = self.in_bounds();
        self.measure(in_bounds);
        self.integrate_error(&self.measured(), in_bounds);

        let mut metrics = self.instant_metrics();
        let (mut own, mut own_reward) = ([zero; OWN_METRICS], zero);
        if !K::METRICS.is_empty() {
            own_reward = K::update(self, &metrics);
            own = K::own_metrics(self, &mut metrics);
        }
        let mut reward = zero;
        let (weights, period, memory) = (&self.kernel.reward, self.kernel.period, &mut self.memory);
        let results = (&mut metrics, &mut reward);
        L::call(&mut Assessment { rows, weights, period, memory, share, in_bounds, results });
        if !K::METRICS.is_empty() {
            reward += own_reward;
        }
        Evaluation { reward, metrics, own, in_bounds, continues: K::continues(self.kernel, &metrics, in_bounds) }
    }

    /// Advances the leaky integral of the measured pose error by a control period.
    #[inline(always)]
    pub(super) fn integrate_error(&mut self, measured: &[L; MEASURED], in_bounds: L::Mask) {
        let (row, [keep, gain]) = (self.kernel.rows.integral, self.kernel.leak);
        for k in 0..6 {
            let old: L = self.memory.get(row + k);
            let new = measured[k].mul_add(L::splat(gain), old * L::splat(keep));
            self.memory.set(row + k, L::select(in_bounds, new, old));
        }
    }

    /// Metrics of episodes at their current control instant, without reward and running means.
    #[inline(always)]
    pub fn current_metrics(&self) -> Evaluation<L> {
        let in_bounds = self.in_bounds();
        let mut metrics = self.instant_metrics();
        let mut own = [L::zero(); OWN_METRICS];
        if !K::METRICS.is_empty() {
            own = K::own_metrics(self, &mut metrics);
        }
        metrics.diverged = L::select(in_bounds, L::zero(), L::c(1.0));
        Evaluation { reward: L::zero(), metrics, own, in_bounds, continues: in_bounds }
    }

    /// Instances whose state is finite and within the bounds.
    #[inline(always)]
    pub(super) fn in_bounds(&self) -> L::Mask {
        in_bounds(K::in_bounds(self), self.state, self.kernel.rows.joints)
    }

    /// Distance (m) and angle (rad) between the task's frame and its target, bounded.
    #[inline(always)]
    pub(super) fn frame_errors(&self) -> [L; 2] {
        [bounded_length(self.error.position, POSITION_BOUND), self.error.angle.min(L::c(PI))]
    }

    /// Metrics at the current control instant; running means and reward terms are 0.
    #[inline(always)]
    pub(super) fn instant_metrics(&self) -> Metrics<L> {
        let Self { kernel, memory, .. } = self;
        let rows = &kernel.rows;
        let mut metrics = Metrics::zero();
        [metrics.position_error, metrics.attitude_error] = self.frame_errors();
        metrics.pose_error = squared_pose_error(metrics.position_error, metrics.attitude_error).sqrt();
        let bounded = [metrics.position_error, metrics.attitude_error];
        [metrics.end_effector_position_error, metrics.end_effector_attitude_error] =
            arm_reference::end_effector_error(self, bounded);
        [metrics.effort, metrics.power, metrics.saturation] = memory.get_all(rows.effort);
        metrics.action_rate = memory.get::<L>(rows.change) * L::splat(kernel.per_entry);
        [metrics.current_x, metrics.current_y, metrics.current_z] = memory.get_all(rows.current);
        let [position, attitude] = kernel.tolerance;
        let reached =
            L::and(metrics.position_error.lt(L::splat(position)), metrics.attitude_error.lt(L::splat(attitude)));
        metrics.success = L::select(reached, L::c(1.0), L::zero());
        metrics.thruster_gain = L::c(1.0);
        if let Some(disturbance) = rows.disturbance {
            [metrics.disturbance_force, metrics.payload, metrics.thruster_gain] = memory.get_all(disturbance.summary);
            if let Some(row) = disturbance.age {
                metrics.measurement_age = memory.get::<L>(row) * L::splat(kernel.period);
            }
        }
        metrics
    }
}

/// Running means, time of recovery and reward: the end of [`ControlInstant::evaluate`], which the kernels of all tasks share.
struct Assessment<'a, 'b, L: Lane> {
    rows: &'a EpisodeRows,
    weights: &'a RewardKernel<L::Real>,
    /// Control period, s.
    period: L::Real,
    memory: &'a mut Rows<'b, L::Real>,
    share: L,
    in_bounds: L::Mask,
    /// Metrics and reward.
    results: (&'a mut Metrics<L>, &'a mut L),
}

impl<L: Lane> Routine<L> for Assessment<'_, '_, L> {
    const PORTABLE: bool = true;

    #[inline(always)]
    fn run(&mut self) {
        self.running_means();
        let Self { rows, weights, period, memory, in_bounds, results: (metrics, reward), .. } = self;
        let (zero, one) = (L::zero(), L::c(1.0));
        let [was_out, clock] = memory.get_all(rows.recovery);
        let within = L::c(0.5).lt(metrics.success);
        metrics.recovery_time = L::select(within, clock, was_out.mul_add(clock, L::splat(*period)));
        memory.set_all(rows.recovery, &[L::select(within, zero, one), metrics.recovery_time]);

        let squared_error = squared_pose_error(metrics.position_error, metrics.attitude_error);
        let terms = weights.terms(squared_error, metrics.effort, memory.get(rows.change), *in_bounds);
        metrics.reward_pose = terms.pose;
        metrics.reward_effort = terms.effort;
        metrics.reward_action_rate = terms.action_rate;
        metrics.reward_diverged = terms.diverged;
        metrics.diverged = L::select(*in_bounds, zero, one);
        **reward = terms.sum();
    }
}

impl<L: Lane> Assessment<'_, '_, L> {
    /// Updates the running means and sets them among the metrics.
    #[inline(always)]
    fn running_means(&mut self) {
        let Self { rows, memory, share, results: (metrics, _), .. } = self;
        let mut entries = [
            metrics.position_error,
            metrics.attitude_error,
            metrics.end_effector_position_error,
            metrics.end_effector_attitude_error,
            metrics.power,
            metrics.saturation,
            metrics.success,
        ];
        for k in 0..4 {
            entries[k] = entries[k] * entries[k];
        }
        for k in 0..7 {
            let mean: L = memory.get(rows.means + k);
            entries[k] = (entries[k] - mean).mul_add(*share, mean);
            memory.set(rows.means + k, entries[k]);
        }
        metrics.rms_position_error = entries[0].sqrt();
        metrics.rms_attitude_error = entries[1].sqrt();
        metrics.rms_end_effector_position_error = entries[2].sqrt();
        metrics.rms_end_effector_attitude_error = entries[3].sqrt();
        metrics.mean_power = entries[4];
        metrics.mean_saturation = entries[5];
        metrics.mean_success = entries[6];
    }
}
