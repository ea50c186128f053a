//! Constants of a compiled scene, in the joint frames of the kernel.

use super::JOINTS;
use crate::contact::ContactTerms;
use crate::hydro::{CentralFrameTerms, Damping, FrameRotation, Restoring, Thruster};
use crate::lane::{Lane, Numbers, Param, RunVisitor, get_all, inverse_sqrt, no_numbers, numbers, sin_cos};
use crate::spatial::{LinkTwist, PointMass, SpatialInertia};
use crate::terms::VehicleTerms;

numbers! {
    /// A scene compiled for computation, shared by all instances. Terms absent from the scene are absent here.
    ///
    /// The z axis of every joint frame lies along the joint. `compile` chooses the frames so that consecutive ones are related by
    /// modified Denavit-Hartenberg transforms wherever these are well conditioned.
    ///
    /// Numbers are of type P; numbers of bodies, which may differ between instances, are of type B.
    #[derive(Debug, Clone, PartialEq)]
    pub struct System<P, B = P> {
        /// Gravity in world axes, m/s2.
        pub gravity: [P; 3],
        /// True if the vehicle is fixed in the world.
        pub fixed: bool,
        /// The vehicle.
        pub vehicle: BodyTerms<B>,
        /// Joints and their links, each after its carrier.
        pub joints: Vec<JointTerms<P, B>>,
        /// True if a joint branches off an earlier body than the one before it.
        pub tree: bool,
        /// Body that carries payload and end effector: 0 for the vehicle, k + 1 for the link of joint k.
        pub payload_body: usize,
        /// True if a joint is prescribed.
        pub prescribed: bool,
        /// True if a joint has a rotor.
        pub geared: bool,
        /// True if all links are [`BodyTerms::is_z_aligned`].
        pub z_aligned: bool,
        /// True if the inertias of all bodies are [`SpatialInertia::is_sparse`].
        pub sparse: bool,
        /// Station-keeping servo, evaluated within the integrator's stages.
        pub vehicle_servo: Option<VehicleServo<P>>,
        /// All thrusters if any has dynamics, else none: ideal thrust enters through the wrench on the vehicle.
        pub thrusters: Vec<Thruster<P>>,
        /// Further forces on the vehicle.
        pub terms: VehicleTerms<P>,
        /// Contact.
        pub contact: Option<ContactTerms<P>>,
    }
}

numbers! {
    /// Terms of one moving body.
    #[derive(Debug, Clone, PartialEq)]
    pub struct BodyTerms<B> {
        /// Sum of rigid and added inertia, which obey one law in the frame that moves with the water.
        pub inertia: SpatialInertia<B> = unvisited,
        /// Weight and buoyancy.
        pub restoring: Option<Restoring<B>> = unvisited,
        /// Damping, one entry per body of the scene that is fixed to this one.
        pub damping: Vec<Damping<B>> = visit_frames,
        /// `inertia`, `restoring` and the first entry of `damping` again, in their common central frame if they have one.
        pub central: Option<CentralFrameTerms<B>>,
        /// Point mass that single instances carry; included in `inertia` and `restoring`, not in `central`.
        pub payload: Option<PointMass<B>> = unvisited,
    }
}

numbers! {
    /// A joint and its link.
    #[derive(Debug, Clone, PartialEq)]
    pub struct JointTerms<P, B = P> {
        /// Kind of joint, for the passes.
        pub kind: JointKind<P>,
        /// Place in the tree.
        pub branch: Branch,
        /// Constant transform from the parent frame.
        pub placement: JointPlacement<P>,
        /// theta (revolute, rad) or d (prismatic, m) at q = 0.
        pub offset: P,
        /// Constant part of its screw about z.
        pub screw: JointScrew<P>,
        /// Terms of the link.
        pub body: BodyTerms<B>,
        /// Inertia of the rotor reflected to the joint, kg m2 or kg. Present, if only as 0, where the joint is prescribed.
        pub rotor_inertia: Option<P>,
        /// True if the joint follows its target exactly.
        pub prescribed: bool,
        /// Friction.
        pub friction: Option<Friction<P>>,
        /// End stops.
        pub limits: Option<Limits<P>>,
        /// Joint servo.
        pub servo: Option<Servo<P>>,
        /// Maximum actuator torque, N m or N.
        pub effort: Option<P>,
        /// Terms that few joints have, behind one test.
        pub rare: Option<Box<RareTerms<P>>>,
    }
}

numbers! {
    /// Kind of joint: passes choose their way by one test. Common joints are revolute, have a rotor, are free to move, start at the
    /// body before them by Denavit-Hartenberg parameters alone, and nothing branches at their links.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub enum JointKind<P> {
        /// Common: axis parallel to the one before it, at the distance a; no offset d.
        Parallel(a: P),
        /// Common: axis opposite to the one before it, at the distance a; no offset d.
        Opposite(a: P),
        /// Common: axis perpendicular to the one before it and through it; no offset d.
        Perpendicular,
        /// Common: axis perpendicular to the one before it, at the distance a; no offset d.
        PerpendicularApart(a: P),
        /// Common: any axis.
        Common,
        /// Not common.
        Other,
    }
}

/// Carrier of a joint that starts in the world.
pub const WORLD: u8 = u8::MAX;

/// Place of a joint in the tree. In a serial chain every joint starts at the body before it, and nothing branches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Branch {
    /// Carrier of the joint where it is not the body before it: 0 for the vehicle, k + 1 for the link of joint k, [`WORLD`].
    pub carrier: Option<u8>,
    /// True if a later joint branches off this link, or the payload is on it and it is not the last.
    pub forks: bool,
}

no_numbers!(Branch);

numbers! {
    /// Terms that few joints have.
    #[derive(Debug, Clone, Copy, PartialEq, Default)]
    pub struct RareTerms<P> {
        /// Linear actuator, whose maximum torque replaces [`JointTerms::effort`].
        pub actuator: Option<Actuator<P>>,
        /// Stiffness and rest coordinate of a spring.
        pub spring: Option<[P; 2]>,
        /// Detent.
        pub detent: Option<Detent<P>>,
        /// Static friction.
        pub break_away: Option<BreakAway<P>>,
    }
}

numbers! {
    /// `-torque sin(rate (q - offset))`
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct Detent<P> {
        /// Maximum torque, N m or N.
        pub torque: P,
        /// `2 pi` by the distance between resting places.
        pub rate: P,
        /// Coordinate of a resting place.
        pub offset: P,
    }
}

numbers! {
    /// Static friction beyond Coulomb friction, `-excess / (1 + decay qd^2) qd / sqrt(qd^2 + speed^2)`.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct BreakAway<P> {
        /// Static less Coulomb friction, N m or N.
        pub excess: P,
        /// `1 / v^2` with the speed v at which half of the excess is left.
        pub decay: P,
        /// Square of the speed over which friction is smoothed.
        pub speed_squared: P,
    }
}

impl<P: Copy> BreakAway<P> {
    /// Friction by speed.
    #[inline(always)]
    pub fn slope<L: Lane>(&self, qd: L) -> L
    where
        P: Param<L>,
    {
        let square = qd * qd;
        let excess = self.excess.get() / square.mul_add(self.decay.get(), L::c(1.0));
        excess * inverse_sqrt(square + self.speed_squared.get())
    }
}

numbers! {
    /// A linear actuator of a revolute joint, with the maximum torque `f |sin(q + angle)| / sqrt(s - t cos(q + angle))`, N m.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct Actuator<P> {
        /// Angle between the two attachment points at q = 0, rad.
        pub angle: P,
        /// s, the sum of the squared distances of the attachment points from the axis, and t, twice their product, m2.
        pub stroke: [P; 2],
        /// f, the maximum force times the product of the distances, N m2.
        pub force: P,
    }
}

impl<P: Copy> Actuator<P> {
    /// Maximum torque at joint coordinate `q`, N m.
    #[inline(always)]
    pub fn effort<L: Lane>(&self, q: L) -> L
    where
        P: Param<L>,
    {
        let (sin, cos) = sin_cos(q + self.angle.get());
        let [squares, product]: [L; 2] = get_all(&self.stroke);
        // Keeps the quotient finite where both points coincide and the lever arm is 0.
        let square = product.neg_mul_add(cos, squares).max(squares * L::c(1e-12));
        self.force.get() * sin.abs() / square.sqrt()
    }
}

numbers! {
    /// Constant parameters of a joint's screw `Rz(theta) Tz(d)`: theta of a revolute joint varies, d of a prismatic one.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct JointScrew<P> {
        /// d of a revolute joint, m; absent where it is 0.
        pub d: Option<P>,
        /// Sine and cosine of theta of a prismatic joint; absent for a revolute one.
        pub theta: Option<[P; 2]>,
    }
}

numbers! {
    /// Constant transform from the parent frame to the joint frame, before the joint's screw about z: `Rx(alpha) Tx(a)` by modified
    /// Denavit-Hartenberg parameters.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct JointPlacement<P> {
        /// Transform before these parameters, where there is one.
        pub before: Option<Before<P>>,
        /// alpha.
        pub twist: LinkTwist<P>,
        /// a, m; absent where it is 0.
        pub a: Option<P>,
    }
}

numbers! {
    /// Transform before the Denavit-Hartenberg parameters of a joint.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub enum Before<P> {
        /// `Rz(theta) Tz(d)`; d is absent where it is 0.
        Screw(turn: LinkTwist<P>, d: Option<P>),
        /// Pose, in place of the parameters: rotation by rows, position.
        Pose(rows: [[P; 3]; 3], point: [P; 3]),
    }
}

numbers! {
    /// `-(viscous qd + coulomb qd / sqrt(qd^2 + speed^2))`
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct Friction<P> {
        /// Viscous coefficient, N m s/rad or N s/m.
        pub viscous: P,
        /// Coulomb torque, and the square of the speed over which it is smoothed.
        pub coulomb: Option<[P; 2]>,
    }
}

numbers! {
    /// Compliant end stops.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct Limits<P> {
        /// Lower and upper limit.
        pub range: [P; 2],
        /// Stiffness and damping.
        pub stop: [P; 2],
    }
}

numbers! {
    /// Gains of a joint servo.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct Servo<P> {
        /// Proportional gain.
        pub kp: P,
        /// Derivative gain.
        pub kd: P,
    }
}

numbers! {
    /// Gains of the vehicle's station keeping.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct VehicleServo<P> {
        /// Proportional gains.
        pub kp: [P; 6],
        /// Derivative gains.
        pub kd: [P; 6],
    }
}

/// Visits the frames of damping: [`System::apply_factors`] sets its coefficients.
#[inline(always)]
fn visit_frames<P: Copy>(damping: &mut [Damping<P>], visitor: &mut impl RunVisitor<P>) {
    for damping in damping {
        damping.frame.visit(visitor);
    }
}

impl<P, B> System<P, B> {
    /// The joints, at most [`JOINTS`] of them: a bound that saves the compiler its index checks.
    #[inline(always)]
    pub fn chain(&self) -> &[JointTerms<P, B>] {
        &self.joints[..self.joints.len().min(JOINTS)]
    }
}

impl<P, B> System<P, B> {
    /// The body that carries payload and end effector.
    #[inline(always)]
    pub fn payload_body(&self) -> &BodyTerms<B> {
        let joint = self.payload_body.checked_sub(1).and_then(|k| self.joints.get(k));
        joint.map_or(&self.vehicle, |joint| &joint.body)
    }

    /// [`Self::payload_body`], mutable.
    #[inline(always)]
    pub fn payload_body_mut(&mut self) -> &mut BodyTerms<B> {
        let joint = self.payload_body.checked_sub(1).and_then(|k| self.joints.get_mut(k));
        joint.map_or(&mut self.vehicle, |joint| &mut joint.body)
    }
}

impl<B> BodyTerms<B> {
    /// True if the body has a central frame whose z axis lies along its own, and no other damping.
    pub fn is_z_aligned(&self) -> bool {
        self.damping.len() <= 1
            && self.central.as_ref().is_some_and(|central| !matches!(central.rotation, FrameRotation::General(_)))
    }
}

impl<P: Copy, B> JointTerms<P, B> {
    /// Kind by the other terms.
    pub fn kind(&self) -> JointKind<P> {
        let JointPlacement { before, twist, a } = &self.placement;
        let free = !self.is_prismatic() && !self.prescribed && self.rotor_inertia.is_some();
        match (self.branch == Branch::default() && before.is_none() && free, self.screw.d, twist, a) {
            (true, None, LinkTwist::Deg0, Some(a)) => JointKind::Parallel(*a),
            (true, None, LinkTwist::Deg180, Some(a)) => JointKind::Opposite(*a),
            (true, None, LinkTwist::Deg90, None) => JointKind::Perpendicular,
            (true, None, LinkTwist::Deg90, Some(a)) => JointKind::PerpendicularApart(*a),
            (true, ..) => JointKind::Common,
            (false, ..) => JointKind::Other,
        }
    }
}

impl<P, B> JointTerms<P, B> {
    /// Body that carries this joint of this index: 0 for the vehicle, k + 1 for the link of joint k; [`WORLD`].
    #[inline(always)]
    pub fn carrier(&self, index: usize) -> usize {
        self.branch.carrier.map_or(index, |carrier| carrier as usize)
    }

    /// True for a prismatic joint.
    #[inline(always)]
    pub fn is_prismatic(&self) -> bool {
        self.screw.theta.is_some()
    }
}
