//! The vehicle as a controller knows it: the scene's nominal model in still water, for groups of rows.

use nalgebra::Matrix6;

use crate::description::Scene;
use crate::dynamics::CompositeBody;
use crate::dynamics::aba::Scratch;
use crate::lane::{Lane, Param, Shared};
use crate::lie::{Pose, Vector3, Vector6, exp_se3, rotation_vector};
use crate::spatial::SpatialInertia;
use crate::system::{JOINTS, System, compile};

/// Longest step of a prediction, s.
const STEP: f64 = 0.1;

/// Where the vehicle stands and how it moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion<L> {
    /// Pose error `[R^T (r - r_d); log(R_d^T R)]`.
    pub error: Vector6<L>,
    /// Body twist.
    pub twist: Vector6<L>,
}

/// Joint coordinates and rates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arm<L> {
    /// rad or m.
    pub q: [L; JOINTS],
    /// rad/s or m/s.
    pub qd: [L; JOINTS],
}

impl<L: Lane> Arm<L> {
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
    pub fn less(&self, b: &Self) -> Self {
        b.scale_add(L::c(-1.0), self)
    }
}

/// Wrenches on the vehicle over a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Push<L> {
    /// What the thrusters are asked for.
    pub command: Vector6<L>,
    /// What they give at the start; they follow with their lag.
    pub thrust: Vector6<L>,
    /// What nothing in the model explains.
    pub disturbance: Vector6<L>,
}

/// The nominal model.
#[derive(Debug, Clone, PartialEq)]
pub struct Plant {
    system: System<Shared<f64>>,
    /// Mean time constant of the thrusters, s.
    lag: f64,
}

impl Plant {
    /// Of a checked scene.
    pub fn new(scene: &Scene) -> Self {
        let count = scene.vehicle.thrusters.len();
        let lag = (0..count).map(|i| scene.vehicle.lag(i)).sum::<f64>() / count.max(1) as f64;
        Self { system: compile(scene).system, lag }
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.system.chain().len()
    }

    /// Mean time constant of the thrusters, s.
    pub fn lag(&self) -> f64 {
        self.lag
    }

    /// Inertia of vehicle and arm at these joint coordinates, as the vehicle feels it.
    pub fn inertia(&self, q: &[f64; JOINTS]) -> Matrix6<f64> {
        let at = Motion { error: Vector6::zero(), twist: Vector6::zero() };
        let arm = Arm { q: *q, qd: [0.0; JOINTS] };
        let inertia = self.whole(&at, &arm, &mut Scratch::new()).inertia;
        Matrix6::from_fn(|i, k| inertia.entry(i, k))
    }

    /// Gravity in vehicle axes. Targets are level, so that the attitude error alone tells it.
    #[inline(always)]
    fn gravity<L: Lane<Real = f64>>(&self, error: Vector6<L>) -> Vector3<L> {
        let turn = exp_se3(Vector6 { linear: Vector3::zero(), angular: error.angular }).rotation;
        let [x, y, z] = self.system.gravity;
        turn.apply_transposed(Vector3([x.get(), y.get(), z.get()]))
    }

    /// Vehicle and arm as one body.
    #[inline(always)]
    pub fn whole<L: Lane<Real = f64>>(
        &self,
        at: &Motion<L>,
        arm: &Arm<L>,
        scratch: &mut Scratch<L>,
    ) -> CompositeBody<L> {
        let gravity = self.gravity(at.error);
        CompositeBody::of(&self.system, gravity, at.twist, (&arm.q, &arm.qd), scratch)
    }

    /// Goes on by `time` (s), while the arm goes from one motion to the other. Momentum by Heun's method, thrusters exactly,
    /// poses along the mean twist.
    #[inline(always)]
    pub fn advance<L: Lane<Real = f64>>(
        &self,
        from: &Motion<L>,
        [arm, arm_then]: [&Arm<L>; 2],
        push: &Push<L>,
        time: f64,
        scratch: &mut Scratch<L>,
    ) -> Reached<L> {
        let steps = (time / STEP - 1e-6).ceil().max(1.0);
        let h = time / steps;
        let (kept, mean) = fading(h, self.lag);
        let moved = arm_then.less(arm);
        let mut reached = Reached { motion: *from, thrust: push.thrust, inertia: SpatialInertia::zero() };
        for step in 0..steps as usize {
            let far = reached.thrust - push.command;
            let wrench = far.scale_add(L::c(mean), push.command) + push.disturbance;
            reached.thrust = far.scale_add(L::c(kept), push.command);
            let arms = [step as f64, step as f64 + 1.0];
            let [arm, arm_then] =
                [moved.scale_add(L::c(arms[0] / steps), arm), moved.scale_add(L::c(arms[1] / steps), arm)];
            let start = reached.motion;
            let (mut momentum, mut rate, mut joints) = (Vector6::zero(), Vector6::zero(), Vector6::zero());
            // Before; with the arm as it is then, which tells the inertia; and after the step that this makes.
            for stage in 0..3 {
                let arm = if stage == 0 { &arm } else { &arm_then };
                let at = if stage == 2 { reached.motion } else { start };
                let here = self.whole(&at, arm, scratch);
                let change = here.force + wrench - here.momentum_transport(at.twist);
                let gained = match stage {
                    0 => {
                        (momentum, rate) = (here.momentum, change);
                        continue;
                    }
                    1 => {
                        (reached.inertia, joints) = (here.inertia, here.joint_momentum(at.twist));
                        rate.scale(L::c(h))
                    }
                    _ => (rate + change).scale(L::c(0.5 * h)),
                };
                reached.motion = start.after(reached.inertia.solve(momentum + gained - joints), h);
            }
        }
        reached
    }
}

/// Where the model comes to.
#[derive(Debug, Clone, Copy)]
pub struct Reached<L> {
    /// Vehicle.
    pub motion: Motion<L>,
    /// What the thrusters give.
    pub thrust: Vector6<L>,
    /// Inertia of vehicle and arm.
    pub inertia: SpatialInertia<L>,
}

impl<L: Lane<Real = f64>> Motion<L> {
    /// The motion after h seconds along the mean of its twist and the one that it has then.
    #[inline(always)]
    fn after(&self, twist: Vector6<L>, h: f64) -> Self {
        let way = exp_se3((self.twist + twist).scale(L::c(0.5 * h)));
        let turn = exp_se3(Vector6 { linear: Vector3::zero(), angular: self.error.angular }).rotation;
        let there = Pose { rotation: turn, position: turn.apply(self.error.linear) }.times(&way);
        let linear = there.rotation.apply_transposed(there.position);
        Self { error: Vector6 { linear, angular: rotation_vector(&there.rotation) }, twist }
    }
}

/// Of what a thrust lacks: what is left after a time, and its mean over the time.
pub(super) fn fading(time: f64, lag: f64) -> (f64, f64) {
    if lag <= 0.0 || time <= 0.0 {
        return (0.0, 0.0);
    }
    let kept = (-time / lag).exp();
    (kept, (1.0 - kept) * lag / time)
}
