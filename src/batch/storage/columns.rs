//! Column groups of a block: what the kernels load into lanes and store from them.

use super::inputs::ActiveLoads;
use super::layout::Layout;
use crate::dynamics::aba::ArmLoads;
use crate::hydro::{THRUSTERS, Thruster, ThrusterDynamics};
use crate::integrate::{Attitude, Motion, StepEstimates};
use crate::lane::{Lane, Param, Real, Rows, unroll};
use crate::lie::{Matrix3, Pose, Vector3, Vector6};
use crate::system::{FACTORS, Factors, JOINTS};
use crate::terms::{FINS, FinAxes, FinTerm};

impl<T: Real> Rows<'_, T> {
    /// Three rows: a vector.
    #[inline(always)]
    pub fn vector<L: Lane<Real = T>>(&self, row: usize) -> Vector3<L> {
        Vector3([self.get(row), self.get(row + 1), self.get(row + 2)])
    }

    /// Six rows: `[linear; angular]`.
    #[inline(always)]
    pub fn six<L: Lane<Real = T>>(&self, row: usize) -> Vector6<L> {
        Vector6 { linear: self.vector(row), angular: self.vector(row + 3) }
    }

    /// Nine rows: a matrix by rows.
    #[inline(always)]
    pub fn matrix<L: Lane<Real = T>>(&self, row: usize) -> Matrix3<L> {
        Matrix3([self.vector(row).0, self.vector(row + 3).0, self.vector(row + 6).0])
    }

    /// Loads the motion.
    #[inline(always)]
    pub fn motion<L: Lane<Real = T>, const BASELINES: bool>(&self, layout: &Layout, motion: &mut Motion<L, JOINTS>) {
        self.place::<_, BASELINES>(layout, motion);
        motion.twist = self.six(layout.twist);
        self.get_some(layout.q, layout.joints, &mut motion.q);
        self.get_some(layout.qd, layout.joints, &mut motion.qd);
    }

    /// Loads position and attitude of the motion.
    #[inline(always)]
    pub fn place<L: Lane<Real = T>, const BASELINES: bool>(&self, layout: &Layout, motion: &mut Motion<L, JOINTS>) {
        motion.pose = Pose { rotation: self.matrix(layout.rotation), position: self.vector(layout.position) };
        motion.rest = self.vector(layout.position + 3);
        if BASELINES && layout.keeps != Attitude::Matrix {
            unroll!(k in 0 1 2 3 => {
                motion.attitude[k] = self.get(layout.attitude + k);
            });
        }
    }

    /// Stores the motion.
    #[inline(always)]
    pub fn set_motion<L: Lane<Real = T>, const BASELINES: bool>(
        &mut self,
        layout: &Layout,
        motion: &Motion<L, JOINTS>,
    ) {
        unroll!(k in 0 1 2 => {
            self.set_some(layout.rotation + 3 * k, &motion.pose.rotation.0[k], 3);
        });
        self.set_some(layout.position, &motion.pose.position.0, 3);
        self.set_some(layout.position + 3, &motion.rest.0, 3);
        self.set_some(layout.twist, &motion.twist.to_array(), 6);
        self.set_some(layout.q, &motion.q, layout.joints);
        self.set_some(layout.qd, &motion.qd, layout.joints);
        if BASELINES && layout.keeps != Attitude::Matrix {
            self.set_some(layout.attitude, &motion.attitude, 4);
        }
    }

    /// Adds steps of size `h` to the time. A compensated sum: neither many steps nor their division into calls shows in it.
    #[inline(always)]
    pub fn add_time<L: Lane<Real = T>>(&mut self, layout: &Layout, h: T, steps: usize) {
        let (mut time, mut rest): (L, L) = (self.get(layout.time), self.get(layout.time + 1));
        for _ in 0..steps {
            let passed = rest + L::splat(h);
            let next = time + passed;
            (time, rest) = (next, passed - (next - time));
        }
        self.set_some(layout.time, &[time, rest], 2);
    }

    /// Estimates of the quality of the last steps.
    #[inline(always)]
    pub fn step_estimates<L: Lane<Real = T>>(&self, layout: &Layout) -> StepEstimates<L> {
        let planned = if layout.adaptive { self.get(layout.planned) } else { L::zero() };
        let row = layout.estimates;
        let mut estimates = StepEstimates { planned, ..StepEstimates::zero() };
        unroll!(k in 0 1 2 => {
            estimates.contrast[k] = self.get(row + k);
        });
        estimates.velocity_error = [self.get(row + 3), self.get(row + 4)];
        estimates.spin_error = self.get(row + 5);
        estimates
    }

    /// Stores these estimates.
    #[inline(always)]
    pub fn set_step_estimates<L: Lane<Real = T>>(&mut self, layout: &Layout, estimates: &StepEstimates<L>) {
        self.set_some(layout.estimates, &estimates.contrast, 3);
        self.set_some(layout.estimates + 3, &estimates.velocity_error, 2);
        self.set(layout.estimates + 5, estimates.spin_error);
        if layout.adaptive {
            self.set(layout.planned, estimates.planned);
        }
    }

    /// Factors on the parameters.
    #[inline(always)]
    pub fn factors<L: Lane<Real = T>>(&self, layout: &Layout) -> Factors<L> {
        let mut factors = [L::zero(); FACTORS];
        self.get_some(layout.factors, FACTORS, &mut factors);
        Factors::from_array(factors)
    }

    /// Loads thrusters with dynamics and their commands, for steps of size `h` (s).
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
        self.get_some(layout.command, layout.thrusters, &mut commands);
        self.get_some(layout.thrust, layout.thrusters, &mut propulsion.thrust);
        for k in 0..layout.thrusters.min(THRUSTERS) {
            gains[k] = self.get::<L>(layout.loss + k).neg_mul_add(factors.thrust, factors.thrust);
        }
        propulsion.command(thrusters, &commands, &gains, (L::splat(h), factors.thruster_lag));
    }

    /// Loads the deflections of the fins.
    #[inline(always)]
    pub fn surfaces<L: Lane<Real = T>, P: Param<L>>(
        &self,
        layout: &Layout,
        fins: &[FinTerm<P>],
        surfaces: &mut FinAxes<L>,
    ) {
        let mut deflections = [L::zero(); FINS];
        self.get_some(layout.fin, layout.fins, &mut deflections);
        surfaces.deflect(fins, &deflections);
    }

    /// Loads the active loads on joints and links.
    #[inline(always)]
    pub fn loads<L: Lane<Real = T>>(&self, layout: &Layout, active: ActiveLoads, loads: &mut ArmLoads<L>) {
        loads.terms = active.target_terms;
        loads.on_links = active.link_wrenches;
        self.get_some(layout.torque, layout.joints, &mut loads.torque);
        for k in 0..layout.joints.min(JOINTS) {
            let row = layout.target + 4 * k;
            if active.target_terms > 0 {
                (loads.target[k][0], loads.target[k][1]) = (self.get(row), self.get(row + 1));
            }
            if active.target_terms > 2 {
                (loads.target[k][2], loads.target[k][3]) = (self.get(row + 2), self.get(row + 3));
            }
            if active.link_wrenches {
                loads.links[k] = self.six(layout.links + 6 * k);
            }
        }
    }
}
