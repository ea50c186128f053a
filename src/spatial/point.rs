//! Points of a body, and a mass at one.

use super::SpatialInertia;
use crate::lane::{Lane, Param, get_all, numbers};
use crate::lie::{Vector3, Vector6};

numbers! {
    /// A point of a body, with fewer numbers on an axis of the frame, where points of links often lie.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub enum BodyPoint<P> {
        /// On the x axis, m.
        X(x: P),
        /// On the y axis, m.
        Y(y: P),
        /// On the z axis, m.
        Z(z: P),
        /// General position, m.
        General(point: [P; 3]),
    }
}

impl BodyPoint<f64> {
    /// From coordinates, m.
    pub fn of(point: [f64; 3]) -> Self {
        match point {
            [x, 0.0, 0.0] => BodyPoint::X(x),
            [0.0, y, 0.0] => BodyPoint::Y(y),
            [0.0, 0.0, z] => BodyPoint::Z(z),
            point => BodyPoint::General(point),
        }
    }
}

impl<P: Copy> BodyPoint<P> {
    /// Coordinates, in lanes.
    #[inline(always)]
    pub fn coordinates<L: Lane>(&self) -> Vector3<L>
    where
        P: Param<L>,
    {
        let zero = L::zero();
        Vector3(match self {
            BodyPoint::X(x) => [x.get(), zero, zero],
            BodyPoint::Y(y) => [zero, y.get(), zero],
            BodyPoint::Z(z) => [zero, zero, z.get()],
            BodyPoint::General(point) => get_all(point),
        })
    }
}

numbers! {
    /// A mass at a point of a body.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct PointMass<P> {
        /// kg.
        pub mass: P,
        /// Position in the body frame.
        pub position: BodyPoint<P>,
    }
}

impl<P: Copy> PointMass<P> {
    /// Inertia in the body frame: `[[m I, -m [r]], [m [r], -m [r] [r]]]`.
    #[inline(always)]
    pub fn inertia<L: Lane>(&self) -> SpatialInertia<L>
    where
        P: Param<L>,
    {
        let (m, r, zero): (L, Vector3<L>, L) = (self.mass.get(), self.position.coordinates(), L::zero());
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

    /// Adds the bias wrench of the mass less its weight, `f = m (omega x v_r - g)` and `r x f` at the body's twist V under
    /// gravity g, to `bias`; all in the body frame.
    #[inline(always)]
    pub fn add_bias<L: Lane>(&self, twist: Vector6<L>, gravity: Vector3<L>, bias: &mut Vector6<L>)
    where
        P: Param<L>,
    {
        match self.position {
            BodyPoint::X(x) => self.add_bias_on_axis::<L, 0>(x.get(), twist, gravity, bias),
            BodyPoint::Y(y) => self.add_bias_on_axis::<L, 1>(y.get(), twist, gravity, bias),
            BodyPoint::Z(z) => self.add_bias_on_axis::<L, 2>(z.get(), twist, gravity, bias),
            BodyPoint::General(point) => {
                let (m, r): (L, _) = (self.mass.get(), Vector3(get_all(&point)));
                let pull = twist.angular.cross(twist.angular.cross_add(r, twist.linear)) - gravity;
                bias.linear = pull.scale_add(m, bias.linear);
                bias.angular = r.scale(m).cross_add(pull, bias.angular);
            }
        }
    }

    /// [`Self::add_bias`] for a point on axis N.
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
