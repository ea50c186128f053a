//! The arm: revolute and prismatic joints, in a chain or branching.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{BASE, Body, EndEffectorFrame, Frame, LinearActuator, MeshFile, VEHICLE};
use crate::keys::numbers;

/// An arm on the vehicle: a chain of links, or a tree.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Arm {
    /// Name of the arm, for people.
    pub name: String,
    /// Loading of the arm's base onto the vehicle: fixed or by a joint.
    #[serde(default)]
    pub mount: Mount,
    /// The arm's base, if it has mass; its frame is the mount frame, moved by `mount.joint` if there is one.
    pub base: Option<Body>,
    /// Meshes of the base in pictures.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub meshes: Vec<MeshFile>,
    /// Links from the base outward, each after its parent.
    #[serde(default)]
    pub links: Vec<Link>,
    /// The end effector that tasks, controllers, planning and disturbances use.
    #[serde(default)]
    pub end_effector: EndEffectorFrame,
    /// End effectors by name, from which [`Scene::with_end_effector`](super::Scene::with_end_effector) chooses.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub end_effectors: BTreeMap<String, EndEffectorFrame>,
}

/// Body that carries a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Parent {
    /// The vehicle.
    Vehicle,
    /// The arm's base.
    Base,
    /// A link, by its index.
    Link(usize),
}

impl Arm {
    /// Body of this name.
    pub fn named(&self, name: &str) -> Option<Parent> {
        self.body(name, self.links.len())
    }

    /// Body of this name among the base, the vehicle and the first `count` links.
    pub(super) fn body(&self, name: &str, count: usize) -> Option<Parent> {
        match name {
            VEHICLE => Some(Parent::Vehicle),
            BASE => Some(Parent::Base),
            name => self.links[..count].iter().position(|link| link.name == name).map(Parent::Link),
        }
    }

    /// Body that carries link `i`; none if it names no earlier link.
    pub fn parent(&self, i: usize) -> Option<Parent> {
        match (&self.links[i].parent, i) {
            (Some(name), _) => self.body(name, i),
            (None, 0) => Some(Parent::Base),
            (None, _) => Some(Parent::Link(i - 1)),
        }
    }

    /// Body that carries an end effector, by default the last link or the base; none if `on` names no body.
    pub fn carrier(&self, end_effector: &EndEffectorFrame) -> Option<Parent> {
        match (&end_effector.on, self.links.len()) {
            (Some(name), count) => self.body(name, count),
            (None, 0) => Some(Parent::Base),
            (None, count) => Some(Parent::Link(count - 1)),
        }
    }
}

/// Fixed loading (no joint, `[HC eq. 32-34]`) or joint loading through q0 with torque tau0 (`[HC eq. 29-31]`).
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mount {
    /// Mount frame in the vehicle frame.
    #[serde(default)]
    pub frame: Frame,
    /// Joint q0 between vehicle and arm base, with its `frame` relative to the mount frame. Requires an arm base with mass.
    pub joint: Option<Joint>,
}

/// A link and its joint. The link frame lies at the joint and moves with the link.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Link {
    /// Name, also used in keys.
    pub name: String,
    /// Link that carries this one, `base` or `vehicle`; the entry before if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parent: Option<String>,
    /// Joint between the parent and this link.
    pub joint: Joint,
    /// Rigid body and hydrodynamics in the link frame. A link on a fixed joint may be a mere frame.
    pub body: Option<Body>,
    /// Meshes in pictures, in the link frame.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub meshes: Vec<MeshFile>,
}

impl Link {
    /// False if the link is fixed to its parent.
    pub fn moves(&self) -> bool {
        self.joint.kind != JointKind::Fixed
    }
}

/// Kind of joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum JointKind {
    /// Rotation about the axis; q in rad, torque in N m.
    Revolute,
    /// Translation along the axis; q in m, "torque" in N.
    Prismatic,
    /// No motion: the link is part of its parent, and no entry of any joint array.
    Fixed,
}

/// A joint of one degree of freedom, or a fixed one. Positive torque acts along +q.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Joint {
    /// Revolute, prismatic or fixed; a fixed joint has no other key than `frame`.
    pub kind: JointKind,
    /// Link frame in the parent frame at q = 0.
    #[serde(default)]
    pub frame: Frame,
    /// Axis in the link frame; normalised on reading. NaN where it is absent, then 0 where the joint is fixed.
    #[serde(default = "no_axis", with = "numbers::vector3", skip_serializing_if = "is_no_axis")]
    pub axis: Vector3<f64>,
    /// Inertia of the actuator's rotor reflected to the joint, rotor inertia times gear ratio squared, kg m2 or kg. It resists
    /// only q''.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub rotor_inertia: f64,
    /// True where the joint follows its target exactly, at whatever torque that takes: its motion is prescribed. Servo,
    /// friction, spring, detent, end stops and effort then do not act on the motion.
    #[serde(default, skip_serializing_if = "is_false")]
    pub prescribed: bool,
    /// Viscous, Coulomb and static friction of the joint.
    #[serde(default)]
    pub friction: Friction,
    /// Spring between the joint's parts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spring: Option<JointSpring>,
    /// Detent, with resting places at equal intervals.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub detent: Option<Detent>,
    /// Compliant end stops.
    pub limits: Option<JointLimits>,
    /// Maximum actuator torque, N m or N. Unlimited when absent.
    pub effort: Option<f64>,
    /// Linear actuator of a revolute joint; its maximum force replaces `effort`.
    pub actuator: Option<LinearActuator>,
    /// Maximum speed of references, rad/s or m/s.
    pub speed: Option<f64>,
    /// Joint servo (the paper's PD on the joints).
    pub servo: Option<JointServo>,
    /// Joint coordinate at the start of a run, rad or m.
    #[serde(default)]
    pub home: f64,
}

fn is_zero(x: &f64) -> bool {
    *x == 0.0
}

fn is_false(x: &bool) -> bool {
    !x
}

fn no_axis() -> Vector3<f64> {
    Vector3::repeat(f64::NAN)
}

fn is_no_axis(axis: &Vector3<f64>) -> bool {
    axis.x.is_nan() || *axis == Vector3::zeros()
}

impl Joint {
    /// A fixed joint.
    pub fn fixed(frame: Frame) -> Self {
        Self {
            kind: JointKind::Fixed,
            frame,
            axis: Vector3::zeros(),
            rotor_inertia: 0.0,
            prescribed: false,
            friction: Friction::default(),
            spring: None,
            detent: None,
            limits: None,
            effort: None,
            actuator: None,
            speed: None,
            servo: None,
            home: 0.0,
        }
    }

    /// True for a prismatic joint.
    pub fn slides(&self) -> bool {
        self.kind == JointKind::Prismatic
    }

    /// Maximum torque of the actuator at joint coordinate `q`, N m or N; infinite if unlimited.
    pub fn effort_at(&self, q: f64) -> f64 {
        match &self.actuator {
            Some(actuator) => actuator.force * actuator.arm(q).abs(),
            None => self.effort.unwrap_or(f64::INFINITY),
        }
    }
}

/// Joint friction `-(viscous qd + c(qd) qd / sqrt(qd^2 + coulomb_speed^2))`, with c = coulomb, or by Stribeck's law
/// `coulomb + (static - coulomb) / (1 + (qd / stribeck_speed)^2)`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Friction {
    /// N m s/rad or N s/m.
    pub viscous: f64,
    /// N m or N.
    pub coulomb: f64,
    /// Speed over which Coulomb friction is smoothed, rad/s or m/s.
    pub coulomb_speed: f64,
    /// Static friction at break-away, N m or N, at least `coulomb`; equal to it when absent.
    #[serde(rename = "static", skip_serializing_if = "Option::is_none")]
    pub break_away: Option<f64>,
    /// Speed at which half of the difference between static and Coulomb friction is left, rad/s or m/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stribeck_speed: Option<f64>,
}

impl Default for Friction {
    fn default() -> Self {
        Self { viscous: 0.0, coulomb: 0.0, coulomb_speed: 0.01, break_away: None, stribeck_speed: None }
    }
}

impl Friction {
    /// Static friction, N m or N: the maximum of the dry part.
    pub fn at_rest(&self) -> f64 {
        self.break_away.unwrap_or(self.coulomb)
    }
}

/// Spring of a joint: torque `-stiffness (q - rest)`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointSpring {
    /// N m/rad or N/m.
    pub stiffness: f64,
    /// Coordinate without torque, rad or m.
    #[serde(default)]
    pub rest: f64,
}

/// Detent of a joint: torque `-torque sin(2 pi (q - offset) / period)`, with resting places at offset plus multiples of the
/// period.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Detent {
    /// Maximum torque, N m or N.
    pub torque: f64,
    /// Distance between resting places, rad or m.
    pub period: f64,
    /// Coordinate of a resting place, rad or m.
    #[serde(default)]
    pub offset: f64,
}

impl Detent {
    /// Stiffness in a resting place, N m/rad or N/m.
    pub fn stiffness(&self) -> f64 {
        std::f64::consts::TAU / self.period * self.torque
    }
}

/// Compliant end stops: torque `-(stiffness p + damping |p| qd)` at the penetration p beyond a limit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointLimits {
    /// Lower limit, rad or m.
    pub lower: f64,
    /// Upper limit, rad or m.
    pub upper: f64,
    /// N m/rad or N/m.
    pub stiffness: f64,
    /// N m s/rad2 or N s/m2.
    #[serde(default)]
    pub damping: f64,
}

/// Joint servo `tau = kp (q_d - q) + kd (qd_d - qd)`, within the joint's effort.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointServo {
    /// N m/rad or N/m.
    pub kp: f64,
    /// N m s/rad or N s/m.
    pub kd: f64,
}
