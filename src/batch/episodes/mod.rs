//! Episodes of a task, many at a time.

mod chunk;
mod closed_loop;
mod episode_slot;
mod kernels;
mod outputs;
mod recording;
mod rollout;
mod storage;

use std::sync::Arc;

use super::monitoring::modal_analysis::UnstableStep;
use super::monitoring::step_monitor::InaccurateStep;
use super::options::{Precision, SimulatorOptions};
use super::simulator::Simulator;
use crate::control::{Controller, Widths};
use crate::description::Scene;
use crate::dynamics::Servos;
use crate::error::{ControlError, TaskError};
use crate::lane::Real;
use crate::task::disturbance::Profile;
use crate::task::{Episode, EpisodeKey, Pose, SceneDraws, StartOverride, Task, TaskOptions, dispatch_task, privileged};
pub use chunk::Autoreset;
use chunk::{Context, Rules};
use closed_loop::LoopPart;
use episode_slot::EpisodeSlot;
use outputs::check_lengths;
pub use outputs::{Final, Outputs, Transition};
pub use recording::{Recorder, Recording, Teacher};
pub use rollout::{Rollout, RolloutStats, Trace};
use storage::{Members, TaskBlocks, TaskStorage};

/// Result of a reset.
#[derive(Debug, Clone, PartialEq)]
pub struct Beginning {
    /// Observations of all instances, (N, d), whether reset or not.
    pub observations: Vec<f32>,
    /// Metrics of all instances, (k, N), at their current control instant.
    pub info: Vec<f64>,
}

/// Complete state of a batch, to continue from.
#[derive(Debug, Clone, PartialEq)]
pub struct Saved {
    /// States and loads, (N, .).
    pub physics: Vec<f64>,
    /// Episodes, seeds and counts, (N, .).
    pub episodes: Vec<f64>,
}

/// Instances of a task, stepped together. Each instance's results depend only on the scene, the options, its seed and its
/// actions, not on the number of instances or threads, nor on other instances.
pub struct TaskBatch {
    task: Task,
    /// Base controller of residual actions.
    base: Option<Arc<dyn Controller>>,
    simulator: Simulator,
    rules: Rules,
    slots: Vec<EpisodeSlot>,
    storage: Box<dyn TaskStorage>,
}

impl Clone for TaskBatch {
    fn clone(&self) -> Self {
        Self {
            task: self.task.clone(),
            base: self.base.clone(),
            simulator: self.simulator.clone(),
            rules: self.rules,
            slots: self.slots.clone(),
            storage: self.storage.boxed_clone(),
        }
    }
}

impl TaskBatch {
    /// A batch that waits for its first [`Self::reset`]. Instance `i` has the seed `i` until it is given another. The
    /// step size is `options.dt`; `simulator.dt` has no influence. Episodes are truncated after `max_steps`, if given.
    ///
    /// # Errors
    /// `TaskError` where the task or the simulator cannot be.
    pub fn new(
        scene: Scene,
        options: TaskOptions,
        simulator: SimulatorOptions,
        autoreset: Autoreset,
        max_steps: Option<u32>,
    ) -> Result<Self, TaskError> {
        let task = Task::new(&scene, options)?;
        let base = task.base()?;
        let samples = task.scene_draws().map(SceneDraws::samples).unwrap_or_default();
        let options = SimulatorOptions { dt: task.options().dt, ..simulator };
        let simulator = Simulator::of(task.scene().clone(), None, &samples, options)?;
        let instances = simulator.instances();
        let storage = match simulator.options().precision {
            Precision::Double => storage::<f64>(&task, instances)?,
            Precision::Single => storage::<f32>(&task, instances)?,
        };
        let slots = (0..instances as u64).map(|seed| EpisodeSlot::before(EpisodeKey { seed, episode: 0 })).collect();
        Ok(Self { task, base, simulator, rules: Rules { autoreset, max_steps }, slots, storage })
    }

    /// Task of all instances.
    pub fn task(&self) -> &Task {
        &self.task
    }

    /// The physics: the true state.
    pub fn simulator(&self) -> &Simulator {
        &self.simulator
    }

    /// Warning before a step, once: see [`Simulator::warn_of_step`], with the servos of joints that follow references.
    pub fn warn_of_step(&mut self) -> Option<UnstableStep> {
        self.simulator.warn_of_step(Servos { joints: !self.task.options().task.drives_joints(), vehicle: false })
    }

    /// Warning after a step, once: see [`Simulator::warn_of_motion`].
    pub fn warn_of_motion(&mut self) -> Option<InaccurateStep> {
        self.simulator.warn_of_motion()
    }

    /// Number of instances N.
    pub fn instances(&self) -> usize {
        self.slots.len()
    }

    /// Handling of instances whose episode is over.
    pub fn autoreset(&self) -> Autoreset {
        self.rules.autoreset
    }

    /// Length at which episodes are truncated, control periods.
    pub fn max_steps(&self) -> Option<u32> {
        self.rules.max_steps
    }

    /// Episode of instance `i`, after its first reset.
    pub fn episode(&self, i: usize) -> Option<Episode> {
        self.slots[i].begun.then(|| self.episode_numbers(i))
    }

    fn episode_numbers(&self, i: usize) -> Episode {
        let EpisodeSlot { key, step, .. } = self.slots[i];
        Episode::from_parts(key, step, self.task.episode_rows(), self.storage.column(i))
    }

    /// Disturbance of instance `i` over the coming control periods for a vehicle at rest, after its first reset.
    pub fn profile(&self, i: usize, steps: u32) -> Option<Profile> {
        let pose = Pose::of_vehicle(&self.simulator.state(i));
        self.episode(i).map(|episode| self.task.profile(&episode, &pose, steps))
    }

    /// Privileged information of all instances: [`privileged`] of each, (N, .).
    pub fn privileged(&self) -> Vec<f64> {
        let joints = self.task.coordinate_count();
        let of = |i: usize| {
            let (state, flow, factors) = (self.simulator.state(i), self.simulator.flow(i), self.simulator.factors(i));
            privileged(joints, &state, &flow, &factors, &self.episode_numbers(i).target())
        };
        (0..self.instances()).flat_map(of).collect()
    }

    /// Observations of all instances, (N, d), of the true, present state: sensors without noise and delay. The integral of
    /// errors sums measured errors.
    ///
    /// # Errors
    /// [`TaskError::NotBegun`] before the first reset.
    pub fn perfect_observations(&mut self) -> Result<Vec<f32>, TaskError> {
        self.check_begun()?;
        Ok(self.observe(true).observations)
    }

    /// Bytes of memory per instance.
    pub fn bytes_per_instance(&self) -> usize {
        self.simulator.bytes_per_instance() + self.storage.bytes_per_instance(self.instances())
    }

    /// Starts the next episode of each instance in `mask` (of all without a mask).
    ///
    /// With a seed its episode 0 starts; without one the next episode of the instance's stream. `given` has the given parts
    /// of the starts: no entry, or one per instance.
    ///
    /// # Errors
    /// `TaskError` for arrays of the wrong length, an impossible start, or an instance that is left out before its
    /// first start; nothing has changed then.
    pub fn reset(
        &mut self,
        seeds: &[Option<u64>],
        mask: Option<&[bool]>,
        given: &[StartOverride],
    ) -> Result<Beginning, TaskError> {
        let expected = self.instances();
        check_lengths([
            ("seeds", seeds.len(), expected),
            ("mask", mask.map_or(expected, <[_]>::len), expected),
            ("starts", if given.is_empty() { expected } else { given.len() }, expected),
        ])?;
        let none = StartOverride::default();
        let mut begun = Vec::new();
        for (i, slot) in self.slots.iter().enumerate() {
            if mask.is_some_and(|mask| !mask[i]) {
                if !slot.begun {
                    return Err(TaskError::NotBegun { instance: i });
                }
                continue;
            }
            let key = seeds[i].map_or(slot.next(), |seed| EpisodeKey { seed, episode: 0 });
            let given = given.get(i).unwrap_or(&none);
            begun.push((i, key, self.task.begin_with(key, given)?, self.task.factors(key, given)));
        }
        for (i, key, (episode, state), factors) in begun {
            self.simulator.set_state(i, &state);
            self.simulator.set_flow(i, episode.current());
            if let Some(factors) = factors {
                self.simulator.set_factors_of(i, &factors);
            }
            self.set_own(i, key);
            self.slots[i] = EpisodeSlot::of(key);
            self.storage.set_column(i, episode.numbers());
        }
        Ok(self.observe(false))
    }

    /// One control period of all instances under `actions`, (N, action length) in [-1, 1]; beyond is clipped.
    ///
    /// # Errors
    /// `TaskError` for actions that are misshaped or not finite, before the first reset, and without autoreset for an
    /// episode that is over; nothing has changed then.
    pub fn step(&mut self, actions: &[f32]) -> Result<Transition, TaskError> {
        let mut transition = self.blank();
        transition.finals = self.step_into(actions, transition.outputs())?;
        Ok(transition)
    }

    /// As [`Self::step`], into arrays of the caller; returns the ends of episodes replaced under [`Autoreset::SameStep`], by
    /// instance.
    ///
    /// # Errors
    /// As [`Self::step`], and `ControlError::Shape` for arrays of the wrong length.
    pub fn step_into(&mut self, actions: &[f32], out: Outputs<'_>) -> Result<Vec<Final>, TaskError> {
        self.task.check_actions(actions, self.instances())?;
        out.check(self.instances(), self.task.observation_len(), self.task.metric_names().len())?;
        let waits = |slot: &EpisodeSlot| !slot.begun || (slot.over && self.rules.autoreset == Autoreset::Disabled);
        if let Some(instance) = self.slots.iter().position(waits) {
            let begun = self.slots[instance].begun;
            return Err(if begun { TaskError::Over { instance } } else { TaskError::NotBegun { instance } });
        }
        let (members, storage) = self.members(self.rules);
        Ok(storage.step(members, actions, out))
    }

    /// `steps` control periods of all instances under a controller, from their current states: bit for bit the numbers of as
    /// many calls of [`Self::step`] with the controller's actions. In every autoreset mode, an instance whose episode is over
    /// waits until it is reset or stepped.
    ///
    /// # Errors
    /// `TaskError` for a controller or a rollout of other sizes, and before the first reset; nothing has changed then.
    pub fn run(&mut self, controller: &dyn Controller, rollout: &mut Rollout, steps: u32) -> Result<(), TaskError> {
        let memory = self.check_widths(controller)?.memory;
        let n = self.instances();
        check_lengths([("stats", rollout.stats.len(), n), ("memory", rollout.memory.len(), n * memory)])?;
        self.check_begun()?;
        self.close_loop(steps as usize, rollout.parts(controller))
    }

    /// Control periods of all instances under a network with noise on its actions, recorded, from their current states: as
    /// many as there is noise for. An instance whose episode is over waits.
    ///
    /// # Errors
    /// `TaskError` for an actor or a teacher of other sizes, noise of the wrong length or not finite, and before the first
    /// reset; nothing has changed then.
    pub fn record(&mut self, recorder: Recorder<'_>) -> Result<Recording, TaskError> {
        let (n, noise) = (self.instances(), recorder.noise);
        let row = n * self.check_widths(recorder.actor)?.action;
        if let Some(teacher) = recorder.teacher {
            self.check_widths(teacher.controller)?;
        }
        check_lengths([("noise", noise.len(), noise.len().next_multiple_of(row))])?;
        if let Some(at) = noise.iter().position(|x| !x.is_finite()) {
            let (instance, index) = (at / (noise.len() / n), at % self.task.action_len());
            return Err(TaskError::Action { instance, index, value: noise[at] });
        }
        self.check_begun()?;
        let mut recording = Recording::blank(&recorder, n);
        self.close_loop(recording.rewards.len() / n, recording.parts(recorder, n))?;
        Ok(recording)
    }

    /// Runs a closed loop; ended episodes stay as they are.
    fn close_loop(&mut self, steps: usize, parts: Vec<Box<dyn LoopPart + '_>>) -> Result<(), TaskError> {
        let rules = Rules { autoreset: Autoreset::Disabled, ..self.rules };
        let (members, storage) = self.members(rules);
        Ok(storage.run(members, steps, parts)?)
    }

    /// All instances under these rules, and the memory of their episodes.
    fn members(&mut self, rules: Rules) -> (Members<'_>, &mut dyn TaskStorage) {
        let Self { task, base, simulator, slots, storage, .. } = self;
        let context = Context { task, rules, base: base.as_deref() };
        (Members { simulator, slots, context }, &mut **storage)
    }

    /// Frames of all instances, for gradients: memories (N, .), and states (N, .) with rotation by rows (9), position, twist, joint
    /// coordinates and rates, current, its acceleration, and thrusts of thrusters with dynamics.
    ///
    /// # Errors
    /// [`TaskError::NotBegun`] before the first reset.
    pub fn frames(&mut self) -> Result<[Vec<f32>; 2], TaskError> {
        self.check_begun()?;
        Ok(self.storage.frames(&mut self.simulator))
    }

    /// Numbers of entries of a frame's state and memory.
    pub fn frame_widths(&self) -> [usize; 2] {
        let widths = self.task.gradient().widths();
        [widths.state_numbers() + 6 + self.simulator.state_size() - widths.state, widths.rows]
    }

    /// Controller that residual actions correct.
    pub fn base(&self) -> Option<Arc<dyn Controller>> {
        self.base.clone()
    }

    /// Refuses a controller for other observations or actions.
    fn check_widths(&self, controller: &dyn Controller) -> Result<Widths, ControlError> {
        let (expected, takes) = (self.task.observation_len(), self.task.action_len());
        let widths @ Widths { observation: got, action: gives, .. } = controller.widths();
        if (got, gives) == (expected, takes) {
            return Ok(widths);
        }
        Err(ControlError::Widths { got, gives, expected, takes })
    }

    /// Refuses instances before their first reset.
    fn check_begun(&self) -> Result<(), TaskError> {
        match self.slots.iter().position(|slot| !slot.begun) {
            Some(instance) => Err(TaskError::NotBegun { instance }),
            None => Ok(()),
        }
    }

    /// State of the batch, for [`Self::load`].
    pub fn save(&self) -> Saved {
        let episodes = self.slots.iter().enumerate();
        let episodes = episodes.flat_map(|(i, slot)| slot.to_numbers(&self.episode_numbers(i))).collect();
        Saved { physics: self.simulator.save(), episodes }
    }

    /// Continues from the saved state of a batch with the same arguments.
    ///
    /// # Errors
    /// `TaskError` for the state of another batch; nothing has changed then.
    pub fn load(&mut self, saved: &Saved) -> Result<(), TaskError> {
        let rows = self.task.episode_rows();
        let width = EpisodeSlot::width(rows);
        if saved.episodes.len() != self.instances() * width {
            let (got, expected) = (saved.episodes.len(), self.instances() * width);
            return Err(TaskError::Saved(format!("{got} numbers of episodes, expected {expected}")));
        }
        let slots = saved.episodes.chunks_exact(width).map(|numbers| EpisodeSlot::from_numbers(rows, numbers));
        let slots = slots.collect::<Result<Vec<_>, _>>()?;
        self.simulator.load(&saved.physics)?;
        for (i, (slot, episode)) in slots.into_iter().enumerate() {
            if slot.begun {
                self.set_own(i, slot.key);
            }
            self.slots[i] = slot;
            self.storage.set_column(i, episode.numbers());
        }
        Ok(())
    }

    /// Sets the numbers that instance `i` has of its own in an episode.
    fn set_own(&mut self, i: usize, key: EpisodeKey) {
        if let Some(draws) = self.task.scene_draws() {
            self.simulator.set_own(i, &draws.draw(key).1);
        }
    }

    fn blank(&self) -> Transition {
        Transition::blank(self.instances(), self.task.observation_len(), self.task.metric_names().len())
    }

    /// Observations, with perfect sensors if asked for, and metrics of all instances at their current control instant.
    fn observe(&mut self, perfect: bool) -> Beginning {
        let mut transition = self.blank();
        self.storage.observe(&mut self.simulator, perfect, &mut transition.outputs());
        Beginning { observations: transition.observations, info: transition.info }
    }
}

/// Episode memory of a task in precision `T`.
fn storage<T: Real>(task: &Task, instances: usize) -> Result<Box<dyn TaskStorage>, TaskError> {
    dispatch_task!(&task.options().task, K, definition => {
        Ok(Box::new(TaskBlocks::<T, K>::new(task, definition, instances)?))
    })
}
