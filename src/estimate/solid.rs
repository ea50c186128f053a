//! Inertia, added mass and quadratic damping of a solid, about its centre and along its axes.

use std::f64::consts::PI;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{lamb, tables};

/// Ends of a box or cylinder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Ends {
    /// In the water: coefficients of finite bodies.
    #[default]
    Free,
    /// Joined to the next part, as in an arm: strip theory, as for a section of an infinite body.
    Joined,
}

/// Dimensions of a round solid.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Round {
    /// Radius, m.
    pub radius: f64,
    /// Length, m; of a capsule without its hemispheres.
    pub length: f64,
    /// Axis: "x", "y" or "z".
    #[serde(default)]
    pub axis: Axis,
}

/// A coordinate axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// Forward.
    #[default]
    X,
    /// Left.
    Y,
    /// Up.
    Z,
}

/// Convex body whose volume, inertia and added mass are known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Solid {
    /// Edges along x, y, z, m.
    Box(Vector3<f64>),
    /// Cylinder with flat ends.
    Cylinder(Round),
    /// Capsule: a cylinder between hemispheres.
    Capsule(Round),
    /// Semi-axes along x, y, z, m.
    Ellipsoid(Vector3<f64>),
}

/// Diagonal of a body of revolution about an axis.
fn along(axis: Axis, along: f64, across: f64) -> Vector3<f64> {
    Vector3::from_fn(|i, _| if i == axis as usize { along } else { across })
}

/// Indices of the two other axes.
pub fn others(axis: usize) -> [usize; 2] {
    [(axis + 1) % 3, (axis + 2) % 3]
}

fn join(linear: Vector3<f64>, angular: Vector3<f64>) -> [f64; 6] {
    std::array::from_fn(|i| if i < 3 { linear[i] } else { angular[i - 3] })
}

/// Two edges in ascending order.
fn sort(a: f64, b: f64) -> (f64, f64) {
    (a.min(b), a.max(b))
}

impl Solid {
    /// Volume of the envelope, m3.
    pub fn volume(&self) -> f64 {
        match *self {
            Self::Box(size) => size.product(),
            Self::Cylinder(Round { radius, length, .. }) => PI * radius * radius * length,
            Self::Capsule(Round { radius, length, .. }) => PI * radius * radius * (length + 4.0 / 3.0 * radius),
            Self::Ellipsoid(semi_axes) => 4.0 / 3.0 * PI * semi_axes.product(),
        }
    }

    /// Extents along x, y, z, m.
    pub fn extent(&self) -> Vector3<f64> {
        match *self {
            Self::Box(size) => size,
            Self::Cylinder(Round { radius, length, axis }) => along(axis, length, 2.0 * radius),
            Self::Capsule(Round { radius, length, axis }) => along(axis, length + 2.0 * radius, 2.0 * radius),
            Self::Ellipsoid(semi_axes) => 2.0 * semi_axes,
        }
    }

    /// Index of the longest axis of a box, or of the axis of a round solid.
    fn axis(&self) -> usize {
        match *self {
            Self::Cylinder(round) | Self::Capsule(round) => round.axis as usize,
            Self::Box(size) | Self::Ellipsoid(size) => size.imax(),
        }
    }

    /// Principal moments of inertia of a homogeneous mass, kg m2.
    pub fn inertia(&self, mass: f64) -> Vector3<f64> {
        let from_squares = |s: Vector3<f64>| mass * Vector3::new(s.y + s.z, s.z + s.x, s.x + s.y);
        match *self {
            Self::Box(size) => from_squares(size.component_mul(&size) / 12.0),
            Self::Ellipsoid(semi_axes) => from_squares(semi_axes.component_mul(&semi_axes) / 5.0),
            Self::Cylinder(Round { radius, length, axis }) => {
                from_squares(along(axis, length * length / 12.0, radius * radius / 4.0))
            }
            Self::Capsule(Round { radius: r, length: l, axis }) => {
                let ends = 4.0 / 3.0 * r / (l + 4.0 / 3.0 * r);
                let across = r * r * ((1.0 - ends) / 4.0 + ends / 5.0);
                // Hemispheres, with centres of mass 3/8 r beyond the cylinder's ends.
                let far = r * r / 5.0 + l * l / 4.0 + 3.0 / 8.0 * l * r;
                from_squares(along(axis, (1.0 - ends) * l * l / 12.0 + ends * far, across))
            }
        }
    }

    /// Diagonal of the added mass: kg and kg m2.
    pub fn added_mass(&self, density: f64, ends: Ends) -> [f64; 6] {
        let displaced = density * self.volume();
        match (*self, ends) {
            (Self::Ellipsoid(semi_axes), _) => lamb::ellipsoid(semi_axes, density),
            (Self::Capsule(Round { radius, length, axis }), Ends::Free) => {
                let half = length / 2.0 + radius;
                let across = (self.volume() / (4.0 / 3.0 * PI * half)).sqrt();
                lamb::ellipsoid(along(axis, half, across), density)
            }
            (Self::Cylinder(Round { length, axis, .. }) | Self::Capsule(Round { length, axis, .. }), Ends::Joined) => {
                let turning = displaced * length * length / 12.0;
                join(along(axis, 0.1 * displaced, displaced), along(axis, 0.0, turning))
            }
            (Self::Cylinder(Round { radius, length, axis }), Ends::Free) => {
                let across = tables::finite_cylinder(length / (2.0 * radius)) * displaced;
                // Axial: a square prism with ends of the same area. Rotation: strips, and 16/45 rho r^5 of the disc.
                let side = PI.sqrt() * radius;
                let end = 8.0 / 3.0 * density * radius.powi(3) * tables::square_prism(length / side);
                let turning = across * length * length / 12.0 + 16.0 / 45.0 * density * radius.powi(5);
                join(along(axis, end, across), along(axis, 0.0, turning))
            }
            (Self::Box(size), _) => {
                let long = self.axis();
                let linear = Vector3::from_fn(|i, _| match ends {
                    Ends::Free => density * free_box(size, i),
                    Ends::Joined if i == long => 0.1 * displaced,
                    Ends::Joined => density * strip(size, i, long) * size[long],
                });
                let angular = Vector3::from_fn(|i, _| density * turning_box(size, i, long, ends));
                join(linear, angular)
            }
        }
    }

    /// Diagonal of the quadratic damping: N s2/m2 and N m s2/rad2.
    pub fn quadratic_damping(&self, density: f64, ends: Ends) -> [f64; 6] {
        let (cd, half) = (self.drag_coefficients(ends), self.extent() / 2.0);
        let pressure = density / 2.0;
        match *self {
            Self::Box(size) => {
                let linear = Vector3::from_fn(|i, _| pressure * cd[i] * size.product() / size[i]);
                let angular = Vector3::from_fn(|i, _| {
                    let [j, k] = others(i);
                    pressure * size[i] * (cd[k] * half[j].powi(4) + cd[j] * half[k].powi(4)) / 2.0
                });
                join(linear, angular)
            }
            Self::Cylinder(Round { radius, length, axis }) | Self::Capsule(Round { radius, length, axis }) => {
                let end = PI * radius * radius;
                let (side, nose) = (2.0 * radius * length, matches!(self, Self::Capsule(_)));
                // In cross flow, the ends of a capsule are hemispheres.
                let [other, _] = others(axis as usize);
                let across = pressure * (cd[other] * side + if nose { tables::SPHERE * end } else { 0.0 });
                let turning = pressure * cd[other] * radius * half[axis as usize].powi(4);
                join(along(axis, pressure * cd[axis as usize] * end, across), along(axis, 0.0, turning))
            }
            Self::Ellipsoid(s) => {
                let linear = Vector3::from_fn(|i, _| pressure * cd[i] * PI * s.product() / s[i]);
                // Strips along the longer axis of the rotating section; a round section has only friction, which is neglected.
                let angular = Vector3::from_fn(|i, _| {
                    let [j, k] = others(i);
                    let (long, short) = if s[j] > s[k] { (j, k) } else { (k, j) };
                    let slender = 1.0 - (s[short] / s[long]).powi(2);
                    pressure * cd[short] * 8.0 / 15.0 * s[i] * s[long].powi(4) * slender
                });
                join(linear, angular)
            }
        }
    }

    fn drag_coefficients(&self, ends: Ends) -> Vector3<f64> {
        let (extent, long) = (self.extent(), self.axis());
        Vector3::from_fn(|i, _| {
            let [j, k] = others(i);
            let (short, wide) = sort(extent[j], extent[k]);
            match *self {
                Self::Box(_) if ends == Ends::Free => tables::face(wide / short),
                Self::Box(_) if i == long => tables::CUBE,
                Self::Box(_) => tables::SQUARE,
                Self::Cylinder(_) if i == long => tables::BLUNT,
                Self::Cylinder(_) | Self::Capsule(_) if i != long => match ends {
                    Ends::Free => tables::CYLINDER * tables::slender_cylinder(extent[long] / short),
                    Ends::Joined => tables::CYLINDER,
                },
                _ => tables::ellipsoid(extent[i] / (short * wide).sqrt()),
            }
        })
    }
}

/// Added volume of a box with free ends in translation along an axis: the volume of a rectangular plate times a thickness factor,
/// which is published for square and for long plates.
fn free_box(size: Vector3<f64>, axis: usize) -> f64 {
    let [j, k] = others(axis);
    let (short, long) = sort(size[j], size[k]);
    let plate = tables::plate(short / long) * PI / 4.0 * short * short * long;
    let (thickness, squareness) = (size[axis] / short, short / long);
    plate * (squareness * tables::square_prism(thickness) + (1.0 - squareness) * tables::rectangle(thickness))
}

/// Added area of a strip across `long` in translation along an axis.
fn strip(size: Vector3<f64>, axis: usize, long: usize) -> f64 {
    let width = size[3 - axis - long];
    tables::rectangle(size[axis] / width) * PI / 4.0 * width * width
}

/// Added moment of inertia over density of a box about an axis: from the rotating section or from translating strips along the
/// longer side, whichever is smaller, as both assume an infinite box.
fn turning_box(size: Vector3<f64>, axis: usize, long: usize, ends: Ends) -> f64 {
    let [j, k] = others(axis);
    let (short, wide) = sort(size[j], size[k]);
    let section = tables::turning_rectangle(short / wide) * PI * (wide / 2.0).powi(4) * size[axis];
    let strips = |along: usize, across: usize| strip(size, across, along) * size[along].powi(3) / 12.0;
    match ends {
        Ends::Joined if axis == long => section,
        Ends::Joined => strips(long, 3 - axis - long),
        Ends::Free if size[j] > size[k] => section.min(strips(j, k)),
        Ends::Free => section.min(strips(k, j)),
    }
}
