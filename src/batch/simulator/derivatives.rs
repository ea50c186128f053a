//! Derivatives of steps in local coordinates.
//!
//! State: `[xi; dq; dV; dq'; dT]` with the pose `T exp(xi)`, the absolute body twist V and the thrusts of thrusters with dynamics.

use nalgebra as na;

use super::Simulator;
use super::coordinates::{Argument, Coordinates, PAYLOAD, Product};
use super::gradients::Gradients;
use super::states::orthonormalised;
use crate::batch::options::{Precision, SimulatorOptions};
use crate::batch::stepping::blocks::{Blocks, Storage};
use crate::batch::stepping::derivative::Duals;
use crate::batch::stepping::parameters::StepSettings;
use crate::batch::storage::inputs::{ActiveLoads, CheckedInputs, Inputs};
use crate::error::SimulatorError;
use crate::integrate::{Integrator, IntegratorKind};
use crate::lane::Isa;
use crate::limits::memory;
use crate::system::Factors;

/// Jacobians of steps.
#[derive(Debug, Clone, PartialEq)]
pub struct StepJacobians {
    /// Arguments in the order of the columns, with their widths.
    pub arguments: Vec<(Argument, usize)>,
    /// Coordinates of the state.
    pub size: usize,
    /// `(N, size, sum of widths)`, row-major.
    pub numbers: Vec<f64>,
}

impl Simulator {
    /// Coordinates of the state: `2 (6 + n)`, and one for each thruster with dynamics.
    pub fn state_size(&self) -> usize {
        2 * (6 + self.joints()) + self.compiled.system.thrusters.len()
    }

    /// Arguments of a step under these inputs, with the widths of their coordinates: the state, each input given, and parameters
    /// where their number is not 0.
    pub fn arguments(&self, inputs: &Inputs, parameters: usize) -> Vec<(Argument, usize)> {
        let width = |input: Option<&[f64]>| input.map_or(0, |numbers| numbers.len() / self.instances());
        let all = [
            (Argument::State, self.state_size()),
            (Argument::Thrust, width(inputs.thrust)),
            (Argument::Fin, width(inputs.fin)),
            (Argument::Wrench, width(inputs.wrench)),
            (Argument::JointTorque, width(inputs.joint_torque)),
            (Argument::JointTarget, width(inputs.joint_target)),
            (Argument::External, width(inputs.external)),
            (Argument::PoseTarget, width(inputs.pose_target) / 2),
            (Argument::Parameters, parameters),
        ];
        all.into_iter().filter(|(_, width)| *width > 0).collect()
    }

    /// Jacobians of `substeps` steps under held inputs with respect to state, inputs and these parameters (indices into
    /// [`Factors::NAMES`]). The simulator is not stepped. In single precision: Jacobians of the step in double precision from the
    /// present state.
    ///
    /// # Errors
    /// As [`Self::step`]; [`SimulatorError::DerivativeLanes`], [`SimulatorError::DerivativeIntegrator`], and
    /// [`SimulatorError::OutOfMemory`].
    pub fn step_jacobians(
        &mut self,
        inputs: &Inputs,
        substeps: usize,
        parameters: &[usize],
    ) -> Result<StepJacobians, SimulatorError> {
        let arguments = self.arguments(inputs, parameters.len());
        let numbers = self.differentiate(inputs, substeps, parameters, &arguments, Product::Jacobians)?;
        Ok(StepJacobians { arguments, size: self.state_size(), numbers })
    }

    /// Product of the Jacobian of [`Self::step_jacobians`] with a tangent for each instance, `(N, sum of widths)`: the tangents of
    /// the next states, `(N, size)`.
    ///
    /// # Errors
    /// As [`Self::step_jacobians`].
    pub fn step_jvp(
        &mut self,
        inputs: &Inputs,
        substeps: usize,
        parameters: &[usize],
        tangents: &[f64],
    ) -> Result<Vec<f64>, SimulatorError> {
        let arguments = self.arguments(inputs, parameters.len());
        let width = arguments.iter().map(|(_, width)| width).sum();
        self.check_rows("tangents", tangents, width)?;
        self.differentiate(inputs, substeps, parameters, &arguments, Product::Tangents(tangents))
    }

    /// Product of a cotangent for each instance, `(N, size)`, with the Jacobian of [`Self::step_jacobians`]: the cotangents of the
    /// arguments, `(N, sum of widths)`. By the adjoint of the step, in a few times its time. Each thread records
    /// the steps of the instances in one set of lanes.
    ///
    /// # Errors
    /// As [`Self::step_jacobians`].
    pub fn step_vjp(
        &mut self,
        inputs: &Inputs,
        substeps: usize,
        parameters: &[usize],
        cotangents: &[f64],
    ) -> Result<Vec<f64>, SimulatorError> {
        let arguments = self.arguments(inputs, parameters.len());
        self.check_rows("cotangents", cotangents, self.state_size())?;
        self.differentiate(inputs, substeps, parameters, &arguments, Product::Cotangents(cotangents))
    }

    fn differentiate(
        &mut self,
        inputs: &Inputs,
        substeps: usize,
        parameters: &[usize],
        arguments: &[(Argument, usize)],
        product: Product,
    ) -> Result<Vec<f64>, SimulatorError> {
        if self.options.precision == Precision::Single {
            return self.in_double_precision()?.differentiate(inputs, substeps, parameters, arguments, product);
        }
        if !Isa::available().any(Isa::is_wide) {
            return Err(SimulatorError::DerivativeLanes);
        }
        if self.integrator.needs_baseline_terms() {
            let production = Integrator::NAMES.into_iter().filter(|entry| entry.kind == IntegratorKind::Production);
            let (name, known) = (self.options.integrator.clone(), production.map(|entry| entry.name).collect());
            return Err(SimulatorError::DerivativeIntegrator { name, known });
        }
        let (size, settings) = (self.state_size(), self.settings(substeps, ActiveLoads::default()));
        let Self { storage, scene, allocation, own, options, .. } = self;
        let inputs = CheckedInputs::new(inputs, scene, allocation, own.as_ref(), options)?;
        let settings = StepSettings { active: inputs.active_loads(), limits: None, ..settings };
        let coordinates =
            Coordinates { inputs: &inputs, fixed: scene.vehicle.fixed, parameters, arguments, size, product };
        // Results, and their copies by arguments.
        memory::check(
            "the derivatives (take fewer instances)",
            &[2, options.instances, coordinates.width(), size_of::<f64>()],
        )?;
        let payload = parameters.contains(&PAYLOAD);
        let blocks: &mut Blocks<f64> = storage.as_any().downcast_mut().expect("the precision of the options");
        if let Product::Cotangents(of) = product {
            let gradients = Gradients { coordinates: &coordinates, of };
            let by = [!parameters.is_empty(), payload];
            return Ok(blocks.pull_back(&settings, &inputs, &gradients, by, coordinates.width())?);
        }
        Ok(blocks.differentiate::<Duals>(&settings, &inputs, &coordinates, payload, coordinates.width()))
    }

    /// A copy in double precision of a simulator in single precision, made on first use. It gets the present numbers of the
    /// instances; rotations are made orthonormal.
    pub(super) fn in_double_precision(&mut self) -> Result<&mut Self, SimulatorError> {
        let mut double = match self.in_double.take() {
            Some(double) => double,
            None => {
                let options = SimulatorOptions {
                    precision: Precision::Double,
                    threads: Some(self.threads),
                    error_estimate: Some(false),
                    ..self.options.clone()
                };
                let scenes = self.scenes().map(<[_]>::to_vec);
                let mut double = Self::of(self.scene.clone(), scenes, &self.samples, options)?;
                // No tolerance below the minimum of single precision.
                double.integrator = self.integrator.at_ratio(1.0, 1.0, Precision::Single.epsilon());
                Box::new(double)
            }
        };
        let single = self.blocks::<f32>();
        let layout = single.parts().0.clone();
        let positions = (0..3).map(|k| [layout.position + k, layout.position + 3 + k]);
        let sums = positions.chain((0..layout.rests).map(|k| [layout.q + k, layout.q_rest + k]));
        for i in 0..double.instances() {
            let mut column = single.column(i);
            for [sum, rest] in sums.clone() {
                column[sum] += std::mem::take(&mut column[rest]);
            }
            let rotation = &mut column[layout.rotation..][..9];
            let orthonormal = orthonormalised(&na::Matrix3::from_row_slice(rotation));
            rotation.copy_from_slice(orthonormal.transpose().as_slice());
            column.drain(layout.q_rest..layout.q_rest + layout.rests);
            double.storage.set_column(i, &column);
        }
        // Numbers of own scenes are in double precision already.
        if double.own.is_none() {
            double.blocks::<f64>().set_own_numbers(single);
        }
        Ok(self.in_double.insert(double))
    }
}

/// Index of a parameter among [`Factors::NAMES`].
///
/// # Errors
/// [`SimulatorError::UnknownParameter`].
pub fn parameter(name: &str) -> Result<usize, SimulatorError> {
    let names = Factors::<f64>::NAMES;
    let found = names.iter().position(|known| *known == name);
    found.ok_or_else(|| SimulatorError::UnknownParameter { name: name.into(), known: names.into() })
}
