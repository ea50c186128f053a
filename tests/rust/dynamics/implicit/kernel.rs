//! The recursion in O(n) against dense matrices, and against the explicit form where the step vanishes.

use std::f64::consts::TAU;

use nalgebra::{DMatrix, DVector, Matrix6, Vector3, Vector6};
use uvms_gym::description::{Body, Joint, Scene};
use uvms_gym::dynamics::ClosedFormModel;
use uvms_gym::dynamics::aba::{ArmLoads, Instant, Scratch, accelerations};
use uvms_gym::dynamics::aba_implicit::{Ahead, implicit_accelerations};
use uvms_gym::dynamics::dense::DensePose;
use uvms_gym::lane::Shared;
use uvms_gym::lie;
use uvms_gym::system::{JOINTS, State, System, compile};

use crate::cases::for_bodies;
use crate::random_scene::{Options, Random, random_scene, random_state};

/// Scene, state and loads of a comparison.
struct Case {
    scene: Scene,
    state: State,
    torque: [f64; JOINTS],
    /// Servo targets and their rates, if servos are on.
    target: Option<[[f64; 2]; JOINTS]>,
    wrench: Vector6<f64>,
    station: bool,
}

impl Case {
    fn new(seed: u64, gravity: bool) -> Self {
        let mut scene = random_scene(seed, Options { current: Some(false), ..Options::default() });
        if !gravity {
            scene.water.gravity = Vector3::zeros();
            for_bodies(&mut scene, |body| body.buoyancy = None);
        }
        let state = random_state(seed, &scene);
        let mut random = Random::new(seed ^ 0xA11);
        let torque = std::array::from_fn(|_| random.between(-3.0, 3.0));
        let target = std::array::from_fn(|k| [state.q[k] + random.between(-1.0, 1.0), random.between(-0.5, 0.5)]);
        let wrench = Vector6::from_fn(|_, _| random.between(-5.0, 5.0));
        let target = random.coin().then_some(target);
        Self { scene, state, torque, target, wrench, station: random.coin() }
    }

    fn loads(&self) -> ArmLoads<f64> {
        let mut loads = ArmLoads::none();
        loads.torque = self.torque;
        loads.terms = if self.target.is_some() { 2 } else { 0 };
        for (k, target) in self.target.iter().flatten().enumerate() {
            loads.target[k][..2].copy_from_slice(target);
        }
        loads
    }

    /// `[V'; q'']` by the recursion, explicit without a step.
    fn recursion(&self, h: Option<f64>) -> DVector<f64> {
        let system: System<Shared<f64>> = compile(&self.scene).system;
        let r = self.state.rotation;
        let gravity = r.tr_mul(&self.scene.water.gravity);
        let at = Instant {
            is_start: true,
            gravity: lie::Vector3(gravity.into()),
            twist: lie::Vector6::from_array(self.state.twist.into()),
            q: &self.state.q,
            qd: &self.state.qd,
            wrench: &lie::Vector6::from_array(self.wrench.into()),
            fixed_rate: system.fixed.then_some(lie::Vector3([0.0; 3])),
            time: 0.0,
            elapsed: 0.0,
        };
        let (mut rate, mut qdd) = (lie::Vector6::zero(), [0.0; JOINTS]);
        let (loads, mut scratch) = (self.loads(), Scratch::new());
        match h {
            None => accelerations::<_, _, _, false>(&system, &at, &loads, &mut scratch, &mut rate, &mut qdd),
            Some(h) => {
                let ahead = Ahead { h, vehicle_servo: self.station };
                implicit_accelerations(&system, &at, ahead, &loads, &mut scratch, &mut rate, &mut qdd);
            }
        }
        let all = rate.to_array().into_iter().chain(qdd[..system.joints.len()].iter().copied());
        DVector::from_vec(all.collect())
    }

    /// The same by dense matrices, without gravity.
    fn dense(&self, h: f64) -> DVector<f64> {
        let Self { scene, state, .. } = self;
        let model = ClosedFormModel::new(scene).unwrap();
        let n = scene.joints().count();
        let equations = model.system.at(&state.twist, &state.q[..n], &state.qd[..n], &Vector3::zeros());
        let mut matrix = equations.mass_matrix.clone();
        let mut force = -equations.bias.clone();
        // Bodies in the order that they were composed in; an arm without a base has one without mass.
        let arm = scene
            .arm
            .iter()
            .flat_map(|arm| std::iter::once(arm.base.as_ref()).chain(arm.links.iter().map(|link| link.body.as_ref())));
        let payload = scene.payload.iter().map(|payload| Some(&payload.body));
        let bodies: Vec<Option<&Body>> = std::iter::once(Some(&scene.vehicle.body)).chain(arm).chain(payload).collect();
        assert_eq!(bodies.len(), equations.bodies.len());
        for (k, (body, motion)) in bodies.iter().zip(&equations.bodies).enumerate() {
            let Some(body) = body else { continue };
            let jacobian = equations.body_jacobian(k);
            let slope = drag_slope(body, &motion.twist) * h;
            matrix += jacobian.tr_mul(&(slope * &jacobian));
            force += jacobian.tr_mul(&(motion.body.damping(&motion.twist) - slope * motion.drift));
        }
        let mut first = force.rows_mut(0, 6);
        first += self.wrench;
        if self.station {
            let servo = scene.vehicle.servo.as_ref().unwrap();
            for i in 0..6 {
                force[i] -= h * servo.kp[i] * state.twist[i];
                matrix[(i, i)] += h * (servo.kd[i] + h * servo.kp[i]);
            }
        }
        for (k, joint) in scene.joints().enumerate() {
            let (torque, falls) = self.joint(joint, k, h);
            force[6 + k] += torque;
            matrix[(6 + k, 6 + k)] += falls;
        }
        let from = if scene.vehicle.fixed { 6 } else { 0 };
        let size = 6 + n - from;
        let free: DMatrix<f64> = matrix.view((from, from), (size, size)).into();
        let mut all = DVector::zeros(6 + n);
        if size > 0 {
            let solved = free.lu().solve(&force.rows(from, size).into_owned()).unwrap();
            all.rows_mut(from, size).copy_from(&solved);
        }
        all
    }

    fn joint(&self, joint: &Joint, k: usize, h: f64) -> (f64, f64) {
        let (q, qd) = (self.state.q[k], self.state.qd[k]);
        let then = q + h * qd;
        let mut demand = self.torque[k];
        let mut slope = 0.0;
        if let (Some(servo), Some(target)) = (&joint.servo, &self.target) {
            demand += servo.kp * (target[k][0] - then) + servo.kd * (target[k][1] - qd);
            slope = servo.kd + h * servo.kp;
        }
        let mut torque = demand;
        if let Some(effort) = joint.effort {
            torque = demand.clamp(-effort, effort);
            slope *= (effort / demand.abs()).min(1.0);
        }
        let friction = &joint.friction;
        let rubbing = friction.viscous + friction.coulomb / qd.hypot(friction.coulomb_speed);
        torque -= rubbing * qd;
        slope += rubbing;
        if let Some(speed) = friction.stribeck_speed {
            let excess = (friction.at_rest() - friction.coulomb) / (1.0 + (qd / speed).powi(2));
            torque -= excess * qd / qd.hypot(friction.coulomb_speed);
            slope += excess / qd.hypot(friction.coulomb_speed);
        }
        if let Some(spring) = &joint.spring {
            torque -= spring.stiffness * (then - spring.rest);
            slope += h * spring.stiffness;
        }
        if let Some(detent) = &joint.detent {
            let angle = TAU / detent.period * (then - detent.offset);
            torque -= detent.torque * angle.sin();
            slope += h * (detent.stiffness() * angle.cos()).max(0.0);
        }
        if let Some(limits) = &joint.limits {
            let beyond = then - then.clamp(limits.lower, limits.upper);
            torque -= limits.stiffness * beyond + limits.damping * beyond.abs() * qd;
            slope += limits.damping * beyond.abs() + if beyond == 0.0 { 0.0 } else { h * limits.stiffness };
        }
        (torque, h * slope)
    }
}

/// Secants of damping, with bounds of lift and of full quadratic coefficients, in body frame.
fn drag_slope(body: &Body, twist: &Vector6<f64>) -> Matrix6<f64> {
    let to = DensePose::from_frame(&body.hydrodynamic_frame).adjoint_inverse();
    let there = to * twist;
    let d = body.damping.linear;
    let (s, n) = ((d + d.transpose()) / 2.0, (d - d.transpose()) / 2.0);
    let linear =
        if d == Matrix6::from_diagonal(&d.diagonal()) { d } else { s + n.transpose() * s.try_inverse().unwrap() * n };
    let steep = body.damping.quadratic.abs() * Matrix6::from_diagonal(&there.abs());
    let quadratic = Matrix6::from_fn(|i, k| {
        if i == k {
            steep[(i, i)] + (0..6).filter(|&j| j != i).map(|j| (steep[(i, j)] + steep[(j, i)]) / 2.0).sum::<f64>()
        } else {
            0.0
        }
    });
    to.tr_mul(&(linear + quadratic)) * to
}

#[test]
fn the_recursion_equals_the_dense_system() {
    let mut worst = 0.0_f64;
    for seed in 0..150 {
        let case = Case::new(seed, false);
        for h in [0.0, 1e-3, 0.1, 10.0] {
            let (a, b) = (case.recursion(Some(h)), case.dense(h));
            let difference = (&a - &b).norm() / b.norm().max(1e-300);
            worst = worst.max(difference);
            assert!(difference < 1e-11, "seed {seed}, h = {h}: {difference:e}");
        }
    }
    println!("maximum difference {worst:e}");
}

#[test]
fn zero_step_gives_the_explicit_form() {
    for seed in 0..150 {
        let case = Case::new(seed, true);
        let (a, b) = (case.recursion(Some(0.0)), case.recursion(None));
        assert!((&a - &b).norm() <= 1e-11 * b.norm(), "seed {seed}: {a} {b}");
    }
}

#[test]
fn large_steps_keep_it_regular() {
    for seed in 0..50 {
        let mut case = Case::new(seed, true);
        case.state.twist *= 100.0;
        for h in [1.0, 1e3, 1e6] {
            assert!(case.recursion(Some(h)).iter().all(|x| x.is_finite()), "seed {seed}, h = {h}");
        }
    }
}
