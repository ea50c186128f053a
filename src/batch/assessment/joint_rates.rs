//! Rates of joints by their causes: friction, servo, spring, detent, end stop.

use nalgebra::{Cholesky, DMatrix, Vector3};

use crate::batch::simulator::Simulator;
use crate::description::{Detent, Joint};
use crate::system::State;

/// Fastest rates of a joint at home against its apparent inertia, everything else free, 1/s; 0 without the cause.
#[derive(Debug, Clone, PartialEq)]
pub struct JointRates {
    /// Name of the joint.
    pub name: String,
    /// Key of the joint.
    pub key: String,
    /// Apparent inertia, kg m2 or kg.
    pub inertia: f64,
    /// `(viscous + static / coulomb_speed) / inertia`: friction at rest.
    pub friction: f64,
    /// Servo: the faster root of `s^2 + kd / inertia s + kp / inertia`.
    pub servo: f64,
    /// Spring: `sqrt(stiffness / inertia)`.
    pub spring: f64,
    /// Detent at rest: `sqrt(2 pi torque / (period inertia))`.
    pub detent: f64,
    /// End stop: `sqrt(stiffness / inertia)`.
    pub end_stop: f64,
}

impl JointRates {
    fn new(joint: &Joint, name: String, key: String, inertia: f64) -> Self {
        let friction = (joint.friction.viscous + joint.friction.at_rest() / joint.friction.coulomb_speed) / inertia;
        let servo = joint.servo.as_ref().map_or(0.0, |servo| {
            let (half, square) = (0.5 * servo.kd / inertia, servo.kp / inertia);
            if half * half > square { half + (half * half - square).sqrt() } else { square.sqrt() }
        });
        let of = |stiffness: Option<f64>| (stiffness.unwrap_or(0.0) / inertia).sqrt();
        let spring = of(joint.spring.as_ref().map(|spring| spring.stiffness));
        let detent = of(joint.detent.as_ref().map(Detent::stiffness));
        let end_stop = of(joint.limits.as_ref().map(|limits| limits.stiffness));
        Self { name, key, inertia, friction, servo, spring, detent, end_stop }
    }

    /// The fastest rate, 1/s, and its cause.
    pub fn fastest(&self) -> (f64, &'static str) {
        let causes = [
            (self.friction, "friction"),
            (self.servo, "servo"),
            (self.spring, "spring"),
            (self.detent, "detent"),
            (self.end_stop, "limits"),
        ];
        causes.into_iter().fold((0.0, ""), |most, cause| if cause.0 > most.0 { cause } else { most })
    }
}

/// Rates of all joints but prescribed ones.
pub(super) fn joint_rates(simulator: &Simulator) -> Vec<JointRates> {
    let scene = simulator.scene();
    let state = State { q: scene.home(), ..State::default() };
    let form = simulator.closed_form_model.at(&state, Vector3::zeros());
    let mut mass = form.mass_matrix().clone();
    let first = if scene.vehicle.fixed { 6 } else { 0 };
    // A prescribed joint moves as it has to, so that the others do not feel it give way.
    let free: Vec<usize> = (first..6)
        .chain(scene.joints().enumerate().filter(|(_, joint)| !joint.prescribed).map(|(k, _)| 6 + k))
        .collect();
    mass = mass.select_rows(&free).select_columns(&free);
    let inverse = Cholesky::new(mass).map_or_else(|| DMatrix::zeros(free.len(), free.len()), |mass| mass.inverse());
    let names = scene.joint_names();
    let keys = scene.joint_keys();
    let rates = |(i, k): (usize, &usize)| {
        let joint = scene.joints().nth(k.checked_sub(6)?)?;
        Some(JointRates::new(joint, names[k - 6].clone(), keys[k - 6].clone(), 1.0 / inverse[(i, i)]))
    };
    free.iter().enumerate().filter_map(rates).collect()
}
