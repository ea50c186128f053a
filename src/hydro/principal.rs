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

    /// `A g + B V - drag - restoring`, with or without (`G`) the rate g, of a body of relative twist V under gravity, all in body frame: see
    /// [`crate::spatial::SpatialInertia::bias_wrench`], [`super::Drag`] and [`super::Restoring`].
    #[inline(always)]
    pub fn bias<const G: bool, L: Lane>(
        &self,
        twist: Vector6<L>,
        gained: Vector6<L>,
        gravity: Vector3<L>,
        bias: &mut Vector6<L>,
    ) where
        P: Param<L>,
    {
        let r = Vector3(get_all(&self.position));
        let (twist, gained) = (moved(r, twist), moved(r, gained));
        let net_mass = -self.net_mass.get();
        match &self.rotation {
            None => {
                let there = self.in_place::<G, L>(twist, gained);
                bias.linear = gravity.scale_add(net_mass, there.linear);
                bias.angular = r.cross_add(bias.linear, there.angular);
            }
            Some(rows) => {
                let turn = Matrix3([get_all(&rows[0]), get_all(&rows[1]), get_all(&rows[2])]);
                let there = self.in_place::<G, L>(turned_back(&turn, twist), turned_back(&turn, gained));
                bias.linear = gravity.scale_add(net_mass, turn.apply(there.linear));
                bias.angular = r.cross_add(bias.linear, turn.apply(there.angular));
            }
        }
    }

    /// `A g + B V - drag` in the principal frame.
    #[inline(always)]
    fn in_place<const G: bool, L: Lane>(&self, twist: Vector6<L>, gained: Vector6<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        let (v, w) = (twist.linear, twist.angular);
        let [mx, my, mz, jx, jy, jz]: [L; 6] = get_all(&self.inertia);
        let momentum = Vector3([mx * v.0[0], my * v.0[1], mz * v.0[2]]);
        let spin = Vector3([jx * w.0[0], jy * w.0[1], jz * w.0[2]]);
        let (mut f, mut m) = (self.along(0, v), self.along(3, w));
        if G {
            let (a, b) = (gained.linear.0, gained.angular.0);
            f = Vector3([mx.mul_add(a[0], f.0[0]), my.mul_add(a[1], f.0[1]), mz.mul_add(a[2], f.0[2])]);
            m = Vector3([jx.mul_add(b[0], m.0[0]), jy.mul_add(b[1], m.0[1]), jz.mul_add(b[2], m.0[2])]);
        }
        Vector6 { linear: w.cross_add(momentum, f), angular: v.cross_add(momentum, w.cross_add(spin, m)) }
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

/// A twist or its rate at the point r.
#[inline(always)]
fn moved<L: Lane>(r: Vector3<L>, x: Vector6<L>) -> Vector6<L> {
    Vector6 { linear: x.angular.cross_add(r, x.linear), ..x }
}

/// `R^T` times both parts.
#[inline(always)]
fn turned_back<L: Lane>(turn: &Matrix3<L>, x: Vector6<L>) -> Vector6<L> {
    Vector6 { linear: turn.apply_transposed(x.linear), angular: turn.apply_transposed(x.angular) }
}
