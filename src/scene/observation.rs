//! What station keeping shows of an episode, and the bounds beyond which it has diverged.

use super::episode::{ACTIONS, Episode};
use super::layout::Layout;
use super::pose::Pose;
use super::reference::METRES_PER_RADIAN;
use super::station_keep::StationKeep;
use crate::description::{Joint, JointKind};
use crate::system::{JOINTS, State};

/// Distance from the target beyond which an episode has diverged, m.
pub(super) const POSITION_BOUND: f64 = 10.0;
/// Likewise linear speed (m/s), angular speed (rad/s) and joint rate (rad/s or m/s).
const SPEED_BOUND: f64 = 10.0;
const TURN_BOUND: f64 = 20.0;
const RATE_BOUND: f64 = 20.0;

/// Physical values of 1 in an observation, in metres, radians and seconds.
const ERROR_SCALE: f64 = 0.1;
const TWIST_SCALE: f64 = 0.2;
const JOINT_SCALE: f64 = 0.5;
const INTEGRAL_SCALE: f64 = 0.2;
/// Joint coordinates are shown within this angle of home, rad, or within twice the joint's travel.
const JOINT_SHOWN: f64 = 10.0;

/// Leak of the integral of the pose error, 1/s: `I' = e - LEAK I`.
const LEAK: f64 = 0.1;

impl StationKeep {
    /// Writes the observation at the current control instant: always finite and within [`Layout::bound`].
    pub fn observe(&self, episode: &Episode, state: &State, row: &mut [f32]) {
        const LONGEST: usize = 12 + 4 * JOINTS + ACTIONS + 6;
        let n = self.joints.len();
        let mut values = [0.0; LONGEST];
        let mut slots = values.iter_mut();
        let mut put = |value: f64| {
            if let Some(slot) = slots.next() {
                *slot = value;
            }
        };
        let error = Pose::of_vehicle(state).error_from(&episode.target);
        error.position.iter().chain(&error.rotation).chain(&state.twist).for_each(|x| put(*x));
        (0..n).for_each(|i| put(state.q[i] - self.home[i]));
        (0..n).for_each(|i| put(state.qd[i]));
        (0..n).for_each(|i| put(episode.next[i].value - self.home[i]));
        (0..n).for_each(|i| put(episode.next[i].rate));
        episode.action[..self.action_len()].iter().for_each(|a| put(f64::from(*a)));
        episode.integral.iter().for_each(|x| put(*x));
        self.layout.write(values, row);
    }

    /// The first bound that a state breaks, if any: name, value and bound.
    fn violation(&self, target: &Pose, state: &State) -> Option<(&'static str, f64, f64)> {
        let n = self.joints.len();
        let twist = &state.twist;
        let bounded = [
            ("distance from the target", (state.position - target.position).norm(), POSITION_BOUND),
            ("linear speed", twist.fixed_rows::<3>(0).norm(), SPEED_BOUND),
            ("angular speed", twist.fixed_rows::<3>(3).norm(), TURN_BOUND),
        ];
        let attitude = state.rotation.iter().map(|x| ("attitude", x.abs(), f64::MAX));
        let rates = state.qd[..n].iter().map(|x| ("joint rate", x.abs(), RATE_BOUND));
        let joints = state.q[..n].iter().map(|x| ("joint coordinate", x.abs(), f64::MAX));
        // Not `value > bound`: NaN is to be found too.
        bounded.into_iter().chain(attitude).chain(rates).chain(joints).find(|(_, value, bound)| !(value <= bound))
    }
}

fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Entries of an observation.
    pub fn observation_len(&self) -> usize {
        self.layout.len()
    }

    /// Entries of an action.
    pub fn action_len(&self) -> usize {
        self.actions.len()
    }

    /// What each entry of an action is.
    pub fn action_ranges(&self) -> Vec<ActionRange> {
        self.actions.ranges(self.thruster_names.iter().map(String::as_str))
    }

    /// The thruster allocation.
    pub fn allocation(&self) -> &Allocation {
        self.actions.allocation()
    }

    /// Number of joints.
    pub fn joint_count(&self) -> usize {
        self.joints.len()
    }

    /// The paper's PD for this task, with these gains or the scene's own (`vehicle.servo`).
    ///
    /// # Errors
    /// `TaskError` if there are no gains, or one is not finite or is negative.
    pub fn pd(&self, gains: Option<VehicleServo>) -> Result<Pd, TaskError> {
        let Some(gains) = gains.or_else(|| self.servo.clone()) else {
            let reason = "it gives no gains (vehicle.servo) for the PD".into();
            return Err(TaskError::Scene { scene: self.scene_name.clone(), reason });
        };
        let find = |names: [&str; 2]| {
            let mut found = names
                .into_iter()
                .filter_map(|name| self.layout.block(name))
                .flat_map(|block| block.scale.iter().enumerate().map(|(k, scale)| (block.offset + k, *scale)));
            std::array::from_fn(|_| found.next().expect("every layout holds these two blocks of three"))
        };
        let reading = Reading {
            width: self.observation_len(),
            error: find(["position_error", "attitude_error"]),
            twist: find(["linear_velocity", "angular_velocity"]),
        };
        Ok(Pd::new(reading, gains, self.actions.clone())?)
    }

    /// Refuses actions (n rows) that are misshaped or not finite. Entries beyond [-1, 1] are clipped by [`Self::act`].
    ///
    /// # Errors
    /// `ControlError::Shape` or `TaskError::Action`, with the instance and the entry.
    pub fn check_actions(&self, actions: &[f32], n: usize) -> Result<(), TaskError> {
        let expected = n * self.action_len();
        if actions.len() != expected {
            return Err(ControlError::Shape { what: "actions", got: actions.len(), expected }.into());
        }
        match actions.iter().position(|a| !a.is_finite()) {
            None => Ok(()),
            Some(at) => {
                let (instance, index) = (at / self.action_len(), at % self.action_len());
                Err(TaskError::Action { instance, index, value: actions[at] })
            }
        }
    }

    /// Takes an action (entries beyond [-1, 1] are clipped, NaN counts as 0) for the coming control period.
    pub fn act(&self, episode: &mut Episode, action: &[f32]) -> Command {
        episode.previous_action = episode.action;
        let mut clipped = [0.0; ACTIONS];
        for (c, &a) in clipped.iter_mut().zip(action).take(self.action_len()) {
            *c = if a.is_nan() { 0.0 } else { a.clamp(-1.0, 1.0) };
        }
        episode.action = clipped;
        episode.thrusts = self.actions.thrusts(&clipped[..self.action_len()]);
        let mut joints = [[0.0; 4]; JOINTS];
        for (i, cubic) in joints.iter_mut().enumerate().take(self.joints.len()) {
            *cubic = hermite(&episode.now[i], &episode.next[i], self.options.control_period());
        }
        Command { thrusts: episode.thrusts, wrench: self.allocation().wrench(&episode.thrusts), joints }
    }

    /// Moves the episode to the control instant that `state` has reached, and judges it. `end_effector` gives the
    /// end effector's pose for a vehicle pose and joint coordinates.
    ///
    /// Errors that are beyond the bounds or no numbers count as the bounds, so that all results are finite.
    pub fn advance(
        &self,
        episode: &mut Episode,
        state: &State,
        end_effector: impl Fn(&Pose, &Joints) -> Pose,
    ) -> Outcome {
        let period = self.options.control_period();
        episode.step += 1;
        episode.now = episode.next;
        let next = f64::from(episode.step + 1) * period;
        for (point, reference) in episode.next.iter_mut().zip(&episode.references).take(self.joints.len()) {
            *point = reference.at(next);
        }

        let pose = Pose::of_vehicle(state);
        let error = pose.error_from(&episode.target);
        let diverged = self.violation(&episode.target, state).is_some();
        if !diverged {
            // Exact for an error that is constant over the period.
            let keep = (-LEAK * period).exp();
            episode.integral = episode.integral * keep + stack(&error) * ((1.0 - keep) / LEAK);
        }
        let (position_error, attitude_error) = magnitudes(&error);
        let joint_reference = episode.now.map(|point: ReferencePoint| point.value);
        let reached = end_effector(&pose, &state.q);
        let wanted = end_effector(&episode.target, &joint_reference);
        let (end_effector_position_error, end_effector_attitude_error) = magnitudes(&reached.error_from(&wanted));

        let allocation = self.allocation();
        let mean = |power: fn(f64) -> f64| {
            allocation.relative(&episode.thrusts).map(power).sum::<f64>() / allocation.count() as f64
        };
        let mut metrics = Metrics {
            position_error,
            attitude_error,
            end_effector_position_error,
            end_effector_attitude_error,
            effort: mean(|u| u.abs() * u.abs().sqrt()),
            saturation: allocation.saturation(&episode.thrusts),
            running: [0.0; 6],
            current: episode.current,
        };
        metrics.accumulate(&mut episode.sums, episode.step);

        let weights = &self.options.reward;
        let pose_error = position_error.hypot(RADIAN * attitude_error);
        let change: f64 =
            episode.action.iter().zip(&episode.previous_action).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        let terms = RewardTerms {
            pose: -weights.pose * ((pose_error / FINE).powi(2).ln_1p() + pose_error / COARSE),
            effort: -weights.effort * mean(|u| u * u),
            rate: -weights.rate * change / self.action_len() as f64,
        };
        let reward = terms.pose + terms.effort + terms.rate;
        Outcome { reward, terms, terminated: diverged, diverged, metrics }
    }

fn stack(error: &PoseError) -> Vector6<f64> {
    let (p, r) = (&error.position, &error.rotation);
    Vector6::new(p.x, p.y, p.z, r.x, r.y, r.z)
}

/// Distance and angle of an error, at most the bounds; NaN counts as the bound.
fn magnitudes(error: &PoseError) -> (f64, f64) {
    (error.position.norm().min(POSITION_BOUND), error.rotation.norm().min(std::f64::consts::PI))
}

fn layout(joints: &[Joint], actions: usize) -> Layout {
    use std::f64::consts::PI;
    let joint_entries = |entry: &dyn Fn(&Joint, f64) -> (f64, f64)| -> Vec<(f64, f64)> {
        let unit = |joint: &Joint| match joint.kind {
            JointKind::Revolute => 1.0,
            JointKind::Prismatic => METRES_PER_RADIAN,
        };
        joints.iter().map(|joint| entry(joint, unit(joint))).collect()
    };
    let coordinates = joint_entries(&|joint, unit| {
        let travel = joint.limits.as_ref().map_or(0.0, |l| l.upper - l.lower);
        (JOINT_SCALE * unit, (JOINT_SHOWN * unit).max(2.0 * travel))
    });
    let rates = joint_entries(&|_, unit| (JOINT_SCALE * unit, RATE_BOUND));
    let integral = [[(INTEGRAL_SCALE, POSITION_BOUND / LEAK); 3], [(INTEGRAL_SCALE, PI / LEAK); 3]].concat();

    let mut layout = Layout::default();
    layout.push("position_error", "m", "R^T (r - r_d), body axes", &[(ERROR_SCALE, POSITION_BOUND); 3]);
    layout.push("attitude_error", "rad", "rotation vector log(R_d^T R), body axes", &[(ERROR_SCALE, PI); 3]);
    layout.push(
        "linear_velocity",
        "m/s",
        "absolute velocity of the vehicle origin, body axes",
        &[(TWIST_SCALE, SPEED_BOUND); 3],
    );
    layout.push("angular_velocity", "rad/s", "absolute angular velocity, body axes", &[(TWIST_SCALE, TURN_BOUND); 3]);
    layout.push("joint_position", "rad or m", "joint coordinates relative to home", &coordinates);
    layout.push("joint_rate", "rad/s or m/s", "joint rates", &rates);
    layout.push(
        "joint_reference",
        "rad or m",
        "joint reference at the next control instant, relative to home",
        &coordinates,
    );
    layout.push(
        "joint_reference_rate",
        "rad/s or m/s",
        "rate of the joint reference at the next control instant",
        &rates,
    );
    layout.push("previous_action", "1", "the last action, as clipped", &vec![(1.0, 1.0); actions]);
    layout.push("error_integral", "m s and rad s", "leaky integral of both errors, I' = e - 0.1 I", &integral);
    layout
}
