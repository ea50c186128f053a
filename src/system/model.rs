//! What the kernel reads: constants of a scene, in the frames that compute fastest.

use super::JOINTS;
use crate::hydro::{Central, Drag, Fin, Restoring, Tether, Thruster, Turn};
use crate::lane::{Lane, Param, get_all, sin_cos};
use crate::spatial::{Bend, PointMass, SpatialInertia};

/// A scene compiled for computation; a term that the scene does not have is absent. Shared by all instances.
///
/// Every joint's frame has its z axis along the joint; `compile` chooses the frames, so that they follow each other by
/// Denavit-Hartenberg moves wherever that is well conditioned.
///
/// Its numbers are of type P, those of bodies of type B: the numbers that instances may have of their own.
#[derive(Debug, Clone, PartialEq)]
pub struct System<P, B = P> {
    /// Gravity in world axes.
    pub gravity: [P; 3],
    /// Whether the vehicle is held in the world.
    pub fixed: bool,
    /// The vehicle.
    pub vehicle: BodyTerms<B>,
    /// Joints and links from the base outward.
    pub joints: Vec<JointTerms<P, B>>,
    /// Whether all links are [`BodyTerms::is_upright`].
    pub upright: bool,
    /// Whether the inertias of all bodies are [`SpatialInertia::is_sparse`].
    pub sparse: bool,
    /// Station keeping evaluated within the stages.
    pub vehicle_servo: Option<VehicleServo<P>>,
    /// Thrusters, if any has dynamics; else what they give is part of the wrench on the vehicle.
    pub thrusters: Vec<Thruster<P>>,
    /// Fins.
    pub fins: Vec<Fin<P>>,
    /// Tether.
    pub tether: Option<Tether<P>>,
}

/// Terms of one moving body.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyTerms<B> {
    /// Rigid and added inertia together: in the frame that moves with the water they obey one law.
    pub inertia: SpatialInertia<B>,
    /// Weight and buoyancy.
    pub restoring: Option<Restoring<B>>,
    /// Drag, one entry per body of the scene that is fixed to this one.
    pub drag: Vec<Drag<B>>,
    /// `inertia`, `restoring` and the first of `drag`, if there is any, once more, in the frame of their centre, where they have
    /// one.
    pub central: Option<Central<B>>,
    /// Payload of single instances, which `central` does not hold; `inertia` and `restoring` do.
    pub load: Option<PointMass<B>>,
}

/// One joint and the link that it moves.
#[derive(Debug, Clone, PartialEq)]
pub struct JointTerms<P, B = P> {
    /// Where the joint stands on its parent.
    pub stand: Stand<P>,
    /// theta (revolute) or d (prismatic) at q = 0.
    pub offset: P,
    /// What does not move of the screw about z.
    pub constant: Constant<P>,
    /// The link.
    pub body: BodyTerms<B>,
    /// Friction.
    pub friction: Option<Friction<P>>,
    /// End stops.
    pub limits: Option<Limits<P>>,
    /// Servo.
    pub servo: Option<Servo<P>>,
    /// Greatest actuator torque.
    pub effort: Option<P>,
    /// Linear actuator, in place of that.
    pub actuator: Option<Actuator<P>>,
}

/// A linear actuator: its greatest torque is `f |sin(q + angle)| / sqrt(s - t cos(q + angle))`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Actuator<P> {
    /// Angle at q = 0.
    pub angle: P,
    /// s: squares of the two distances from the axis, and t: twice their product.
    pub stroke: [P; 2],
    /// f: greatest force times that product.
    pub force: P,
}

impl<P: Copy> Actuator<P> {
    fn map<Q>(&self, c: &impl Fn(P) -> Q) -> Actuator<Q> {
        Actuator { angle: c(self.angle), stroke: self.stroke.map(c), force: c(self.force) }
    }

    /// Greatest torque at joint coordinate `q`.
    #[inline(always)]
    pub fn effort<L: Lane>(&self, q: L) -> L
    where
        P: Param<L>,
    {
        let (sin, cos) = sin_cos(q + self.angle.get());
        let [squares, product]: [L; 2] = get_all(&self.stroke);
        // Where both points fall together there is no lever arm either.
        let square = product.neg_mul_add(cos, squares).max(squares * L::c(1e-12));
        self.force.get() * sin.abs() / square.sqrt()
    }
}

/// The constant part of a joint's `Rz(theta) Tz(d)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Constant<P> {
    /// Of a joint that turns: d, absent where it is 0.
    Shift(Option<P>),
    /// Of a joint that slides: sine and cosine of theta.
    Turn(P, P),
}

/// Constant move from the parent frame to the joint's, before the screw about z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stand<P> {
    /// `Rx(alpha) Tx(a)`; a is absent where it is 0.
    Bend(Bend<P>, Option<P>),
    /// `Rz(theta) Tz(d) Rx(alpha) Tx(a)` with constant theta and d, by theta, d, alpha, a.
    Crank(Bend<P>, Option<P>, Bend<P>, Option<P>),
    /// Any pose: rotation by rows, position.
    Pose([[P; 3]; 3], [P; 3]),
}

/// `-(viscous qd + coulomb qd / sqrt(qd^2 + speed^2))`
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Friction<P> {
    /// Viscous coefficient.
    pub viscous: P,
    /// Coulomb torque and the square of its smoothing speed.
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
    /// The joints; never more than [`JOINTS`], which spares the compiler checks.
    #[inline(always)]
    pub fn chain(&self) -> &[JointTerms<P, B>] {
        &self.joints[..self.joints.len().min(JOINTS)]
    }
}

impl<P: Copy> System<P> {
    /// The same system with each number changed.
    pub fn map<Q>(&self, change: impl Fn(P) -> Q) -> System<Q> {
        self.map_both(&change, &change)
    }
}

impl<P: Copy, B: Copy> System<P, B> {
    /// The same system with each number of its bodies changed.
    pub fn map_bodies<C>(&self, change: impl Fn(B) -> C) -> System<P, C> {
        self.map_both(&|x| x, &change)
    }

    fn map_both<Q, C>(&self, c: &impl Fn(P) -> Q, of_body: &impl Fn(B) -> C) -> System<Q, C> {
        System {
            gravity: self.gravity.map(c),
            fixed: self.fixed,
            vehicle: self.vehicle.map(of_body),
            joints: self.joints.iter().map(|joint| joint.map(c, of_body)).collect(),
            upright: self.upright,
            sparse: self.sparse,
            vehicle_servo: self.vehicle_servo.map(|s| VehicleServo { kp: s.kp.map(c), kd: s.kd.map(c) }),
            thrusters: self.thrusters.iter().map(|thruster| thruster.map(c)).collect(),
            fins: self.fins.iter().map(|fin| fin.map(c)).collect(),
            tether: self.tether.map(|tether| tether.map(c)),
        }
    }
}

impl<B> BodyTerms<B> {
    /// Whether it has a central frame along its own axes or turned about z, and no drag but that.
    pub fn is_upright(&self) -> bool {
        self.drag.len() <= 1 && self.central.as_ref().is_some_and(|central| !matches!(central.turn, Turn::Whole(_)))
    }
}

impl<B: Copy> BodyTerms<B> {
    fn map<C>(&self, c: &impl Fn(B) -> C) -> BodyTerms<C> {
        BodyTerms {
            inertia: self.inertia.map(c),
            restoring: self.restoring.map(|r| r.map(c)),
            drag: self.drag.iter().map(|d| d.map(c)).collect(),
            central: self.central.map(|p| p.map(c)),
            load: self.load.map(|load| load.map(c)),
        }
    }
}

impl<P: Copy> Constant<P> {
    pub(super) fn map<Q>(&self, c: &impl Fn(P) -> Q) -> Constant<Q> {
        match *self {
            Constant::Shift(d) => Constant::Shift(d.map(c)),
            Constant::Turn(sin, cos) => Constant::Turn(c(sin), c(cos)),
        }
    }
}

impl<P: Copy> Stand<P> {
    pub(super) fn map<Q>(&self, c: &impl Fn(P) -> Q) -> Stand<Q> {
        match *self {
            Stand::Bend(bend, a) => Stand::Bend(bend.map(c), a.map(c)),
            Stand::Crank(turn, d, bend, a) => Stand::Crank(turn.map(c), d.map(c), bend.map(c), a.map(c)),
            Stand::Pose(r, p) => Stand::Pose(r.map(|row| row.map(c)), p.map(c)),
        }
    }
}

impl<P, B> JointTerms<P, B> {
    /// Whether the joint slides instead of turning.
    #[inline(always)]
    pub fn slides(&self) -> bool {
        matches!(self.constant, Constant::Turn(..))
    }
}

impl<P: Copy, B: Copy> JointTerms<P, B> {
    fn map<Q, C>(&self, c: &impl Fn(P) -> Q, of_body: &impl Fn(B) -> C) -> JointTerms<Q, C> {
        JointTerms {
            stand: self.stand.map(c),
            offset: c(self.offset),
            constant: self.constant.map(c),
            body: self.body.map(of_body),
            friction: self.friction.map(|f| Friction { viscous: c(f.viscous), coulomb: f.coulomb.map(|k| k.map(c)) }),
            limits: self.limits.map(|l| Limits { range: l.range.map(c), stop: l.stop.map(c) }),
            servo: self.servo.map(|s| Servo { kp: c(s.kp), kd: c(s.kd) }),
            effort: self.effort.map(c),
            actuator: self.actuator.map(|actuator| actuator.map(c)),
        }
    }
}
