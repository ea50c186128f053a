//! A point mass on a body.

use super::SpatialInertia;
use crate::lane::{Lane, Param, get_all};
use crate::lie::{Vector3, Vector6};

/// A mass at a point of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointMass<P> {
    /// kg.
    pub mass: P,
    /// In the body's frame, m.
    pub at: [P; 3],
}

impl<P: Copy> PointMass<P> {
    /// The same with each number changed.
    pub fn map<Q>(&self, change: impl Fn(P) -> Q) -> PointMass<Q> {
        PointMass { mass: change(self.mass), at: self.at.map(change) }
    }

    /// Its inertia in the body's frame: `[[m I, -m [r]], [m [r], -m [r] [r]]]`.
    #[inline(always)]
    pub fn inertia<L: Lane>(&self) -> SpatialInertia<L>
    where
        P: Param<L>,
    {
        let (m, r, zero): (L, [L; 3], L) = (self.mass.get(), get_all(&self.at), L::zero());
        let [x, y, z] = Vector3(r).scale(m).0;
        SpatialInertia {
            m: [m, zero, zero, m, zero, m],
            h: [[zero, z, -y], [-z, zero, x], [y, -x, zero]],
            j: [
                y.mul_add(r[1], z * r[2]),
                -(x * r[1]),
                -(x * r[2]),
                x.mul_add(r[0], z * r[2]),
                -(y * r[2]),
                x.mul_add(r[0], y * r[1]),
            ],
        }
    }

    /// `m (omega x v_r - gravity)` at the point r, which the body's twist V and gravity ask for; as a wrench in the body's
    /// frame.
    #[inline(always)]
    pub fn bias<L: Lane>(&self, twist: Vector6<L>, gravity: Vector3<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        let r = Vector3(get_all(&self.at));
        let v = twist.angular.cross_add(r, twist.linear);
        let force = (twist.angular.cross(v) - gravity).scale(self.mass.get());
        Vector6 { linear: force, angular: r.cross(force) }
    }
}
