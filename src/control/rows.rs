//! Control laws on rows in lanes: observations and memory to lanes, and wrenches in lanes to actions.

use nalgebra as na;

use super::controller::{Controller, Widths};
use super::indices::{BlockIndices, ModelIndices};
use super::nominal_model::{ArmState, VehicleMotion};
use super::{ACTIONS, ActionMap, Actuated, Actuation};
use crate::dynamics::aba::Scratch;
use crate::error::ControlError;
use crate::lane::{Isa, Kernel, Lane, Real};
use crate::lie::Vector6;
use crate::limits::interrupt;
use crate::system::JOINTS;

/// Upper bound of the lanes of f64.
pub(super) const WIDEST: usize = 16;

/// Memory of a law's computations, for all groups of rows.
pub(super) struct Work<L> {
    pub scratch: Scratch<L>,
    /// A group's memory.
    pub memory: Vec<L>,
    /// Wrenches by model.
    pub wrenches: Vec<Vector6<L>>,
}

/// Control law on groups of rows.
pub(super) trait LaneLaw: Controller + Sized {
    /// Writes the actions of up to `L::LANES` rows, and updates their memory.
    fn control<L: Lane<Real = f64>>(
        &self,
        observations: &[f32],
        memory: &mut [f64],
        actions: &mut [f32],
        work: &mut Work<L>,
    );

    /// [`Controller::act`], group by group.
    fn act_in_lanes(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        self.widths().rows(observations, memory, actions)?;
        // An unavailable instruction set is reported elsewhere.
        f64::dispatch_lanes(
            Isa::best().unwrap_or(Isa::Plain),
            &mut Groups { law: self, observations, memory, actions },
        );
        Ok(())
    }
}

struct Groups<'a, C> {
    law: &'a C,
    observations: &'a [f32],
    memory: &'a mut [f64],
    actions: &'a mut [f32],
}

impl<C: LaneLaw> Kernel<f64> for Groups<'_, C> {
    #[inline(always)]
    fn run<L: Lane<Real = f64>>(&mut self) {
        let Widths { observation, memory, action } = self.law.widths();
        let mut work = Work { scratch: Scratch::new(), memory: Vec::new(), wrenches: Vec::new() };
        let count = self.observations.len() / observation;
        for first in (0..count).step_by(L::LANES) {
            if interrupt::requested() {
                break;
            }
            let end = count.min(first + L::LANES);
            self.law.control::<L>(
                &self.observations[first * observation..end * observation],
                &mut self.memory[first * memory..end * memory],
                &mut self.actions[first * action..end * action],
                &mut work,
            );
        }
    }
}

/// Measurement at a row of observations.
#[derive(Debug, Clone, Copy)]
pub struct MeasuredMotion<L> {
    /// Vehicle.
    pub motion: VehicleMotion<L>,
    /// Arm.
    pub arm: ArmState<L>,
    /// Joint references for the next control instant; not delayed.
    pub reference: ArmState<L>,
}

/// Entry `offset` of each row, times its scale; rows past the last repeat it.
#[inline(always)]
fn column<L: Lane<Real = f64>>(rows: &[f32], width: usize, (offset, scale): (usize, f64)) -> L {
    let (mut all, last) = ([0.0; WIDEST], rows.len() / width - 1);
    for lane in 0..L::LANES {
        all[lane] = f64::from(rows[lane.min(last) * width + offset]) * scale;
    }
    L::load(&all)
}

/// Resets rows of memory that are not finite: predictions may diverge with a vehicle that does.
pub(super) fn reset_diverged(memory: &mut [f64], width: usize) {
    for row in memory.chunks_exact_mut(width) {
        let mut finite = true;
        for k in 0..width {
            finite &= row[k].is_finite();
        }
        if !finite {
            row.fill(0.0);
        }
    }
}

/// The first columns of rows of f64 as lanes.
#[inline(always)]
pub(super) fn load<L: Lane<Real = f64>>(rows: &[f64], width: usize, to: &mut [L]) {
    let last = rows.len() / width - 1;
    for k in 0..to.len() {
        let mut all = [0.0; WIDEST];
        for lane in 0..L::LANES {
            all[lane] = rows[lane.min(last) * width + k];
        }
        to[k] = L::load(&all);
    }
}

/// Lanes as the first columns of rows of f64.
#[inline(always)]
pub(super) fn store<L: Lane<Real = f64>>(from: &[L], rows: &mut [f64], width: usize) {
    let count = rows.len() / width;
    for k in 0..from.len() {
        let mut all = [0.0; WIDEST];
        from[k].store(&mut all);
        for lane in 0..count {
            rows[lane * width + k] = all[lane];
        }
    }
}

/// A block of the arm.
#[inline(always)]
fn joints<L: Lane<Real = f64>>(indices: &ModelIndices, rows: &[f32], [q, qd]: &[BlockIndices; 2]) -> ArmState<L> {
    let mut arm = ArmState { q: [L::zero(); JOINTS], qd: [L::zero(); JOINTS] };
    let width = indices.vehicle.width;
    for (i, home) in indices.home.iter().enumerate() {
        let coordinate: L = column(rows, width, (q.offset + i, q.scale[i]));
        arm.q[i] = coordinate + L::c(*home);
        arm.qd[i] = column(rows, width, (qd.offset + i, qd.scale[i]));
    }
    arm
}

/// Measurements of a group of rows.
#[inline(always)]
pub(super) fn read<L: Lane<Real = f64>>(indices: &ModelIndices, rows: &[f32]) -> MeasuredMotion<L> {
    let (vehicle, mut error, mut twist) = (&indices.vehicle, [L::zero(); 6], [L::zero(); 6]);
    for k in 0..6 {
        error[k] = column(rows, vehicle.width, (vehicle.error.offset + k, vehicle.error.scale[k]));
        twist[k] = column(rows, vehicle.width, (vehicle.twist.offset + k, vehicle.twist.scale[k]));
    }
    MeasuredMotion {
        motion: VehicleMotion { error: Vector6::from_array(error), twist: Vector6::from_array(twist) },
        arm: joints(indices, rows, &indices.arm),
        reference: joints(indices, rows, &indices.reference),
    }
}

/// Vectors of six lanes by row.
#[inline(always)]
pub(super) fn rows_of<L: Lane<Real = f64>, const K: usize>(lanes: &[[L; 6]; K]) -> [[[f64; 6]; K]; WIDEST] {
    let mut rows = [[[0.0; 6]; K]; WIDEST];
    for (k, six) in lanes.iter().enumerate() {
        for (i, x) in six.iter().enumerate() {
            let mut all = [0.0; WIDEST];
            x.store(&mut all);
            for lane in 0..L::LANES {
                rows[lane][k][i] = all[lane];
            }
        }
    }
    rows
}

/// Rows of six numbers as a vector of lanes.
#[inline(always)]
pub(super) fn lanes_of<L: Lane<Real = f64>>(rows: &[[f64; 6]; WIDEST]) -> Vector6<L> {
    let mut lanes = [L::zero(); 6];
    for i in 0..6 {
        let mut all = [0.0; WIDEST];
        for lane in 0..L::LANES {
            all[lane] = rows[lane][i];
        }
        lanes[i] = L::load(&all);
    }
    Vector6::from_array(lanes)
}

/// The arm in a lane.
#[inline(always)]
pub(super) fn arm_of<L: Lane<Real = f64>>(arm: &ArmState<L>, lane: usize) -> ArmState<f64> {
    let mut row = ArmState { q: [0.0; JOINTS], qd: [0.0; JOINTS] };
    for i in 0..JOINTS {
        let mut all = [0.0; WIDEST];
        arm.q[i].store(&mut all);
        row.q[i] = all[lane];
        arm.qd[i].store(&mut all);
        row.qd[i] = all[lane];
    }
    row
}

/// Writes the actions of these wrenches, 0 where a prediction has diverged.
#[inline(always)]
pub(super) fn write_actions<L: Lane<Real = f64>>(map: &ActionMap, wrench: Vector6<L>, actions: &mut [f32]) {
    let rows = rows_of(&[wrench.to_array()]);
    for lane in 0..actions.len() / map.len() {
        let wrench = na::Vector6::from(rows[lane][0].map(|x| if x.is_finite() { x } else { 0.0 }));
        map.normalise(&wrench, &[], &mut actions[lane * map.len()..][..map.len()]);
    }
}

/// Thrusts of these actions within the thrusters' limits, and their wrench.
#[inline(always)]
pub(super) fn achieved<L: Lane<Real = f64>>(actuation: &Actuation<f64>, actions: &[f32]) -> Actuated<L> {
    let mut entries = [L::zero(); ACTIONS];
    for k in 0..actuation.len() {
        entries[k] = column(actions, actuation.len(), (k, 1.0));
    }
    actuation.act(&entries)
}
