//! A body in its principal frame.

use crate::lane::{Lane, Param, get_all};
use crate::lie::{Matrix3, Vector3, Vector6};

/// Inertia (rigid and added), drag and net weight in a frame that makes all of them diagonal, as that of most links does:
/// there they take half the arithmetic.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Principal<P> {
    /// Position of the frame in the body's.
    pub position: [P; 3],
    /// Its rotation by rows, where its axes do not lie along the body's.
    pub rotation: Option<[[P; 3]; 3]>,
    /// Diagonal of the inertia.
    pub inertia: [P; 6],
    /// Diagonals of D_L and D_Q.
    pub drag: [[P; 6]; 2],
    /// Mass less displaced mass: both have their centres here.
    pub net_mass: P,
}

impl<P: Copy> Principal<P> {
    /// The same with each number changed.
    pub fn map<Q>(&self, change: impl Fn(P) -> Q) -> Principal<Q> {
        Principal {
            position: self.position.map(&change),
            rotation: self.rotation.map(|rows| rows.map(|row| row.map(&change))),
            inertia: self.inertia.map(&change),
            drag: self.drag.map(|d| d.map(&change)),
            net_mass: change(self.net_mass),
        }
    }

    /// `B V - drag - restoring` of a body of relative twist V under gravity g, all in body frame: see
    /// [`crate::spatial::SpatialInertia::bias_wrench`], [`super::Drag`] and [`super::Restoring`].
    #[inline(always)]
    pub fn bias<L: Lane>(&self, twist: Vector6<L>, gravity: Vector3<L>, bias: &mut Vector6<L>)
    where
        P: Param<L>,
    {
        match &self.rotation {
            None => *bias = self.bias_along(twist, gravity),
            Some(rows) => {
                let r = Vector3(get_all(&self.position));
                let (v, w) = (twist.angular.cross_add(r, twist.linear), twist.angular);
                let net_mass = -self.net_mass.get();
                let turn = Matrix3([get_all(&rows[0]), get_all(&rows[1]), get_all(&rows[2])]);
                let there = self.in_place(turn.apply_transposed(v), turn.apply_transposed(w));
                bias.linear = gravity.scale_add(net_mass, turn.apply(there.linear));
                bias.angular = r.cross_add(bias.linear, turn.apply(there.angular));
            }
        }
    }

    /// [`Self::bias`] where the frame's axes lie along the body's.
    #[inline(always)]
    pub fn bias_along<L: Lane>(&self, twist: Vector6<L>, gravity: Vector3<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        let r = Vector3(get_all(&self.position));
        let there = self.in_place(twist.angular.cross_add(r, twist.linear), twist.angular);
        let linear = gravity.scale_add(-self.net_mass.get(), there.linear);
        Vector6 { linear, angular: r.cross_add(linear, there.angular) }
    }

    /// `B V - drag` in the principal frame.
    #[inline(always)]
    fn in_place<L: Lane>(&self, v: Vector3<L>, w: Vector3<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        let [mx, my, mz, jx, jy, jz]: [L; 6] = get_all(&self.inertia);
        let momentum = Vector3([mx * v.0[0], my * v.0[1], mz * v.0[2]]);
        // omega x J omega
        let mut moment = self.along(3, w).0;
        moment[0] = (w.0[1] * w.0[2]).mul_add(jz - jy, moment[0]);
        moment[1] = (w.0[2] * w.0[0]).mul_add(jx - jz, moment[1]);
        moment[2] = (w.0[0] * w.0[1]).mul_add(jy - jx, moment[2]);
        Vector6 { linear: w.cross_add(momentum, self.along(0, v)), angular: v.cross_add(momentum, Vector3(moment)) }
    }

    /// `(D_L + D_Q |v|) v` of the three entries from `first` on.
    #[inline(always)]
    fn along<L: Lane>(&self, first: usize, v: Vector3<L>) -> Vector3<L>
    where
        P: Param<L>,
    {
        let [linear, quadratic] = &self.drag;
        let mut out = v.0;
        for k in 0..3 {
            out[k] = quadratic[first + k].get().mul_add(v.0[k].abs(), linear[first + k].get()) * v.0[k];
        }
        Vector3(out)
    }
}
