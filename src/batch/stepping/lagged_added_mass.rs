//! Baseline method with added mass as a force: from the acceleration of earlier steps in place of the present one.
//!
//! The method of Gazebo's underwater plugins, since a plugin may add forces but not inertia:
//!
//! ```text
//! a <- (1 - alpha) a + alpha (V_r - last V_r) / h,    F = -(A_A a + B_A(V_r) V_r)      per body
//! ```
//!
//! On a single body of mass m a step multiplies `a` by `1 - alpha (1 + M_A / m)`: unstable at any step size unless
//! `M_A / m < 2 / alpha - 1`.

use super::equations_of_motion::EquationsOfMotion;
use crate::batch::storage::inputs::ActiveLoads;
use crate::batch::storage::layout::Layout;
use crate::dynamics::aba::link_twists;
use crate::integrate::Motion;
use crate::lane::{Lane, Param, Real, Rows, unroll};
use crate::lie::Vector6;
use crate::system::{JOINTS, UnscaledBodyTerms};

/// Moving bodies.
const BODIES: usize = JOINTS + 1;

/// Parameters of the lagged force.
#[derive(Clone, Copy)]
pub struct LaggedAddedMass<'a, P> {
    /// The bodies, vehicle first.
    pub unscaled: &'a [UnscaledBodyTerms<P>],
    /// alpha.
    pub filter: f64,
}

/// State of the filter, and the other loads.
pub struct LagState<L> {
    /// Factor on added mass.
    pub factor: L,
    /// Other wrench on the vehicle.
    pub wrench: Vector6<L>,
    /// Other wrenches on the links.
    pub links: [Vector6<L>; JOINTS],
    /// 1 after the first step, else 0.
    pub begun: L,
    /// V_r and a of each body at the last step, in its joint's frame.
    pub last: [[Vector6<L>; 2]; BODIES],
}

impl<P> LaggedAddedMass<'_, P> {
    /// Sets the loads of `equations` for a step of size `h` from `motion`: the lagged forces and the other loads.
    #[inline(always)]
    pub fn apply<L: Lane>(
        &self,
        h: L,
        motion: &Motion<L, JOINTS>,
        state: &mut LagState<L>,
        equations: &mut EquationsOfMotion<L, P>,
    ) where
        P: Param<L>,
    {
        let n = equations.system.chain().len();
        let mut twists = [motion.twist; BODIES];
        let both = [motion.twist, equations.scratch.water.world_twist(L::zero())];
        link_twists(equations.system, both, &motion.q, &motion.qd, equations.scratch, &mut twists[1..]);
        let begun = L::c(0.5).lt(state.begun);
        let (weight, rest) = (L::c(self.filter), L::c(1.0 - self.filter));
        for i in 0..=n {
            let Some(parts) = self.unscaled.get(i) else { break };
            let added = parts.added.get().scale(state.factor);
            let (twist, [last, a]) = (twists[i].to_array(), state.last[i]);
            let (last, mut a) = (last.to_array(), a.to_array());
            unroll!(k in 0 1 2 3 4 5 => {
                let seen = (twist[k] - last[k]) / h;
                a[k] = L::select(begun, seen.mul_add(weight, a[k] * rest), L::zero());
            });
            let a = Vector6::from_array(a);
            state.last[i] = [twists[i], a];
            let force = added.apply(a) + added.bias_wrench(twists[i]);
            let minus = L::c(-1.0);
            if i == 0 {
                equations.wrench = force.scale_add(minus, state.wrench);
            } else {
                equations.loads.links[i - 1] = force.scale_add(minus, state.links[i - 1]);
            }
        }
        equations.loads.on_links = true;
        state.begun = L::c(1.0);
    }
}

impl<T: Real> Rows<'_, T> {
    /// Loads the state of the filter.
    #[inline(always)]
    pub fn lag_state<L: Lane<Real = T>>(&self, layout: &Layout, active: ActiveLoads, state: &mut LagState<L>) {
        state.factor = self.factors(layout).added_mass;
        state.wrench = self.six(layout.wrench);
        for k in 0..layout.joints.min(JOINTS) {
            state.links[k] = if active.link_wrenches { self.six(layout.links + 6 * k) } else { Vector6::zero() };
        }
        state.begun = self.get(layout.lag);
        for i in 0..=layout.joints.min(JOINTS) {
            let row = layout.lag + 1 + 12 * i;
            state.last[i] = [self.six(row), self.six(row + 6)];
        }
    }

    /// Stores the state of the filter.
    #[inline(always)]
    pub fn set_lag_state<L: Lane<Real = T>>(&mut self, layout: &Layout, state: &LagState<L>) {
        self.set(layout.lag, state.begun);
        for i in 0..=layout.joints.min(JOINTS) {
            let row = layout.lag + 1 + 12 * i;
            self.set_some(row, &state.last[i][0].to_array(), 6);
            self.set_some(row + 6, &state.last[i][1].to_array(), 6);
        }
    }
}
