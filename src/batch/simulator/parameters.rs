//! Single instances: scene, factors, and the closed form and linearization with them.

use std::borrow::Cow;

use super::Simulator;
use crate::batch::storage::inputs::{CheckedInputs, Inputs};
use crate::control::Allocation;
use crate::description::Scene;
use crate::dynamics::aba::ArmLoads;
use crate::dynamics::{ClosedForm, ClosedFormModel, Linearization, linearize};
use crate::error::SimulatorError;
use crate::hydro::thrust_wrench;
use crate::lie::Vector6;
use crate::system::{Compiled, Factors, compile};

impl Simulator {
    /// Scenes of all instances, where they differ.
    pub fn scenes(&self) -> Option<&[Scene]> {
        self.own.as_ref().map(|own| own.scenes())
    }

    /// Scene of instance `i`.
    pub fn scene_of(&self, i: usize) -> &Scene {
        self.scenes().map_or(&self.scene, |scenes| &scenes[i])
    }

    /// Scene of instance `i`, compiled.
    pub(super) fn compiled_of(&self, i: usize) -> Cow<'_, Compiled> {
        self.scenes().map_or(Cow::Borrowed(&self.compiled), |scenes| Cow::Owned(compile(&scenes[i])))
    }

    /// Thruster allocation of instance `i`.
    pub fn allocation_of(&self, i: usize) -> &Allocation {
        self.own.as_ref().map_or(&self.allocation, |own| own.allocation(i))
    }

    /// Factors on the parameters of instance `i`.
    pub fn factors(&self, i: usize) -> Factors<f64> {
        self.storage.factors(i)
    }

    /// Sets the factors on the parameters of all instances, for domain randomisation; they stay through `reset`.
    ///
    /// # Errors
    /// [`SimulatorError::Factor`] where one is not finite or negative, or a mass is 0; nothing has changed then.
    pub fn set_factors(&mut self, factors: &[Factors<f64>]) -> Result<(), SimulatorError> {
        let (expected, got) = (self.options.instances, factors.len());
        if got != expected {
            return Err(SimulatorError::Length { name: "factors", expected, got });
        }
        for (instance, factors) in factors.iter().enumerate() {
            for (name, value) in Factors::<f64>::NAMES.into_iter().zip(factors.to_array()) {
                if !(value.is_finite() && value >= 0.0 && (name != "mass" || value > 0.0)) {
                    return Err(SimulatorError::Factor { name, instance, value });
                }
            }
        }
        for (i, factors) in factors.iter().enumerate() {
            self.storage.set_factors(i, factors);
        }
        Ok(())
    }

    /// Sets the factors of instance `i`, which the caller has checked.
    pub(in crate::batch) fn set_factors_of(&mut self, i: usize, factors: &Factors<f64>) {
        self.storage.set_factors(i, factors);
    }

    /// Sets the numbers that instance `i` has of its own, of a simulator with samples, to the numbers of a scene of their structure.
    pub(in crate::batch) fn set_own(&mut self, i: usize, compiled: &Compiled) {
        self.storage.set_own(i, compiled);
    }

    /// The closed form with the parameters of instance `i`.
    pub fn closed_form_model_of(&self, i: usize) -> Cow<'_, ClosedFormModel> {
        let factors = self.factors(i);
        if factors == Factors::ONE && self.own.is_none() {
            return Cow::Borrowed(&self.closed_form_model);
        }
        // Composition does not depend on the masses.
        let varied = ClosedFormModel::new(&self.scene_of(i).varied(factors.of_bodies()));
        varied.map_or(Cow::Borrowed(&self.closed_form_model), Cow::Owned)
    }

    /// Evaluates the closed form `W F + L tau = M [V'; q''] + C [V; q']` of instance `i`. `[HC eq. 13]`
    pub fn closed_form<R>(&self, i: usize, read: impl FnOnce(&ClosedForm) -> R) -> R {
        read(&self.closed_form_model_of(i).at(&self.state(i), self.flow(i)))
    }

    /// Linearizes instance `i` about its state under `inputs`, servos off, thrusts of thrusters with dynamics settled.
    /// Prescribed joints keep the accelerations of their targets, whatever the state and the torques.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn linearize(&self, inputs: &Inputs, i: usize) -> Result<Linearization, SimulatorError> {
        let inputs = CheckedInputs::new(inputs, &self.scene, &self.allocation, self.own.as_ref(), &self.options)?;
        Ok(self.linearize_checked(&inputs, i))
    }

    pub(super) fn linearize_checked(&self, inputs: &CheckedInputs, i: usize) -> Linearization {
        let given = inputs.loads(i, self.factors(i).thrust);
        let mut loads = ArmLoads::none();
        loads.torque = given.torque;
        loads.on_links = inputs.active_loads().link_wrenches;
        let compiled = self.compiled_of(i);
        for (k, link) in compiled.links.iter().enumerate() {
            loads.links[k] = link.co_adjoint_apply_inverse(Vector6::from_array(given.links[k]));
        }
        let (state, flow) = (self.state(i), self.flow(i));
        let mut scene = self.scene_of(i).varied(self.factors(i).of_bodies());
        if self.compiled.system.prescribed {
            (loads.terms, loads.target) = (4, given.target);
            scene.joints_mut().for_each(|joint| joint.servo = None);
        }
        // Thrusts as settled: a motion that lasts.
        let mut wrench = given.wrench;
        if let Some(propulsion) = self.propulsion(i, &given.command) {
            let thrusters = &compiled.system.thrusters;
            let settled = propulsion.settled(thrusters, self.twist_through_water(i));
            let thrust: [f64; 6] = thrust_wrench(thrusters, &settled).to_array();
            wrench = std::array::from_fn(|k| wrench[k] + thrust[k]);
        }
        linearize(&compile(&scene).system, &state, &flow, &wrench, &given.fins, &loads)
    }
}
