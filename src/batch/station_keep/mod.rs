//! Episodes of station keeping, many at a time.

mod crew;

use super::monitor::Stray;
use super::rates::Unstable;
use super::simulator::{Simulator, SimulatorOptions};
use super::step::Switches;
use crate::balance::Servos;
use crate::description::Scene;
use crate::error::{ControlError, TaskError};
use crate::scene::{Episode, EpisodeKey, Outcome, StartOverride, StationKeep, StationKeepOptions};
use crate::system::{EndEffector, State};
use crew::{Crew, Rules};

/// What happens to an instance whose episode is over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Autoreset {
    /// The next step ignores the action and starts the next episode: its first observation, reward 0.
    #[default]
    NextStep,
    /// The same step starts the next episode; the last observation and measures are in [`Transition::finals`].
    SameStep,
    /// Nothing, until [`StationKeepBatch::reset`].
    Disabled,
}

/// Verdict on one instance after a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict {
    /// Reward.
    pub reward: f64,
    /// The episode is over for a reason within the task.
    pub terminated: bool,
    /// The episode is over because its time is.
    pub truncated: bool,
    /// Measures, in the order of [`Outcome::INFO`].
    pub info: [f64; INFO],
}

/// Number of measures.
pub const INFO: usize = Outcome::INFO.len();

/// The end of an episode whose successor began in the same step.
#[derive(Debug, Clone, PartialEq)]
pub struct Final {
    /// Instance.
    pub instance: usize,
    /// Last observation.
    pub observation: Vec<f32>,
    /// Last measures.
    pub info: [f64; INFO],
}

/// What a step brought.
#[derive(Debug, Clone, PartialEq)]
pub struct Transition {
    /// Observations, (N, d).
    pub observations: Vec<f32>,
    /// One verdict per instance.
    pub verdicts: Vec<Verdict>,
    /// Ends of episodes that [`Autoreset::SameStep`] replaced, by instance.
    pub finals: Vec<Final>,
}

/// What a reset brought.
#[derive(Debug, Clone, PartialEq)]
pub struct Beginning {
    /// Observations of all instances, (N, d), whether reset or not.
    pub observations: Vec<f32>,
    /// Measures of all instances, (N): of those that were not reset, at the instant where they stand.
    pub info: Vec<[f64; INFO]>,
}

/// Everything that makes a batch go on as if it had not been interrupted.
#[derive(Debug, Clone, PartialEq)]
pub struct Saved {
    /// States and loads, (N, .).
    pub physics: Vec<f64>,
    /// Episodes, seeds and counts, (N, .).
    pub episodes: Vec<f64>,
}

/// One instance's place: the episode that runs, and the address of the one after it.
#[derive(Debug, Clone, PartialEq, Default)]
struct Slot {
    next: EpisodeKey,
    episode: Option<Episode>,
    over: bool,
}

/// Instances of station keeping, stepped together. Each instance's results follow from the scene, the options, its seed
/// and its actions alone: not from the number of instances, of threads, or from what happens to its neighbours.
#[derive(Clone)]
pub struct StationKeepBatch {
    task: StationKeep,
    end_effector: EndEffector,
    simulator: Simulator,
    rules: Rules,
    slots: Vec<Slot>,
}

impl StationKeepBatch {
    /// A batch that waits for its first [`Self::reset`]. Instance `i` has the seed `i` until it is given another. The
    /// step is that of `options`; `simulator.dt` has no influence. Episodes are truncated after `max_steps`, if given.
    ///
    /// # Errors
    /// `TaskError` where the task or the simulator cannot be.
    pub fn new(
        scene: Scene,
        options: StationKeepOptions,
        simulator: SimulatorOptions,
        autoreset: Autoreset,
        max_steps: Option<u32>,
    ) -> Result<Self, TaskError> {
        let end_effector = EndEffector::new(&scene);
        let task = StationKeep::new(&scene, options)?;
        let simulator = Simulator::new(scene, SimulatorOptions { dt: task.options().dt, ..simulator })?;
        let slot = |i| Slot { next: EpisodeKey { seed: i, episode: 0 }, ..Slot::default() };
        let slots = (0..simulator.instances() as u64).map(slot).collect();
        Ok(Self { task, end_effector, simulator, rules: Rules { autoreset, max_steps }, slots })
    }

    /// The task.
    pub fn task(&self) -> &StationKeep {
        &self.task
    }

    /// The physics, for reading the true state.
    pub fn simulator(&self) -> &Simulator {
        &self.simulator
    }

    /// What to warn of before a step, once: as [`Simulator::warn_of_step`] with the servos of the joints on.
    pub fn warn_of_step(&mut self) -> Option<Unstable> {
        self.simulator.warn_of_step(Servos { joints: true, station: false })
    }

    /// What to warn of after a step, once: as [`Simulator::warn_of_motion`].
    pub fn warn_of_motion(&mut self) -> Option<Stray> {
        self.simulator.warn_of_motion()
    }

    /// Number of instances N.
    pub fn instances(&self) -> usize {
        self.slots.len()
    }

    /// What happens to instances whose episode is over.
    pub fn autoreset(&self) -> Autoreset {
        self.rules.autoreset
    }

    /// Steps after which episodes are truncated.
    pub fn max_steps(&self) -> Option<u32> {
        self.rules.max_steps
    }

    /// The episode that instance `i` is in, once it was reset.
    pub fn episode(&self, i: usize) -> Option<&Episode> {
        self.slots[i].episode.as_ref()
    }

    /// Starts the next episode of each instance that `mask` picks (of all without a mask).
    ///
    /// With a seed its episode 0 starts; without one the episode that follows in the instance's stream. `given` has
    /// what is not to be drawn: nothing, or one entry per instance.
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
        let lengths = [("seeds", seeds.len()), ("mask", mask.map_or(expected, <[_]>::len))];
        let starts = ("starts", if given.is_empty() { expected } else { given.len() });
        for (what, got) in lengths.into_iter().chain([starts]) {
            if got != expected {
                return Err(ControlError::Shape { what, got, expected }.into());
            }
        }
        let none = StartOverride::default();
        let mut begun = Vec::new();
        for (i, slot) in self.slots.iter().enumerate() {
            if mask.is_some_and(|mask| !mask[i]) {
                if slot.episode.is_none() {
                    return Err(TaskError::NotBegun { instance: i });
                }
                continue;
            }
            let key = seeds[i].map_or(slot.next, |seed| EpisodeKey { seed, episode: 0 });
            begun.push((i, key, self.task.begin_with(key, given.get(i).unwrap_or(&none))?));
        }
        for (i, key, (episode, state)) in begun {
            self.simulator.set_state(i, &state);
            self.simulator.set_flow(i, *episode.current());
            self.slots[i] = Slot { next: key.following(), episode: Some(episode), over: false };
        }
        Ok(self.look())
    }

    /// One control period of all instances under `actions`, (N, action length) in [-1, 1]; beyond is clipped.
    ///
    /// # Errors
    /// `TaskError` for actions that are misshaped or not finite, before the first reset, and without autoreset for an
    /// episode that is over; nothing has changed then.
    pub fn step(&mut self, actions: &[f32]) -> Result<Transition, TaskError> {
        self.task.check_actions(actions, self.instances())?;
        for (instance, slot) in self.slots.iter().enumerate() {
            if slot.episode.is_none() {
                return Err(TaskError::NotBegun { instance });
            }
            if slot.over && self.rules.autoreset == Autoreset::Disabled {
                return Err(TaskError::Over { instance });
            }
        }
        let (ride, width) = (self.simulator.ride(), self.task.observation_len());
        let blank = Verdict { reward: 0.0, terminated: false, truncated: false, info: [0.0; INFO] };
        let mut observations = vec![0.0; self.instances() * width];
        let mut verdicts = vec![blank; self.instances()];
        let mut finals = vec![Vec::new(); self.instances().div_ceil(ride)];
        let home = State { q: self.simulator.scene().home(), ..State::default() };
        let mut crews: Vec<Box<dyn super::blocks::Rider + '_>> = Vec::with_capacity(finals.len());
        let parts = self.slots.chunks_mut(ride).zip(actions.chunks(ride * self.task.action_len()));
        let results = observations.chunks_mut(ride * width).zip(verdicts.chunks_mut(ride)).zip(&mut finals);
        for (k, ((slots, actions), ((observations, verdicts), finals))) in parts.zip(results).enumerate() {
            crews.push(Box::new(Crew {
                task: &self.task,
                end_effector: &self.end_effector,
                rules: self.rules,
                home: &home,
                first: k * ride,
                slots,
                actions,
                observations,
                verdicts,
                finals,
            }));
        }
        let substeps = self.task.options().substeps as usize;
        self.simulator.step_with(substeps, Switches { servo: true, ..Switches::default() }, &mut crews);
        drop(crews);
        Ok(Transition { observations, verdicts, finals: finals.concat() })
    }

    /// Everything there is to save.
    pub fn save(&self) -> Saved {
        Saved { physics: self.simulator.save(), episodes: self.slots.iter().flat_map(Slot::to_numbers).collect() }
    }

    /// Continues from where a batch like this one was saved.
    ///
    /// # Errors
    /// `TaskError` if it was not a like one; nothing has changed then.
    pub fn load(&mut self, saved: &Saved) -> Result<(), TaskError> {
        let width = Slot::default().to_numbers().len();
        if saved.episodes.len() != self.instances() * width {
            let (got, expected) = (saved.episodes.len(), self.instances() * width);
            return Err(TaskError::Saved(format!("{got} numbers of episodes, expected {expected}")));
        }
        let slots = saved.episodes.chunks_exact(width).map(Slot::from_numbers).collect::<Result<_, _>>()?;
        self.simulator.load(&saved.physics)?;
        self.slots = slots;
        Ok(())
    }

    /// Observations and measures where all instances stand.
    fn look(&self) -> Beginning {
        let width = self.task.observation_len();
        let mut observations = vec![0.0; self.instances() * width];
        let mut info = vec![[0.0; INFO]; self.instances()];
        for (i, row) in observations.chunks_exact_mut(width).enumerate() {
            if let Some(episode) = &self.slots[i].episode {
                let state = self.simulator.state(i);
                self.task.observe(episode, &state, row);
                info[i] = self.task.survey(episode, &state, crew::reach(&self.end_effector)).info();
            }
        }
        Beginning { observations, info }
    }
}

impl Slot {
    /// Numbers before those of the episode.
    const HEAD: usize = 6;

    fn to_numbers(&self) -> Vec<f64> {
        let EpisodeKey { seed, episode } = self.next;
        let halves = |x: u64| [f64::from(x as u32), f64::from((x >> 32) as u32)];
        let flags = [f64::from(u8::from(self.over)), f64::from(u8::from(self.episode.is_some()))];
        let blank = || Episode::blank(self.next);
        let episode_numbers = self.episode.as_ref().map_or_else(|| blank().to_numbers(), Episode::to_numbers);
        [halves(seed), halves(episode), flags].concat().into_iter().chain(episode_numbers).collect()
    }

    fn from_numbers(numbers: &[f64]) -> Result<Self, TaskError> {
        let (head, episode) = numbers.split_at(Self::HEAD);
        let whole = |k: usize| {
            let n = head[k] as u32;
            if f64::from(n) == head[k] { Ok(n) } else { Err(TaskError::Saved(format!("{} is no count", head[k]))) }
        };
        let join = |k: usize| Ok::<u64, TaskError>(u64::from(whole(k)?) | u64::from(whole(k + 1)?) << 32);
        let episode = Episode::from_numbers(episode)?;
        Ok(Self {
            next: EpisodeKey { seed: join(0)?, episode: join(2)? },
            over: whole(4)? != 0,
            episode: (whole(5)? != 0).then_some(episode),
        })
    }
}
