//! Bias wrench of a body in its central frame.

use crate::lane::{Lane, Param, get_all, numbers, unroll};
use crate::lie::{Matrix3, Vector3, Vector6};
use crate::spatial::{BodyPoint, LinkTwist, constant_screw_z};

numbers! {
    /// Inertia (rigid and added), damping and net weight in the central frame: its origin is the centre of all of them, and damping
    /// and linear inertia are diagonal in its axes. Most links have such a frame, in which they take half the arithmetic.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct CentralFrameTerms<P> {
        /// Origin in the body frame.
        pub origin: BodyPoint<P>,
        /// Rotation relative to the body frame.
        pub rotation: FrameRotation<P>,
        /// Diagonal of the linear inertia.
        pub masses: [P; 3] = unvisited,
        /// Gyroscopic differences of the diagonal of the angular inertia: `[J_z - J_y, J_x - J_z, J_y - J_x]`.
        pub gyration: [P; 3] = unvisited,
        /// Products of inertia, unless all are 0: `[J_yz, J_xz, J_xy]`.
        pub products: Option<[P; 3]> = unvisited,
        /// Diagonals of D_L and D_Q, unless all are 0.
        pub damping: Option<[[P; 6]; 2]> = unvisited,
        /// Mass minus displaced mass, kg; both are centred here.
        pub net_mass: P = unvisited,
    }
}

numbers! {
    /// Rotation of a frame relative to the body frame.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub enum FrameRotation<P> {
        /// Parallel axes.
        Aligned,
        /// About z, by sine and cosine.
        AboutZ(sin: P, cos: P),
        /// General rotation, by rows.
        General(rows: [[P; 3]; 3]),
    }
}

impl<P: Copy> CentralFrameTerms<P> {
    /// `B V - damping - restoring` at the relative twist V under gravity g, all in the body frame: see
    /// [`crate::spatial::SpatialInertia::bias_wrench`], [`super::Damping`] and [`super::Restoring`].
    #[inline(always)]
    pub fn bias<L: Lane>(&self, twist: Vector6<L>, gravity: Vector3<L>, bias: &mut Vector6<L>)
    where
        P: Param<L>,
    {
        let FrameRotation::General(rows) = &self.rotation else { return self.bias_z_aligned(twist, gravity, bias) };
        let rotation = Matrix3([get_all(&rows[0]), get_all(&rows[1]), get_all(&rows[2])]);
        let r = self.origin.coordinates();
        let v = rotation.apply_transposed(twist.angular.cross_add(r, twist.linear));
        let w = rotation.apply_transposed(twist.angular);
        let mut there = self.in_central_frame(v, w);
        self.add_products(w, &mut there.angular);
        bias.linear = self.less_weight(gravity, rotation.apply(there.linear));
        bias.angular = r.cross_add(bias.linear, rotation.apply(there.angular));
    }

    /// [`Self::bias`] for a frame whose z axis is parallel to the body's.
    #[inline(always)]
    pub fn bias_z_aligned<L: Lane>(&self, twist: Vector6<L>, gravity: Vector3<L>, bias: &mut Vector6<L>)
    where
        P: Param<L>,
    {
        if let FrameRotation::AboutZ(sin, cos) = self.rotation {
            let rotation = constant_screw_z(LinkTwist::General(sin, cos), None);
            let r = self.origin.coordinates();
            let linear = twist.angular.cross_add(r, twist.linear);
            let local = rotation.adjoint_apply_inverse(Vector6 { linear, ..twist });
            let mut there = self.in_central_frame(local.linear, local.angular);
            self.add_products(local.angular, &mut there.angular);
            let Vector6 { linear, angular } = rotation.co_adjoint_apply_inverse(there);
            bias.linear = self.less_weight(gravity, linear);
            bias.angular = r.cross_add(bias.linear, angular);
            return;
        }
        match self.origin {
            BodyPoint::X(x) => *bias = self.bias_on_axis::<L, 0>(x.get(), twist, gravity),
            BodyPoint::Y(y) => *bias = self.bias_on_axis::<L, 1>(y.get(), twist, gravity),
            BodyPoint::Z(z) => *bias = self.bias_on_axis::<L, 2>(z.get(), twist, gravity),
            BodyPoint::General(point) => {
                let r = Vector3(get_all(&point));
                let there = self.in_central_frame(twist.angular.cross_add(r, twist.linear), twist.angular);
                bias.linear = self.less_weight(gravity, there.linear);
                bias.angular = r.cross_add(bias.linear, there.angular);
            }
        }
        self.add_products(twist.angular, &mut bias.angular);
    }

    /// [`Self::bias`] for a frame with parallel axes and its origin on axis N.
    #[inline(always)]
    fn bias_on_axis<L: Lane, const N: usize>(&self, d: L, twist: Vector6<L>, gravity: Vector3<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        let (i, k) = ((N + 1) % 3, (N + 2) % 3);
        let (mut v, w) = (twist.linear, twist.angular);
        v.0[i] = w.0[k].mul_add(d, v.0[i]);
        v.0[k] = w.0[i].neg_mul_add(d, v.0[k]);
        let there = self.in_central_frame(v, w);
        let (linear, mut angular) = (self.less_weight(gravity, there.linear), there.angular);
        angular.0[i] = linear.0[k].neg_mul_add(d, angular.0[i]);
        angular.0[k] = linear.0[i].mul_add(d, angular.0[k]);
        Vector6 { linear, angular }
    }

    /// `force` minus the net weight.
    #[inline(always)]
    fn less_weight<L: Lane>(&self, gravity: Vector3<L>, force: Vector3<L>) -> Vector3<L>
    where
        P: Param<L>,
    {
        gravity.scale_add(-self.net_mass.get(), force)
    }

    /// `B V - damping` in the central frame, without the products of inertia.
    #[inline(always)]
    fn in_central_frame<L: Lane>(&self, v: Vector3<L>, w: Vector3<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        let [mx, my, mz]: [L; 3] = get_all(&self.masses);
        let [gx, gy, gz]: [L; 3] = get_all(&self.gyration);
        let momentum = Vector3([mx * v.0[0], my * v.0[1], mz * v.0[2]]);
        let mut sum = self.damping_wrench(v, w);
        // omega x J omega
        let moment = &mut sum.angular.0;
        moment[0] = (w.0[1] * w.0[2]).mul_add(gx, moment[0]);
        moment[1] = (w.0[2] * w.0[0]).mul_add(gy, moment[1]);
        moment[2] = (w.0[0] * w.0[1]).mul_add(gz, moment[2]);
        Vector6 { linear: w.cross_add(momentum, sum.linear), angular: v.cross_add(momentum, sum.angular) }
    }

    /// Adds the gyroscopic moment of the products of inertia.
    #[inline(always)]
    fn add_products<L: Lane>(&self, w: Vector3<L>, moment: &mut Vector3<L>)
    where
        P: Param<L>,
    {
        if let Some(products) = &self.products {
            let [yz, xz, xy]: [L; 3] = get_all(products);
            let [x, y, z] = w.0;
            let momentum = Vector3([xy.mul_add(y, xz * z), xy.mul_add(x, yz * z), xz.mul_add(x, yz * y)]);
            *moment = w.cross_add(momentum, *moment);
        }
    }

    /// `(D_L + D_Q |V|) V`
    #[inline(always)]
    fn damping_wrench<L: Lane>(&self, v: Vector3<L>, w: Vector3<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        let Some([linear, quadratic]) = &self.damping else { return Vector6::zero() };
        let mut out = [v.0[0], v.0[1], v.0[2], w.0[0], w.0[1], w.0[2]];
        unroll!(k in 0 1 2 3 4 5 => {
            out[k] = quadratic[k].get().mul_add(out[k].abs(), linear[k].get()) * out[k];
        });
        Vector6::from_array(out)
    }
}
