//! Normal force of Hunt and Crossley on a ramp that is twice continuously differentiable, and regularised Coulomb friction. `[HuC75]`
//!
//! With the penetration x and its rate v:
//!
//! ```text
//! f   = k s(x) max(1 + d v, 0)
//! s   = 0 for x <= 0,  x^3 / e^2 (1 - x / (2 e)) up to e,  x - e / 2 beyond
//! f_t = -mu f v_t / sqrt(|v_t|^2 + v_s^2)
//! ```
//!
//! The force is continuous with its first two derivatives where spheres touch and part, so that methods keep their order
//! through a bounce. A sphere of mass m that enters at v_i leaves at v_o with
//! `v_i - ln(1 + d v_i) / d = -v_o - ln(1 - d v_o) / d`, whatever k, e and m.

use crate::lane::{Lane, Param, numbers};

numbers! {
    /// Numbers of the law.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct Law<P> {
        /// k, N/m.
        pub stiffness: P,
        /// d, s/m.
        pub dissipation: P,
        /// e, m.
        pub ramp: P,
        /// mu.
        pub friction: P,
        /// v_s^2, m2/s2; not 0.
        pub slip_speed_squared: P,
    }
}

impl<P: Copy> Law<P> {
    /// s, m.
    #[inline(always)]
    pub fn effective_depth<L: Lane>(&self, depth: L) -> L
    where
        P: Param<L>,
    {
        let e: L = self.ramp.get();
        let on_ramp = depth.max(L::zero()).min(e);
        let share = on_ramp / e;
        let ramp = on_ramp * share * share * share.mul_add(L::c(-0.5), L::c(1.0));
        ramp + (depth.max(e) - e)
    }

    /// f, N, at a depth that grows at this rate.
    #[inline(always)]
    pub fn normal_force<L: Lane>(&self, depth: L, rate: L) -> L
    where
        P: Param<L>,
    {
        let loss = self.dissipation.get().mul_add(rate, L::c(1.0)).max(L::zero());
        self.stiffness.get() * self.effective_depth(depth) * loss
    }
}
