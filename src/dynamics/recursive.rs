//! The equations of motion of a scene in still water by recursion along the arm, for control: no memory is allocated.
//!
//! The same numbers as [`super::ClosedForm`], which composes them for any system and checks these: M by composite bodies,
//! the rest by one pass of Newton and Euler there and back. `[RF08]`

use nalgebra::{Matrix6, SMatrix, SVector, Vector3, Vector6};

use super::appendages::Appendages;
use super::body::DenseBody;
use super::dense::{Pose, ad, angular, blocks, cross, linear, stack};
use super::joint::{EndStop, friction, joint_axis};
use crate::description::{Joint, JointKind, Scene};
use crate::error::DynamicsError;
use crate::system::{JOINTS, Joints};

/// Greatest number of velocities `[V; q']`.
pub const VELOCITIES: usize = 6 + JOINTS;
/// One number per velocity; entries past the scene's are 0.
pub type Velocities = SVector<f64, VELOCITIES>;
/// A matrix between velocities and forces.
pub type Masses = SMatrix<f64, VELOCITIES, VELOCITIES>;

/// A scene's vehicle and the chain of moving bodies that it carries.
#[derive(Debug, Clone)]
pub struct Recursion {
    /// Vehicle first, then one per joint.
    bodies: Vec<Moving>,
    joints: Vec<Hinge>,
    /// End effector in the last moving body.
    end_effector: Pose,
    appendages: Appendages,
    deflections: Vec<f64>,
    /// m/s^2.
    gravity: f64,
}

/// Bodies that move as one.
#[derive(Debug, Clone, Default)]
struct Moving {
    inertia: Matrix6<f64>,
    /// Mass that is not buoyed up, kg, and its first moment, kg m.
    weight: f64,
    moment: Vector3<f64>,
    drags: Vec<Drag>,
}

/// Drag in the frame of its coefficients, at its pose.
#[derive(Debug, Clone)]
struct Drag {
    pose: Pose,
    linear: Matrix6<f64>,
    quadratic: Matrix6<f64>,
}

impl Moving {
    fn add(&mut self, pose: Pose, body: &DenseBody) {
        self.inertia += inertia_to_parent(&pose, &body.inertia());
        // Restoring wrenches are linear in gravity: the force is the weight times it, the moment its product with the moment.
        let [x, y] = [Vector3::x(), Vector3::y()].map(|axis| body.restoring(&axis));
        self.weight += x[0];
        self.moment += pose.rotation * Vector3::new(y[5], -x[5], x[4]) + pose.position * x[0];
        let (linear, quadratic) = (body.linear_damping, body.quadratic_damping);
        if linear != Matrix6::zeros() || quadratic != Matrix6::zeros() {
            self.drags.push(Drag { pose: pose * body.hydrodynamic, linear, quadratic });
        }
    }

    /// What it takes to move it so without accelerating it beyond `drift`.
    #[inline]
    fn force(&self, twist: &Vector6<f64>, drift: &Vector6<f64>, gravity: &Vector3<f64>) -> Vector6<f64> {
        let momentum = self.inertia * twist;
        let (p, l, v, omega) = (linear(&momentum), angular(&momentum), linear(twist), angular(twist));
        // -ad_V^T A V.
        let mut force = self.inertia * drift + stack(&omega.cross(&p), &(omega.cross(&l) + v.cross(&p)));
        force -= stack(&(gravity * self.weight), &self.moment.cross(gravity));
        for drag in &self.drags {
            let there = to_child(&drag.pose, twist);
            let squared = there.component_mul(&there.abs());
            force += drag.pose.carry_wrench(&(drag.linear * there + drag.quadratic * squared));
        }
        force
    }
}

#[derive(Debug, Clone)]
struct Hinge {
    /// Joint frame at q = 0 in the moving body that carries it.
    frame: Pose,
    axis: Vector6<f64>,
    joint: Joint,
}

/// `M [V'; q''] + bias = [F; tau]` at a configuration and velocity.
#[derive(Debug, Clone, PartialEq)]
pub struct Terms {
    /// M, added mass included; identity past the scene's velocities.
    pub mass: Masses,
    /// `C [V; q']` less drag, weight, buoyancy, fins and tether, but not less what joints make by themselves.
    pub bias: Velocities,
    /// End-effector body twist per `[V; q']`.
    pub jacobian: SMatrix<f64, 6, VELOCITIES>,
}

/// What a joint makes by itself.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Passive {
    /// Torque of friction and end stops, N m or N.
    pub torque: f64,
    /// By how much it falls with the rate, N m s/rad or N s/m: a secant, never negative.
    pub damping: f64,
    /// By how much it falls with the coordinate, N m/rad or N/m.
    pub stiffness: f64,
}

impl Recursion {
    /// For a checked scene.
    ///
    /// # Errors
    /// [`DynamicsError::Joints`] where the scene has more joints than a state holds.
    pub fn new(scene: &Scene) -> Result<Self, DynamicsError> {
        let body = |body| DenseBody::new(body, &scene.water);
        let mut bodies = vec![Moving::default()];
        bodies[0].add(Pose::identity(), &body(&scene.vehicle.body));
        let mut joints = Vec::new();
        // What is carried next, in the last moving body.
        let mut at = Pose::identity();
        if let Some(arm) = &scene.arm {
            at = Pose::from_frame(&arm.mount.frame);
            let mut hinge = |at: &mut Pose, joint: &Joint, bodies: &mut Vec<Moving>| {
                let frame = *at * Pose::from_frame(&joint.frame);
                joints.push(Hinge { frame, axis: joint_axis(joint), joint: joint.clone() });
                bodies.push(Moving::default());
                *at = Pose::identity();
            };
            if let Some(joint) = &arm.mount.joint {
                hinge(&mut at, joint, &mut bodies);
            }
            if let (Some(base), Some(last)) = (&arm.base, bodies.last_mut()) {
                last.add(at, &body(base));
            }
            for link in &arm.links {
                hinge(&mut at, &link.joint, &mut bodies);
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
        let appendages = Appendages::new(&scene.vehicle, &scene.water);
        let deflections = appendages.deflections();
        let gravity = scene.water.gravity.norm();
        Ok(Self { bodies, joints, end_effector: at, appendages, deflections, gravity })
    }

    /// Number of joints n.
    pub fn joints(&self) -> usize {
        self.joints.len()
    }

    /// The equations where gravity points against `up` (a unit vector, vehicle axes), at joint coordinates `q` and
    /// velocities `[V; q']`.
    pub fn at(&self, up: &Vector3<f64>, q: &Joints, velocities: &Velocities) -> Terms {
        let n = self.joints();
        let mut links = [(Pose::identity(), Vector6::zeros()); JOINTS];
        let mut forces = [Vector6::zeros(); VELOCITIES];
        let mut twist: Vector6<f64> = velocities.fixed_rows::<6>(0).into_owned();
        let (mut drift, mut gravity) = (Vector6::zeros(), up * -self.gravity);
        forces[0] = self.bodies[0].force(&twist, &drift, &gravity);
        if !self.deflections.is_empty() {
            forces[0] -= self.appendages.fin_wrench(&self.deflections, &twist);
        }
        forces[0] -= self.appendages.tether_wrench(&twist, &gravity);
        for (i, hinge) in self.joints.iter().enumerate() {
            let pose = hinge.frame * hinge.motion(q[i]);
            let own = hinge.axis * velocities[6 + i];
            twist = to_child(&pose, &twist) + own;
            drift = to_child(&pose, &drift) - ad(&own) * twist;
            gravity = pose.rotation.tr_mul(&gravity);
            forces[1 + i] = self.bodies[1 + i].force(&twist, &drift, &gravity);
            links[i] = (pose, hinge.axis);
        }

        let (mut mass, mut bias) = (Masses::identity(), Velocities::zeros());
        let mut jacobian = SMatrix::<f64, 6, VELOCITIES>::zeros();
        let mut composite = self.bodies[n].inertia;
        let mut to_tip = self.end_effector;
        for i in (0..n).rev() {
            let (pose, axis) = &links[i];
            jacobian.set_column(6 + i, &to_child(&to_tip, axis));
            to_tip = *pose * to_tip;
            let mut force = composite * axis;
            mass[(6 + i, 6 + i)] = axis.dot(&force);
            for j in (0..i).rev() {
                force = links[j + 1].0.carry_wrench(&force);
                let entry = links[j].1.dot(&force);
                (mass[(6 + i, 6 + j)], mass[(6 + j, 6 + i)]) = (entry, entry);
            }
            force = links[0].0.carry_wrench(&force);
            mass.fixed_view_mut::<6, 1>(0, 6 + i).copy_from(&force);
            mass.fixed_view_mut::<1, 6>(6 + i, 0).copy_from(&force.transpose());
            composite = self.bodies[i].inertia + inertia_to_parent(pose, &composite);
            bias[6 + i] = axis.dot(&forces[1 + i]);
            let carried = pose.carry_wrench(&forces[1 + i]);
            forces[i] += carried;
        }
        mass.fixed_view_mut::<6, 6>(0, 0).copy_from(&composite);
        bias.fixed_rows_mut::<6>(0).copy_from(&forces[0]);
        jacobian.fixed_view_mut::<6, 6>(0, 0).copy_from(&to_tip.adjoint_inverse());
        Terms { mass, bias, jacobian }
    }

    /// What joint `i` makes by itself at a coordinate and a rate.
    pub fn passive(&self, i: usize, q: f64, qd: f64) -> Passive {
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
        Passive { torque: friction(joint, qd) + (stop.elastic + stop.damping), damping, stiffness }
    }
}

impl Hinge {
    fn motion(&self, q: f64) -> Pose {
        match self.joint.kind {
            JointKind::Revolute => Pose::turn(&self.joint.axis, q),
            JointKind::Prismatic => Pose::shift(self.joint.axis * q),
        }
    }
}

/// A twist of the parent at the child.
#[inline]
fn to_child(pose: &Pose, twist: &Vector6<f64>) -> Vector6<f64> {
    let (v, omega) = (linear(twist), angular(twist));
    stack(&pose.rotation.tr_mul(&(v + omega.cross(&pose.position))), &pose.rotation.tr_mul(&omega))
}

/// `Ad^-T A Ad^-1`, block by block.
fn inertia_to_parent(pose: &Pose, inertia: &Matrix6<f64>) -> Matrix6<f64> {
    let (r, p) = (&pose.rotation, cross(&pose.position));
    let turned = |i, k| r * inertia.fixed_view::<3, 3>(i, k) * r.transpose();
    let (a, b, c, d) = (turned(0, 0), turned(0, 3), turned(3, 0), turned(3, 3));
    let (right, below) = (b - a * p, c + p * a);
    blocks(a, right, below, d + p * right - c * p)
}

impl Pose {
    /// [`Self::wrench_to_parent`] without the matrix.
    #[inline]
    fn carry_wrench(&self, wrench: &Vector6<f64>) -> Vector6<f64> {
        let force = self.rotation * linear(wrench);
        stack(&force, &(self.rotation * angular(wrench) + self.position.cross(&force)))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, Rotation3};

    use super::*;
    use crate::dynamics::{Balance, Loads};
    use crate::system::State;

    #[test]
    fn recursion_is_the_closed_form() {
        let mut seed = 7u64;
        let mut draw = move || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        };
        for name in Scene::shipped_names() {
            let scene = Scene::shipped(name).unwrap();
            let (balance, recursion) = (Balance::new(&scene).unwrap(), Recursion::new(&scene).unwrap());
            let n = recursion.joints();
            for _ in 0..20 {
                let rotation = Rotation3::from_euler_angles(draw(), draw(), 3.0 * draw());
                let mut state = State { rotation: rotation.into_inner(), ..State::default() };
                state.twist = Vector6::from_fn(|_, _| draw());
                for k in 0..n {
                    (state.q[k], state.qd[k]) = (2.0 * draw(), draw());
                }
                let form = balance.at(&state, Vector3::zeros());
                let velocities = Velocities::from_fn(|k, _| match k {
                    0..6 => state.twist[k],
                    _ => state.qd[k - 6],
                });
                let up = state.rotation.row(2).transpose();
                let terms = recursion.at(&up, &state.q, &velocities);
                let size = form.mass_matrix().norm();
                let mass = DMatrix::from_fn(6 + n, 6 + n, |i, k| terms.mass[(i, k)]);
                assert!((mass - form.mass_matrix()).norm() < 1e-13 * size, "{name}");
                assert!((terms.mass - terms.mass.transpose()).norm() < 1e-14 * size, "{name}");
                let jacobian = terms.jacobian.columns(0, 6 + n) - form.jacobian();
                assert!(jacobian.norm() < 1e-13 * form.jacobian().norm(), "{name}");
                let rest = form.bias() - form.generalized_force(&Loads::default()).unwrap();
                let own = form.joint_torques(&Loads::default()).unwrap().sum;
                for k in 0..6 + n {
                    let passive =
                        if k < 6 { 0.0 } else { recursion.passive(k - 6, state.q[k - 6], state.qd[k - 6]).torque };
                    assert!((terms.bias[k] - passive - rest[k]).abs() < 1e-12 * rest.norm(), "{name} {k}");
                    assert!(k < 6 || (passive - own[k - 6]).abs() < 1e-12 * own.norm().max(1.0), "{name} {k}");
                }
            }
        }
    }

    #[test]
    fn what_joints_make_by_themselves_falls_by_its_secants() {
        let scene = Scene::shipped("petasus-pum").unwrap();
        let recursion = Recursion::new(&scene).unwrap();
        for i in 0..5 {
            for (q, qd) in [(0.1, 0.3), (3.5, -0.2), (-3.4, 0.0)] {
                let passive = recursion.passive(i, q, qd);
                let elastic = recursion.passive(i, q, 0.0).torque;
                assert!((passive.torque - elastic + passive.damping * qd).abs() < 1e-12 * (1.0 + elastic.abs()));
                let stretched = recursion.passive(i, q + 0.01 * q.signum(), 0.0).torque;
                assert!(
                    (stretched - elastic + passive.stiffness * 0.01 * q.signum()).abs() < 1e-12 * (1.0 + elastic.abs())
                );
            }
        }
    }
}
