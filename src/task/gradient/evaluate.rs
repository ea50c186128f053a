//! Gradient through the evaluation of a state.

use super::frames::{BLOCK, Evaluated, GradientWidths, memory_row, pack, unpack};
use crate::lane::{Dual, Kernel, Lane, Real, Rows};
use crate::lie::{Matrix3, Pose, Vector3, Vector6};
use crate::system::JOINTS;
use crate::task::definition::{ControlInstant, TaskDefinition, TaskKernel};
use crate::task::disturbance::MEASURED;
use crate::task::observation::{LONGEST, ObservationWriter};
use crate::task::pose::{PoseError, StageState};
use crate::task::reward::squared_pose_error;

/// Result of [`super::TaskGradient::evaluate_vjp`].
pub(super) fn evaluate_vjp<K: TaskDefinition>(
    kernel: &TaskKernel<f64, K>,
    widths: GradientWidths,
    frames: &Evaluated<'_>,
    cotangents: &[f64],
) -> Vec<f64> {
    let (count, rows, state) = (frames.fresh.len(), widths.rows, widths.state_numbers());
    let inputs = widths.state + widths.measurement + widths.memory;
    let outputs = widths.observation + 1 + widths.measurement + widths.memory;
    let mut block = EvaluateBlock {
        kernel,
        widths,
        perfect: frames.perfect,
        count: 0,
        states: vec![0.0; BLOCK * state],
        fresh: [0.0; BLOCK],
        memory: vec![0.0; 2 * BLOCK * rows],
        saved: vec![0.0; BLOCK * rows],
        cotangents: vec![0.0; BLOCK * outputs],
        out: vec![0.0; BLOCK * inputs],
        entries: vec![0.0; 2 * LONGEST * BLOCK],
    };
    let [first_updated, updated] = kernel.rows.task.updated;
    let mut out = vec![0.0; count * inputs];
    for first in (0..count).step_by(BLOCK) {
        pack(frames.memory, 0..rows, rows, first, &mut block.saved);
        pack(frames.before, first_updated..first_updated + updated, rows, first, &mut block.saved);
        block.memory[..BLOCK * rows].copy_from_slice(&block.saved);
        pack(frames.states, 0..state, state, first, &mut block.states);
        pack(cotangents, 0..outputs, outputs, first, &mut block.cotangents);
        for column in 0..BLOCK {
            block.fresh[column] = f64::from(u8::from(frames.fresh[(first + column).min(count - 1)]));
        }
        block.count = BLOCK.min(count - first);
        f64::dispatch_wide(&mut block);
        unpack(&block.out, inputs, first, &mut out);
    }
    out
}

/// Columns of frames after the physics.
struct EvaluateBlock<'a, K: TaskDefinition> {
    kernel: &'a TaskKernel<f64, K>,
    widths: GradientWidths,
    perfect: bool,
    count: usize,
    states: Vec<f64>,
    fresh: [f64; BLOCK],
    /// Memory: values, and behind them slopes.
    memory: Vec<f64>,
    /// The values again.
    saved: Vec<f64>,
    /// Cotangents of observation, reward, measurement and memory.
    cotangents: Vec<f64>,
    /// Cotangents of state, measurement and memory.
    out: Vec<f64>,
    /// Entries of an observation: values, and behind them slopes.
    entries: Vec<f32>,
}

impl<K: TaskDefinition> Kernel<f64> for EvaluateBlock<'_, K> {
    #[inline(always)]
    fn run<L: Lane<Real = f64>>(&mut self) {
        for group in (0..self.count).step_by(L::LANES) {
            self.group::<L>(group);
        }
    }
}

impl<K: TaskDefinition> EvaluateBlock<'_, K> {
    /// Cotangents of the inputs of a group of frames. The parts that all tasks share and that are linear are differentiated by
    /// hand: scales of an observation, and the integral. All else is differentiated along one coordinate after the other.
    #[inline(always)]
    fn group<L: Lane<Real = f64>>(&mut self, group: usize) {
        let (kernel, widths, rows) = (self.kernel, &self.widths, &self.kernel.rows);
        let Self { perfect, states, fresh, memory, saved, cotangents, out, entries, .. } = self;
        let (n, a, zero) = (rows.joints, rows.actions, L::zero());
        let coordinates = rows.coordinates;
        let values = state_values::<L>(states, group, coordinates);
        let at = ControlInstant::new(kernel, Rows::of_block(memory, group), &values);
        let (in_bounds, truth) = (at.in_bounds(), at.true_values());
        let error = at.error;
        let fresh = L::c(0.5).lt(L::load(&fresh[group..]));
        let observed = Cotangents { scaling: &kernel.scaling, columns: &cotangents[group..] };
        let own_end = widths.observation - a - 6;
        let memory_at = widths.observation + 1 + widths.measurement;

        let mut by_measured = [zero; MEASURED];
        for k in 0..rows.means - rows.action {
            let mut cotangent: L = observed.get(memory_at + k);
            let value = L::load(&memory[(rows.action + k) * BLOCK + group..]);
            if k < a {
                cotangent += observed.entry(own_end + k, value);
            } else if k >= a + 4 {
                let i = k - a - 4;
                cotangent += observed.entry(own_end + a + i, value);
                by_measured[i] = L::select(in_bounds, cotangent * L::splat(kernel.leak[1]), zero);
                cotangent = L::select(in_bounds, cotangent * L::splat(kernel.leak[0]), cotangent);
            }
            cotangent.store(&mut out[(widths.state + widths.measurement + k) * BLOCK + group..]);
        }
        let mut by_truth = [zero; MEASURED];
        let ups = if K::OBSERVES_UP { 3 } else { 0 };
        for entry in 0..widths.measurement {
            // The direction against gravity is observed before the joints, and measured after them.
            let k = match entry {
                _ if entry < 12 => entry,
                _ if entry < 12 + ups => entry + 2 * n,
                _ => entry - ups,
            };
            let home = if (12..12 + n).contains(&k) { kernel.home[k - 12] } else { 0.0 };
            let cotangent = observed.entry(entry, truth[k] - L::splat(home));
            if *perfect {
                by_truth[k] = cotangent;
            } else {
                by_measured[k] += cotangent;
            }
        }
        for k in 0..widths.measurement {
            by_truth[k] += observed.get(widths.observation + 1 + k);
            by_truth[k] += L::select(fresh, by_measured[k], zero);
            L::select(fresh, zero, by_measured[k]).store(&mut out[(widths.state + k) * BLOCK + group..]);
        }
        let (common, [first_updated, updated]) = (rows.means - rows.action, rows.task.updated);
        for k in common..widths.memory {
            zero.store(&mut out[(widths.state + widths.measurement + k) * BLOCK + group..]);
        }

        // One pass for each coordinate of the state, measured quantity that the task observes again, and row of the memory that
        // the reward depends on: change, effort, and the task's own.
        let measured_inputs = K::MEASURED_INPUTS.min(widths.measurement);
        let (measured_end, effort_end) = (widths.state + measured_inputs, widths.state + measured_inputs + 4);
        for along in 0..effort_end + updated {
            let (state, memory) = (seeded_state(&values, coordinates, along), Rows::of_block(memory, group));
            // Only pose and joint coordinates change the pose error.
            let mut at = if along < 6 + coordinates {
                ControlInstant::new(kernel, memory, &state)
            } else {
                ControlInstant { kernel, memory, state: &state, error: constant_error(&error) }
            };
            let truth = at.true_values();
            let (mut measured, mut sum) = (truth, zero);
            for k in 0..widths.measurement {
                let seeded = along < measured_end && along == widths.state + k;
                let given = Dual::new(truth[k].value, if seeded { L::c(1.0) } else { zero });
                measured[k] = if *perfect { truth[k] } else { Dual::select(fresh, truth[k], given) };
                sum = truth[k].slope.mul_add(by_truth[k], sum);
            }
            let (mut input, mut row) = (along, None);
            if along >= measured_end {
                let k = if along < effort_end { a + along - measured_end } else { common + along - effort_end };
                (input, row) = (widths.state + widths.measurement + k, Some(memory_row(rows, k)));
            }
            if let Some(row) = row {
                at.memory.set(row, Dual::new(L::load(&saved[row * BLOCK + group..]), L::c(1.0)));
            }

            let mut writer = ObservationWriter::new(&kernel.scaling[widths.measurement..own_end], entries, L::LANES);
            K::observe(&at, &measured, &mut writer);
            let slopes = &entries[entries.len() / 2..];
            for k in 0..own_end - widths.measurement {
                let slope = L::load_single(&slopes[k * L::LANES..]);
                sum = slope.mul_add(observed.get(widths.measurement + k), sum);
            }
            let [position, attitude] = at.frame_errors();
            let (effort, change) = (at.memory.get(rows.effort), at.memory.get(rows.change));
            let error = squared_pose_error(position, attitude);
            let mut reward: Dual<L> = kernel.reward.terms(error, effort, change, in_bounds).sum();
            if !K::METRICS.is_empty() {
                let metrics = at.instant_metrics();
                reward += K::update(&mut at, &metrics);
            }
            sum = reward.slope.mul_add(observed.get(widths.observation), sum);
            for k in 0..updated {
                let number: Dual<L> = at.memory.get(first_updated + k);
                sum = number.slope.mul_add(observed.get(memory_at + common + k), sum);
            }
            // The next pass starts from the same memory.
            if let Some(row) = row {
                at.memory.set(row, Dual::new(L::load(&saved[row * BLOCK + group..]), zero));
            }
            for row in first_updated..first_updated + updated {
                at.memory.set(row, Dual::new(L::load(&saved[row * BLOCK + group..]), zero));
            }
            let to = &mut out[input * BLOCK + group..];
            if along >= widths.state {
                sum += L::load(to);
            }
            sum.store(to);
        }
    }
}

/// Cotangents of the outputs of a group of frames.
struct Cotangents<'a> {
    /// One over the scale, and the bound, of each entry of an observation.
    scaling: &'a [[f64; 2]],
    columns: &'a [f64],
}

impl Cotangents<'_> {
    /// Cotangent of output `k`.
    #[inline(always)]
    fn get<L: Lane<Real = f64>>(&self, k: usize) -> L {
        L::load(&self.columns[k * BLOCK..])
    }

    /// Cotangent of the physical value behind entry `k` of an observation; 0 beyond its bound.
    #[inline(always)]
    fn entry<L: Lane<Real = f64>>(&self, k: usize, value: L) -> L {
        let [by, bound] = self.scaling[k];
        let beyond = L::splat(bound).lt((value * L::splat(by)).abs());
        L::select(beyond, L::zero(), self.get::<L>(k) * L::splat(by))
    }
}

/// A pose error that no coordinate changes.
#[inline(always)]
fn constant_error<L: Lane<Real = f64>>(error: &PoseError<L>) -> PoseError<Dual<L>> {
    let (mut position, mut rotation, mut turn) = ([Dual::zero(); 3], [Dual::zero(); 3], [[Dual::zero(); 3]; 3]);
    for i in 0..3 {
        position[i] = Dual::new(error.position.0[i], L::zero());
        rotation[i] = Dual::new(error.rotation.0[i], L::zero());
        for k in 0..3 {
            turn[i][k] = Dual::new(error.turn.0[i][k], L::zero());
        }
    }
    let angle = Dual::new(error.angle, L::zero());
    PoseError { position: Vector3(position), rotation: Vector3(rotation), angle, turn: Matrix3(turn) }
}

/// States of a group of frames.
#[inline(always)]
fn state_values<L: Lane<Real = f64>>(states: &[f64], group: usize, joints: usize) -> StageState<L> {
    let mut numbers = [L::zero(); 18 + 2 * JOINTS];
    for k in 0..18 + 2 * joints {
        numbers[k] = L::load(&states[k * BLOCK + group..]);
    }
    let [xx, xy, xz, yx, yy, yz, zx, zy, zz, x, y, z, vx, vy, vz, wx, wy, wz, ..] = numbers;
    let (mut q, mut qd) = ([L::zero(); JOINTS], [L::zero(); JOINTS]);
    for i in 0..joints {
        (q[i], qd[i]) = (numbers[18 + i], numbers[18 + joints + i]);
    }
    StageState {
        pose: Pose { rotation: Matrix3([[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]]), position: Vector3([x, y, z]) },
        twist: Vector6::from_array([vx, vy, vz, wx, wy, wz]),
        q,
        qd,
    }
}

/// These states with slopes 1 along a coordinate: `[xi; q; V; q']` with the pose `T exp(xi)`; 0 beyond the last.
#[inline(always)]
fn seeded_state<L: Lane<Real = f64>>(values: &StageState<L>, joints: usize, along: usize) -> StageState<Dual<L>> {
    let mut seed = [L::zero(); 12 + 2 * JOINTS];
    if along < seed.len() {
        seed[along] = L::c(1.0);
    }
    let (shift, turn) = (Vector3([seed[0], seed[1], seed[2]]), Vector3([seed[3], seed[4], seed[5]]));
    let (mut rotation, mut position, mut twist) = ([[Dual::zero(); 3]; 3], [Dual::zero(); 3], [Dual::zero(); 6]);
    let twists = values.twist.to_array();
    for i in 0..3 {
        let row = Vector3(values.pose.rotation.0[i]);
        // Row i of R hat(w) is r_i x w.
        let slope = row.cross(turn);
        for k in 0..3 {
            rotation[i][k] = Dual::new(row.0[k], slope.0[k]);
        }
        position[i] = Dual::new(values.pose.position.0[i], row.dot(shift));
    }
    for k in 0..6 {
        twist[k] = Dual::new(twists[k], seed[6 + joints + k]);
    }
    let (mut q, mut qd) = ([Dual::zero(); JOINTS], [Dual::zero(); JOINTS]);
    for i in 0..joints {
        q[i] = Dual::new(values.q[i], seed[6 + i]);
        qd[i] = Dual::new(values.qd[i], seed[12 + joints + i]);
    }
    let pose = Pose { rotation: Matrix3(rotation), position: Vector3(position) };
    StageState { pose, twist: Vector6::from_array(twist), q, qd }
}
