//! Linearization by dual numbers through the articulated-body algorithm, exact to rounding. `[PC05]`

use nalgebra::{DMatrix, Vector3};

use super::aba::{ArmLoads, Instant, Scratch, accelerations};
use super::contact::ContactWrenches;
use super::place::WaterFrame;
use crate::lane::{Lane, Shared, Unfused};
use crate::lie::{self, Matrix3, Pose, Vector6};
use crate::system::{Flow, JOINTS, State, System};
use crate::terms::{FINS, FinAxes, TermInstant};

/// Dual numbers outside kernels, where fused multiply-add is a slow call.
type Dual = crate::lane::Dual<Unfused<f64>>;

/// Linearization `z' = A z + B u` about a motion, with `z = [xi; dq; dV; dq']` and `u = [dF; dtau]`.
///
/// `xi` is the pose error in body axes, `T = T_0 exp xi`; V is the absolute body twist, F the wrench on the vehicle.
/// About a moving frame `xi' = dV - ad_V0 xi`.
#[derive(Debug, Clone, PartialEq)]
pub struct Linearization {
    /// A, (2(6+n), 2(6+n)).
    pub a: DMatrix<f64>,
    /// B, (2(6+n), 6+n).
    pub b: DMatrix<f64>,
}

fn dual(value: f64, slope: f64) -> Dual {
    Dual::new(Unfused(value), Unfused(slope))
}

/// Direction of differentiation.
#[derive(Clone, Copy, PartialEq)]
enum Direction {
    Turn(usize),
    Joint(usize),
    Twist(usize),
    Rate(usize),
    Wrench(usize),
    Torque(usize),
}

/// Linearizes a system about a state under constant loads and fin deflections. Servos are off; a saturated actuator has
/// derivative 0.
pub fn linearize(
    system: &System<Shared<f64>>,
    state: &State,
    flow: &Flow,
    wrench: &[f64; 6],
    fins: &[f64; FINS],
    loads: &ArmLoads<f64>,
) -> Linearization {
    let n = system.joints.len();
    let (rates, size) = (6 + n, 2 * (6 + n));
    let mut a = DMatrix::zeros(size, size);
    let mut b = DMatrix::zeros(size, rates);
    let derivative = |direction| accelerations_along(system, state, flow, (wrench, fins), loads, direction);

    for k in 0..3 {
        a.view_mut((rates, 3 + k), (rates, 1)).copy_from_slice(&derivative(Direction::Turn(k)));
    }
    for k in 0..n {
        a.view_mut((rates, 6 + k), (rates, 1)).copy_from_slice(&derivative(Direction::Joint(k)));
        a.view_mut((rates, rates + 6 + k), (rates, 1)).copy_from_slice(&derivative(Direction::Rate(k)));
        b.view_mut((rates, 6 + k), (rates, 1)).copy_from_slice(&derivative(Direction::Torque(k)));
    }
    for k in 0..6 {
        a.view_mut((rates, rates + k), (rates, 1)).copy_from_slice(&derivative(Direction::Twist(k)));
        b.view_mut((rates, k), (rates, 1)).copy_from_slice(&derivative(Direction::Wrench(k)));
    }

    // Kinematics: xi' = dV - ad_V0 xi, dq' = dq'.
    let minus_ad = -super::dense::ad(&state.twist);
    a.view_mut((0, 0), (6, 6)).copy_from(&minus_ad);
    a.view_mut((0, rates), (rates, rates)).fill_with_identity();
    Linearization { a, b }
}

/// Derivative of `[V'; q'']` along `direction`.
fn accelerations_along(
    system: &System<Shared<f64>>,
    state: &State,
    flow: &Flow,
    (wrench, fins): (&[f64; 6], &[f64; FINS]),
    loads: &ArmLoads<f64>,
    direction: Direction,
) -> Vec<f64> {
    let number = |value: f64, along: Direction| dual(value, if along == direction { 1.0 } else { 0.0 });
    let vector = |v: &Vector3<f64>| lie::Vector3([dual(v.x, 0.0), dual(v.y, 0.0), dual(v.z, 0.0)]);
    let six = |x: &dyn Fn(usize) -> Dual| Vector6::from_array(std::array::from_fn(x));

    // R = R_0 (I + [xi_omega]) to first order.
    let turn = match direction {
        Direction::Turn(k) => Vector3::ith(k, 1.0),
        _ => Vector3::zeros(),
    };
    let slope = state.rotation * turn.cross_matrix();
    let rotation =
        Matrix3(std::array::from_fn(|i| std::array::from_fn(|k| dual(state.rotation[(i, k)], slope[(i, k)]))));
    let water = rotation.apply_transposed(vector(&flow.velocity));
    let pull = rotation.apply_transposed(vector(&flow.acceleration));
    let mut twist = six(&|k| number(state.twist[k], Direction::Twist(k)));
    twist.linear = twist.linear - water;
    let q: [Dual; JOINTS] = std::array::from_fn(|k| number(state.q[k], Direction::Joint(k)));
    let qd: [Dual; JOINTS] = std::array::from_fn(|k| number(state.qd[k], Direction::Rate(k)));
    let zero = dual(0.0, 0.0);
    let gravity = rotation.apply_transposed(lie::Vector3(system.gravity.map(|Shared(g)| dual(g, 0.0))));
    let mut surfaces = FinAxes::blank();
    surfaces.deflect(&system.terms.fins, &fins.map(|x| dual(x, 0.0)));
    let wrench = six(&|k| number(wrench[k], Direction::Wrench(k)));
    let mut scratch = Scratch::new();
    scratch.water = WaterFrame {
        velocity: vector(&flow.velocity),
        acceleration: vector(&flow.acceleration),
        gravity: lie::Vector3(system.gravity.map(|Shared(g)| dual(g, 0.0))) - vector(&flow.acceleration),
    };
    if system.contact.is_some() {
        let position = lie::Vector3(std::array::from_fn(|k| dual(state.position[k], 0.0)));
        Dual::call(&mut ContactWrenches {
            system,
            is_start: true,
            pose: (&Pose { rotation, position }, None),
            elapsed: zero,
            twist,
            q: &q,
            qd: &qd,
            scratch: &mut scratch,
        });
    }
    let terms = system.terms.wrench(&TermInstant { twist, gravity, fins: &surfaces });
    let instant = Instant {
        is_start: true,
        gravity: gravity - pull,
        twist,
        q: &q,
        qd: &qd,
        wrench: &(wrench + scratch.contact.vehicle + terms),
        fixed_rate: system.fixed.then_some(lie::Vector3::zero() - pull),
        time: zero,
        elapsed: zero,
    };
    let loads = ArmLoads {
        torque: std::array::from_fn(|k| number(loads.torque[k], Direction::Torque(k))),
        terms: loads.terms,
        target: loads.target.map(|target| target.map(|x| dual(x, 0.0))),
        on_links: loads.on_links,
        links: loads.links.map(|w| Vector6::from_array(w.to_array().map(|x| dual(x, 0.0)))),
    };
    let (mut twist_rate, mut qdd) = (Vector6::zero(), [zero; JOINTS]);
    accelerations::<_, _, _, true>(system, &instant, &loads, &mut scratch, &mut twist_rate, &mut qdd);
    if !system.fixed {
        // V' = V_r' - [omega x R^T v_c; 0] + [R^T a_c; 0]
        twist_rate.linear = twist_rate.linear - twist.angular.cross(water) + pull;
    }
    let joints = &qdd[..system.joints.len()];
    twist_rate.to_array().iter().chain(joints).map(|x| x.slope.0).collect()
}
