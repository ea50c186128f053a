//! Shapes: signed distance of a point from the surface, and the outward normal there.

use crate::lane::{Lane, Param, get_all, numbers};
use crate::lie::Vector3;

numbers! {
    /// Form and size of a shape, in its own frame.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub enum Geometry<P> {
        /// Half-space below z = 0.
        Plane,
        /// Box about the origin: half its lengths, m.
        Box(half: [P; 3]),
        /// Cylinder about the z axis and the origin: radius and half its length, m.
        Cylinder(radius: P, half: P),
        /// Torus about the z axis: radius of its circle in the xy plane, and of its tube, m.
        Torus(radius: P, tube: P),
    }
}

/// Distance of a point from a surface.
#[derive(Debug, Clone, Copy)]
pub struct Distance<L> {
    /// Signed distance, m; negative inside.
    pub distance: L,
    /// Outward normal at the nearest point of the surface.
    pub normal: Vector3<L>,
}

/// Square of a length below which directions are undefined, m2.
const TINY: f64 = 1e-30;

/// Signed distance in two coordinates from a rectangle, by the distances q beyond its sides; and the outward normal.
#[inline(always)]
fn beyond_sides<L: Lane, const K: usize>(q: [L; K]) -> (L, [L; K]) {
    let (zero, one) = (L::zero(), L::c(1.0));
    let (mut square, mut largest) = (zero, q[0]);
    for k in 0..K {
        let out = q[k].max(zero);
        square = out.mul_add(out, square);
        largest = largest.max(q[k]);
    }
    let outside = zero.lt(largest);
    let length = square.max(L::c(TINY)).sqrt();
    let (mut normal, mut left) = ([zero; K], one);
    for k in 0..K {
        // Inside, the nearest side; the first of two that are as near.
        let nearest = L::select(q[k].lt(largest), zero, left);
        left -= nearest;
        normal[k] = L::select(outside, q[k].max(zero) / length, nearest);
    }
    (L::select(outside, length, largest), normal)
}

/// `x` with the sign of `of`.
#[inline(always)]
fn with_sign<L: Lane>(x: L, of: L) -> L {
    L::select(of.lt(L::zero()), -x, x)
}

impl<P: Copy> Geometry<P> {
    /// Distance of a point in the shape's frame.
    #[inline(always)]
    pub fn distance<L: Lane>(&self, point: Vector3<L>) -> Distance<L>
    where
        P: Param<L>,
    {
        let [x, y, z] = point.0;
        match *self {
            Geometry::Plane => Distance { distance: z, normal: Vector3([L::zero(), L::zero(), L::c(1.0)]) },
            Geometry::Box(half) => {
                let half: [L; 3] = get_all(&half);
                let (distance, [a, b, c]) = beyond_sides([x.abs() - half[0], y.abs() - half[1], z.abs() - half[2]]);
                Distance { distance, normal: Vector3([with_sign(a, x), with_sign(b, y), with_sign(c, z)]) }
            }
            Geometry::Cylinder(radius, half) => {
                let rho = x.mul_add(x, y.mul_add(y, L::c(TINY))).sqrt();
                let (distance, [across, along]) = beyond_sides([rho - radius.get(), z.abs() - half.get()]);
                let turn = across / rho;
                Distance { distance, normal: Vector3([x * turn, y * turn, with_sign(along, z)]) }
            }
            Geometry::Torus(radius, tube) => {
                let rho = x.mul_add(x, y.mul_add(y, L::c(TINY))).sqrt();
                let across = rho - radius.get();
                let length = across.mul_add(across, z.mul_add(z, L::c(TINY))).sqrt();
                let (turn, over) = (across / (length * rho), L::c(1.0) / length);
                Distance { distance: length - tube.get(), normal: Vector3([x * turn, y * turn, z * over]) }
            }
        }
    }
}
