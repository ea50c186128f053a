//! Quasi-static tether. `[HC eq. 21, F_EXT]`

use super::fin::MIN_SPEED_SQUARED;
use crate::lane::{Lane, Param, get_all, numbers};
use crate::lie::{Vector3, Vector6};

numbers! {
    /// A tether, quasi-static: weight in water and drag of the half that the vehicle carries.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct Tether<P> {
        /// Point of attachment in the vehicle frame, m.
        pub position: [P; 3],
        /// Mass less displaced mass of that half, kg.
        pub net_mass: P,
        /// `rho C_D d l / 2` of that half of length l, N s2/m2.
        pub drag: P,
    }
}

impl<P: Copy> Tether<P> {
    /// Wrench on the vehicle, from its twist relative to the water and gravity in vehicle axes.
    #[inline(always)]
    pub fn wrench<L: Lane>(&self, twist: Vector6<L>, gravity: Vector3<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        let r = Vector3(get_all(&self.position));
        let v = twist.angular.cross_add(r, twist.linear);
        let speed = (v.dot(v) + L::c(MIN_SPEED_SQUARED)).sqrt();
        let force = v.scale_add(-(self.drag.get() * speed), gravity.scale(self.net_mass.get()));
        Vector6 { linear: force, angular: r.cross(force) }
    }
}
