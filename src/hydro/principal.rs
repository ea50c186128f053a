//! A body in its principal frame.

use crate::lane::{Lane, Param, get_all};
use crate::lie::{Matrix3, Vector3, Vector6};

/// Inertia (rigid and added), drag and net weight in a frame that makes all of them diagonal, as that of most links does:
/// there they take half the arithmetic.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Principal<P> {
    /// Where the frame lies in the body's.
    pub place: Place<P>,
    /// Its rotation by rows, where its axes do not lie along the body's.
    pub rotation: Option<[[P; 3]; 3]>,
    /// Diagonal of the linear inertia.
    pub masses: [P; 3],
    /// What turning makes of the angular one: `[J_z - J_y, J_x - J_z, J_y - J_x]`.
    pub gyration: [P; 3],
    /// Diagonals of D_L and D_Q.
    pub drag: [[P; 6]; 2],
    /// Mass less displaced mass: both have their centres here.
    pub net_mass: P,
}

/// A point of a body: that of a link is often on an axis of its joint's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Place<P> {
    /// On the x axis.
    X(P),
    /// On the y axis.
    Y(P),
    /// On the z axis.
    Z(P),
    /// Anywhere.
    At([P; 3]),
}

impl Place<f64> {
    /// The place of a point.
    pub fn of(point: [f64; 3]) -> Self {
        match point {
            [x, 0.0, 0.0] => Place::X(x),
            [0.0, y, 0.0] => Place::Y(y),
            [0.0, 0.0, z] => Place::Z(z),
            point => Place::At(point),
        }
    }
}

impl<P: Copy> Place<P> {
    /// The same with each number changed.
    pub fn map<Q>(&self, change: impl Fn(P) -> Q) -> Place<Q> {
        match *self {
            Place::X(x) => Place::X(change(x)),
            Place::Y(y) => Place::Y(change(y)),
            Place::Z(z) => Place::Z(change(z)),
            Place::At(point) => Place::At(point.map(change)),
        }
    }

    /// The point in lanes.
    #[inline(always)]
    fn point<L: Lane>(&self) -> Vector3<L>
    where
        P: Param<L>,
    {
        let zero = L::zero();
        Vector3(match self {
            Place::X(x) => [x.get(), zero, zero],
            Place::Y(y) => [zero, y.get(), zero],
            Place::Z(z) => [zero, zero, z.get()],
            Place::At(point) => get_all(point),
        })
    }
}

impl<P: Copy> Principal<P> {
    /// The same with each number changed.
    pub fn map<Q>(&self, change: impl Fn(P) -> Q) -> Principal<Q> {
        Principal {
            place: self.place.map(&change),
            rotation: self.rotation.map(|rows| rows.map(|row| row.map(&change))),
            masses: self.masses.map(&change),
            gyration: self.gyration.map(&change),
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
            None => self.bias_along(twist, gravity, bias),
            Some(rows) => {
                let r = self.place.point();
                let (v, w) = (twist.angular.cross_add(r, twist.linear), twist.angular);
                let turn = Matrix3([get_all(&rows[0]), get_all(&rows[1]), get_all(&rows[2])]);
                let there = self.in_place(turn.apply_transposed(v), turn.apply_transposed(w));
                bias.linear = self.less_weight(gravity, turn.apply(there.linear));
                bias.angular = r.cross_add(bias.linear, turn.apply(there.angular));
            }
        }
    }

    /// [`Self::bias`] where the frame's axes lie along the body's.
    #[inline(always)]
    pub fn bias_along<L: Lane>(&self, twist: Vector6<L>, gravity: Vector3<L>, bias: &mut Vector6<L>)
    where
        P: Param<L>,
    {
        match self.place {
            Place::X(x) => *bias = self.bias_on_axis::<L, 0>(x.get(), twist, gravity),
            Place::Y(y) => *bias = self.bias_on_axis::<L, 1>(y.get(), twist, gravity),
            Place::Z(z) => *bias = self.bias_on_axis::<L, 2>(z.get(), twist, gravity),
            Place::At(point) => {
                let r = Vector3(get_all(&point));
                let there = self.in_place(twist.angular.cross_add(r, twist.linear), twist.angular);
                bias.linear = self.less_weight(gravity, there.linear);
                bias.angular = r.cross_add(bias.linear, there.angular);
            }
        }
    }

    /// The same at a point of axis N.
    #[inline(always)]
    fn bias_on_axis<L: Lane, const N: usize>(&self, d: L, twist: Vector6<L>, gravity: Vector3<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        let (i, k) = ((N + 1) % 3, (N + 2) % 3);
        let (mut v, w) = (twist.linear, twist.angular);
        v.0[i] = w.0[k].mul_add(d, v.0[i]);
        v.0[k] = w.0[i].neg_mul_add(d, v.0[k]);
        let there = self.in_place(v, w);
        let (linear, mut angular) = (self.less_weight(gravity, there.linear), there.angular);
        angular.0[i] = linear.0[k].neg_mul_add(d, angular.0[i]);
        angular.0[k] = linear.0[i].mul_add(d, angular.0[k]);
        Vector6 { linear, angular }
    }

    /// `force` less what pulls at the body.
    #[inline(always)]
    fn less_weight<L: Lane>(&self, gravity: Vector3<L>, force: Vector3<L>) -> Vector3<L>
    where
        P: Param<L>,
    {
        gravity.scale_add(-self.net_mass.get(), force)
    }

    /// `B V - drag` in the principal frame.
    #[inline(always)]
    fn in_place<L: Lane>(&self, v: Vector3<L>, w: Vector3<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        let [mx, my, mz]: [L; 3] = get_all(&self.masses);
        let [gx, gy, gz]: [L; 3] = get_all(&self.gyration);
        let momentum = Vector3([mx * v.0[0], my * v.0[1], mz * v.0[2]]);
        // omega x J omega
        let mut moment = self.along(3, w).0;
        moment[0] = (w.0[1] * w.0[2]).mul_add(gx, moment[0]);
        moment[1] = (w.0[2] * w.0[0]).mul_add(gy, moment[1]);
        moment[2] = (w.0[0] * w.0[1]).mul_add(gz, moment[2]);
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_point_on_an_axis_is_a_point(
            d in -2.0..2.0f64, v in prop::array::uniform3(-3.0..3.0f64), w in prop::array::uniform3(-3.0..3.0f64),
            g in prop::array::uniform3(-10.0..10.0f64), numbers in prop::array::uniform32(0.1..5.0f64),
        ) {
            let (twist, gravity) = (Vector6 { linear: Vector3(v), angular: Vector3(w) }, Vector3(g));
            let at = |place| {
                let three = |k: usize| [numbers[k], numbers[k + 1], numbers[k + 2]];
                let six = |k: usize| [0, 1, 2, 3, 4, 5].map(|i| numbers[k + i]);
                let (masses, gyration, drag) = (three(0), three(3), [six(6), six(12)]);
                let body = Principal { place, rotation: None, masses, gyration, drag, net_mass: numbers[18] - 2.5 };
                let mut bias = Vector6::zero();
                body.bias_along(twist, gravity, &mut bias);
                bias.to_array()
            };
            let axes = [(Place::X(d), [d, 0.0, 0.0]), (Place::Y(d), [0.0, d, 0.0]), (Place::Z(d), [0.0, 0.0, d])];
            for (place, point) in axes {
                prop_assert_eq!(Place::of(point), place);
                for (on_axis, anywhere) in at(place).into_iter().zip(at(Place::At(point))) {
                    prop_assert!((on_axis - anywhere).abs() < 1e-11, "{place:?}: {on_axis}, {anywhere}");
                }
            }
        }
    }
}
