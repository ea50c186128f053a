//! Compilation of contact: spheres and shapes in the frames of the moving bodies.

use nalgebra as na;

use super::joint_frames::pose;
use super::model::{BodyTerms, JointTerms};
use crate::contact::{ContactTerms, Geometry, Law, ShapeTerms, SphereTerms};
use crate::description::{ContactGeometry, ContactLaw, Frame, Scene};
use crate::lie::{Pose, Vector3};

/// Number of a moving body, 0 for the vehicle (for shapes the world) and k + 1 for the link of joint k, and a frame in its frame.
pub(super) type OnBody = (usize, Pose<f64>);

/// Contact of a scene whose robot's bodies and fixtures have these places; none where nothing can touch.
pub(super) fn contact_terms(
    scene: &Scene,
    vehicle: &BodyTerms<f64>,
    joints: &[JointTerms<f64>],
    robot_body: impl Fn(&str) -> OnBody,
    fixture: impl Fn(&str) -> OnBody,
) -> Option<ContactTerms<f64>> {
    let contact = scene.contact.as_ref().filter(|contact| !contact.spheres.is_empty() && !contact.shapes.is_empty())?;
    let places: Vec<(usize, Vector3<f64>)> = contact
        .spheres
        .iter()
        .map(|sphere| {
            let (body, place) = robot_body(&sphere.on);
            (body, place.times(&at(&sphere.position)).position)
        })
        .collect();
    let spheres = contact.spheres.iter().zip(&places).map(|(sphere, &(body, center))| {
        let of = |points: &[Vector3<f64>]| match body.checked_sub(1) {
            Some(k) => mobility(&joints[k].body, Some(&joints[k]), points),
            None if scene.vehicle.fixed => 0.0,
            None => mobility(vehicle, None, points),
        };
        let all: Vec<_> = places.iter().filter(|(other, _)| *other == body).map(|(_, center)| *center).collect();
        let (mobility, together) = (of(&[center]), of(&all));
        SphereTerms { body, position: center.0, radius: sphere.radius, mobility, together }
    });
    let shapes = contact.shapes.iter().map(|shape| {
        let (body, place) = fixture(&shape.on);
        let place = place.times(&pose(&shape.frame));
        let geometry = geometry(&shape.geometry);
        let mobility = body.checked_sub(1).map_or(0.0, |k| fixture_mobility(&joints[k], &geometry, place.position));
        let law = law(&contact.law(shape));
        ShapeTerms { body, rotation: place.rotation.0, position: place.position.0, geometry, law, mobility }
    });
    Some(ContactTerms { spheres: spheres.collect(), shapes: shapes.collect() })
}

fn at(position: &na::Vector3<f64>) -> Pose<f64> {
    pose(&Frame { position: *position, ..Frame::default() })
}

fn law(law: &ContactLaw) -> Law<f64> {
    // Without friction any slip speed serves.
    let slip_speed = if law.friction > 0.0 { law.slip_speed } else { 1.0 };
    let ContactLaw { stiffness, dissipation, ramp, friction, .. } = *law;
    Law { stiffness, dissipation, ramp, friction, slip_speed_squared: slip_speed * slip_speed }
}

fn geometry(geometry: &ContactGeometry) -> Geometry<f64> {
    match *geometry {
        ContactGeometry::Plane => Geometry::Plane,
        ContactGeometry::Box { size } => Geometry::Box((size / 2.0).into()),
        ContactGeometry::Cylinder { radius, length } => Geometry::Cylinder(radius, length / 2.0),
        ContactGeometry::Torus { radius, tube } => Geometry::Torus(radius, tube),
    }
}

/// Maximum eigenvalue of `sum J M^-1 J^T` over points of a body, 1/kg, with the body free and its joint's rotor fixed to it: of one point
/// the maximum acceleration per force on it.
fn mobility(body: &BodyTerms<f64>, joint: Option<&JointTerms<f64>>, points: &[Vector3<f64>]) -> f64 {
    let mut inertia = na::Matrix6::from_fn(|i, k| body.inertia.entry(i, k));
    if let Some(joint) = joint {
        let along = if joint.is_prismatic() { 2 } else { 5 };
        inertia[(along, along)] += joint.rotor_inertia.unwrap_or(0.0);
    }
    let mut squares = na::Matrix6::zeros();
    for &Vector3(point) in points {
        let mut velocity = na::Matrix3x6::zeros();
        velocity.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        velocity.fixed_view_mut::<3, 3>(0, 3).copy_from(&-na::Vector3::from(point).cross_matrix());
        squares += velocity.tr_mul(&velocity);
    }
    let Some(lower) = inertia.cholesky().map(|cholesky| cholesky.l()) else { return 0.0 };
    // L^-1 S L^-T has the eigenvalues of S M^-1.
    let Some(half) = lower.solve_lower_triangular(&squares) else { return 0.0 };
    let Some(whole) = lower.solve_lower_triangular(&half.transpose()) else { return 0.0 };
    whole.symmetric_eigenvalues().max()
}

/// Maximum acceleration of a point of a fixture's shape per force on it, 1/kg.
fn fixture_mobility(joint: &JointTerms<f64>, geometry: &Geometry<f64>, Vector3(origin): Vector3<f64>) -> f64 {
    let rotor = joint.rotor_inertia.unwrap_or(0.0);
    if joint.prescribed {
        return 0.0;
    }
    if joint.is_prismatic() {
        return 1.0 / (joint.body.inertia.entry(2, 2) + rotor);
    }
    let extent = match *geometry {
        // Of a plane a point one metre away.
        Geometry::Plane => 1.0,
        Geometry::Box(half) => na::Vector3::from(half).norm(),
        Geometry::Cylinder(radius, half) => radius.hypot(half),
        Geometry::Torus(radius, tube) => radius + tube,
    };
    let lever = origin[0].hypot(origin[1]) + extent;
    lever * lever / (joint.body.inertia.entry(5, 5) + rotor)
}
