//! Moving parts of the chain: links that are rigidly connected.

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::chain::Chain;
use super::element::Result;
use super::file::{Inertial, JointType, Robot, UrdfLink};
use crate::description::Frame;
use crate::estimate::Shape;

/// Minimum semi-axis of the ellipsoid that represents a link without geometry, m.
const THINNEST: f64 = 1e-3;
/// Density of that ellipsoid below which the moments are no body's, kg/m3: frames with dummy moments.
const LIGHTEST: f64 = 100.0;

/// A moving part: inertial properties and shapes, in the frame of its joint.
#[derive(Default)]
pub struct Part {
    pub mass: f64,
    pub center_of_mass: Vector3<f64>,
    /// About the centre of mass.
    pub inertia: Matrix3<f64>,
    pub shapes: Vec<Shape>,
    /// Notes for the user.
    pub notes: Vec<String>,
}

/// The pose of `inner` in the parent of `outer`. Composition with a pose without rotation is exact.
pub fn compose(outer: &Frame, inner: &Frame) -> Frame {
    let rotation = outer.rotation();
    let position = if *outer == Frame::default() { inner.position } else { outer.position + rotation * inner.position };
    let rpy = if outer.rpy == Vector3::zeros() {
        inner.rpy
    } else if inner.rpy == Vector3::zeros() {
        outer.rpy
    } else {
        angles(&(rotation * inner.rotation()))
    };
    Frame { position, rpy }
}

/// Roll, pitch and yaw of a rotation.
pub fn angles(rotation: &Matrix3<f64>) -> Vector3<f64> {
    let (roll, pitch, yaw) = Rotation3::from_matrix_unchecked(*rotation).euler_angles();
    Vector3::new(roll, pitch, yaw)
}

/// Homogeneous ellipsoid of the same mass and moments, and its density, kg/m3.
fn ellipsoid(inertial: &Inertial) -> (Shape, f64) {
    let (moments, turn) = if inertial.inertia == Matrix3::from_diagonal(&inertial.inertia.diagonal()) {
        (inertial.inertia.diagonal(), Matrix3::identity())
    } else {
        let eigen = inertial.inertia.symmetric_eigen();
        let mut turn = eigen.eigenvectors;
        if turn.determinant() < 0.0 {
            turn.column_mut(0).neg_mut();
        }
        (eigen.eigenvalues, turn)
    };
    let square = Vector3::from_fn(|i, _| 2.5 * (moments.sum() - 2.0 * moments[i]) / inertial.mass);
    let axes = Frame { position: Vector3::zeros(), rpy: angles(&turn) };
    let frame = compose(&inertial.frame, &axes);
    let semi_axes = square.map(|s| s.max(0.0).sqrt().max(THINNEST));
    let density = inertial.mass / (4.0 / 3.0 * std::f64::consts::PI * semi_axes.product());
    (Shape { ellipsoid: Some(semi_axes), position: frame.position, rpy: frame.rpy, ..Shape::default() }, density)
}

impl Part {
    fn add(&mut self, link: &UrdfLink, at: &Frame) {
        let own = link.inertial.as_ref().filter(|inertial| inertial.mass > 0.0);
        if let Some(inertial) = own {
            let frame = compose(at, &inertial.frame);
            let inertia = if frame.rpy == Vector3::zeros() {
                inertial.inertia
            } else {
                let turned = frame.rotation() * inertial.inertia * frame.rotation().transpose();
                (turned + turned.transpose()) / 2.0
            };
            if self.mass == 0.0 {
                (self.mass, self.center_of_mass, self.inertia) = (inertial.mass, frame.position, inertia);
            } else {
                let total = self.mass + inertial.mass;
                let offset = (frame.position - self.center_of_mass).cross_matrix();
                self.inertia += inertia - offset * offset * (self.mass * inertial.mass / total);
                self.center_of_mass = (self.center_of_mass * self.mass + frame.position * inertial.mass) / total;
                self.mass = total;
            }
        }
        for shape in &link.shapes {
            let frame = compose(at, &Frame { position: shape.position, rpy: shape.rpy });
            self.shapes.push(Shape { position: frame.position, rpy: frame.rpy, ..shape.clone() });
        }
        if let (Some(inertial), true) = (own, link.shapes.is_empty()) {
            let why = if link.mesh { "geometry is a mesh, which is not supported" } else { "no geometry" };
            let (shape, density) = ellipsoid(inertial);
            let what = if inertial.inertia == Matrix3::zeros() {
                "no moments of inertia: a point mass, which displaces no water".to_owned()
            } else if density < LIGHTEST {
                format!("its moments belong to {density:.2e} kg/m3: no outline, it displaces no water")
            } else {
                let frame = compose(at, &Frame { position: shape.position, rpy: shape.rpy });
                self.shapes.push(Shape { position: frame.position, rpy: frame.rpy, ..shape });
                format!("{why}: hydrodynamics of the homogeneous ellipsoid of its mass and moments")
            };
            self.notes.push(format!("{}: {what}", link.name));
        }
    }
}

impl Robot {
    /// The moving part of a link, up to the next moving joint of the chain, with index and frame of that joint, and the frame of the
    /// tip if it belongs to the part.
    ///
    /// # Errors
    /// Moments of inertia that no body has.
    pub fn part(&self, chain: &Chain, link: usize) -> Result<(Part, Option<(usize, Frame)>, Option<Frame>)> {
        let (mut part, mut next, mut tip) = (Part::default(), None, None);
        let mut open = vec![(link, Frame::default())];
        while let Some((at, frame)) = open.pop() {
            if let Some((line, element, problem)) =
                self.links[at].inertial.as_ref().and_then(|own| own.problem.as_ref())
            {
                return self.fault(*line, element, problem);
            }
            part.add(&self.links[at], &frame);
            if at == chain.tip {
                tip = Some(frame.clone());
            }
            for (index, joint) in self.joints_of(at) {
                let beyond = compose(&frame, &joint.frame);
                if joint.kind != JointType::Fixed && chain.has[index] {
                    next = Some((index, beyond));
                    continue;
                }
                let (to, child) = (&self.links[link].name, &self.links[joint.child].name);
                if joint.kind != JointType::Fixed {
                    let name = &joint.name;
                    part.notes
                        .push(format!("{name}: a moving joint outside the chain, fixed at 0: {child} is part of {to}"));
                } else if self.links[joint.child].inertial.is_some() {
                    part.notes.push(format!("{child}: merged into {to}"));
                }
                open.push((joint.child, beyond));
            }
        }
        Ok((part, next, tip))
    }
}
