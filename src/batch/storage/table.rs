//! Access to single instances in rows of blocks.

use std::ops::Range;

use nalgebra as na;

use super::inputs::InstanceLoads;
use super::layout::{Layout, index};
use crate::batch::monitoring::step_quality::StepQuality;
use crate::hydro::Thrusts;
use crate::integrate::{Attitude, step_error, stiffness};
use crate::lane::Real;
use crate::lie::{Pose, Vector6};
use crate::system::{FACTORS, Factors, Flow, State, quaternion, roll_pitch_yaw};
use crate::terms::FINS;

/// Reads and writes single instances: column `i` of rows in this layout.
#[derive(Debug, Clone)]
pub struct Table {
    /// Rows of a block.
    pub layout: Layout,
    /// Each link's frame in its joint's frame: of all instances, or of each.
    pub links: Vec<Vec<Pose<f64>>>,
}

impl Table {
    fn index<T: Real>(&self, i: usize, row: usize) -> usize {
        index::<T>(self.layout.rows, i, row)
    }

    /// Number in row `row`.
    pub fn get<T: Real>(&self, rows: &[T], i: usize, row: usize) -> f64 {
        rows[self.index::<T>(i, row)].to_f64()
    }

    fn get_all<T: Real, const K: usize>(&self, rows: &[T], i: usize, row: usize) -> [f64; K] {
        std::array::from_fn(|k| self.get(rows, i, row + k))
    }

    fn set_all<T: Real>(&self, rows: &mut [T], i: usize, row: usize, values: impl IntoIterator<Item = f64>) {
        for (k, value) in values.into_iter().enumerate() {
            rows[self.index::<T>(i, row + k)] = T::from_f64(value);
        }
    }

    /// State of an instance.
    pub fn state<T: Real>(&self, rows: &[T], i: usize) -> State {
        let layout = &self.layout;
        let place = |k| self.get(rows, i, layout.position + k);
        let mut state = State {
            position: [0, 1, 2].map(|k| place(k) + place(3 + k)).into(),
            rotation: na::Matrix3::from_row_slice(&self.get_all::<T, 9>(rows, i, layout.rotation)),
            twist: self.get_all::<T, 6>(rows, i, layout.twist).into(),
            time: self.get(rows, i, layout.time) + self.get(rows, i, layout.time + 1),
            ..State::default()
        };
        for k in 0..layout.joints {
            let rest = if k < layout.rests { self.get(rows, i, layout.q_rest + k) } else { 0.0 };
            state.q[k] = self.get(rows, i, layout.q + k) + rest;
            state.qd[k] = self.get(rows, i, layout.qd + k);
        }
        for k in 0..layout.thrusters {
            state.thrust[k] = self.get(rows, i, layout.thrust + k);
        }
        state
    }

    /// Sets the state.
    pub fn set_state<T: Real>(&self, rows: &mut [T], i: usize, state: &State) {
        let layout = &self.layout;
        self.set_all(rows, i, layout.rotation, state.rotation.transpose().iter().copied());
        let position = state.position.map(|x| T::from_f64(x).to_f64());
        self.set_all(rows, i, layout.position, position.iter().copied());
        self.set_all(rows, i, layout.position + 3, (state.position - position).iter().copied());
        self.set_all(rows, i, layout.twist, state.twist.iter().copied());
        self.set_all(rows, i, layout.q, state.q[..layout.joints].iter().copied());
        let rest = |q: &f64| q - T::from_f64(*q).to_f64();
        self.set_all(rows, i, layout.q_rest, state.q[..layout.rests].iter().map(rest));
        self.set_all(rows, i, layout.qd, state.qd[..layout.joints].iter().copied());
        self.set_all(rows, i, layout.thrust, state.thrust[..layout.thrusters].iter().copied());
        let time = T::from_f64(state.time).to_f64();
        self.set_all(rows, i, layout.time, [time, state.time - time]);
        match layout.keeps {
            Attitude::Matrix => {}
            Attitude::Quaternion => self.set_all(rows, i, layout.attitude, quaternion(&state.rotation)),
            Attitude::Angles => {
                let [roll, pitch, yaw] = roll_pitch_yaw(&state.rotation);
                self.set_all(rows, i, layout.attitude, [0.0, roll, pitch, yaw]);
            }
        }
        // Estimates of another motion say nothing about this one.
        self.set_all(rows, i, layout.estimates, [0.0; 6]);
        if layout.adaptive {
            self.set_all(rows, i, layout.planned, [0.0]);
        }
        if layout.lagged {
            self.set_all(rows, i, layout.lag, [0.0]);
        }
    }

    /// Sets the velocities of a state.
    pub fn set_velocities<T: Real>(&self, rows: &mut [T], i: usize, state: &State) {
        self.set_all(rows, i, self.layout.twist, state.twist.iter().copied());
        self.set_all(rows, i, self.layout.qd, state.qd[..self.layout.joints].iter().copied());
    }

    /// Copies rows, given as pairs of the row in `other` and the row here, from column `ahead + i` of `other` to each column i.
    pub fn copy<T: Real, U: Real>(
        &self,
        rows: &mut [T],
        columns: Range<usize>,
        (other, from, ahead): (&Self, &[U], usize),
        pairs: &[[usize; 2]],
    ) {
        for &[there, here] in pairs {
            for i in columns.clone() {
                rows[self.index::<T>(i, here)] = T::from_f64(other.get(from, ahead + i, there));
            }
        }
    }

    /// Quality of the last steps of size `h` (s), without the accumulated error.
    pub fn step_quality<T: Real>(&self, rows: &[T], i: usize, h: f64) -> StepQuality {
        let [places, speeds, changes, errors @ ..]: [f64; 6] = self.get_all(rows, i, self.layout.estimates);
        let stiffness = stiffness([places, speeds, changes], T::EPSILON);
        StepQuality { stiffness, error: step_error(errors, h), accumulated: 0.0 }
    }

    /// Attitude coordinates, where the integrator has any besides the rotation matrix.
    pub fn attitude<T: Real>(&self, rows: &[T], i: usize) -> Option<[f64; 4]> {
        (self.layout.keeps != Attitude::Matrix).then(|| self.get_all(rows, i, self.layout.attitude))
    }

    /// Sets these coordinates.
    pub fn set_attitude<T: Real>(&self, rows: &mut [T], i: usize, attitude: &[f64; 4]) {
        self.set_all(rows, i, self.layout.attitude, *attitude);
    }

    /// Flow of the water.
    pub fn flow<T: Real>(&self, rows: &[T], i: usize) -> Flow {
        let vector = |row| self.get_all::<T, 3>(rows, i, row).into();
        Flow { velocity: vector(self.layout.current), acceleration: vector(self.layout.acceleration) }
    }

    /// Sets the flow of the water.
    pub fn set_flow<T: Real>(&self, rows: &mut [T], i: usize, flow: &Flow) {
        self.set_all(rows, i, self.layout.current, flow.velocity.iter().copied());
        self.set_all(rows, i, self.layout.acceleration, flow.acceleration.iter().copied());
    }

    /// Factors on the parameters.
    pub fn factors<T: Real>(&self, rows: &[T], i: usize) -> Factors<f64> {
        Factors::from_array(self.get_all(rows, i, self.layout.factors))
    }

    /// Fraction of its thrust that each thruster with dynamics has lost.
    pub fn losses<T: Real>(&self, rows: &[T], i: usize) -> Thrusts {
        let lost = |k| if k < self.layout.thrusters { self.get(rows, i, self.layout.loss + k) } else { 0.0 };
        std::array::from_fn(lost)
    }

    /// `[any instance has a factor other than 1, any has a payload]`.
    pub fn scaled<T: Real>(&self, rows: &[T]) -> [bool; 2] {
        let ones = Factors::ONE.to_array().map(T::from_f64);
        let mut differs = [false; FACTORS];
        for block in rows.chunks_exact(self.layout.rows * T::BLOCK) {
            let factors = block[self.layout.factors * T::BLOCK..].chunks_exact(T::BLOCK);
            for ((differs, row), one) in differs.iter_mut().zip(factors).zip(ones) {
                *differs |= row.iter().fold(false, |any, x| any | (*x != one));
            }
        }
        [differs.contains(&true), Factors::from_array(differs).payload]
    }

    /// Sets the factors on the parameters.
    pub fn set_factors<T: Real>(&self, rows: &mut [T], i: usize, factors: &Factors<f64>) {
        self.set_all(rows, i, self.layout.factors, factors.to_array());
    }

    /// Sets the deflections of the fins.
    pub fn set_fins<T: Real>(&self, rows: &mut [T], i: usize, fins: &[f64; FINS]) {
        self.set_all(rows, i, self.layout.fin, fins[..self.layout.fins].iter().copied());
    }

    /// Sets the loads by thrusters and fins.
    pub fn set_actuators<T: Real>(&self, rows: &mut [T], i: usize, loads: &InstanceLoads) {
        self.set_all(rows, i, self.layout.wrench, loads.wrench);
        self.set_all(rows, i, self.layout.command, loads.command[..self.layout.thrusters].iter().copied());
        self.set_fins(rows, i, &loads.fins);
    }

    /// Sets the wrenches on the links, each given in its link frame; the instance is number `instance` among all.
    pub fn set_links<T: Real>(
        &self,
        rows: &mut [T],
        i: usize,
        instance: usize,
        wrenches: impl Iterator<Item = [f64; 6]>,
    ) {
        let links = self.links.get(instance).or(self.links.first());
        for (k, (link, wrench)) in links.into_iter().flatten().zip(wrenches).enumerate() {
            let wrench = link.co_adjoint_apply_inverse(Vector6::from_array(wrench));
            self.set_all(rows, i, self.layout.links + 6 * k, wrench.to_array());
        }
    }

    /// Every number of the instance.
    pub fn column<T: Real>(&self, rows: &[T], i: usize) -> Vec<f64> {
        (0..self.layout.rows).map(|row| self.get(rows, i, row)).collect()
    }

    /// Sets every number of the instance.
    pub fn set_column<T: Real>(&self, rows: &mut [T], i: usize, column: &[f64]) {
        self.set_all(rows, i, 0, column[..self.layout.rows].iter().copied());
    }
}
