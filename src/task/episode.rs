//! What an episode has drawn, and what it remembers between its control instants. The physical state is not in here.

use nalgebra::{Matrix3, Vector3};

use super::disturbance::{Disturbance, DisturbanceRows, Site};
use super::options::Goal;
use super::path::{PATH, path_places};
use super::pose::Pose;
use super::random::EpisodeKey;
use super::reference::{JointReference, ReferencePoint};
use crate::error::TaskError;
use crate::lane::{Lane, Real, Rows};
use crate::lie;

/// Where the numbers of an episode lie in a table that has a column per instance: first row of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EpisodeRows {
    /// What is to be done.
    pub goal: Goal,
    /// Number of joints.
    pub joints: usize,
    /// Entries of an action.
    pub actions: usize,
    /// Pose to hold, or to be at now: rotation by rows (9), position (3).
    pub target: usize,
    /// Its velocity and angular velocity in world axes, 6; only where there is a path.
    pub motion: usize,
    /// Path of the end effector, [`PATH`]; only where it follows one.
    pub path: usize,
    /// Current in world axes, 3.
    pub current: usize,
    /// Joint references, [`JointReference::LEN`] per joint; as the next two, only where the joints follow them.
    pub reference: usize,
    /// Value and rate of each joint's reference at the current control instant,
    pub now: usize,
    /// and at the next one.
    pub next: usize,
    /// The last action, as clipped.
    pub action: usize,
    /// Square of its change, 1.
    pub change: usize,
    /// Means over the actuators, 3: square and power 3/2 of relative thrust, share at full thrust.
    pub effort: usize,
    /// Leaky integral of the pose error, 6.
    pub integral: usize,
    /// Running means of the measures (of the squares of the first four), 7.
    pub means: usize,
    /// Whether the pose was off its tolerances at the last instant (1) or not (0), and for how long the last time it was, s.
    pub astray: usize,
    /// What disturbances remember, if they change within episodes.
    pub disturbance: Option<DisturbanceRows>,
    /// Rows in all.
    pub rows: usize,
}

impl EpisodeRows {
    /// With room for a disturbance.
    pub(super) fn with(self, disturbance: &Disturbance, site: &Site) -> Self {
        let disturbance = disturbance.rows(site, self.rows);
        Self { disturbance, rows: disturbance.map_or(self.rows, |rows| rows.end), ..self }
    }

    /// For this number of joints and of entries of an action.
    pub fn new(goal: Goal, joints: usize, actions: usize) -> Self {
        let tracks = goal == Goal::Track;
        let (following, path) = if tracks { (0, 1) } else { (joints, 0) };
        let mut rows = 0;
        let mut take = |count: usize| {
            rows += count;
            rows - count
        };
        Self {
            goal,
            joints,
            actions,
            target: take(12),
            motion: take(6 * path),
            path: take(PATH * path),
            current: take(3),
            reference: take(JointReference::<f64>::LEN * following),
            now: take(2 * following),
            next: take(2 * following),
            action: take(actions),
            change: take(1),
            effort: take(3),
            integral: take(6),
            means: take(7),
            astray: take(2),
            disturbance: None,
            rows: take(0),
        }
    }

    #[inline(always)]
    pub(super) fn target<T: Real, L: Lane<Real = T>>(&self, memory: &Rows<'_, T>) -> lie::Pose<L> {
        let rotation: [L; 9] = memory.get_all(self.target);
        let [xx, xy, xz, yx, yy, yz, zx, zy, zz] = rotation;
        lie::Pose {
            rotation: lie::Matrix3([[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]]),
            position: lie::Vector3(memory.get_all(self.target + 9)),
        }
    }

    #[inline(always)]
    pub(super) fn set_target<T: Real, L: Lane<Real = T>>(&self, memory: &mut Rows<'_, T>, target: &lie::Pose<L>) {
        let [x, y, z] = target.rotation.0;
        memory.set_all(self.target, &[x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2]]);
        memory.set_all(self.target + 9, &target.position.0);
    }

    #[inline(always)]
    pub(super) fn reference<T: Real, L: Lane<Real = T>>(
        &self,
        memory: &Rows<'_, T>,
        joint: usize,
    ) -> JointReference<L> {
        JointReference::from_array(memory.get_all(self.reference + JointReference::<L>::LEN * joint))
    }

    #[inline(always)]
    pub(super) fn point<T: Real, L: Lane<Real = T>>(
        &self,
        memory: &Rows<'_, T>,
        row: usize,
        joint: usize,
    ) -> ReferencePoint<L> {
        let [value, rate] = memory.get_all(row + 2 * joint);
        ReferencePoint { value, rate }
    }

    #[inline(always)]
    pub(super) fn set_point<T: Real, L: Lane<Real = T>>(
        &self,
        memory: &mut Rows<'_, T>,
        row: usize,
        joint: usize,
        point: &ReferencePoint<L>,
    ) {
        memory.set_all(row + 2 * joint, &[point.value, point.rate]);
    }
}

/// One episode of one instance, outside of any batch.
#[derive(Debug, Clone, PartialEq)]
pub struct Episode {
    pub(super) key: EpisodeKey,
    pub(super) step: u32,
    pub(super) rows: EpisodeRows,
    pub(super) numbers: Vec<f64>,
}

impl Episode {
    /// An episode at its start, in which nothing was drawn.
    pub fn blank(key: EpisodeKey, rows: EpisodeRows) -> Self {
        let mut this = Self { key, step: 0, rows, numbers: vec![0.0; rows.rows] };
        this.set_target(&Pose::default());
        this
    }

    /// From its parts, as a batch has them; `numbers` by the rows.
    pub fn from_parts(key: EpisodeKey, step: u32, rows: EpisodeRows, numbers: Vec<f64>) -> Self {
        assert_eq!(numbers.len(), rows.rows, "numbers of an episode");
        Self { key, step, rows, numbers }
    }

    /// Seed and number.
    pub fn key(&self) -> EpisodeKey {
        self.key
    }

    /// Control periods done.
    pub fn step(&self) -> u32 {
        self.step
    }

    /// All it remembers, by the rows.
    pub fn numbers(&self) -> &[f64] {
        &self.numbers
    }

    /// Pose to hold, or to be at now.
    pub fn target(&self) -> Pose {
        let numbers = &self.numbers[self.rows.target..];
        Pose { position: Vector3::from_column_slice(&numbers[9..12]), rotation: Matrix3::from_row_slice(&numbers[..9]) }
    }

    /// Current in world axes over the last control period (at the start: over the first), m/s.
    pub fn current(&self) -> Vector3<f64> {
        Vector3::from_column_slice(&self.numbers[self.rows.current..][..3])
    }

    /// The last action, as clipped; 0 before the first.
    pub fn action(&self) -> &[f64] {
        &self.numbers[self.rows.action..][..self.rows.actions]
    }

    /// Places all along the path of the end effector, the first and the last the same; none without a path.
    pub fn path(&self, count: usize) -> Vec<[f64; 3]> {
        if self.rows.goal != Goal::Track {
            return Vec::new();
        }
        let mut numbers = self.numbers.clone();
        let around = (0..count).map(|k| k as f64 / (count - 1).max(1) as f64);
        path_places(&Rows::of_one(&mut numbers), self.rows.path, around)
    }

    /// Joint reference at the current control instant, one point per joint that follows one.
    pub fn reference(&self) -> Vec<ReferencePoint> {
        let points = self.numbers[self.rows.now..self.rows.next].chunks_exact(2);
        points.map(|point| ReferencePoint { value: point[0], rate: point[1] }).collect()
    }

    pub(super) fn set_target(&mut self, target: &Pose) {
        let numbers = target.rotation.transpose();
        let numbers = numbers.iter().chain(&target.position);
        self.numbers[self.rows.target..].iter_mut().zip(numbers).for_each(|(row, x)| *row = *x);
    }

    /// The numbers as a table of one column.
    pub(super) fn memory(&mut self) -> Rows<'_, f64> {
        Rows::of_one(&mut self.numbers)
    }

    /// The episode as plain numbers, for saving: [`Episode::from_numbers`] gives it back bit for bit. Integers are cut
    /// into halves of 32 bits, so every number is finite.
    pub fn to_numbers(&self) -> Vec<f64> {
        let EpisodeKey { seed, episode } = self.key;
        let halves = |x: u64| [f64::from(x as u32), f64::from((x >> 32) as u32)];
        let head = [halves(seed), halves(episode)].concat();
        head.into_iter().chain([f64::from(self.step)]).chain(self.numbers.iter().copied()).collect()
    }

    /// The episode that [`Episode::to_numbers`] wrote.
    ///
    /// # Errors
    /// `TaskError::Saved` if there are too many or too few numbers, or one is not of the kind that stands there.
    pub fn from_numbers(rows: EpisodeRows, numbers: &[f64]) -> Result<Self, TaskError> {
        const HEAD: usize = 5;
        let expected = HEAD + rows.rows;
        if numbers.len() != expected {
            return Err(TaskError::Saved(format!("{} numbers, expected {expected}", numbers.len())));
        }
        if let Some((i, x)) = numbers.iter().enumerate().find(|(_, x)| !x.is_finite()) {
            return Err(TaskError::Saved(format!("number {i} is {x}")));
        }
        let (head, rest) = numbers.split_at(HEAD);
        let whole = |x: f64| {
            let n = x as u32;
            if f64::from(n) == x { Ok(n) } else { Err(TaskError::Saved(format!("{x} is no count"))) }
        };
        let join = |k: usize| Ok::<u64, TaskError>(u64::from(whole(head[k])?) | u64::from(whole(head[k + 1])?) << 32);
        let key = EpisodeKey { seed: join(0)?, episode: join(2)? };
        Ok(Self { key, step: whole(head[4])?, rows, numbers: rest.to_vec() })
    }
}
