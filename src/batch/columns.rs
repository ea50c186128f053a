//! Groups of columns of a block, as the kernels read and write them.

use super::dynamics::Station;
use super::lagged::Lag;
use super::layout::Layout;
use super::step::Switches;
use crate::dynamics::aba::Loads;
use crate::hydro::{FINS, Fin, FinAxes, THRUSTERS, Thruster, ThrusterDynamics};
use crate::integrate::{Attitude, Motion, Watch};
use crate::lane::{Lane, Param, Real};
use crate::lie::{Matrix3, Pose, Vector3, Vector6};
use crate::system::{FACTORS, Factors, JOINTS};

/// One column group of a block: rows by number, `LANES` instances wide.
pub struct Columns<'a, T> {
    /// Rows of a block.
    pub rows: &'a mut [T],
    /// First column of the group.
    pub first: usize,
}

impl<T: Real> Columns<'_, T> {
    /// A row; NaN where there is none, as a panic would take a call.
    #[inline(always)]
    pub fn get<L: Lane<Real = T>>(&self, row: usize) -> L {
        let at = row * T::BLOCK + self.first;
        let numbers = self.rows.get(at..at + L::LANES);
        debug_assert!(numbers.is_some(), "row {row}");
        if let Some(numbers) = numbers { L::load(numbers) } else { L::c(f64::NAN) }
    }

    /// Sets a row, if there is one.
    #[inline(always)]
    pub fn set<L: Lane<Real = T>>(&mut self, row: usize, x: L) {
        let at = row * T::BLOCK + self.first;
        let numbers = self.rows.get_mut(at..at + L::LANES);
        debug_assert!(numbers.is_some(), "row {row}");
        if let Some(numbers) = numbers {
            x.store(numbers);
        }
    }

    /// Three rows.
    #[inline(always)]
    pub fn vector<L: Lane<Real = T>>(&self, row: usize) -> Vector3<L> {
        Vector3([self.get(row), self.get(row + 1), self.get(row + 2)])
    }

    /// Six rows.
    #[inline(always)]
    pub fn six<L: Lane<Real = T>>(&self, row: usize) -> Vector6<L> {
        Vector6 { linear: self.vector(row), angular: self.vector(row + 3) }
    }

    /// Nine rows: a matrix by rows.
    #[inline(always)]
    pub fn matrix<L: Lane<Real = T>>(&self, row: usize) -> Matrix3<L> {
        Matrix3([self.vector(row).0, self.vector(row + 3).0, self.vector(row + 6).0])
    }

    /// Sets the first `count` of these rows.
    #[inline(always)]
    pub fn set_all<L: Lane<Real = T>, const K: usize>(&mut self, row: usize, x: &[L; K], count: usize) {
        for k in 0..count.min(K) {
            self.set(row + k, x[k]);
        }
    }

    /// One row per joint.
    #[inline(always)]
    pub fn joints<L: Lane<Real = T>>(&self, row: usize, count: usize, to: &mut [L; JOINTS]) {
        for k in 0..count.min(JOINTS) {
            to[k] = self.get(row + k);
        }
    }

    /// The motion that is stepped.
    #[inline(always)]
    pub fn motion<L: Lane<Real = T>, const BASELINES: bool>(&self, layout: &Layout, motion: &mut Motion<L, JOINTS>) {
        self.place::<_, BASELINES>(layout, motion);
        motion.twist = self.six(layout.twist);
        self.joints(layout.q, layout.joints, &mut motion.q);
        self.joints(layout.qd, layout.joints, &mut motion.qd);
    }

    /// Its position and attitude.
    #[inline(always)]
    pub fn place<L: Lane<Real = T>, const BASELINES: bool>(&self, layout: &Layout, motion: &mut Motion<L, JOINTS>) {
        motion.pose = Pose { rotation: self.matrix(layout.rotation), position: self.vector(layout.position) };
        motion.rest = self.vector(layout.position + 3);
        if BASELINES && layout.keeps != Attitude::Matrix {
            for k in 0..4 {
                motion.attitude[k] = self.get(layout.attitude + k);
            }
        }
    }

    /// Sets the motion.
    #[inline(always)]
    pub fn set_motion<L: Lane<Real = T>, const BASELINES: bool>(
        &mut self,
        layout: &Layout,
        motion: &Motion<L, JOINTS>,
    ) {
        for k in 0..3 {
            self.set_all(layout.rotation + 3 * k, &motion.pose.rotation.0[k], 3);
        }
        self.set_all(layout.position, &motion.pose.position.0, 3);
        self.set_all(layout.position + 3, &motion.rest.0, 3);
        self.set_all(layout.twist, &motion.twist.to_array(), 6);
        self.set_all(layout.q, &motion.q, layout.joints);
        self.set_all(layout.qd, &motion.qd, layout.joints);
        if BASELINES && layout.keeps != Attitude::Matrix {
            self.set_all(layout.attitude, &motion.attitude, 4);
        }
    }

    /// What was seen of the motion.
    #[inline(always)]
    pub fn watch<L: Lane<Real = T>>(&self, layout: &Layout) -> Watch<L> {
        let plan = if layout.adaptive { self.get(layout.plan) } else { L::zero() };
        let seen = layout.contrast;
        let mut watch = Watch { plan, ..Watch::blank() };
        for k in 0..3 {
            watch.contrast[k] = self.get(seen + k);
        }
        (watch.slip, watch.spin) = ([self.get(seen + 3), self.get(seen + 4)], self.get(seen + 5));
        watch
    }

    /// Sets what was seen of it.
    #[inline(always)]
    pub fn set_watch<L: Lane<Real = T>>(&mut self, layout: &Layout, watch: &Watch<L>) {
        self.set_all(layout.contrast, &watch.contrast, 3);
        self.set_all(layout.contrast + 3, &watch.slip, 2);
        self.set(layout.contrast + 5, watch.spin);
        if layout.adaptive {
            self.set(layout.plan, watch.plan);
        }
    }

    /// What is remembered of the steps before.
    #[inline(always)]
    pub fn lag<L: Lane<Real = T>>(&self, layout: &Layout, switches: Switches, lag: &mut Lag<L>) {
        lag.factor = self.factors(layout).added_mass;
        lag.wrench = self.six(layout.wrench);
        for k in 0..layout.joints.min(JOINTS) {
            lag.links[k] = if switches.on_links { self.six(layout.links + 6 * k) } else { Vector6::zero() };
        }
        lag.begun = self.get(layout.lag);
        for i in 0..=layout.joints.min(JOINTS) {
            let row = layout.lag + 1 + 12 * i;
            lag.last[i] = [self.six(row), self.six(row + 6)];
        }
    }

    /// Sets what is remembered.
    #[inline(always)]
    pub fn set_lag<L: Lane<Real = T>>(&mut self, layout: &Layout, lag: &Lag<L>) {
        self.set(layout.lag, lag.begun);
        for i in 0..=layout.joints.min(JOINTS) {
            let row = layout.lag + 1 + 12 * i;
            self.set_all(row, &lag.last[i][0].to_array(), 6);
            self.set_all(row + 6, &lag.last[i][1].to_array(), 6);
        }
    }

    /// Station that is kept.
    #[inline(always)]
    pub fn station<L: Lane<Real = T>>(&self, layout: &Layout) -> Station<L> {
        let target = Pose { rotation: self.matrix(layout.station), position: self.vector(layout.station + 9) };
        Station { target, current: self.vector(layout.current), acceleration: self.vector(layout.acceleration) }
    }

    /// Factors on the parameters.
    #[inline(always)]
    pub fn factors<L: Lane<Real = T>>(&self, layout: &Layout) -> Factors<L> {
        let mut factors = [L::zero(); FACTORS];
        for k in 0..FACTORS {
            factors[k] = self.get(layout.factors + k);
        }
        Factors::from_array(factors)
    }

    /// Thrusters with dynamics, under their commands, for steps of size `h`.
    #[inline(always)]
    pub fn propulsion<L: Lane<Real = T>, P: Param<L>>(
        &self,
        layout: &Layout,
        thrusters: &[Thruster<P>],
        h: T,
        propulsion: &mut ThrusterDynamics<L>,
    ) {
        let (mut commands, mut gains) = ([L::zero(); THRUSTERS], [L::zero(); THRUSTERS]);
        let factors = self.factors(layout);
        for k in 0..layout.thrusters.min(THRUSTERS) {
            commands[k] = self.get(layout.command + k);
            gains[k] = self.get::<L>(layout.loss + k).neg_mul_add(factors.thrust, factors.thrust);
            propulsion.thrust[k] = self.get(layout.thrust + k);
        }
        propulsion.command(thrusters, &commands, &gains, (L::splat(h), factors.thruster_lag));
    }

    /// Fins, deflected.
    #[inline(always)]
    pub fn surfaces<L: Lane<Real = T>, P: Param<L>>(
        &self,
        layout: &Layout,
        fins: &[Fin<P>],
        surfaces: &mut FinAxes<L>,
    ) {
        let mut deflections = [L::zero(); FINS];
        for k in 0..layout.fins.min(FINS) {
            deflections[k] = self.get(layout.fin + k);
        }
        surfaces.deflect(fins, &deflections);
    }

    /// Loads, as far as they are on.
    #[inline(always)]
    pub fn loads<L: Lane<Real = T>>(&self, layout: &Layout, switches: Switches, loads: &mut Loads<L>) {
        loads.terms = switches.terms;
        loads.on_links = switches.on_links;
        for k in 0..layout.joints.min(JOINTS) {
            loads.torque[k] = self.get(layout.torque + k);
            let row = layout.target + 4 * k;
            if switches.terms > 0 {
                (loads.target[k][0], loads.target[k][1]) = (self.get(row), self.get(row + 1));
            }
            if switches.terms > 2 {
                (loads.target[k][2], loads.target[k][3]) = (self.get(row + 2), self.get(row + 3));
            }
            if switches.on_links {
                loads.links[k] = self.six(layout.links + 6 * k);
            }
        }
    }
}
