//! The rival that treats added mass as a force: by the acceleration seen in the steps before, not the present one.
//!
//! Gazebo's underwater plugins do so, since a plugin may add forces but not inertia:
//!
//! ```text
//! a <- (1 - alpha) a + alpha (V_r - last V_r) / h,    F = -(A_A a + B_A(V_r) V_r)      per body
//! ```
//!
//! On a body of mass m alone `a` is multiplied by `1 - alpha (1 + M_A / m)` at each step: unstable, however short the step,
//! unless `M_A / m < 2 / alpha - 1`.

use super::dynamics::Dynamics;
use crate::dynamics::aba::link_twists;
use crate::integrate::Motion;
use crate::lane::{Lane, Param, Real, Shared};
use crate::lie::Vector6;
use crate::system::{JOINTS, UnscaledBodyTerms};

/// Moving bodies.
const BODIES: usize = JOINTS + 1;

/// What the lagged force is made of.
#[derive(Clone, Copy)]
pub struct Lagged<'a, T> {
    /// The bodies, vehicle first.
    pub unscaled: &'a [UnscaledBodyTerms<Shared<T>>],
    /// alpha.
    pub filter: f64,
}

/// What is remembered of the steps before, and what else acts.
pub struct Lag<L> {
    /// Factor on added mass.
    pub factor: L,
    /// Wrench on the vehicle.
    pub wrench: Vector6<L>,
    /// Wrenches on the links.
    pub links: [Vector6<L>; JOINTS],
    /// 1 where there were any, else 0.
    pub begun: L,
    /// V_r and a of each body, in its joint's frame.
    pub last: [[Vector6<L>; 2]; BODIES],
}

impl<T: Real> Lagged<'_, T> {
    /// Puts the forces of a step of size `h` from `motion` into `dynamics`, with what else acts.
    #[inline(always)]
    pub fn apply<L: Lane<Real = T>, B: Param<L>>(
        &self,
        h: L,
        motion: &Motion<L, JOINTS>,
        lag: &mut Lag<L>,
        dynamics: &mut Dynamics<L, B>,
    ) {
        let n = dynamics.system.chain().len();
        let mut twists = [motion.twist; BODIES];
        link_twists(dynamics.system, motion.twist, &motion.q, &motion.qd, dynamics.scratch, &mut twists[1..]);
        let begun = L::c(0.5).lt(lag.begun);
        let (weight, rest) = (L::c(self.filter), L::c(1.0 - self.filter));
        for i in 0..=n {
            let Some(parts) = self.unscaled.get(i) else { break };
            let added = parts.added.get().scale(lag.factor);
            let (twist, [last, a]) = (twists[i].to_array(), lag.last[i]);
            let (last, mut a) = (last.to_array(), a.to_array());
            for k in 0..6 {
                let seen = (twist[k] - last[k]) / h;
                a[k] = L::select(begun, seen.mul_add(weight, a[k] * rest), L::zero());
            }
            let a = Vector6::from_array(a);
            lag.last[i] = [twists[i], a];
            let force = added.apply(a) + added.bias_wrench(twists[i]);
            let minus = L::c(-1.0);
            if i == 0 {
                dynamics.wrench = force.scale_add(minus, lag.wrench);
            } else {
                dynamics.loads.links[i - 1] = force.scale_add(minus, lag.links[i - 1]);
            }
        }
        dynamics.loads.on_links = true;
        lag.begun = L::c(1.0);
    }
}
