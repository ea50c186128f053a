//! Memory of an episode: its draws and its state between control instants. The physical state is not part of it.

use nalgebra::{Matrix3, Vector3};

use super::disturbance::DisturbanceRows;
use super::model::TaskModel;
use super::path::{PATH, path_places};
use super::pose::Pose;
use super::random::EpisodeKey;
use super::reference::{JointReferenceRows, ReferencePoint};
use crate::error::TaskError;
use crate::lane::{Lane, Rows};
use crate::lie;

/// Allocates rows one after the other.
#[derive(Debug, Default)]
pub struct RowAllocator(usize);

impl RowAllocator {
    /// First of `count` further rows.
    pub fn take(&mut self, count: usize) -> usize {
        self.0 += count;
        self.0 - count
    }
}

/// Rows of the reference path of an end effector.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PathRows {
    /// Velocity and angular velocity of the target in world axes, 6.
    pub motion: usize,
    /// The path, [`PATH`].
    pub path: usize,
    /// Poses of the path ahead: rotation by rows (9) and position (3) each.
    pub ahead: usize,
}

impl PathRows {
    /// Allocates them, with this number of poses ahead.
    pub fn new(rows: &mut RowAllocator, points: usize) -> Self {
        Self { motion: rows.take(6), path: rows.take(PATH), ahead: rows.take(12 * points) }
    }
}

/// Rows that a task adds to the shared ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TaskRows {
    /// References of joints that follow one.
    pub joints: Option<JointReferenceRows>,
    /// Path of the end effector.
    pub path: Option<PathRows>,
    /// First of the task's own rows.
    pub own: usize,
    /// First row and number of rows that [`super::TaskDefinition::update`] changes.
    pub updated: [usize; 2],
}

/// Rows of an episode's numbers in a table with a column per instance: first row of each quantity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EpisodeRows {
    /// Number of joints of the robot.
    pub joints: usize,
    /// Number of joint coordinates of the state: those of the robot, then those of fixtures.
    pub coordinates: usize,
    /// Entries of an action.
    pub actions: usize,
    /// Target at the current control instant: rotation by rows (9), position (3).
    pub target: usize,
    /// Current in world axes, 3.
    pub current: usize,
    /// Rows of the task.
    pub task: TaskRows,
    /// The previous action, as clipped.
    pub action: usize,
    /// Squared norm of its change, 1.
    pub change: usize,
    /// Means over the actuators, 3: square and power 3/2 of relative thrust, fraction at full thrust.
    pub effort: usize,
    /// Leaky integral of the pose error, 6.
    pub integral: usize,
    /// Running means of the metrics (of the squares of the four errors), 7.
    pub means: usize,
    /// Recovery, 2: out of tolerance at the last control instant (1) or not (0), and duration of the last departure, s.
    pub recovery: usize,
    /// Memory of disturbances that change within episodes.
    pub disturbance: Option<DisturbanceRows>,
    /// Number of rows.
    pub rows: usize,
}

impl EpisodeRows {
    /// Rows for a scene, with those that the task takes.
    pub(super) fn new(model: &TaskModel, task: impl FnOnce(&mut RowAllocator) -> TaskRows) -> Self {
        let (joints, actions) = (model.joints.len(), model.actions.len());
        let mut rows = RowAllocator::default();
        let (target, current, task) = (rows.take(12), rows.take(3), task(&mut rows));
        let this = Self {
            joints,
            coordinates: model.scene.coordinates().count(),
            actions,
            target,
            current,
            task,
            action: rows.take(actions),
            change: rows.take(1),
            effort: rows.take(3),
            integral: rows.take(6),
            means: rows.take(7),
            recovery: rows.take(2),
            disturbance: None,
            rows: rows.take(0),
        };
        let disturbance = DisturbanceRows::new(&model.disturbance, &model.context, this.rows);
        Self { disturbance, rows: disturbance.map_or(this.rows, |rows| rows.end), ..this }
    }

    /// Rows of a recorded memory, from which a control period can be differentiated: all but scripts and sensors.
    pub fn recorded(&self) -> usize {
        self.disturbance.map_or(self.rows, |rows| rows.recorded)
    }

    /// First of the rows that an action needs, up to [`Self::integral`].
    #[inline]
    pub fn first_for_action(&self) -> usize {
        self.task.joints.map_or(self.action, |joints| joints.now)
    }

    #[inline(always)]
    pub(super) fn target<L: Lane>(&self, memory: &Rows<'_, L::Real>) -> lie::Pose<L> {
        pose(memory, self.target)
    }

    #[inline(always)]
    pub(super) fn set_target<L: Lane>(&self, memory: &mut Rows<'_, L::Real>, target: &lie::Pose<L>) {
        set_pose(memory, self.target, target);
    }
}

/// Pose in rows from `row` on: rotation by rows (9) and position (3).
#[inline(always)]
pub(super) fn pose<L: Lane>(memory: &Rows<'_, L::Real>, row: usize) -> lie::Pose<L> {
    let [xx, xy, xz, yx, yy, yz, zx, zy, zz, x, y, z] = memory.get_all(row);
    lie::Pose { rotation: lie::Matrix3([[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]]), position: lie::Vector3([x, y, z]) }
}

/// Sets the pose in rows from `row` on.
#[inline(always)]
pub(super) fn set_pose<L: Lane>(memory: &mut Rows<'_, L::Real>, row: usize, pose: &lie::Pose<L>) {
    let ([x, y, z], position) = (pose.rotation.0, pose.position.0);
    memory.set_all(row, &[x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2], position[0], position[1], position[2]]);
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
    /// An episode at its start, before anything is drawn.
    pub fn blank(key: EpisodeKey, rows: EpisodeRows) -> Self {
        let mut this = Self { key, step: 0, rows, numbers: vec![0.0; rows.rows] };
        this.set_target(&Pose::default());
        this
    }

    /// From its parts, as a batch holds them; `numbers` by the rows.
    pub fn from_parts(key: EpisodeKey, step: u32, rows: EpisodeRows, numbers: Vec<f64>) -> Self {
        assert_eq!(numbers.len(), rows.rows, "numbers of an episode");
        Self { key, step, rows, numbers }
    }

    /// Seed and number.
    pub fn key(&self) -> EpisodeKey {
        self.key
    }

    /// Completed control periods.
    pub fn step(&self) -> u32 {
        self.step
    }

    /// All numbers, by the rows.
    pub fn numbers(&self) -> &[f64] {
        &self.numbers
    }

    /// Target at the current control instant.
    pub fn target(&self) -> Pose {
        let numbers = &self.numbers[self.rows.target..];
        Pose { position: Vector3::from_column_slice(&numbers[9..12]), rotation: Matrix3::from_row_slice(&numbers[..9]) }
    }

    /// Current in world axes over the last control period (at the start: over the first), m/s.
    pub fn current(&self) -> Vector3<f64> {
        Vector3::from_column_slice(&self.numbers[self.rows.current..][..3])
    }

    /// The previous action, as clipped; 0 before the first.
    pub fn action(&self) -> &[f64] {
        &self.numbers[self.rows.action..][..self.rows.actions]
    }

    /// Equally spaced places along the path of the end effector, the first and the last the same; none without a path.
    pub fn path(&self, count: usize) -> Vec<[f64; 3]> {
        let Some(rows) = self.rows.task.path else { return Vec::new() };
        let mut numbers = self.numbers.clone();
        let around = (0..count).map(|k| k as f64 / (count - 1).max(1) as f64);
        path_places(&Rows::of_one(&mut numbers), rows.path, around)
    }

    /// Joint references at the current control instant, one point per joint that follows one.
    pub fn reference(&self) -> Vec<ReferencePoint> {
        let points = self.rows.task.joints.map_or(&[][..], |rows| &self.numbers[rows.now..rows.next]);
        points.chunks_exact(2).map(|point| ReferencePoint { value: point[0], rate: point[1] }).collect()
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

    /// The episode as plain numbers, for saving; [`Episode::from_numbers`] restores it bit for bit. Integers are split into
    /// halves of 32 bits, so every number is finite.
    pub fn to_numbers(&self) -> Vec<f64> {
        let EpisodeKey { seed, episode } = self.key;
        let halves = |x: u64| [f64::from(x as u32), f64::from((x >> 32) as u32)];
        let head = [halves(seed), halves(episode)].concat();
        head.into_iter().chain([f64::from(self.step)]).chain(self.numbers.iter().copied()).collect()
    }

    /// The episode of [`Episode::to_numbers`].
    ///
    /// # Errors
    /// `TaskError::Saved` for a wrong number of numbers, one that is not finite, or a count that is not an integer.
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
        let integer = |x: f64| {
            let n = x as u32;
            if f64::from(n) == x { Ok(n) } else { Err(TaskError::Saved(format!("{x} is not a count"))) }
        };
        let join =
            |k: usize| Ok::<u64, TaskError>(u64::from(integer(head[k])?) | u64::from(integer(head[k + 1])?) << 32);
        let key = EpisodeKey { seed: join(0)?, episode: join(2)? };
        Ok(Self { key, step: integer(head[4])?, rows, numbers: rest.to_vec() })
    }
}
