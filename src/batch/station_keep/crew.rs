//! What the task does to a few instances around their physics.

use super::{Autoreset, Final, Slot, Verdict};
use crate::batch::blocks::{Instances, Rider};
use crate::batch::step::Switches;
use crate::batch::table::InstanceLoads;
use crate::scene::{Outcome, Pose, StationKeep};
use crate::system::{EndEffector, Flow, Joints, State};

/// How episodes end and follow each other.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rules {
    pub autoreset: Autoreset,
    pub max_steps: Option<u32>,
}

/// The task at work on a few instances.
pub(super) struct Crew<'a> {
    pub task: &'a StationKeep,
    pub end_effector: &'a EndEffector,
    pub rules: Rules,
    /// A state that steps harmlessly.
    pub home: &'a State,
    /// Number of the first instance.
    pub first: usize,
    pub slots: &'a mut [Slot],
    pub actions: &'a [f32],
    pub observations: &'a mut [f32],
    pub verdicts: &'a mut [Verdict],
    pub finals: &'a mut Vec<Final>,
}

/// The end effector's pose for a vehicle pose and joint coordinates.
pub(super) fn reach(end_effector: &EndEffector) -> impl Fn(&Pose, &Joints) -> Pose {
    |vehicle, q| {
        let (rotation, position) = end_effector.pose(q);
        Pose { position: vehicle.position + vehicle.rotation * position, rotation: vehicle.rotation * rotation }
    }
}

impl Crew<'_> {
    /// Starts the next episode of instance `k`; its measures.
    fn begin(&mut self, k: usize, instances: &mut dyn Instances) -> Outcome {
        let slot = &mut self.slots[k];
        let (episode, state) = self.task.begin(slot.next);
        instances.set_state(k, &state);
        instances.set_flow(k, &Flow::from(*episode.current()));
        slot.next = slot.next.following();
        slot.over = false;
        let episode = slot.episode.insert(episode);
        self.task.survey(episode, &instances.state(k), reach(self.end_effector))
    }

    /// Judges instance `k` after its physics.
    fn judge(&mut self, k: usize, instances: &mut dyn Instances) -> Verdict {
        let Rules { autoreset, max_steps } = self.rules;
        if self.slots[k].over {
            let info = self.begin(k, instances).info();
            return Verdict { reward: 0.0, terminated: false, truncated: false, info };
        }
        let slot = &mut self.slots[k];
        let Some(episode) = &mut slot.episode else { unreachable!("a step is refused before the first episode") };
        let state = instances.state(k);
        let outcome = self.task.advance(episode, &state, reach(self.end_effector));
        let truncated = max_steps.is_some_and(|most| episode.step() >= most);
        slot.over = outcome.terminated || truncated;
        let mut info = outcome.info();
        if slot.over && autoreset == Autoreset::SameStep {
            let mut observation = vec![0.0; self.task.observation_len()];
            self.task.observe(episode, &state, &mut observation);
            self.finals.push(Final { instance: self.first + k, observation, info });
            info = self.begin(k, instances).info();
        }
        Verdict { reward: outcome.reward, terminated: outcome.terminated, truncated, info }
    }
}

impl Rider for Crew<'_> {
    fn before(&mut self, instances: &mut dyn Instances) {
        let mut loads = InstanceLoads::default();
        let actions = self.actions.chunks_exact(self.task.action_len());
        for (k, (slot, action)) in self.slots.iter_mut().zip(actions).enumerate() {
            match &mut slot.episode {
                Some(episode) if !slot.over => {
                    let command = self.task.act(episode, action);
                    loads.wrench = command.wrench.into();
                    loads.target = command.joints;
                    instances.set_loads(k, &loads, Switches { servo: true, ..Switches::default() });
                }
                // What it was left in may be a state that takes long to step.
                _ => instances.set_state(k, self.home),
            }
        }
    }

    fn after(&mut self, instances: &mut dyn Instances) {
        let width = self.task.observation_len();
        for k in 0..self.slots.len() {
            self.verdicts[k] = self.judge(k, instances);
            if let Some(episode) = &self.slots[k].episode {
                let row = &mut self.observations[k * width..(k + 1) * width];
                self.task.observe(episode, &instances.state(k), row);
            }
        }
    }
}
