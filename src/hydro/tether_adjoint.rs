//! Adjoint of the tether.

use super::fin::MIN_SPEED_SQUARED;
use super::tether::Tether;
use crate::lane::Lane;
use crate::lie::{Vector3, Vector6};

impl<L: Lane> Tether<L> {
    /// Cotangents of twist and gravity from that of [`Tether::wrench`].
    #[inline(always)]
    pub fn wrench_adjoint(&self, twist: Vector6<L>, of: Vector6<L>) -> (Vector6<L>, Vector3<L>) {
        let r = Vector3(self.position);
        let v = twist.angular.cross_add(r, twist.linear);
        let speed = (v.dot(v) + L::c(MIN_SPEED_SQUARED)).sqrt();
        let of_force = of.angular.cross_add(r, of.linear);
        let of_v = v.scale_add(of_force.dot(v) / speed, of_force.scale(speed)).scale(-self.drag);
        (Vector6 { linear: of_v, angular: r.cross(of_v) }, of_force.scale(self.net_mass))
    }
}
