//! Points of a body, and a mass at one.

use super::SpatialInertia;
use crate::lane::{Lane, Param, get_all};
use crate::lie::{Vector3, Vector6};

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
    pub fn point<L: Lane>(&self) -> Vector3<L>
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

/// A mass at a point of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointMass<P> {
    /// kg.
    pub mass: P,
    /// In the body's frame, m.
    pub at: Place<P>,
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
        let (m, r, zero): (L, Vector3<L>, L) = (self.mass.get(), self.at.point(), L::zero());
        let (r, [x, y, z]) = (r.0, r.scale(m).0);
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

    /// Adds `m (omega x v_r - gravity)` at the point r, which the body's twist V and gravity ask for, to a wrench in the
    /// body's frame.
    #[inline(always)]
    pub fn add_bias<L: Lane>(&self, twist: Vector6<L>, gravity: Vector3<L>, bias: &mut Vector6<L>)
    where
        P: Param<L>,
    {
        match self.at {
            Place::X(x) => self.add_bias_on_axis::<L, 0>(x.get(), twist, gravity, bias),
            Place::Y(y) => self.add_bias_on_axis::<L, 1>(y.get(), twist, gravity, bias),
            Place::Z(z) => self.add_bias_on_axis::<L, 2>(z.get(), twist, gravity, bias),
            Place::At(point) => {
                let (m, r): (L, _) = (self.mass.get(), Vector3(get_all(&point)));
                let pull = twist.angular.cross(twist.angular.cross_add(r, twist.linear)) - gravity;
                bias.linear = pull.scale_add(m, bias.linear);
                bias.angular = r.scale(m).cross_add(pull, bias.angular);
            }
        }
    }

    /// The same at a point of axis N.
    #[inline(always)]
    fn add_bias_on_axis<L: Lane, const N: usize>(
        &self,
        d: L,
        twist: Vector6<L>,
        gravity: Vector3<L>,
        bias: &mut Vector6<L>,
    ) where
        P: Param<L>,
    {
        let (i, k) = ((N + 1) % 3, (N + 2) % 3);
        let (mut v, w) = (twist.linear, twist.angular);
        v.0[i] = w.0[k].mul_add(d, v.0[i]);
        v.0[k] = w.0[i].neg_mul_add(d, v.0[k]);
        let (m, pull): (L, _) = (self.mass.get(), w.cross(v) - gravity);
        let moment = m * d;
        bias.linear = pull.scale_add(m, bias.linear);
        bias.angular.0[i] = pull.0[k].neg_mul_add(moment, bias.angular.0[i]);
        bias.angular.0[k] = pull.0[i].mul_add(moment, bias.angular.0[k]);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_point_mass_asks_for_what_its_inertia_does(
            [x, y, z] in prop::array::uniform3(-2.0..2.0f64), mass in 0.0..5.0f64,
            v in prop::array::uniform3(-3.0..3.0f64), w in prop::array::uniform3(-3.0..3.0f64),
            g in prop::array::uniform3(-10.0..10.0f64),
        ) {
            let (twist, gravity) = (Vector6 { linear: Vector3(v), angular: Vector3(w) }, Vector3(g));
            for point in [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z], [x, y, z]] {
                let load = PointMass { mass, at: Place::of(point) };
                let mut bias = twist;
                load.add_bias(twist, gravity, &mut bias);
                let weight = gravity.scale(mass);
                let pull = Vector6 { linear: weight, angular: Vector3(point).cross(weight) };
                let expected = twist + (load.inertia().bias_wrench(twist) - pull);
                for (got, expected) in bias.to_array().into_iter().zip(expected.to_array()) {
                    prop_assert!((got - expected).abs() < 1e-12 * (1.0 + expected.abs()), "{load:?}: {got}, {expected}");
                }
            }
        }
    }
}
