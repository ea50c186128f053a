//! Nominal model of vehicle and arm in still water, in lanes, for controllers and their predictions.

use nalgebra as na;

use super::equations::{ChainState, Velocities};
use crate::description::{Scene, Thruster};
use crate::dynamics::CompositeBody;
use crate::dynamics::aba::Scratch;
use crate::lane::{Lane, Param, Routine, Shared};
use crate::lie::{Pose, Vector3, Vector6, exp_se3, rotation_vector};
use crate::spatial::SpatialInertia;
use crate::system::{EndEffector, JOINTS, Joints, System, compile};

/// Shortest and longest step of a prediction, s.
const STEPS: [f64; 2] = [0.005, 0.1];
/// Maximum of a step times the rate of damping; Heun's method is stable up to 2.
const STABLE: f64 = 1.5;
/// Speed beyond that of any vehicle, m/s or rad/s.
const FASTEST: f64 = 10.0;

/// Pose error and twist of the vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VehicleMotion<L> {
    /// Pose error `[R^T (r - r_d); log(R_d^T R)]`.
    pub error: Vector6<L>,
    /// Body twist.
    pub twist: Vector6<L>,
}

/// Joint coordinates and rates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmState<L> {
    /// rad or m.
    pub q: [L; JOINTS],
    /// rad/s or m/s.
    pub qd: [L; JOINTS],
}

impl<L: Lane> ArmState<L> {
    /// `self * s + b`
    #[inline(always)]
    pub fn scale_add(&self, s: L, b: &Self) -> Self {
        let mut sum = *b;
        for i in 0..JOINTS {
            sum.q[i] = self.q[i].mul_add(s, sum.q[i]);
            sum.qd[i] = self.qd[i].mul_add(s, sum.qd[i]);
        }
        sum
    }

    /// `self - b`
    #[inline(always)]
    pub fn minus(&self, b: &Self) -> Self {
        b.scale_add(L::c(-1.0), self)
    }

    /// `yes` where the mask is true, else `no`.
    #[inline(always)]
    pub fn select(mask: L::Mask, yes: &Self, no: &Self) -> Self {
        let mut arm = *no;
        for i in 0..JOINTS {
            arm.q[i] = L::select(mask, yes.q[i], no.q[i]);
            arm.qd[i] = L::select(mask, yes.qd[i], no.qd[i]);
        }
        arm
    }
}

/// Wrenches on the vehicle over a time step, N and N m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AppliedWrenches<L> {
    /// Command to the thrusters.
    pub command: Vector6<L>,
    /// Thrusters' wrench at the start; it follows the command with their lag.
    pub thrust: Vector6<L>,
    /// Disturbance: wrench that the model does not explain.
    pub disturbance: Vector6<L>,
}

/// Nominal model of a scene, which all controllers share: the compiled system, its end effector, and the thrusters' lag.
#[derive(Debug, Clone, PartialEq)]
pub struct NominalModel {
    pub(super) system: System<Shared<f64>>,
    pub(super) end_effector: EndEffector,
    /// Further end effectors that a controller holds still.
    pub(super) held: Vec<EndEffector>,
    /// Magnitude of gravity, m/s2.
    pub(super) gravity: f64,
    /// Mean time constant of the thrusters, s.
    lag: f64,
    /// Longest step of a prediction, s: small vehicles are damped fast.
    step: f64,
}

impl NominalModel {
    /// Nominal model of a checked scene.
    pub fn new(scene: &Scene) -> Self {
        let count = scene.vehicle.thrusters.len();
        let lag = (0..count).map(|i| scene.vehicle.lag(i)).sum::<f64>() / count.max(1) as f64;
        let (end_effector, gravity) = (EndEffector::new(scene), scene.water.gravity.norm());
        // Contact and fixtures are unknown to controllers.
        let system = compile(&scene.robot()).system;
        let mut model = Self { system, end_effector, held: Vec::new(), gravity, lag, step: STEPS[1] };
        model.step = (STABLE / model.maximum_damping(scene)).clamp(STEPS[0], STEPS[1]);
        model
    }

    /// Maximum rate of damping along an axis, 1/s: at the speed that all thrusters sustain along it.
    fn maximum_damping(&self, scene: &Scene) -> f64 {
        let (inertia, arm) = (self.inertia(&scene.home()), ArmState { q: scene.home(), qd: [0.0; JOINTS] });
        let rate = |k: usize| {
            let along = |thruster: &Thruster| {
                let moment = thruster.position.cross(&thruster.axis);
                let arm = if k < 3 { thruster.axis[k] } else { moment[k - 3] } / thruster.axis.norm();
                arm.abs() * thruster.limits[0].abs().max(thruster.limits[1].abs())
            };
            let limit: f64 = scene.vehicle.thrusters.iter().map(along).sum();
            let drag = |speed: f64| {
                let twist = Vector6::from_array(std::array::from_fn(|i| if i == k { speed } else { 0.0 }));
                let at = VehicleMotion { error: Vector6::zero(), twist };
                -self.composite_body(&at, &arm, &mut Scratch::new()).force.to_array()[k]
            };
            let (mut low, mut high) = (0.0, FASTEST);
            for _ in 0..40 {
                let middle = 0.5 * (low + high);
                if drag(middle) - drag(0.0) < limit { low = middle } else { high = middle }
            }
            (drag(1.001 * high) - drag(0.999 * high)) / (0.002 * high * inertia[(k, k)])
        };
        (0..6).map(rate).fold(0.0, f64::max)
    }

    /// Number of joints.
    #[inline(always)]
    pub fn joints(&self) -> usize {
        self.system.chain().len()
    }

    /// Mean time constant of the thrusters, s.
    pub fn lag(&self) -> f64 {
        self.lag
    }

    /// Composite inertia of vehicle and arm at these joint coordinates.
    pub fn inertia(&self, q: &Joints) -> na::Matrix6<f64> {
        let at = ChainState { up: &na::Vector3::z(), q, velocities: &Velocities::zeros() };
        self.equations(at, 0.0).inertia.fixed_view::<6, 6>(0, 0).into_owned()
    }

    /// Gravity in vehicle axes. Targets are level, so that the attitude error gives it.
    #[inline(always)]
    fn gravity_at<L: Lane<Real = f64>>(&self, error: Vector6<L>) -> Vector3<L> {
        let rotation = exp_se3(Vector6 { linear: Vector3::zero(), angular: error.angular }).rotation;
        let [x, y, z] = self.system.gravity;
        rotation.apply_transposed(Vector3([x.get(), y.get(), z.get()]))
    }

    /// Vehicle and arm as one composite body.
    #[inline(always)]
    pub fn composite_body<L: Lane<Real = f64>>(
        &self,
        at: &VehicleMotion<L>,
        arm: &ArmState<L>,
        scratch: &mut Scratch<L>,
    ) -> CompositeBody<L> {
        let (six, inertia) = (Vector6::zero(), SpatialInertia::zero());
        let mut body = CompositeBody { inertia, momentum: six, force: six };
        L::call(&mut Composition { model: self, at, arm, scratch, body: &mut body });
        body
    }

    /// Prediction over `time` (s), while the arm moves from one motion to the other. Momentum by Heun's method, thruster
    /// lag exactly, poses along the mean twist.
    #[inline(always)]
    pub fn predict<L: Lane<Real = f64>>(
        &self,
        from: &VehicleMotion<L>,
        [arm, arm_then]: [&ArmState<L>; 2],
        wrenches: &AppliedWrenches<L>,
        time: f64,
        scratch: &mut Scratch<L>,
    ) -> Prediction<L> {
        let steps = (time / self.step - 1e-6).ceil().max(1.0);
        let h = time / steps;
        let (end, mean) = lag_decay(h, self.lag);
        let change = arm_then.minus(arm);
        let mut predicted = Prediction { motion: *from, thrust: wrenches.thrust, inertia: SpatialInertia::zero() };
        for step in 0..steps as usize {
            let gap = predicted.thrust - wrenches.command;
            let wrench = gap.scale_add(L::c(mean), wrenches.command) + wrenches.disturbance;
            predicted.thrust = gap.scale_add(L::c(end), wrenches.command);
            let arms = [step as f64, step as f64 + 1.0];
            let [arm, arm_then] =
                [change.scale_add(L::c(arms[0] / steps), arm), change.scale_add(L::c(arms[1] / steps), arm)];
            let start = predicted.motion;
            let (mut momentum, mut first_rate, mut joints) = (Vector6::zero(), Vector6::zero(), Vector6::zero());
            // At the start; with the arm's later position, for the inertia; and after the Euler step.
            for stage in 0..3 {
                let arm = if stage == 0 { &arm } else { &arm_then };
                let at = if stage == 2 { predicted.motion } else { start };
                let body = self.composite_body(&at, arm, scratch);
                let rate = body.force + wrench - body.momentum_transport(at.twist);
                let impulse = match stage {
                    0 => {
                        (momentum, first_rate) = (body.momentum, rate);
                        continue;
                    }
                    1 => {
                        (predicted.inertia, joints) = (body.inertia, body.joint_momentum(at.twist));
                        first_rate.scale(L::c(h))
                    }
                    _ => (first_rate + rate).scale(L::c(0.5 * h)),
                };
                predicted.motion = start.after(predicted.inertia.solve(momentum + impulse - joints), h);
            }
        }
        predicted
    }
}

/// [`NominalModel::composite_body`], which controllers need in several places, as a function of its own.
struct Composition<'a, L> {
    model: &'a NominalModel,
    at: &'a VehicleMotion<L>,
    arm: &'a ArmState<L>,
    scratch: &'a mut Scratch<L>,
    body: &'a mut CompositeBody<L>,
}

impl<L: Lane<Real = f64>> Routine<L> for Composition<'_, L> {
    #[inline(always)]
    fn run(&mut self) {
        let Self { model, at, arm, scratch, body } = self;
        let joints = (&arm.q, &arm.qd);
        let gravity = model.gravity_at(at.error);
        **body = CompositeBody::of(&model.system, gravity, at.twist, joints, scratch);
        body.force = body.force + model.system.terms.passive_wrench(at.twist, gravity);
    }
}

/// Predicted motion after a time step.
#[derive(Debug, Clone, Copy)]
pub struct Prediction<L> {
    /// Vehicle.
    pub motion: VehicleMotion<L>,
    /// Thrusters' wrench, N and N m.
    pub thrust: Vector6<L>,
    /// Composite inertia of vehicle and arm.
    pub inertia: SpatialInertia<L>,
}

impl<L: Lane<Real = f64>> VehicleMotion<L> {
    /// Motion after h seconds along the mean of the present twist and the final one.
    #[inline(always)]
    fn after(&self, twist: Vector6<L>, h: f64) -> Self {
        let step = exp_se3((self.twist + twist).scale(L::c(0.5 * h)));
        let rotation = exp_se3(Vector6 { linear: Vector3::zero(), angular: self.error.angular }).rotation;
        let pose = Pose { rotation, position: rotation.apply(self.error.linear) }.times(&step);
        let linear = pose.rotation.apply_transposed(pose.position);
        Self { error: Vector6 { linear, angular: rotation_vector(&pose.rotation) }, twist }
    }
}

/// Decay of the gap between thrust and command over a time: its remaining share at the end, and its mean.
pub(super) fn lag_decay(time: f64, lag: f64) -> (f64, f64) {
    if lag <= 0.0 || time <= 0.0 {
        return (0.0, 0.0);
    }
    let end = (-time / lag).exp();
    (end, (1.0 - end) * lag / time)
}
