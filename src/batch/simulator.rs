//! The batched simulator without any task.

use std::borrow::Cow;

use super::blocks::{Blocks, Part, Run, Storage};
use super::inputs::{Applied, Inputs, check};
use super::monitor::{Bounds, WRONG, Watch};
use super::step::Switches;
use super::table::InstanceLoads;
use crate::control::Allocation;
use crate::description::Scene;
use crate::dynamics::aba::Loads;
use crate::dynamics::{ClosedForm, ClosedFormModel, Linearization, linearize};
use crate::error::SimulatorError;
use crate::hydro::{Thrusts, thrust_wrench};
use crate::integrate::{Attitude, Gains, Integrator};
use crate::lane::{Isa, Real};
use crate::lie::Vector6;
use crate::system::{Compiled, Factors, Flow, State, compile};

/// Steps of one instance that are made between two questions whether to go on: some tens of milliseconds.
const PART: usize = 1 << 16;

/// Number type of the kernel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Precision {
    /// f64, the default: carries every accuracy claim.
    Double,
    /// f32: twice as fast.
    Single,
}

impl Precision {
    /// Least magnitude that rounds to infinity.
    fn bound(self) -> f64 {
        match self {
            Precision::Double => f64::INFINITY,
            // Half a unit in the last place beyond the greatest.
            Precision::Single => f64::from(f32::MAX) + 2.0_f64.powi(103),
        }
    }

    /// Whether `x` is a finite number of this type.
    pub(super) fn holds(self, x: f64) -> bool {
        x.abs() < self.bound()
    }

    /// Whether all of them are. (Without a way out of the loop, which so looks at several at a time.)
    pub(super) fn holds_all(self, values: &[f64]) -> bool {
        let bound = self.bound();
        values.iter().fold(true, |all, x| all & (x.abs() < bound))
    }

    /// Distance of 1 to the next number.
    pub(super) fn epsilon(self) -> f64 {
        match self {
            Precision::Double => f64::EPSILON,
            Precision::Single => f64::from(f32::EPSILON),
        }
    }
}

/// How to simulate.
#[derive(Debug, Clone)]
pub struct SimulatorOptions {
    /// Number of instances.
    pub instances: usize,
    /// Step size, s.
    pub dt: f64,
    /// Integrator, by the names of [`Integrator::NAMES`].
    pub integrator: String,
    /// Gain of eq. 14, for the quaternion integrators, 1/s.
    pub gamma: f64,
    /// Bound on the estimated error of a piece of a step, for adaptive integrators: absolute in m and rad for the pose,
    /// absolute and relative for twist, q and q'. Below 8 times the precision's epsilon (1e-6 in single precision) it
    /// counts as that.
    pub tolerance: f64,
    /// Number type.
    pub precision: Precision,
    /// Most threads; as many as there are cores where `None`. Few instances use fewer.
    pub threads: Option<usize>,
}

impl Default for SimulatorOptions {
    fn default() -> Self {
        Self {
            instances: 1,
            dt: 0.01,
            integrator: "mk4".into(),
            gamma: Gains::DEFAULT.gamma,
            tolerance: Gains::DEFAULT.tolerance,
            precision: Precision::Double,
            threads: None,
        }
    }
}

/// Instances of one scene, stepped together; the result of each is independent of all others, of their number and of
/// the threads.
pub struct Simulator {
    scene: Scene,
    closed_form_model: ClosedFormModel,
    compiled: Compiled,
    allocation: Allocation,
    options: SimulatorOptions,
    integrator: Integrator,
    threads: usize,
    isa: Isa,
    storage: Box<dyn Storage>,
    /// `h |rate|` up to which the integrator is right.
    range: f64,
    watch: Watch,
}

impl Clone for Simulator {
    fn clone(&self) -> Self {
        Self {
            scene: self.scene.clone(),
            closed_form_model: self.closed_form_model.clone(),
            compiled: self.compiled.clone(),
            allocation: self.allocation.clone(),
            options: self.options.clone(),
            storage: self.storage.boxed_clone(),
            ..*self
        }
    }
}

impl Simulator {
    /// All instances at the scene's home: level at the world origin, at rest, joints at home.
    ///
    /// # Errors
    /// [`SimulatorError`] where an option is out of range or the scene does not compose.
    pub fn new(scene: Scene, options: SimulatorOptions) -> Result<Self, SimulatorError> {
        if options.instances == 0 {
            return Err(SimulatorError::NoInstances);
        }
        if !(options.dt > 0.0 && options.dt.is_finite()) {
            return Err(SimulatorError::Step { dt: options.dt });
        }
        if !(options.gamma >= 0.0 && options.gamma.is_finite()) {
            return Err(SimulatorError::Gamma { gamma: options.gamma });
        }
        if options.threads == Some(0) {
            return Err(SimulatorError::NoThreads);
        }
        if !(options.tolerance > 0.0 && options.tolerance.is_finite()) {
            return Err(SimulatorError::Tolerance { tolerance: options.tolerance });
        }
        let gains = Gains { gamma: options.gamma, tolerance: options.tolerance };
        let integrator = Integrator::named(&options.integrator, &gains).ok_or_else(|| {
            let known = Integrator::NAMES.map(|entry| entry.name).into();
            SimulatorError::UnknownIntegrator { name: options.integrator.clone(), known }
        })?;
        let isa = Isa::best_for(options.instances)?;
        let allocation = Allocation::new(&scene.vehicle)?;
        let compiled = compile(&scene);
        let state = State { q: scene.home(), ..State::default() };
        let flow = Flow::from(scene.water.current);
        let storage: Box<dyn Storage> = match options.precision {
            Precision::Double => {
                Box::new(Blocks::<f64>::new(&compiled, options.instances, &integrator, isa, &state, &flow)?)
            }
            Precision::Single => {
                Box::new(Blocks::<f32>::new(&compiled, options.instances, &integrator, isa, &state, &flow)?)
            }
        };
        let cores = || std::thread::available_parallelism().map_or(1, usize::from);
        Ok(Self {
            closed_form_model: ClosedFormModel::new(&scene)?,
            allocation,
            threads: options.threads.unwrap_or_else(cores),
            scene,
            compiled,
            options,
            integrator,
            isa,
            storage,
            range: integrator.range(),
            watch: Watch::default(),
        })
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The options it was made with.
    pub fn options(&self) -> &SimulatorOptions {
        &self.options
    }

    /// The compiled scene.
    pub fn compiled(&self) -> &Compiled {
        &self.compiled
    }

    /// The integrator.
    pub fn integrator(&self) -> Integrator {
        self.integrator
    }

    /// The scene composed, with the scene's own parameters.
    pub(super) fn closed_form_model(&self) -> &ClosedFormModel {
        &self.closed_form_model
    }

    pub(super) fn watch_mut(&mut self) -> &mut Watch {
        &mut self.watch
    }

    /// `h |rate|` up to which the integrator is right: [`Integrator::range`].
    pub fn range(&self) -> f64 {
        self.range
    }

    /// What motions are watched for leaving, as long as they are.
    fn bounds(&self) -> Option<Bounds> {
        // After a warning of the step itself only what is no longer finite is news.
        let bounds = if self.watch.has_warned() {
            Bounds { stiffness: f64::INFINITY, error: f64::INFINITY }
        } else {
            Bounds { stiffness: self.range, error: WRONG }
        };
        self.watch.watches().then_some(bounds)
    }

    /// Number of instances.
    pub fn instances(&self) -> usize {
        self.options.instances
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.compiled.links.len()
    }

    /// Thruster allocation.
    pub fn allocation(&self) -> &Allocation {
        &self.allocation
    }

    /// Instruction set that the kernel runs on.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// Most threads.
    pub fn threads(&self) -> usize {
        self.threads
    }

    /// Bytes of memory per instance.
    pub fn bytes_per_instance(&self) -> usize {
        self.storage.bytes_per_instance()
    }

    /// State of instance `i`.
    pub fn state(&self, i: usize) -> State {
        self.storage.state(i)
    }

    /// Sets the state of instance `i`.
    pub fn set_state(&mut self, i: usize, state: &State) {
        self.storage.set_state(i, state);
    }

    /// Quaternion of instance `i` as a quaternion integrator keeps it, which need not be of unit length.
    pub fn kept_quaternion(&self, i: usize) -> Option<[f64; 4]> {
        self.kept_attitude(i).filter(|_| self.integrator.attitude() == Attitude::Quaternion)
    }

    /// Coordinates of the attitude of instance `i` that the integrator keeps, if it does.
    pub(super) fn kept_attitude(&self, i: usize) -> Option<[f64; 4]> {
        self.storage.attitude(i)
    }

    /// Sets those coordinates.
    pub(super) fn set_kept_attitude(&mut self, i: usize, attitude: &[f64; 4]) {
        self.storage.set_attitude(i, attitude);
    }

    /// `h |lambda|` of the fastest rate that the motion of instance `i` excites: the step times 1/s. An explicit method
    /// of order 4 is unstable beyond about 2.8, and inaccurate well below.
    ///
    /// Estimated from how the stages of a step differ, over some thirty steps, the last ones counting most. What moves
    /// by less than rounding does not count. 0 before the first step after [`Self::set_state`], and for integrators of
    /// one stage, which have nothing to compare. Adaptive integrators count with the pieces that they choose.
    pub fn stiffness(&self, i: usize) -> f64 {
        self.storage.watched(i, self.options.dt).stiffness
    }

    /// Share of its speed that the last thirty steps or so of instance `i` got wrong, estimated for the methods of orders 2
    /// to 4 from how a step's stages (`ros2`: its fine and its coarse result) differ: the velocity error summed over
    /// them, by the greatest speed among them; or what spinning got wrong in ten seconds, if that is more. One-stage
    /// methods count spinning alone; adaptive ones keep to a tolerance and have 0.
    pub fn step_error(&self, i: usize) -> f64 {
        self.storage.watched(i, self.options.dt).error
    }

    /// Flow of the water at instance `i`.
    pub fn flow(&self, i: usize) -> Flow {
        self.storage.flow(i)
    }

    /// Sets the flow of the water at instance `i`; its velocity then changes by the acceleration times the time.
    ///
    /// Where the scene has no gravity, its acceleration must be 0: weight and buoyancy are not compiled then.
    pub fn set_flow(&mut self, i: usize, flow: impl Into<Flow>) {
        self.storage.set_flow(i, &flow.into());
    }

    /// Steps all instances `substeps` times under held inputs.
    ///
    /// # Errors
    /// [`SimulatorError`] where an input has the wrong length or a number that is not finite; nothing has changed then.
    pub fn step(&mut self, inputs: &Inputs, substeps: usize) -> Result<(), SimulatorError> {
        self.step_while(inputs, substeps, &mut || true).map(drop)
    }

    /// As [`Self::step`], but asks `go_on` between parts of the work and stops where it says no; whether it said no
    /// nowhere. The parts make no difference to the result.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn step_while(
        &mut self,
        inputs: &Inputs,
        substeps: usize,
        go_on: &mut dyn FnMut() -> bool,
    ) -> Result<bool, SimulatorError> {
        let (integrator, h, threads) = (self.integrator, self.options.dt, self.threads);
        let bounds = self.bounds();
        let applied = Applied::new(inputs, &self.scene, &self.allocation, &self.options)?;
        let switches = applied.switches();
        let part = (PART / self.options.instances).max(1);
        let mut before = 0;
        while before < substeps {
            if before > 0 && !go_on() {
                return Ok(false);
            }
            let substeps = part.min(substeps - before);
            let run = Run { integrator, h, substeps, before, switches, threads, bounds };
            let sighting = self.storage.step(&run, (before == 0).then_some(&applied));
            self.watch.sighted(sighting);
            before += substeps;
        }
        Ok(true)
    }

    /// Every number of all instances, instance by instance: [`Self::load`] gives them back bit for bit.
    pub fn save(&self) -> Vec<f64> {
        (0..self.instances()).flat_map(|i| self.storage.column(i)).collect()
    }

    /// Sets every number of all instances to what [`Self::save`] of a like simulator gave.
    ///
    /// # Errors
    /// [`SimulatorError::Length`] if it was not a like one; nothing has changed then.
    pub fn load(&mut self, numbers: &[f64]) -> Result<(), SimulatorError> {
        let width = self.storage.column_len();
        let (expected, got) = (self.instances() * width, numbers.len());
        if got != expected {
            return Err(SimulatorError::Length { name: "saved simulator", expected, got });
        }
        for (i, column) in numbers.chunks_exact(width).enumerate() {
            self.storage.set_column(i, column);
        }
        Ok(())
    }

    /// Hands chunks of instances to `work`, each with its item; [`Part::step`] makes `substeps` steps of one.
    pub(super) fn visit<T: Real, I: Send>(
        &mut self,
        substeps: usize,
        switches: Switches,
        items: impl ExactSizeIterator<Item = I> + Send,
        work: impl Fn(&mut Part<'_, T>, I) + Sync,
    ) {
        let (integrator, h, threads) = (self.integrator, self.options.dt, self.threads);
        let run = Run { integrator, h, substeps, before: 0, switches, threads, bounds: self.bounds() };
        let sighting = self.blocks().visit(&run, items, work);
        self.watch.sighted(sighting);
    }

    /// All instances, for those who know the precision.
    pub(super) fn blocks<T: Real>(&mut self) -> &mut Blocks<T> {
        self.storage.as_any().downcast_mut().expect("the precision of the options")
    }

    /// `[V'; q'']` of all instances, (N, 6 + n), by the articulated-body form.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn forward_dynamics(&mut self, inputs: &Inputs) -> Result<Vec<f64>, SimulatorError> {
        let applied = Applied::new(inputs, &self.scene, &self.allocation, &self.options)?;
        Ok(self.storage.accelerations(&applied))
    }

    /// Factors on the parameters of instance `i`.
    pub fn factors(&self, i: usize) -> Factors<f64> {
        self.storage.factors(i)
    }

    /// Share of its thrust that each thruster with dynamics of instance `i` has lost.
    pub(super) fn losses(&self, i: usize) -> Thrusts {
        self.storage.losses(i)
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

    /// Sets those of instance `i`, which are sound.
    pub(super) fn set_factors_of(&mut self, i: usize, factors: &Factors<f64>) {
        self.storage.set_factors(i, factors);
    }

    /// The composed scene with the parameters of instance `i`.
    pub fn closed_form_model_of(&self, i: usize) -> Cow<'_, ClosedFormModel> {
        let factors = self.factors(i);
        if factors == Factors::ONE {
            return Cow::Borrowed(&self.closed_form_model);
        }
        // A scene that composed does so with other masses too.
        let varied = ClosedFormModel::new(&self.scene.varied(factors.of_bodies()));
        varied.map_or(Cow::Borrowed(&self.closed_form_model), Cow::Owned)
    }

    /// Reads the closed form `W F + L tau = M [V'; q''] + C [V; q']` of instance `i`. `[HC eq. 13]`
    pub fn closed_form<R>(&self, i: usize, read: impl FnOnce(&ClosedForm) -> R) -> R {
        read(&self.closed_form_model_of(i).at(&self.state(i), self.flow(i)))
    }

    /// Linearizes instance `i` about its state under `inputs` (servos off).
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn linearize(&self, inputs: &Inputs, i: usize) -> Result<Linearization, SimulatorError> {
        let applied = Applied::new(inputs, &self.scene, &self.allocation, &self.options)?;
        let mut given = InstanceLoads::default();
        applied.fill(i, self.factors(i).thrust, &mut given);
        let mut loads = Loads::none();
        loads.torque = given.torque;
        loads.on_links = applied.switches().on_links;
        for (k, link) in self.compiled.links.iter().enumerate() {
            loads.links[k] = link.co_adjoint_apply_inverse(Vector6::from_array(given.links[k]));
        }
        let (state, flow) = (self.state(i), self.flow(i));
        let scene = self.scene.varied(self.factors(i).of_bodies());
        // As if thrusts had settled: about a motion that lasts.
        let mut wrench = given.wrench;
        if let Some(propulsion) = self.propulsion(i, &given.command) {
            let thrusters = &self.compiled.system.thrusters;
            let settled = propulsion.settled(thrusters, self.twist_through_water(i));
            let thrust: [f64; 6] = thrust_wrench(thrusters, &settled).to_array();
            wrench = std::array::from_fn(|k| wrench[k] + thrust[k]);
        }
        Ok(linearize(&compile(&scene).system, &state, &flow, &wrench, &given.fins, &loads))
    }

    /// Checks that `values` are `width` finite numbers per instance; `name` appears in errors.
    ///
    /// # Errors
    /// [`SimulatorError::Length`] or [`SimulatorError::NotFinite`].
    pub fn check_rows(&self, name: &'static str, values: &[f64], width: usize) -> Result<(), SimulatorError> {
        check(name, Some(values), width, &self.options)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn single_precision_holds_what_does_not_round_to_infinity() {
        let border = f64::from(f32::MAX) + 0.5 * (f64::from(f32::MAX) - f64::from(f32::MAX.next_down()));
        for x in
            [border, border.next_down(), border.next_up(), 0.0, f64::from(f32::MAX), 1e300, f64::INFINITY, f64::NAN]
        {
            for x in [x, -x] {
                assert_eq!(Precision::Single.holds(x), (x as f32).is_finite(), "{x}");
                assert_eq!(Precision::Double.holds(x), x.is_finite(), "{x}");
            }
        }
    }
}
