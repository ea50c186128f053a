//! Energy of a scene at a state, and the powers that change it.
//!
//! Kinetic energy of the water depends on the twist relative to it. In still water the powers sum to the rate of the total
//! energy. In a steady current they do so for [`relative_to_water`], since such a current changes nothing but the observer.

use nalgebra::{DVector, Vector3, Vector6};

use super::closed_form::{ClosedForm, Loads};
use super::dense::relative_twist;
use crate::error::DynamicsError;
use crate::system::State;
use crate::terms::PerTerm;

/// Energies, J.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Energy {
    /// Kinetic energy of the rigid bodies, by absolute twists, and of the joints' rotors, by joint rates.
    pub kinetic_rigid: f64,
    /// Kinetic energy of the water that they set in motion, by twists relative to it.
    pub kinetic_added: f64,
    /// Potential energy of weight and buoyancy; 0 at the world origin.
    pub potential: f64,
    /// Elastic energy of end stops, springs and detents; 0 at the resting places of springs and detents.
    pub elastic: f64,
    /// Elastic energy of contacts.
    pub contact: f64,
    /// Energy of the fixtures, each with the sum of the above.
    pub fixtures: f64,
}

impl Energy {
    /// Sum, J.
    pub fn total(&self) -> f64 {
        self.kinetic_rigid + self.kinetic_added + self.potential + self.elastic + self.contact + self.fixtures
    }
}

/// Powers put into the system, W.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Power {
    /// Linear and quadratic damping.
    pub damping: f64,
    /// Joint friction.
    pub friction: f64,
    /// Damping of the end stops.
    pub end_stop: f64,
    /// Acceleration of the water.
    pub flow: f64,
    /// Thrusters.
    pub thrust: f64,
    /// Terms of the vehicle; the tether's weight included.
    pub terms: PerTerm<f64>,
    /// Dissipation and friction of contacts.
    pub contact: f64,
    /// Friction, end stops, damping and flow of the fixtures.
    pub fixtures: f64,
    /// External wrenches.
    pub external: f64,
    /// Actuators of the joints.
    pub joint_command: f64,
}

impl Power {
    /// Sum, W: the rate of [`Energy::total`] in still water.
    pub fn total(&self) -> f64 {
        let water = self.damping + self.terms.into_array().iter().sum::<f64>() + self.flow;
        let surroundings = self.contact + self.fixtures;
        water + surroundings + self.friction + self.end_stop + self.thrust + self.external + self.joint_command
    }
}

impl ClosedForm<'_> {
    /// Energies, J.
    pub fn energy(&self) -> Energy {
        let mut energy = Energy {
            kinetic_rigid: 0.0,
            kinetic_added: 0.0,
            potential: 0.0,
            elastic: 0.0,
            contact: self.contacts().iter().map(|contact| contact.energy).sum(),
            fixtures: self.fixtures.iter().map(|fixture| fixture.energy().total()).sum(),
        };
        for (k, motion) in self.equations.bodies.iter().enumerate() {
            let relative = self.relative_twist(k);
            energy.kinetic_rigid += 0.5 * motion.twist.dot(&(motion.body.rigid * motion.twist));
            energy.kinetic_added += 0.5 * relative.dot(&(motion.body.added * relative));
            energy.potential += motion.body.potential(&self.world_pose(k), &self.model.gravity);
        }
        let rotors = self.equations.joints.iter().zip(&self.qd);
        energy.kinetic_rigid += rotors.map(|(joint, rate)| 0.5 * joint.rotor_inertia * rate * rate).sum::<f64>();
        energy.elastic = self.end_stops().map(|stop| stop.energy).chain(self.springs().map(|(_, energy)| energy)).sum();
        energy
    }

    /// Powers by absolute twists, W.
    ///
    /// # Errors
    /// [`DynamicsError::Length`] for a nonempty load whose length does not match the scene.
    pub fn power(&self, loads: &Loads) -> Result<Power, DynamicsError> {
        let wrenches = self.body_wrenches(loads)?;
        let torques = self.joint_torques(loads)?;
        let twists = self.body_twists();
        let of_wrenches = |wrenches: &[Vector6<f64>]| twists.iter().zip(wrenches).map(|(v, f)| v.dot(f)).sum();
        let damping = DVector::from_iterator(self.joints(), self.end_stops().map(|stop| stop.damping));
        Ok(Power {
            damping: of_wrenches(&wrenches.damping),
            friction: self.qd.dot(&torques.friction),
            end_stop: self.qd.dot(&damping),
            flow: of_wrenches(&wrenches.flow),
            thrust: twists[0].dot(&wrenches.thrust),
            terms: wrenches.terms.map(|wrench| twists[0].dot(&wrench)),
            contact: self.contacts().iter().map(|contact| contact.power).sum(),
            fixtures: self.fixture_power()?,
            external: of_wrenches(&wrenches.external),
            joint_command: self.qd.dot(&torques.command),
        })
    }
}

/// `state` as seen by an observer who has drifted with the water since time 0; `current` in world axes, m/s.
pub fn relative_to_water(state: &State, current: &Vector3<f64>) -> State {
    let water = state.rotation.tr_mul(current);
    State {
        position: state.position - current * state.time,
        twist: relative_twist(&state.twist, &water),
        ..state.clone()
    }
}
