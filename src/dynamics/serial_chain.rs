//! Vehicle and arm as a serial chain of dense f64 bodies in still water: the model of the tracking controller, without
//! allocation.
//!
//! [`SerialChain::at`] evaluates M by composite bodies (`crba`), the bias by Newton and Euler (`rnea`) and the Jacobian of
//! the end effector. The closed form, which composes the same terms for any system, checks them.
//!
//! The chain is built from the scene in the scene's frames. Controllers' shipped results reproduce bit for bit, which the
//! frames of the compiled `System` would not give.

use nalgebra::{Matrix6, SMatrix, SVector, Vector3, Vector6};

use super::dense::{DenseBody, EndStop, Pose, angular, blocks, cross, friction, joint_axis, linear, stack};
use crate::description::{Joint, JointKind, Scene, Vehicle};
use crate::error::DynamicsError;
use crate::system::{JOINTS, Joints};

/// Maximum number of velocities `[V; q']`.
pub const VELOCITIES: usize = 6 + JOINTS;
/// Velocities `[V; q']` or generalized forces `[F; tau]`; entries past the scene's are 0.
pub type Velocities = SVector<f64, VELOCITIES>;
/// Mass matrix M; identity past the scene's velocities.
pub type MassMatrix = SMatrix<f64, VELOCITIES, VELOCITIES>;

/// Vehicle and the serial chain of moving bodies that it carries.
#[derive(Debug, Clone)]
pub struct SerialChain {
    /// Vehicle first, then one per joint.
    pub(super) bodies: Vec<ChainBody>,
    pub(super) joints: Vec<ChainJoint>,
    /// End effector in the last moving body.
    end_effector: Pose,
    pub(super) vehicle: Vehicle,
    pub(super) density: f64,
    pub(super) deflections: Vec<f64>,
    /// Magnitude, m/s2.
    pub(super) gravity: f64,
}

/// Sum of the scene's bodies that move as one.
#[derive(Debug, Clone, Default)]
pub(super) struct ChainBody {
    /// Rigid and added inertia.
    pub inertia: Matrix6<f64>,
    /// Mass less displaced mass, kg.
    pub weight: f64,
    /// First moment of that mass, kg m.
    pub moment: Vector3<f64>,
    pub dampings: Vec<ChainDamping>,
}

/// Damping coefficients, in their frame at `pose` in the moving body.
#[derive(Debug, Clone)]
pub(super) struct ChainDamping {
    pub pose: Pose,
    pub linear: Matrix6<f64>,
    pub quadratic: Matrix6<f64>,
}

impl ChainBody {
    fn add(&mut self, pose: Pose, body: &DenseBody) {
        self.inertia += inertia_to_parent(&pose, &body.inertia());
        // Restoring wrenches are linear in gravity: unit gravity along x and y gives net mass and first moment.
        let [x, y] = [Vector3::x(), Vector3::y()].map(|axis| body.restoring(&axis));
        self.weight += x[0];
        self.moment += pose.rotation * Vector3::new(y[5], -x[5], x[4]) + pose.position * x[0];
        let (linear, quadratic) = (body.linear_damping, body.quadratic_damping);
        if linear != Matrix6::zeros() || quadratic != Matrix6::zeros() {
            self.dampings.push(ChainDamping { pose: pose * body.hydrodynamic, linear, quadratic });
        }
    }
}

/// Joint of the chain.
#[derive(Debug, Clone)]
pub(super) struct ChainJoint {
    /// Joint frame at q = 0 in the moving body that carries it.
    frame: Pose,
    /// Joint matrix E.
    pub axis: Vector6<f64>,
    joint: Joint,
}

impl ChainJoint {
    /// Child body in the body that carries the joint.
    fn pose(&self, q: f64) -> Pose {
        let motion = match self.joint.kind {
            JointKind::Revolute => Pose::turn(&self.joint.axis, q),
            JointKind::Prismatic => Pose::shift(self.joint.axis * q),
        };
        self.frame * motion
    }

    /// Inertia of the rotor reflected to the joint, kg m2 or kg.
    pub(super) fn rotor_inertia(&self) -> f64 {
        self.joint.rotor_inertia
    }
}

/// `M [V'; q''] + bias = [F; tau]` at a configuration and velocity.
#[derive(Debug, Clone, PartialEq)]
pub struct EquationsOfMotion {
    /// M, added mass included; identity past the scene's velocities.
    pub mass: MassMatrix,
    /// `C [V; q']` less damping, weight, buoyancy, fins and tether; passive joint torques are not included.
    pub bias: Velocities,
    /// End-effector body twist per `[V; q']`.
    pub jacobian: SMatrix<f64, 6, VELOCITIES>,
}

/// Passive torque of a joint: friction and end stops.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PassiveTorque {
    /// Torque, N m or N.
    pub torque: f64,
    /// Secant of the torque's decrease with the rate, N m s/rad or N s/m; never negative.
    pub damping: f64,
    /// Decrease of the torque with the coordinate, N m/rad or N/m.
    pub stiffness: f64,
}

impl SerialChain {
    /// Builds the chain of a checked scene.
    ///
    /// # Errors
    /// [`DynamicsError::Joints`] for more joints than a state holds.
    pub fn new(scene: &Scene) -> Result<Self, DynamicsError> {
        let body = |body| DenseBody::new(body, &scene.water);
        let mut bodies = vec![ChainBody::default()];
        bodies[0].add(Pose::identity(), &body(&scene.vehicle.body));
        let mut joints = Vec::new();
        // Frame of the next body or joint in the last moving body.
        let mut at = Pose::identity();
        if let Some(arm) = &scene.arm {
            at = Pose::from_frame(&arm.mount.frame);
            let mut add_joint = |at: &mut Pose, joint: &Joint, bodies: &mut Vec<ChainBody>| {
                let frame = *at * Pose::from_frame(&joint.frame);
                joints.push(ChainJoint { frame, axis: joint_axis(joint), joint: joint.clone() });
                bodies.push(ChainBody::default());
                *at = Pose::identity();
            };
            if let Some(joint) = &arm.mount.joint {
                add_joint(&mut at, joint, &mut bodies);
            }
            if let (Some(base), Some(last)) = (&arm.base, bodies.last_mut()) {
                last.add(at, &body(base));
            }
            for link in &arm.links {
                add_joint(&mut at, &link.joint, &mut bodies);
                if let Some(last) = bodies.last_mut() {
                    last.add(at, &body(&link.body));
                }
            }
            at = at * Pose::from_frame(&arm.end_effector);
        }
        if let (Some(payload), Some(last)) = (&scene.payload, bodies.last_mut()) {
            last.add(at * Pose::from_frame(&payload.frame), &body(&payload.body));
        }
        if joints.len() > JOINTS {
            return Err(DynamicsError::Joints { joints: joints.len(), max: JOINTS });
        }
        let (vehicle, density) = (scene.vehicle.clone(), scene.water.density);
        let deflections = vehicle.deflections();
        let gravity = scene.water.gravity.norm();
        Ok(Self { bodies, joints, end_effector: at, vehicle, density, deflections, gravity })
    }

    /// Number of joints n.
    pub fn joints(&self) -> usize {
        self.joints.len()
    }

    /// Equations of motion at joint coordinates `q` and velocities `[V; q']`; `up` is the unit vector against gravity in
    /// vehicle axes.
    pub fn at(&self, up: &Vector3<f64>, q: &Joints, velocities: &Velocities) -> EquationsOfMotion {
        let mut poses = [Pose::identity(); JOINTS];
        for (i, joint) in self.joints.iter().enumerate() {
            poses[i] = joint.pose(q[i]);
        }
        EquationsOfMotion {
            mass: self.mass_matrix(&poses),
            bias: self.bias(&poses, up, velocities),
            jacobian: self.jacobian(&poses),
        }
    }

    /// End-effector body twist per `[V; q']`, from the child poses of the joints. `[MLS94]`
    fn jacobian(&self, poses: &[Pose; JOINTS]) -> SMatrix<f64, 6, VELOCITIES> {
        let mut jacobian = SMatrix::<f64, 6, VELOCITIES>::zeros();
        let mut to_tip = self.end_effector;
        for i in (0..self.joints()).rev() {
            jacobian.set_column(6 + i, &twist_to_child(&to_tip, &self.joints[i].axis));
            to_tip = poses[i] * to_tip;
        }
        jacobian.fixed_view_mut::<6, 6>(0, 0).copy_from(&to_tip.adjoint_inverse());
        jacobian
    }

    /// Friction and end stop of joint `i` at coordinate `q` and rate `qd`.
    pub fn passive(&self, i: usize, q: f64, qd: f64) -> PassiveTorque {
        let joint = &self.joints[i].joint;
        let stop = EndStop::new(joint, q, qd);
        let (mut damping, mut stiffness) = (joint.friction.viscous, 0.0);
        if joint.friction.coulomb > 0.0 {
            damping += joint.friction.coulomb / qd.hypot(joint.friction.coulomb_speed);
        }
        if let Some(limits) = joint.limits.as_ref().filter(|limits| !(limits.lower..=limits.upper).contains(&q)) {
            let excess = (q - limits.upper).max(limits.lower - q);
            damping += limits.damping * excess;
            stiffness = limits.stiffness;
        }
        PassiveTorque { torque: friction(joint, qd) + (stop.elastic + stop.damping), damping, stiffness }
    }
}

/// Twist at the child frame from that of the parent: `Ad^-1 V`.
#[inline]
pub(super) fn twist_to_child(pose: &Pose, twist: &Vector6<f64>) -> Vector6<f64> {
    let (v, omega) = (linear(twist), angular(twist));
    stack(&pose.rotation.tr_mul(&(v + omega.cross(&pose.position))), &pose.rotation.tr_mul(&omega))
}

/// Inertia in the parent frame, `Ad^-T A Ad^-1`, block by block.
pub(super) fn inertia_to_parent(pose: &Pose, inertia: &Matrix6<f64>) -> Matrix6<f64> {
    let (r, p) = (&pose.rotation, cross(&pose.position));
    let turned = |i, k| r * inertia.fixed_view::<3, 3>(i, k) * r.transpose();
    let (a, b, c, d) = (turned(0, 0), turned(0, 3), turned(3, 0), turned(3, 3));
    let (right, below) = (b - a * p, c + p * a);
    blocks(a, right, below, d + p * right - c * p)
}

/// Wrench at the parent frame, `Ad^-T F`, without the 6x6 matrix.
#[inline]
pub(super) fn wrench_to_parent(pose: &Pose, wrench: &Vector6<f64>) -> Vector6<f64> {
    let force = pose.rotation * linear(wrench);
    stack(&force, &(pose.rotation * angular(wrench) + pose.position.cross(&force)))
}
