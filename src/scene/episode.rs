//! One episode of one instance, between its control instants.

use nalgebra::{Vector3, Vector6};

use super::pose::Pose;
use super::random::EpisodeKey;
use super::reference::{JointReference, ReferencePoint};
use crate::control::{THRUSTERS, Thrusts};
use crate::error::TaskError;
use crate::system::JOINTS;

/// Greatest number of entries of an action.
pub const ACTIONS: usize = THRUSTERS;

/// What an episode has drawn, and what it remembers. The physical state is not in here.
#[derive(Debug, Clone, PartialEq)]
pub struct Episode {
    pub(super) key: EpisodeKey,
    pub(super) step: u32,
    pub(super) target: Pose,
    pub(super) current: Vector3<f64>,
    pub(super) references: [JointReference; JOINTS],
    /// Reference at the current control instant and at the next one.
    pub(super) now: [ReferencePoint; JOINTS],
    pub(super) next: [ReferencePoint; JOINTS],
    pub(super) action: [f32; ACTIONS],
    pub(super) previous_action: [f32; ACTIONS],
    pub(super) thrusts: Thrusts,
    pub(super) integral: Vector6<f64>,
    pub(super) sums: [f64; 6],
}

impl Episode {
    pub(super) fn new(key: EpisodeKey, target: Pose, current: Vector3<f64>) -> Self {
        Self {
            key,
            step: 0,
            target,
            current,
            references: [JointReference::default(); JOINTS],
            now: [ReferencePoint::default(); JOINTS],
            next: [ReferencePoint::default(); JOINTS],
            action: [0.0; ACTIONS],
            previous_action: [0.0; ACTIONS],
            thrusts: [0.0; THRUSTERS],
            integral: Vector6::zeros(),
            sums: [0.0; 6],
        }
    }

    /// An episode in which nothing was drawn.
    pub fn blank(key: EpisodeKey) -> Self {
        Self::new(key, Pose::default(), Vector3::zeros())
    }

    /// Seed and number.
    pub fn key(&self) -> EpisodeKey {
        self.key
    }

    /// Control periods done.
    pub fn step(&self) -> u32 {
        self.step
    }

    /// Pose to hold.
    pub fn target(&self) -> &Pose {
        &self.target
    }

    /// Current in world axes, m/s.
    pub fn current(&self) -> &Vector3<f64> {
        &self.current
    }

    /// Joint reference at the current control instant.
    pub fn reference(&self) -> &[ReferencePoint; JOINTS] {
        &self.now
    }

    /// The episode as plain numbers, for saving: [`Episode::from_numbers`] gives it back bit for bit. Integers are cut
    /// into halves of 32 bits, so every number is finite.
    pub fn to_numbers(&self) -> Vec<f64> {
        let EpisodeKey { seed, episode } = self.key;
        let halves = |x: u64| [f64::from(x as u32), f64::from((x >> 32) as u32)];
        let mut numbers = [halves(seed), halves(episode)].concat();
        numbers.push(f64::from(self.step));
        numbers.extend(self.action.iter().chain(&self.previous_action).map(|a| f64::from(*a)));
        self.clone().visit(&mut |x| numbers.push(*x));
        numbers
    }

    /// The episode that [`Episode::to_numbers`] wrote.
    ///
    /// # Errors
    /// `TaskError::Saved` if there are too many or too few numbers, or one is not of the kind that stands there.
    pub fn from_numbers(numbers: &[f64]) -> Result<Self, TaskError> {
        let mut this = Self::blank(EpisodeKey::default());
        let expected = this.to_numbers().len();
        if numbers.len() != expected {
            return Err(TaskError::Saved(format!("{} numbers, expected {expected}", numbers.len())));
        }
        if let Some((i, x)) = numbers.iter().enumerate().find(|(_, x)| !x.is_finite()) {
            return Err(TaskError::Saved(format!("number {i} is {x}")));
        }
        let (head, rest) = numbers.split_at(5);
        let whole = |x: f64| {
            let n = x as u32;
            if f64::from(n) == x { Ok(n) } else { Err(TaskError::Saved(format!("{x} is no count"))) }
        };
        let join = |k: usize| Ok::<u64, TaskError>(u64::from(whole(head[k])?) | u64::from(whole(head[k + 1])?) << 32);
        this.key = EpisodeKey { seed: join(0)?, episode: join(2)? };
        this.step = whole(head[4])?;
        let mut rest = rest.iter().copied();
        for (a, x) in this.action.iter_mut().chain(&mut this.previous_action).zip(&mut rest) {
            *a = x as f32;
        }
        this.visit(&mut |slot| {
            if let Some(x) = rest.next() {
                *slot = x;
            }
        });
        Ok(this)
    }

    /// Visits every f64, in a fixed order.
    fn visit(&mut self, visit: &mut dyn FnMut(&mut f64)) {
        self.target.position.iter_mut().for_each(&mut *visit);
        self.target.rotation.iter_mut().for_each(&mut *visit);
        self.current.iter_mut().for_each(&mut *visit);
        for r in &mut self.references {
            [&mut r.start, &mut r.shift, &mut r.pace].into_iter().for_each(&mut *visit);
            let pairs = r.amplitude.iter_mut().chain(&mut r.frequency).chain(&mut r.phase);
            pairs.for_each(&mut *visit);
        }
        for point in self.now.iter_mut().chain(&mut self.next) {
            [&mut point.value, &mut point.rate, &mut point.acceleration].into_iter().for_each(&mut *visit);
        }
        self.thrusts.iter_mut().for_each(&mut *visit);
        self.integral.iter_mut().for_each(&mut *visit);
        self.sums.iter_mut().for_each(&mut *visit);
    }
}
