//! What tasks show of an episode, and the bounds beyond which it has diverged.

use super::layout::Layout;
use super::pose::Pose;
use super::reference::METRES_PER_RADIAN;
use super::task::Task;
use crate::description::{Joint, JointKind};
use crate::system::State;

/// Distance from the target beyond which an episode has diverged, m.
pub(super) const POSITION_BOUND: f64 = 10.0;
/// Likewise linear speed (m/s), angular speed (rad/s) and joint rate (rad/s or m/s).
pub(super) const SPEED_BOUND: f64 = 10.0;
pub(super) const TURN_BOUND: f64 = 20.0;
pub(super) const RATE_BOUND: f64 = 20.0;

/// Physical values of 1 in an observation, in metres, radians and seconds.
const ERROR_SCALE: f64 = 0.1;
const TWIST_SCALE: f64 = 0.2;
const JOINT_SCALE: f64 = 0.5;
const INTEGRAL_SCALE: f64 = 0.2;
/// Joint coordinates are shown within this angle of home, rad, or within twice the joint's travel.
const JOINT_SHOWN: f64 = 10.0;

/// Leak of the integral of the pose error, 1/s: `I' = e - LEAK I`.
pub(super) const LEAK: f64 = 0.1;

impl Task {
    /// The first bound that a state reaches, if any: name, value and bound.
    pub(super) fn violation(&self, target: &Pose, state: &State) -> Option<(&'static str, f64, f64)> {
        let n = self.joints.len();
        let twist = &state.twist;
        let bounded = [
            ("distance from the target", (state.position - target.position).norm(), POSITION_BOUND),
            ("linear speed", twist.fixed_rows::<3>(0).norm(), SPEED_BOUND),
            ("angular speed", twist.fixed_rows::<3>(3).norm(), TURN_BOUND),
        ];
        let attitude = state.rotation.iter().map(|x| ("attitude", x.abs(), f64::INFINITY));
        let rates = state.qd[..n].iter().map(|x| ("joint rate", x.abs(), RATE_BOUND));
        let joints = state.q[..n].iter().map(|x| ("joint coordinate", x.abs(), f64::INFINITY));
        let mut all = bounded.into_iter().chain(attitude).chain(rates).chain(joints);
        all.find(|(_, value, bound)| value.is_nan() || value >= bound)
    }
}

/// Blocks of a station-keeping observation for these joints and this number of action entries.
pub(super) fn station_keep_layout(joints: &[Joint], actions: usize) -> Layout {
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
    layout.push("joint_reference", "rad or m", "reference at the next control instant, relative to home", &coordinates);
    layout.push("joint_reference_rate", "rad/s or m/s", "rate of the reference at the next control instant", &rates);
    layout.push("previous_action", "1", "the last action, as clipped", &vec![(1.0, 1.0); actions]);
    layout.push("error_integral", "m s and rad s", "leaky integral of both errors, I' = e - 0.1 I", &integral);
    layout
}
