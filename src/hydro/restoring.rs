//! Weight and buoyancy.

use crate::lane::{Lane, Param, get_all, numbers};
use crate::lie::{Vector3, Vector6};

numbers! {
    /// Weight and buoyancy of a body under uniform gravity: `f = n g`, `m = s x g`, with g in body axes. `[HC eq. 24]`
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct Restoring<P> {
        /// n, mass minus displaced mass, kg.
        pub net_mass: P,
        /// s = m r_CoG - rho vol r_CoB, kg m.
        pub moment: [P; 3],
    }
}

impl<P: Copy> Restoring<P> {
    /// Wrench under gravity `g` (body axes).
    #[inline(always)]
    pub fn wrench<L: Lane>(&self, g: Vector3<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        Vector6 { linear: g.scale(self.net_mass.get()), angular: Vector3(get_all(&self.moment)).cross(g) }
    }

    /// `sum` minus the wrench under gravity `g` (body axes).
    #[inline(always)]
    pub fn subtract<L: Lane>(&self, g: Vector3<L>, sum: Vector6<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        let linear = g.scale_add(-self.net_mass.get(), sum.linear);
        Vector6 { linear, angular: g.cross_add(Vector3(get_all(&self.moment)), sum.angular) }
    }
}
