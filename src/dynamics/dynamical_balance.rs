//! Principle of dynamical balance: equations of motion of systems composed of systems. `[P05]`
//!
//! A system with base twist V and joints q obeys `W F + L tau = M [V'; q''] + b`, where `b` is the product
//! `C [V; q']` `[HC eq. 13]`. A parent p and a child c of this form are joined at body k of the parent by the
//! velocity constraint `[HC eq. 29]`
//!
//! ```text
//! V_c = Ad^-1 V_k + E q0'      V_c' = Ad^-1 V_k' + E q0'' - ad_(E q0') V_c
//! ```
//!
//! without E and q0 under fixed loading (eq. 32); the last term is due to the moving joint frame. Because `V_k = W_k^T nu_p`,
//! the velocities of both parts are linear in nu of the composite, `nu_p = J_p nu` and `nu_c = J_c nu`. Their d'Alembertian
//! wrenches `F* = W F + L tau - M nu' - b` balance in the dual of the constraint `[HC eqs. 30, 33]`,
//!
//! ```text
//! F_p* = -W_k Ad^-T F_c*    tau_0 = -E^T F_c* + J_0 q0''    tau_c* = 0,    hence
//! J_p^T F_p* + J_c^T F_c* + [0; tau_0 - J_0 q0''; 0] = 0,
//! ```
//!
//! with the inertia J_0 of the joint's rotor, reflected by its gear. This has the same form, with
//! `M = J_p^T M_p J_p + J_c^T M_c J_c + e_0 J_0 e_0^T`, `b = J_p^T b_p + J_c^T (b_c + M_c J_c' nu)`,
//! `W = [J_p^T W_p, J_c^T W_c]` and `L = [J_p^T L_p, e_0, J_c^T L_c]`. Composites can therefore be composed in any order.

use nalgebra::{DMatrix, DVector, Matrix6xX, Vector3, Vector6};

use super::dense::{DenseBody, DensePose, ad, joint_axis, joint_pose};
use crate::description::Joint;

/// A rigid body, or a parent loaded with a child. Bodies and joints are numbered parent first.
#[derive(Debug, Clone)]
pub struct Composite {
    node: Node,
    bodies: usize,
    joints: usize,
}

#[derive(Debug, Clone)]
enum Node {
    Body(Box<DenseBody>),
    Loading { parent: Box<Composite>, at: usize, mount: DensePose, joint: Option<Box<Joint>>, child: Box<Composite> },
}

impl Composite {
    /// One rigid body. `[HC eqs. 4, 20, 26]`
    pub fn rigid_body(body: DenseBody) -> Self {
        Self { node: Node::Body(Box::new(body)), bodies: 1, joints: 0 }
    }

    /// Fixed loading: `child` fixed to body `at` of this system, its base frame at `mount` in that body's frame.
    /// `[HC eqs. 32-34]`
    ///
    /// # Panics
    /// If this system has no body `at`.
    pub fn fixed_loading(self, at: usize, mount: DensePose, child: Self) -> Self {
        self.load(at, mount, None, child)
    }

    /// Joint loading: `child` on body `at` of this system through a joint q0, whose frame is relative to `mount` in that
    /// body's frame. `[HC eqs. 29-31]`
    ///
    /// # Panics
    /// If this system has no body `at`.
    pub fn joint_loading(self, at: usize, mount: DensePose, joint: Joint, child: Self) -> Self {
        self.load(at, mount, Some(Box::new(joint)), child)
    }

    fn load(self, at: usize, mount: DensePose, joint: Option<Box<Joint>>, child: Self) -> Self {
        assert!(at < self.bodies, "body {at} of {}", self.bodies);
        Self {
            bodies: self.bodies + child.bodies,
            joints: self.joints + usize::from(joint.is_some()) + child.joints,
            node: Node::Loading { parent: Box::new(self), at, mount, joint, child: Box::new(child) },
        }
    }

    /// Number of bodies; each has six columns of W.
    pub fn bodies(&self) -> usize {
        self.bodies
    }

    /// Number of joints n.
    pub fn joints(&self) -> usize {
        self.joints
    }

    /// Equations of motion at base twist `twist` (6, base frame), joint coordinates and rates `q`, `qd` (n each), in water
    /// moving at `water` (base axes, m/s).
    ///
    /// # Panics
    /// If `q` or `qd` do not have n entries.
    pub fn at(&self, twist: &Vector6<f64>, q: &[f64], qd: &[f64], water: &Vector3<f64>) -> Equations<'_> {
        assert!(q.len() == self.joints && qd.len() == self.joints, "{} joints", self.joints);
        match &self.node {
            Node::Body(body) => Equations::of_body(body, twist, water),
            Node::Loading { parent, at, mount, joint, child } => {
                let own = usize::from(joint.is_some());
                let (q_p, q) = q.split_at(parent.joints);
                let (qd_p, qd) = qd.split_at(parent.joints);
                let parent = parent.at(twist, q_p, qd_p, water);
                let loading = match joint {
                    None => Loading { at: *at, pose: *mount, joint: None },
                    Some(joint) => Loading {
                        at: *at,
                        pose: *mount * joint_pose(joint, q[0]),
                        joint: Some((joint, joint_axis(joint), qd[0])),
                    },
                };
                let carrier = &parent.bodies[*at];
                let twist = loading.pose.adjoint_inverse() * carrier.twist + loading.joint_twist();
                let water = (carrier.pose * loading.pose).rotation.tr_mul(water);
                let child = child.at(&twist, &q[own..], &qd[own..], &water);
                parent.load(&loading, child)
            }
        }
    }
}

/// A loading at one configuration and velocity.
struct Loading<'a> {
    at: usize,
    /// Child base in body `at`.
    pose: DensePose,
    /// The joint, its matrix E and its rate.
    joint: Option<(&'a Joint, Vector6<f64>, f64)>,
}

impl Loading<'_> {
    fn joint_twist(&self) -> Vector6<f64> {
        self.joint.map_or_else(Vector6::zeros, |(_, axis, rate)| axis * rate)
    }
}

/// A body of a composite, at one configuration and velocity.
#[derive(Debug, Clone)]
pub struct BodyMotion<'a> {
    /// Its constants.
    pub body: &'a DenseBody,
    /// Its frame in the system's base frame.
    pub pose: DensePose,
    /// Its absolute body twist V_k.
    pub twist: Vector6<f64>,
    /// `W_k'^T nu`, the velocity product in its acceleration `W_k^T nu' + W_k'^T nu`.
    pub drift: Vector6<f64>,
    /// The moving body it belongs to: itself, or the body it is fixed to.
    pub carrier: usize,
    /// Its frame in the frame of the moving body.
    pub in_carrier: DensePose,
}

/// Equations of motion `W F + L tau = M [V'; q''] + bias` of a free-base system of k bodies and n joints at one
/// configuration and velocity. `[HC eqs. 13, 28]`
#[derive(Debug, Clone)]
pub struct Equations<'a> {
    /// M, (6+n, 6+n).
    pub mass_matrix: DMatrix<f64>,
    /// The product `C [V; q']`, (6+n).
    pub bias: DVector<f64>,
    /// W, (6+n, 6k); its transpose maps `[V; q']` to the bodies' twists.
    pub wrench_influence: DMatrix<f64>,
    /// L, (6+n, n).
    pub torque_influence: DMatrix<f64>,
    /// Motion of each body, vehicle first.
    pub bodies: Vec<BodyMotion<'a>>,
    /// Joints in the order of q.
    pub joints: Vec<&'a Joint>,
}

impl<'a> Equations<'a> {
    fn of_body(body: &'a DenseBody, twist: &Vector6<f64>, water: &Vector3<f64>) -> Self {
        let motion = BodyMotion {
            body,
            pose: DensePose::identity(),
            twist: *twist,
            drift: Vector6::zeros(),
            carrier: 0,
            in_carrier: DensePose::identity(),
        };
        Self {
            mass_matrix: DMatrix::from_column_slice(6, 6, body.inertia().as_slice()),
            bias: DVector::from_column_slice(body.bias(twist, water).as_slice()),
            wrench_influence: DMatrix::identity(6, 6),
            torque_influence: DMatrix::zeros(6, 0),
            bodies: vec![motion],
            joints: Vec::new(),
        }
    }

    /// `W_k^T`, (6, 6+n): the twist of body `k` per `[V; q']`.
    pub fn body_jacobian(&self, k: usize) -> Matrix6xX<f64> {
        self.wrench_influence.fixed_columns::<6>(6 * k).transpose()
    }

    /// Composition by the principle of dynamical balance, as in the module's documentation.
    fn load(self, loading: &Loading<'a>, child: Self) -> Self {
        let (parent, at) = (self, loading.at);
        let (size_p, size_c) = (parent.bias.len(), child.bias.len());
        let (n_p, n_c, own) = (parent.joints.len(), child.joints.len(), usize::from(loading.joint.is_some()));
        let size = size_p + own + n_c;

        let to_child = loading.pose.adjoint_inverse();
        let mut jacobian_p = DMatrix::zeros(size_p, size);
        jacobian_p.view_mut((0, 0), (size_p, size_p)).fill_with_identity();
        let mut jacobian_c = DMatrix::zeros(size_c, size);
        jacobian_c.view_mut((0, 0), (6, size_p)).copy_from(&(to_child * parent.body_jacobian(at)));
        if let Some((_, axis, _)) = &loading.joint {
            jacobian_c.view_mut((0, size_p), (6, 1)).copy_from(axis);
        }
        jacobian_c.view_mut((6, size_p + own), (n_c, n_c)).fill_with_identity();

        // J_c' nu; its joint rows are 0.
        let carrier = &parent.bodies[at];
        let drift = to_child * carrier.drift - ad(&loading.joint_twist()) * child.bodies[0].twist;
        let mut drift_c = DVector::zeros(size_c);
        drift_c.rows_mut(0, 6).copy_from(&drift);

        let mut mass_matrix =
            jacobian_p.tr_mul(&parent.mass_matrix) * &jacobian_p + jacobian_c.tr_mul(&child.mass_matrix) * &jacobian_c;
        if let Some((joint, ..)) = &loading.joint {
            mass_matrix[(size_p, size_p)] += joint.rotor_inertia;
        }
        let bias = jacobian_p.tr_mul(&parent.bias) + jacobian_c.tr_mul(&(&child.bias + &child.mass_matrix * &drift_c));
        let columns = parent.wrench_influence.ncols();
        let mut wrench_influence = DMatrix::zeros(size, columns + child.wrench_influence.ncols());
        wrench_influence.columns_mut(0, columns).copy_from(&jacobian_p.tr_mul(&parent.wrench_influence));
        wrench_influence.columns_range_mut(columns..).copy_from(&jacobian_c.tr_mul(&child.wrench_influence));
        let mut torque_influence = DMatrix::zeros(size, n_p + own + n_c);
        torque_influence.columns_mut(0, n_p).copy_from(&jacobian_p.tr_mul(&parent.torque_influence));
        torque_influence.view_mut((size_p, n_p), (own, own)).fill_with_identity();
        torque_influence.columns_mut(n_p + own, n_c).copy_from(&jacobian_c.tr_mul(&child.torque_influence));

        let base = carrier.pose * loading.pose;
        let first = parent.bodies.len();
        let (carrier, in_carrier) = (carrier.carrier, carrier.in_carrier * loading.pose);
        let drifts: Vec<_> = (0..child.bodies.len()).map(|k| child.body_jacobian(k) * &drift_c).collect();
        let mut bodies = parent.bodies;
        bodies.extend(child.bodies.into_iter().zip(drifts).map(|(body, drift)| {
            // Bodies fixed to the child's base now belong to the moving body of the parent.
            let fixed = own == 0 && body.carrier == 0;
            BodyMotion {
                pose: base * body.pose,
                drift: body.drift + drift,
                carrier: if fixed { carrier } else { first + body.carrier },
                in_carrier: if fixed { in_carrier * body.in_carrier } else { body.in_carrier },
                ..body
            }
        }));
        let mut joints = parent.joints;
        joints.extend(loading.joint.map(|(joint, ..)| joint));
        joints.extend(child.joints);
        Self { mass_matrix, bias, wrench_influence, torque_influence, bodies, joints }
    }
}
