//! Estimate of a body from its shapes.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

use super::solid::{Solid, others};
use super::{Ends, Outline, Shape, tables};
use crate::description::{Body, Damping};

/// A body estimated from shapes, with its formulas.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// The body. Added mass and damping are in the frame of a single shape; of several shapes, in the body frame.
    pub body: Body,
    /// Formula of each key of the body.
    pub formulas: Vec<(&'static str, String)>,
}

/// Rounds to seven digits: more are never known, and sums of rounded entries stay semi-definite.
fn digits(x: f64) -> f64 {
    format!("{x:.6e}").parse().expect("it was written as a number")
}

/// Rounds a matrix; rounding errors of rotations by right angles become 0.
fn rounded<const N: usize>(m: nalgebra::SMatrix<f64, N, N>) -> nalgebra::SMatrix<f64, N, N> {
    let scale = |i: usize, j: usize| (m[(i, i)] * m[(j, j)]).abs().sqrt();
    nalgebra::SMatrix::from_fn(|i, j| if m[(i, j)].abs() <= 1e-9 * scale(i, j) { 0.0 } else { digits(m[(i, j)]) })
}

fn rounded_vector(v: Vector3<f64>) -> Vector3<f64> {
    v.map(|x| if x.abs() < 1e-12 { 0.0 } else { digits(x) })
}

/// Diagonals of one shape in its own frame: added mass, linear and quadratic damping.
fn hydrodynamics(shape: &Shape, solid: &Solid, outline: &Outline) -> [Vector6<f64>; 3] {
    let (remaining, closed) = (shape.perforation.map(tables::perforated), shape.solidities());
    // Rotation moves water across both other axes: the maximum factor applies to added mass, the mean to damping.
    let on_mass = |i: usize| {
        if i < 3 { remaining[i] } else { others(i - 3).map(|j| remaining[j]).into_iter().fold(0.0, f64::max) }
    };
    let on_drag = |i: usize| if i < 3 { closed[i] } else { others(i - 3).map(|j| closed[j]).iter().sum::<f64>() / 2.0 };
    let mass = solid.added_mass(outline.density, shape.ends);
    let drag = solid.quadratic_damping(outline.density, shape.ends);
    let quadratic = Vector6::from_fn(|i, _| drag[i] * on_drag(i));
    let linear = Vector6::from_fn(|i, _| quadratic[i] * outline.speed[i / 3]);
    [Vector6::from_fn(|i, _| mass[i] * on_mass(i)), linear, quadratic]
}

impl Outline {
    /// Estimates the body from its shapes.
    ///
    /// Added mass and linear damping of several shapes are exact sums about the body's origin (parallel axes). Quadratic damping is
    /// not covariant: its columns are exact for motion along or about a single axis of the body.
    ///
    /// # Panics
    /// If a shape has no kind or several kinds, in an outline that was not checked on reading.
    pub fn estimate(&self) -> Estimate {
        let solids: Vec<_> = self.shapes.iter().map(|shape| shape.solid().expect("checked on reading")).collect();
        let shapes = || self.shapes.iter().zip(&solids);
        let masses: Vec<_> = shapes()
            .map(|(shape, solid)| {
                let water = self.density * shape.displaced_volume(solid);
                shape.mass.unwrap_or(water * shape.relative_density.unwrap_or(1.0))
            })
            .collect();
        let mass: f64 = masses.iter().sum();
        let volume: f64 = shapes().map(|(shape, solid)| shape.displaced_volume(solid)).sum();
        let center_of_mass: Vector3<f64> =
            shapes().zip(&masses).map(|((s, _), m)| s.position * *m).sum::<Vector3<f64>>() / mass;
        let moment: Vector3<f64> = shapes().map(|(s, solid)| s.position * s.displaced_volume(solid)).sum();
        let mut inertia = Matrix3::zeros();
        for ((shape, solid), &mass) in shapes().zip(&masses) {
            let (r, c) = (shape.frame().rotation(), (shape.position - center_of_mass).cross_matrix());
            inertia += r * Matrix3::from_diagonal(&solid.inertia(mass)) * r.transpose() - mass * c * c;
        }
        let mut body = Body {
            center_of_mass: rounded_vector(center_of_mass),
            inertia: rounded((inertia + inertia.transpose()) / 2.0),
            volume: Some(digits(volume)),
            center_of_buoyancy: if volume > 0.0 { rounded_vector(moment / volume) } else { Vector3::zeros() },
            ..Body::point(digits(mass))
        };
        self.water(&mut body, &solids);
        let formulas = self.formulas(&solids);
        Estimate { body, formulas }
    }

    /// Sets added mass and damping.
    fn water(&self, body: &mut Body, solids: &[Solid]) {
        if let ([shape], [solid]) = (&self.shapes[..], solids) {
            let diagonals = hydrodynamics(shape, solid, self);
            let [added_mass, linear, quadratic] = diagonals.map(|d| Matrix6::from_diagonal(&d.map(digits)));
            body.hydrodynamic_frame = shape.frame();
            (body.added_mass, body.damping) = (added_mass, Damping { linear, quadratic });
            return;
        }
        let (mut added_mass, mut linear, mut quadratic) = (Matrix6::zeros(), Matrix6::zeros(), Matrix6::zeros());
        for (shape, solid) in self.shapes.iter().zip(solids) {
            let x = shape.frame().adjoint_inverse();
            let part = hydrodynamics(shape, solid, self).map(|d| x.transpose() * Matrix6::from_diagonal(&d));
            added_mass += part[0] * x;
            linear += part[1] * x;
            quadratic += part[2] * x.component_mul(&x.abs());
        }
        body.added_mass = rounded((added_mass + added_mass.transpose()) / 2.0);
        body.damping = Damping { linear: rounded((linear + linear.transpose()) / 2.0), quadratic: rounded(quadratic) };
    }
}

/// Formula of the added mass of a solid.
pub(super) fn added_mass_formula(solid: &Solid, ends: Ends) -> &'static str {
    match (solid, ends) {
        (Solid::Ellipsoid(_), _) => "ellipsoid, potential flow (Lamb 1932 art. 114-115)",
        (Solid::Capsule(_), Ends::Free) => {
            "spheroid of the capsule's length and volume, potential flow (Lamb 1932 art. 114-115)"
        }
        (Solid::Capsule(_), Ends::Joined) => {
            "strips of the capsule: across rho V, along 0.1 rho V, turning rho V l^2/12 (Fossen 2021)"
        }
        (Solid::Cylinder(_), Ends::Joined) => {
            "strips of the cylinder: across rho V, along 0.1 rho V, turning rho V l^2/12 (Fossen 2021)"
        }
        (Solid::Cylinder(_), Ends::Free) => {
            "finite cylinder: across C_A(l/d) rho V, along as a square prism of equal ends (DNV-RP-H103 table A-2), turning C_A rho V l^2/12 + 16/45 rho r^5"
        }
        (Solid::Box(_), Ends::Free) => {
            "box: rectangular plate times thickness factor, turning by sections or strips, the less (DNV-RP-H103 tables A-1, A-2)"
        }
        (Solid::Box(_), Ends::Joined) => {
            "strips of the box: across C_A rho pi/4 w^2 l (DNV-RP-H103 table A-1), along 0.1 rho V"
        }
    }
}

/// Formula of the quadratic damping of a solid.
pub(super) fn drag_formula(solid: &Solid, ends: Ends) -> &'static str {
    match (solid, ends) {
        (Solid::Ellipsoid(_), _) => "ellipsoid: 1/2 rho C_D(l/w) frontal area (White table 7.3)",
        (Solid::Capsule(_), _) => {
            "capsule: across 1/2 rho 1.1 kappa d l and a sphere's ends, along as an ellipsoid (White table 7.3)"
        }
        (Solid::Cylinder(_), Ends::Free) => {
            "cylinder: across 1/2 rho 1.1 kappa(l/d) d l (DNV-RP-C205 table 6-2), turning times l^3/32 instead of l, along 1/2 rho 0.8 pi r^2 (Hoerner)"
        }
        (Solid::Cylinder(_), Ends::Joined) => {
            "strips of the cylinder: across 1/2 rho 1.1 d l, turning 1/2 rho 1.1 d l^4/32, along 1/2 rho 0.8 pi r^2 (Hoerner)"
        }
        (Solid::Box(_), Ends::Free) => {
            "box: 1/2 rho C_D area, C_D from 1.05 (cube) to 2.05 kappa (Hoerner; DNV-RP-C205 table 6-2), turning by strips of the faces"
        }
        (Solid::Box(_), Ends::Joined) => {
            "strips of the box: across 1/2 rho 2.05 area, along 1.05 (Hoerner), turning by strips of the faces"
        }
    }
}
