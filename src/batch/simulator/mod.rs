//! The batched simulator of one scene, or of scenes of one structure, without a task.

pub mod applied_loads;
pub mod coordinates;
pub mod derivatives;
pub mod error_estimate;
mod gradients;
mod instances;
mod parameters;
pub mod states;

use crate::batch::monitoring::step_monitor::StepMonitor;
use crate::batch::options::{Precision, SimulatorOptions};
use crate::batch::stepping::blocks::{Blocks, Storage};
use crate::batch::stepping::chunk::PhysicsChunk;
use crate::batch::stepping::companion::Follow;
use crate::batch::stepping::parameters::StepSettings;
use crate::batch::storage::inputs::{ActiveLoads, CheckedInputs, Inputs, check};
use crate::batch::storage::own_scenes::OwnScenes;
use crate::control::Allocation;
use crate::description::Scene;
use crate::dynamics::ClosedFormModel;
use crate::error::SimulatorError;
use crate::integrate::{Attitude, Gains, Integrator};
use crate::lane::{Isa, Real};
use crate::system::{Compiled, Flow, State, compile};

/// Steps of instances in a portion, after which the caller may interrupt: some tens of milliseconds.
const PORTION: usize = 1 << 16;

/// Instances of one scene, stepped together. The result of each is independent of the others, of their number and of the
/// threads.
pub struct Simulator {
    /// The scene of all instances, or of the first.
    scene: Scene,
    /// The scenes of all instances, where they differ.
    own: Option<OwnScenes>,
    /// The closed form of the scene without factors.
    pub(super) closed_form_model: ClosedFormModel,
    compiled: Compiled,
    /// Scenes that differ in the numbers that [`Self::set_own`] sets.
    samples: Vec<Compiled>,
    allocation: Allocation,
    options: SimulatorOptions,
    integrator: Integrator,
    threads: usize,
    isa: Isa,
    storage: Box<dyn Storage>,
    /// See [`Self::in_double_precision`].
    in_double: Option<Box<Self>>,
    /// Maximum `h |lambda|` at which the integrator is accurate: [`Integrator::range`].
    pub(super) range: f64,
    pub(super) monitor: StepMonitor,
}

impl Clone for Simulator {
    fn clone(&self) -> Self {
        Self {
            scene: self.scene.clone(),
            own: self.own.clone(),
            closed_form_model: self.closed_form_model.clone(),
            compiled: self.compiled.clone(),
            allocation: self.allocation.clone(),
            options: self.options.clone(),
            samples: self.samples.clone(),
            storage: self.storage.boxed_clone(),
            in_double: None,
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
        Self::of(scene, None, &[], options)
    }

    /// Each instance at its own scene's home. The scenes have the same structure: they differ only in numbers, and no number is 0
    /// in one where its term is left out.
    ///
    /// # Errors
    /// As [`Self::new`]; [`SimulatorError::Scenes`] where there is not one scene for each instance, and
    /// [`SimulatorError::Structure`] where scenes differ in structure.
    pub fn with_scenes(scenes: Vec<Scene>, options: SimulatorOptions) -> Result<Self, SimulatorError> {
        match &scenes[..] {
            [] => Err(SimulatorError::NoInstances),
            [first, ..] if scenes.len() == options.instances => Self::of(first.clone(), Some(scenes), &[], options),
            _ => Err(SimulatorError::Scenes { scenes: scenes.len(), instances: options.instances }),
        }
    }

    /// Instances of `scene`, or of `scenes`, one for each. With `samples`, scenes of one structure, [`Self::set_own`] sets the
    /// numbers that differ between these; until then all instances have the numbers of the first sample.
    pub(in crate::batch) fn of(
        scene: Scene,
        scenes: Option<Vec<Scene>>,
        samples: &[Compiled],
        options: SimulatorOptions,
    ) -> Result<Self, SimulatorError> {
        let SimulatorOptions { instances, dt, gamma, tolerance, .. } = options;
        let refusals = [
            (instances == 0, SimulatorError::NoInstances),
            (!(dt > 0.0 && dt.is_finite()), SimulatorError::Step { dt }),
            (!(gamma >= 0.0 && gamma.is_finite()), SimulatorError::Gamma { gamma }),
            (options.threads == Some(0), SimulatorError::NoThreads),
            (!(tolerance > 0.0 && tolerance.is_finite()), SimulatorError::Tolerance { tolerance }),
        ];
        if let Some((_, error)) = refusals.into_iter().find(|(refused, _)| *refused) {
            return Err(error);
        }
        let gains = Gains { gamma, tolerance };
        let integrator = Integrator::named(&options.integrator, &gains).ok_or_else(|| {
            let known = Integrator::NAMES.map(|entry| entry.name).into();
            SimulatorError::UnknownIntegrator { name: options.integrator.clone(), known }
        })?;
        let isa = Isa::best_for(options.instances)?;
        let allocation = Allocation::new(&scene.vehicle)?;
        let compiled = compile(&scene);
        let state = State { q: scene.home(), ..State::default() };
        let flow = Flow::from(scene.water.current);
        let scenes = scenes.filter(|scenes| scenes.iter().any(|other| *other != scene));
        let own = scenes.map(|scenes| OwnScenes::new(scenes, &compiled)).transpose()?;
        let compile_own = |i: usize| match &own {
            Some(own) => compile(&own.scenes()[i]),
            None => samples[i].clone(),
        };
        let count = own.as_ref().map_or(samples.len(), |own| own.scenes().len());
        let of_each: Option<(usize, &dyn Fn(usize) -> Compiled)> = (count > 0).then_some((count, &compile_own));
        let of_all = samples.first().unwrap_or(&compiled);
        let (start, follow) = ((&state, &flow), Follow::of(options.error_estimate, options.instances));
        let storage: Box<dyn Storage> = match options.precision {
            Precision::Double => {
                Box::new(Blocks::<f64>::new(of_all, of_each, options.instances, &integrator, isa, start, follow)?)
            }
            Precision::Single => {
                Box::new(Blocks::<f32>::new(of_all, of_each, options.instances, &integrator, isa, start, follow)?)
            }
        };
        let cores = || std::thread::available_parallelism().map_or(1, usize::from);
        let mut simulator = Self {
            closed_form_model: ClosedFormModel::new(&scene)?,
            allocation,
            threads: options.threads.unwrap_or_else(cores),
            scene,
            own,
            compiled,
            samples: samples.to_vec(),
            options,
            integrator,
            isa,
            storage,
            in_double: None,
            range: integrator.range(),
            monitor: StepMonitor::default(),
        };
        if simulator.own.is_some() {
            simulator.reset();
        }
        Ok(simulator)
    }

    /// The scene of all instances, or of the first where they differ.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Options with which the simulator was made.
    pub fn options(&self) -> &SimulatorOptions {
        &self.options
    }

    /// [`Self::scene`], compiled.
    pub fn compiled(&self) -> &Compiled {
        &self.compiled
    }

    /// Integrator by the name in the options, at their step and tolerance.
    pub fn integrator(&self) -> Integrator {
        self.integrator
    }

    /// Number of instances.
    pub fn instances(&self) -> usize {
        self.options.instances
    }

    /// Number of joints, fixtures included.
    pub fn joints(&self) -> usize {
        self.compiled.links.len()
    }

    /// Number of the robot's joints: the first ones.
    pub fn robot_joints(&self) -> usize {
        self.compiled.links.len() - self.scene().fixtures.len()
    }

    /// Thruster allocation of [`Self::scene`].
    pub fn allocation(&self) -> &Allocation {
        &self.allocation
    }

    /// Instruction set of the kernels.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// Maximum number of threads.
    pub fn threads(&self) -> usize {
        self.threads
    }

    /// Bytes of memory per instance, including the copy in double precision that derivatives in single precision make.
    pub fn bytes_per_instance(&self) -> usize {
        let in_double = self.in_double.as_ref().map_or(0, |double| double.bytes_per_instance());
        self.storage.bytes_per_instance() + in_double
    }

    /// State of instance `i`.
    pub fn state(&self, i: usize) -> State {
        self.storage.state(i)
    }

    /// Sets the state of instance `i`.
    pub fn set_state(&mut self, i: usize, state: &State) {
        self.storage.set_state(i, state);
    }

    /// Quaternion of instance `i` in the state of a quaternion integrator, not necessarily of unit length.
    pub fn kept_quaternion(&self, i: usize) -> Option<[f64; 4]> {
        self.storage.attitude(i).filter(|_| self.integrator.attitude() == Attitude::Quaternion)
    }

    /// `h |lambda|` of the fastest rate that the motion of instance `i` excites: the step times 1/s. An explicit method
    /// of order 4 is unstable beyond about 2.8, and inaccurate well below.
    ///
    /// Estimated from the differences between the stages of a step, over some thirty steps, the last ones counting most.
    /// Motion within rounding does not count. 0 before the first step after [`Self::set_state`], and for integrators of one
    /// stage, which have no differences. For adaptive integrators h is the sub-interval that they choose.
    pub fn stiffness(&self, i: usize) -> f64 {
        self.storage.step_quality(i, self.options.dt).stiffness
    }

    /// Relative velocity error of the last thirty steps or so of instance `i`: the sum of the velocity errors over the
    /// maximum speed, estimated for the methods of orders 2 to 4 from the differences between a step's stages (`ros2`:
    /// between its fine and its coarse result); or the error of spinning in ten seconds, if that is greater. One-stage
    /// methods have only the error of spinning; adaptive ones have 0, as they control their error.
    pub fn step_error(&self, i: usize) -> f64 {
        self.storage.step_quality(i, self.options.dt).error
    }

    /// Flow of the water at instance `i`.
    pub fn flow(&self, i: usize) -> Flow {
        self.storage.flow(i)
    }

    /// Sets the flow of the water at instance `i`; its velocity then changes at its acceleration.
    ///
    /// Where the scene has no gravity, the acceleration must be 0: weight and buoyancy are not compiled then.
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

    /// As [`Self::step`], but calls `go_on` between portions of the steps and stops where it returns false. Returns true
    /// where all steps are done. The portions make no difference to the result.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn step_while(
        &mut self,
        inputs: &Inputs,
        substeps: usize,
        go_on: &mut dyn FnMut() -> bool,
    ) -> Result<bool, SimulatorError> {
        let inputs = CheckedInputs::new(inputs, &self.scene, &self.allocation, self.own.as_ref(), &self.options)?;
        let settings = self.settings(substeps, inputs.active_loads());
        let portion = (PORTION / self.options.instances).max(1);
        let mut before = 0;
        while before < substeps {
            if before > 0 && !go_on() {
                return Ok(false);
            }
            let settings = StepSettings { substeps: portion.min(substeps - before), before, ..settings };
            let violations = self.storage.step(&settings, (before == 0).then_some(&inputs));
            self.monitor.record(&violations);
            before += settings.substeps;
        }
        Ok(true)
    }

    /// Settings of a call of as many steps, monitored.
    pub(super) fn settings(&self, substeps: usize, active: ActiveLoads) -> StepSettings {
        let Self { integrator, threads, .. } = *self;
        let limits = self.monitor.limits(self.range, self.storage.follows_all());
        StepSettings { integrator, h: self.options.dt, substeps, before: 0, total: substeps, active, threads, limits }
    }

    /// Every number of all instances, instance by instance: [`Self::load`] restores them bit for bit.
    pub fn save(&self) -> Vec<f64> {
        (0..self.instances()).flat_map(|i| self.storage.column(i)).collect()
    }

    /// Count of an instance's numbers in [`Self::save`].
    pub fn save_len(&self) -> usize {
        self.storage.column_len()
    }

    /// Restores the numbers that [`Self::save`] of a simulator with the same scene and options returned.
    ///
    /// # Errors
    /// [`SimulatorError::Length`] if their number differs; nothing has changed then.
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

    /// Calls `work` on each chunk of instances with its item; [`PhysicsChunk::step`] makes `substeps` steps of a chunk.
    pub(super) fn for_each_chunk<T: Real, I: Send>(
        &mut self,
        substeps: usize,
        active: ActiveLoads,
        items: impl ExactSizeIterator<Item = I> + Send,
        work: impl Fn(&mut PhysicsChunk<'_, T>, I) + Sync,
    ) {
        let settings = self.settings(substeps, active);
        let violations = self.blocks().for_each_chunk(&settings, items, work);
        self.monitor.record(&violations);
    }

    /// All instances in the precision of the options.
    pub(super) fn blocks<T: Real>(&mut self) -> &mut Blocks<T> {
        self.storage.as_any().downcast_mut().expect("the precision of the options")
    }

    /// `[V'; q'']` of all instances, (N, 6 + n), by the articulated-body form.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn forward_dynamics(&mut self, inputs: &Inputs) -> Result<Vec<f64>, SimulatorError> {
        let inputs = CheckedInputs::new(inputs, &self.scene, &self.allocation, self.own.as_ref(), &self.options)?;
        let settings = self.settings(1, inputs.active_loads());
        Ok(self.storage.accelerations(&settings, &inputs))
    }

    /// Checks that `values` are `width` finite numbers per instance; `name` appears in errors.
    ///
    /// # Errors
    /// [`SimulatorError::Length`] or [`SimulatorError::NotFinite`].
    pub fn check_rows(&self, name: &'static str, values: &[f64], width: usize) -> Result<(), SimulatorError> {
        check(name, Some(values), width, &self.options)
    }
}
