//! The books: energy, momentum and power of a scene at a state.
//!
//! Kinetic energy and impulse of the water go by the twist relative to it. Energy balances powers in still water; in a
//! current the same books balance for [`seen_from_water`], since a steady current changes nothing but the observer.

use nalgebra::{DVector, Vector3, Vector6};

use super::closed_form::{ClosedForm, Loads};
use super::dense::{angular, linear, stack};
use super::joint::EndStop;
use crate::error::DynamicsError;
use crate::system::State;

/// Energies, J.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Energy {
    /// Of the rigid bodies, by absolute twists.
    pub kinetic_rigid: f64,
    /// Of the water that they set in motion, by relative twists.
    pub kinetic_added: f64,
    /// Of weight and buoyancy; 0 at the world origin.
    pub potential: f64,
    /// Of the end stops.
    pub elastic: f64,
}

impl Energy {
    /// Sum, J.
    pub fn total(&self) -> f64 {
        self.kinetic_rigid + self.kinetic_added + self.potential + self.elastic
    }
}

/// Momentum `[linear; angular]` in world axes about the world origin, N s and N m s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Momentum {
    /// Of the rigid bodies, by absolute twists.
    pub rigid: Vector6<f64>,
    /// Impulse of the water, by relative twists.
    pub added: Vector6<f64>,
    /// Sum over bodies of the lengths of their linear and angular `rigid`: what drift is measured against.
    pub rigid_scale: [f64; 2],
    /// Sum over bodies of the lengths of their linear and angular `rigid + added`.
    pub total_scale: [f64; 2],
}

impl Momentum {
    /// `rigid + added`.
    pub fn total(&self) -> Vector6<f64> {
        self.rigid + self.added
    }
}

/// Powers put into the system, W.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Power {
    /// Drag.
    pub drag: f64,
    /// Joint friction.
    pub friction: f64,
    /// Damping of the end stops.
    pub end_stop: f64,
    /// Acceleration of the water.
    pub flow: f64,
    /// Thrusters.
    pub thrust: f64,
    /// Fins.
    pub fins: f64,
    /// Tether, its weight included.
    pub tether: f64,
    /// External wrenches.
    pub external: f64,
    /// Actuators of the joints.
    pub joint_command: f64,
}

impl Power {
    /// Sum, W: the rate of [`Energy::total`] in still water.
    pub fn total(&self) -> f64 {
        let water = self.drag + self.fins + self.tether + self.flow;
        water + self.friction + self.end_stop + self.thrust + self.external + self.joint_command
    }
}

impl ClosedForm<'_> {
    /// Energies.
    pub fn energy(&self) -> Energy {
        let mut energy = Energy { kinetic_rigid: 0.0, kinetic_added: 0.0, potential: 0.0, elastic: 0.0 };
        for (k, motion) in self.equations.bodies.iter().enumerate() {
            let relative = self.relative_twist(k);
            energy.kinetic_rigid += 0.5 * motion.twist.dot(&(motion.body.rigid * motion.twist));
            energy.kinetic_added += 0.5 * relative.dot(&(motion.body.added * relative));
            energy.potential += motion.body.potential(&self.world_pose(k), &self.balance.gravity);
        }
        energy.elastic = self.end_stops().map(|stop| stop.energy).sum();
        energy
    }

    /// Momentum and impulse.
    pub fn momentum(&self) -> Momentum {
        let mut momentum =
            Momentum { rigid: Vector6::zeros(), added: Vector6::zeros(), rigid_scale: [0.0; 2], total_scale: [0.0; 2] };
        for (k, motion) in self.equations.bodies.iter().enumerate() {
            let pose = self.world_pose(k);
            let rigid = pose.wrench_to_parent(&(motion.body.rigid * motion.twist));
            let added = pose.wrench_to_parent(&(motion.body.added * self.relative_twist(k)));
            momentum.rigid += rigid;
            momentum.added += added;
            add_lengths(&mut momentum.rigid_scale, &rigid);
            add_lengths(&mut momentum.total_scale, &(rigid + added));
        }
        momentum
    }

    /// Powers, by absolute twists.
    ///
    /// # Errors
    /// [`DynamicsError::Length`] where a load fits neither the scene nor "none".
    pub fn power(&self, loads: &Loads) -> Result<Power, DynamicsError> {
        let wrenches = self.body_wrenches(loads)?;
        let torques = self.joint_torques(loads)?;
        let twists = self.body_twists();
        let of_wrenches = |wrenches: &[Vector6<f64>]| twists.iter().zip(wrenches).map(|(v, f)| v.dot(f)).sum();
        let damping = DVector::from_iterator(self.joints(), self.end_stops().map(|stop| stop.damping));
        Ok(Power {
            drag: of_wrenches(&wrenches.drag),
            friction: self.qd.dot(&torques.friction),
            end_stop: self.qd.dot(&damping),
            flow: of_wrenches(&wrenches.flow),
            thrust: twists[0].dot(&wrenches.thrust),
            fins: twists[0].dot(&wrenches.fins),
            tether: twists[0].dot(&wrenches.tether),
            external: of_wrenches(&wrenches.external),
            joint_command: self.qd.dot(&torques.command),
        })
    }

    fn end_stops(&self) -> impl Iterator<Item = EndStop> {
        self.equations.joints.iter().enumerate().map(|(i, joint)| EndStop::new(joint, self.q[i], self.qd[i]))
    }
}

/// `state` as an observer sees it who drifts with the water since time 0; `current` in world axes, m/s.
pub fn seen_from_water(state: &State, current: &Vector3<f64>) -> State {
    let water = state.rotation.tr_mul(current);
    State {
        position: state.position - current * state.time,
        twist: stack(&(linear(&state.twist) - water), &angular(&state.twist)),
        ..state.clone()
    }
}

fn add_lengths(scale: &mut [f64; 2], momentum: &Vector6<f64>) {
    scale[0] += linear(momentum).norm();
    scale[1] += angular(momentum).norm();
}
