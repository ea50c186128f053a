//! What tasks show of an episode, and the bounds beyond which it has diverged.

use super::layout::Layout;
use super::options::{Goal, TaskOptions};
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

/// Greatest entry of a unit vector: rounding included.
const UP_BOUND: f64 = 1.001;

/// Leak of the integral of the pose error, 1/s: `I' = e - LEAK I`.
pub(super) const LEAK: f64 = 0.1;

impl Task {
    /// The first bound that a state reaches, if any: name, value and bound.
    pub(super) fn violation(&self, target: &Pose, state: &State) -> Option<(&'static str, f64, f64)> {
        let n = self.joints.len();
        let twist = &state.twist;
        let bounded = [
            ("distance from the target", (self.frame(state).position - target.position).norm(), POSITION_BOUND),
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

/// Greatest distance of each joint coordinate from home.
pub(super) fn joint_bounds(layout: &Layout) -> Vec<f64> {
    let block = layout.block("joint_position");
    block.into_iter().flat_map(|b| b.bound.iter().zip(&b.scale).map(|(bound, scale)| bound * scale)).collect()
}

/// Blocks of an observation for these joints and this number of action entries.
pub(super) fn layout(options: &TaskOptions, joints: &[Joint], actions: usize) -> Layout {
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
    let tracks = options.task == Goal::Track;
    let [position, attitude] = if tracks {
        ["R_e^T (r_e - r_d), end-effector axes", "rotation vector log(R_d^T R_e), end-effector axes"]
    } else {
        ["R^T (r - r_d), body axes", "rotation vector log(R_d^T R), body axes"]
    };

    let mut layout = Layout::default();
    layout.push("position_error", "m", position, &[(ERROR_SCALE, POSITION_BOUND); 3]);
    layout.push("attitude_error", "rad", attitude, &[(ERROR_SCALE, PI); 3]);
    layout.push(
        "linear_velocity",
        "m/s",
        "absolute velocity of the vehicle origin, body axes",
        &[(TWIST_SCALE, SPEED_BOUND); 3],
    );
    layout.push("angular_velocity", "rad/s", "absolute angular velocity, body axes", &[(TWIST_SCALE, TURN_BOUND); 3]);
    if tracks {
        layout.push("up", "1", "direction against gravity, body axes", &[(1.0, UP_BOUND); 3]);
    }
    layout.push("joint_position", "rad or m", "joint coordinates relative to home", &coordinates);
    layout.push("joint_rate", "rad/s or m/s", "joint rates", &rates);
    if tracks {
        let (speed, ahead) = (options.reference_speed, f64::from(options.preview.points) * options.preview.spacing);
        let motion = [[(TWIST_SCALE, SPEED_BOUND); 3], [(TWIST_SCALE, TURN_BOUND); 3]].concat();
        layout.push("reference_twist", "m/s and rad/s", "velocities of the reference, end-effector axes", &motion);
        let point = [[(ERROR_SCALE, POSITION_BOUND + 1.01 * speed * ahead); 3], [(ERROR_SCALE, PI); 3]].concat();
        layout.push(
            "preview",
            "m and rad",
            "both errors against each point of the reference ahead",
            &point.repeat(options.preview.points as usize),
        );
    } else {
        let next = "reference at the next control instant, relative to home";
        layout.push("joint_reference", "rad or m", next, &coordinates);
        let rate = "rate of the reference at the next control instant";
        layout.push("joint_reference_rate", "rad/s or m/s", rate, &rates);
    }
    layout.push("previous_action", "1", "the last action, as clipped", &vec![(1.0, 1.0); actions]);
    layout.push("error_integral", "m s and rad s", "leaky integral of both errors, I' = e - 0.1 I", &integral);
    layout
}
