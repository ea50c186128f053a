//! A system whose numbers differ between the instances of a lane, and the order of its numbers.

use super::Compiled;
use super::factors::UnscaledBodyTerms;
use super::model::{BodyTerms, JointPlacement, JointScrew, JointTerms, System};
use crate::hydro::{CoefficientFrame, CoefficientMatrix, Damping, Fin, FrameRotation, Restoring, Thruster};
use crate::lane::{Lane, Shared};
use crate::spatial::{BodyPoint, LinkTwist, SpatialInertia};

/// A system, the parts of its bodies' terms, of which [`System::apply_factors`] makes these, and the point at which payloads are
/// held.
#[derive(Debug, Clone, PartialEq)]
pub struct InstanceSystem<P> {
    /// The system.
    pub system: System<P>,
    /// Parts of the terms of each moving body, vehicle first.
    pub unscaled: Vec<UnscaledBodyTerms<P>>,
    /// Point at which payloads are held, in the last moving body's frame, m.
    pub payload_attachment: [P; 3],
}

/// Visits numbers of a system in runs: adjacent numbers of one term. (No closure: it would not inherit the caller's instruction
/// set.)
pub trait RunVisitor<P> {
    /// Visits the next run.
    fn visit(&mut self, run: &mut [P]);
}

impl From<&Compiled> for InstanceSystem<f64> {
    fn from(compiled: &Compiled) -> Self {
        Self {
            system: compiled.system.map(|Shared(x)| x),
            unscaled: compiled.unscaled.iter().map(|parts| parts.map(|Shared(x)| x)).collect(),
            payload_attachment: compiled.payload_attachment,
        }
    }
}

impl<L: Lane> InstanceSystem<L> {
    /// Memory for the numbers of a lane, set to shared ones: those of [`System::allocate_scaled`], and `parts` of the bodies.
    pub fn allocate(
        system: System<L>,
        parts: &[UnscaledBodyTerms<Shared<L::Real>>],
        payload_attachment: Option<[Shared<L::Real>; 3]>,
    ) -> Self {
        let unscaled = parts.iter().map(|parts| parts.map(|Shared(x)| L::splat(x))).collect();
        let payload_attachment = payload_attachment.map_or([L::zero(); 3], |at| at.map(|Shared(x)| L::splat(x)));
        Self { system, unscaled, payload_attachment }
    }

    /// Puts the payload, if there is one, at its attachment.
    #[inline(always)]
    pub fn attach_payload(&mut self) {
        let last = match self.system.joints.last_mut() {
            Some(joint) => &mut joint.body,
            None => &mut self.system.vehicle,
        };
        if let Some(payload) = &mut last.payload {
            let [x, y, z] = self.payload_attachment;
            match &mut payload.position {
                BodyPoint::X(to) => *to = x,
                BodyPoint::Y(to) => *to = y,
                BodyPoint::Z(to) => *to = z,
                BodyPoint::General(to) => *to = [x, y, z],
            }
        }
    }
}

impl<P> InstanceSystem<P> {
    /// Visits all numbers but those of the bodies' terms that [`System::apply_factors`] sets. Systems of the same structure have
    /// the same runs.
    #[inline(always)]
    pub fn visit(&mut self, visitor: &mut impl RunVisitor<P>) {
        let system = &mut self.system;
        visitor.visit(&mut system.gravity);
        visit_frames(&mut system.vehicle, visitor);
        for joint in &mut system.joints {
            visit_joint(joint, visitor);
        }
        if let Some(servo) = &mut system.vehicle_servo {
            visitor.visit(&mut servo.kp);
            visitor.visit(&mut servo.kd);
        }
        for thruster in &mut system.thrusters {
            visit_thruster(thruster, visitor);
        }
        for fin in &mut system.fins {
            visit_fin(fin, visitor);
        }
        if let Some(tether) = &mut system.tether {
            visitor.visit(&mut tether.position);
            visit_one(&mut tether.net_mass, visitor);
            visit_one(&mut tether.drag, visitor);
        }
        for parts in &mut self.unscaled {
            visit_parts(parts, visitor);
        }
        visitor.visit(&mut self.payload_attachment);
    }
}

#[inline(always)]
fn visit_one<P>(number: &mut P, visitor: &mut impl RunVisitor<P>) {
    visitor.visit(std::slice::from_mut(number));
}

#[inline(always)]
fn visit_option<P>(number: &mut Option<P>, visitor: &mut impl RunVisitor<P>) {
    if let Some(number) = number {
        visit_one(number, visitor);
    }
}

#[inline(always)]
fn visit_rows<P, const N: usize, const M: usize>(rows: &mut [[P; N]; M], visitor: &mut impl RunVisitor<P>) {
    for row in rows {
        visitor.visit(row);
    }
}

/// Frames of a body's damping and of its central terms.
#[inline(always)]
fn visit_frames<P>(body: &mut BodyTerms<P>, visitor: &mut impl RunVisitor<P>) {
    if let Some(central) = &mut body.central {
        match &mut central.origin {
            BodyPoint::X(x) | BodyPoint::Y(x) | BodyPoint::Z(x) => visit_one(x, visitor),
            BodyPoint::General(point) => visitor.visit(point),
        }
        match &mut central.rotation {
            FrameRotation::Aligned => {}
            FrameRotation::AboutZ(sin, cos) => {
                visit_one(sin, visitor);
                visit_one(cos, visitor);
            }
            FrameRotation::General(rows) => visit_rows(rows, visitor),
        }
    }
    for damping in &mut body.damping {
        match &mut damping.frame {
            CoefficientFrame::Body => {}
            CoefficientFrame::Shifted(point) => visitor.visit(point),
            CoefficientFrame::General(rows, point) => {
                visit_rows(rows, visitor);
                visitor.visit(point);
            }
        }
    }
}

#[inline(always)]
fn visit_joint<P>(joint: &mut JointTerms<P>, visitor: &mut impl RunVisitor<P>) {
    match &mut joint.placement {
        JointPlacement::Dh(bend, a) => {
            visit_twist(bend, visitor);
            visit_option(a, visitor);
        }
        JointPlacement::DhWithOffset(turn, d, bend, a) => {
            visit_twist(turn, visitor);
            visit_option(d, visitor);
            visit_twist(bend, visitor);
            visit_option(a, visitor);
        }
        JointPlacement::General(rows, point) => {
            visit_rows(rows, visitor);
            visitor.visit(point);
        }
    }
    visit_one(&mut joint.offset, visitor);
    match &mut joint.screw {
        JointScrew::Revolute { d } => visit_option(d, visitor),
        JointScrew::Prismatic { sin, cos } => {
            visit_one(sin, visitor);
            visit_one(cos, visitor);
        }
    }
    visit_frames(&mut joint.body, visitor);
    visit_option(&mut joint.rotor_inertia, visitor);
    if let Some(friction) = &mut joint.friction {
        visit_one(&mut friction.viscous, visitor);
        if let Some(coulomb) = &mut friction.coulomb {
            visitor.visit(coulomb);
        }
    }
    if let Some(limits) = &mut joint.limits {
        visitor.visit(&mut limits.range);
        visitor.visit(&mut limits.stop);
    }
    if let Some(servo) = &mut joint.servo {
        visit_one(&mut servo.kp, visitor);
        visit_one(&mut servo.kd, visitor);
    }
    visit_option(&mut joint.effort, visitor);
    if let Some(actuator) = &mut joint.actuator {
        visit_one(&mut actuator.angle, visitor);
        visitor.visit(&mut actuator.stroke);
        visit_one(&mut actuator.force, visitor);
    }
}

#[inline(always)]
fn visit_twist<P>(twist: &mut LinkTwist<P>, visitor: &mut impl RunVisitor<P>) {
    if let LinkTwist::General(sin, cos) = twist {
        visit_one(sin, visitor);
        visit_one(cos, visitor);
    }
}

#[inline(always)]
fn visit_thruster<P>(thruster: &mut Thruster<P>, visitor: &mut impl RunVisitor<P>) {
    visitor.visit(&mut thruster.wrench);
    visitor.visit(&mut thruster.along);
    visitor.visit(&mut thruster.limits);
    visit_option(&mut thruster.lag, visitor);
    if let Some(band) = &mut thruster.dead_band {
        visitor.visit(band);
    }
    if let Some(branches) = &mut thruster.map {
        for branch in branches {
            visit_one(&mut branch.base, visitor);
            for piece in &mut branch.pieces {
                visitor.visit(piece);
            }
        }
    }
    visit_option(&mut thruster.ambient_flow, visitor);
}

#[inline(always)]
fn visit_fin<P>(fin: &mut Fin<P>, visitor: &mut impl RunVisitor<P>) {
    visitor.visit(&mut fin.position);
    visitor.visit(&mut fin.chord);
    visitor.visit(&mut fin.normal);
    visit_one(&mut fin.deflection, visitor);
    visitor.visit(&mut fin.limits);
    visit_one(&mut fin.lift, visitor);
    visit_option(&mut fin.drag, visitor);
    visit_option(&mut fin.induced, visitor);
    if let Some(stall) = &mut fin.stall {
        visitor.visit(stall);
    }
}

#[inline(always)]
fn visit_parts<P>(parts: &mut UnscaledBodyTerms<P>, visitor: &mut impl RunVisitor<P>) {
    visit_inertia(&mut parts.rigid, visitor);
    visit_inertia(&mut parts.added, visitor);
    if let Some(central) = &mut parts.central {
        for inertia in central {
            visitor.visit(&mut inertia.diagonal);
            visitor.visit(&mut inertia.products);
        }
    }
    visit_restoring(&mut parts.weight, visitor);
    visit_restoring(&mut parts.displaced, visitor);
    for Damping { linear, quadratic, linear_bound, .. } in &mut parts.damping {
        visit_coefficients(linear, visitor);
        visit_coefficients(quadratic, visitor);
        if let Some(bound) = linear_bound {
            visit_inertia(bound, visitor);
        }
    }
    if let Some(coefficients) = &mut parts.central_damping {
        visit_rows(coefficients, visitor);
    }
}

#[inline(always)]
fn visit_inertia<P>(inertia: &mut SpatialInertia<P>, visitor: &mut impl RunVisitor<P>) {
    visitor.visit(&mut inertia.m);
    visit_rows(&mut inertia.h, visitor);
    visitor.visit(&mut inertia.j);
}

#[inline(always)]
fn visit_restoring<P>(restoring: &mut Restoring<P>, visitor: &mut impl RunVisitor<P>) {
    visit_one(&mut restoring.net_mass, visitor);
    visitor.visit(&mut restoring.moment);
}

#[inline(always)]
fn visit_coefficients<P>(coefficients: &mut CoefficientMatrix<P>, visitor: &mut impl RunVisitor<P>) {
    match coefficients {
        CoefficientMatrix::None => {}
        CoefficientMatrix::Diagonal(diagonal) => visitor.visit(diagonal),
        CoefficientMatrix::Full(rows) => visit_rows(rows, visitor),
    }
}
