//! Constants of a compiled scene, in the joint frames of the kernel.

use super::JOINTS;
use crate::hydro::{CentralFrameTerms, Damping, Fin, FrameRotation, Restoring, Tether, Thruster};
use crate::lane::{Lane, Param, get_all, sin_cos};
use crate::spatial::{LinkTwist, PointMass, SpatialInertia};

/// A scene compiled for computation, shared by all instances. Terms absent from the scene are absent here.
///
/// The z axis of every joint frame lies along the joint. `compile` chooses the frames so that consecutive ones are related by
/// modified Denavit-Hartenberg transforms wherever these are well conditioned.
///
/// Numbers are of type P; those of bodies, which may differ between instances, are of type B.
#[derive(Debug, Clone, PartialEq)]
pub struct System<P, B = P> {
    /// Gravity in world axes, m/s2.
    pub gravity: [P; 3],
    /// True if the vehicle is fixed in the world.
    pub fixed: bool,
    /// The vehicle.
    pub vehicle: BodyTerms<B>,
    /// Joints and their links, from the base outward.
    pub joints: Vec<JointTerms<P, B>>,
    /// True if a joint is prescribed.
    pub prescribed: bool,
    /// True if all links are [`BodyTerms::is_z_aligned`].
    pub z_aligned: bool,
    /// True if the inertias of all bodies are [`SpatialInertia::is_sparse`].
    pub sparse: bool,
    /// Station-keeping servo, evaluated within the integrator's stages.
    pub vehicle_servo: Option<VehicleServo<P>>,
    /// All thrusters if any has dynamics, else none: ideal thrust enters through the wrench on the vehicle.
    pub thrusters: Vec<Thruster<P>>,
    /// Fins.
    pub fins: Vec<Fin<P>>,
    /// Tether.
    pub tether: Option<Tether<P>>,
}

/// Terms of one moving body.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyTerms<B> {
    /// Sum of rigid and added inertia, which obey one law in the frame that moves with the water.
    pub inertia: SpatialInertia<B>,
    /// Weight and buoyancy.
    pub restoring: Option<Restoring<B>>,
    /// Damping, one entry per body of the scene that is fixed to this one.
    pub damping: Vec<Damping<B>>,
    /// `inertia`, `restoring` and the first entry of `damping` again, in their common central frame if they have one.
    pub central: Option<CentralFrameTerms<B>>,
    /// Point mass held by single instances; included in `inertia` and `restoring`, not in `central`.
    pub payload: Option<PointMass<B>>,
}

/// A joint and its link.
#[derive(Debug, Clone, PartialEq)]
pub struct JointTerms<P, B = P> {
    /// Constant transform from the parent frame.
    pub placement: JointPlacement<P>,
    /// theta (revolute, rad) or d (prismatic, m) at q = 0.
    pub offset: P,
    /// Kind of joint, with the constant part of its screw about z.
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
    /// Linear actuator, whose maximum torque replaces `effort`.
    pub actuator: Option<Actuator<P>>,
}

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

impl<P: Copy> Actuator<P> {
    fn map<Q>(&self, c: &impl Fn(P) -> Q) -> Actuator<Q> {
        Actuator { angle: c(self.angle), stroke: self.stroke.map(c), force: c(self.force) }
    }

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

/// Kind of joint, with the constant parameter of its screw `Rz(theta) Tz(d)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum JointScrew<P> {
    /// theta varies; d is absent where it is 0.
    Revolute {
        /// Joint offset, m.
        d: Option<P>,
    },
    /// d varies; theta is given by its sine and cosine.
    Prismatic {
        /// Sine of theta.
        sin: P,
        /// Cosine of theta.
        cos: P,
    },
}

/// Constant transform from the parent frame to the joint frame, before the joint's screw about z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum JointPlacement<P> {
    /// Modified Denavit-Hartenberg parameters: `Rx(alpha) Tx(a)`; a is absent where it is 0.
    Dh(LinkTwist<P>, Option<P>),
    /// `Rz(theta) Tz(d) Rx(alpha) Tx(a)` with constant theta and d, in this order.
    DhWithOffset(LinkTwist<P>, Option<P>, LinkTwist<P>, Option<P>),
    /// General pose: rotation by rows, position.
    General([[P; 3]; 3], [P; 3]),
}

/// `-(viscous qd + coulomb qd / sqrt(qd^2 + speed^2))`
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Friction<P> {
    /// Viscous coefficient, N m s/rad or N s/m.
    pub viscous: P,
    /// Coulomb torque, and the square of the speed over which it is smoothed.
    pub coulomb: Option<[P; 2]>,
}

/// Compliant end stops.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits<P> {
    /// Lower and upper limit.
    pub range: [P; 2],
    /// Stiffness and damping.
    pub stop: [P; 2],
}

/// Gains of a joint servo.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Servo<P> {
    /// Proportional gain.
    pub kp: P,
    /// Derivative gain.
    pub kd: P,
}

/// Gains of the vehicle's station keeping.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VehicleServo<P> {
    /// Proportional gains.
    pub kp: [P; 6],
    /// Derivative gains.
    pub kd: [P; 6],
}

impl<P, B> System<P, B> {
    /// The joints, at most [`JOINTS`] of them: a bound that saves the compiler its index checks.
    #[inline(always)]
    pub fn chain(&self) -> &[JointTerms<P, B>] {
        &self.joints[..self.joints.len().min(JOINTS)]
    }
}

impl<P: Copy> System<P> {
    /// The system with `change` applied to each number.
    pub fn map<Q>(&self, change: impl Fn(P) -> Q) -> System<Q> {
        let c = &change;
        System {
            gravity: self.gravity.map(c),
            fixed: self.fixed,
            vehicle: self.vehicle.map(c),
            joints: self.joints.iter().map(|joint| joint.map(c)).collect(),
            prescribed: self.prescribed,
            z_aligned: self.z_aligned,
            sparse: self.sparse,
            vehicle_servo: self.vehicle_servo.map(|s| VehicleServo { kp: s.kp.map(c), kd: s.kd.map(c) }),
            thrusters: self.thrusters.iter().map(|thruster| thruster.map(c)).collect(),
            fins: self.fins.iter().map(|fin| fin.map(c)).collect(),
            tether: self.tether.map(|tether| tether.map(c)),
        }
    }
}

impl<B> BodyTerms<B> {
    /// True if the body has a central frame whose z axis lies along its own, and no other damping.
    pub fn is_z_aligned(&self) -> bool {
        self.damping.len() <= 1
            && self.central.as_ref().is_some_and(|central| !matches!(central.rotation, FrameRotation::General(_)))
    }
}

impl<B: Copy> BodyTerms<B> {
    fn map<C>(&self, c: &impl Fn(B) -> C) -> BodyTerms<C> {
        BodyTerms {
            inertia: self.inertia.map(c),
            restoring: self.restoring.map(|r| r.map(c)),
            damping: self.damping.iter().map(|d| d.map(c)).collect(),
            central: self.central.map(|p| p.map(c)),
            payload: self.payload.map(|payload| payload.map(c)),
        }
    }
}

impl<P: Copy> JointScrew<P> {
    pub(super) fn map<Q>(&self, c: &impl Fn(P) -> Q) -> JointScrew<Q> {
        match *self {
            JointScrew::Revolute { d } => JointScrew::Revolute { d: d.map(c) },
            JointScrew::Prismatic { sin, cos } => JointScrew::Prismatic { sin: c(sin), cos: c(cos) },
        }
    }
}

impl<P: Copy> JointPlacement<P> {
    pub(super) fn map<Q>(&self, c: &impl Fn(P) -> Q) -> JointPlacement<Q> {
        match *self {
            JointPlacement::Dh(bend, a) => JointPlacement::Dh(bend.map(c), a.map(c)),
            JointPlacement::DhWithOffset(turn, d, bend, a) => {
                JointPlacement::DhWithOffset(turn.map(c), d.map(c), bend.map(c), a.map(c))
            }
            JointPlacement::General(r, p) => JointPlacement::General(r.map(|row| row.map(c)), p.map(c)),
        }
    }
}

impl<P, B> JointTerms<P, B> {
    /// True for a prismatic joint.
    #[inline(always)]
    pub fn is_prismatic(&self) -> bool {
        matches!(self.screw, JointScrew::Prismatic { .. })
    }
}

impl<P: Copy> JointTerms<P> {
    fn map<Q>(&self, c: &impl Fn(P) -> Q) -> JointTerms<Q> {
        JointTerms {
            placement: self.placement.map(c),
            offset: c(self.offset),
            screw: self.screw.map(c),
            body: self.body.map(c),
            rotor_inertia: self.rotor_inertia.map(c),
            prescribed: self.prescribed,
            friction: self.friction.map(|f| Friction { viscous: c(f.viscous), coulomb: f.coulomb.map(|k| k.map(c)) }),
            limits: self.limits.map(|l| Limits { range: l.range.map(c), stop: l.stop.map(c) }),
            servo: self.servo.map(|s| Servo { kp: c(s.kp), kd: c(s.kd) }),
            effort: self.effort.map(c),
            actuator: self.actuator.map(|actuator| actuator.map(c)),
        }
    }
}
