//! Forward kinematics of the end effector and of the links.

use nalgebra as na;

use super::compile::compile;
use super::model::{Before, JointPlacement, JointScrew, JointTerms};
use super::state::{JOINTS, Joints};
use crate::description::Scene;
use crate::lane::{Lane, Param, Routine, Shared, get_option, numbers, sin_cos};
use crate::lie::{Pose, Vector3};
use crate::spatial::{Screw, constant_screw_z, screw_x, screw_z};

numbers! {
    /// The joints from the vehicle frame to the end effector, in the kernel's joint frames.
    #[derive(Debug, Clone, PartialEq)]
    pub struct EndEffector<P = Shared<f64>> {
        joints: Vec<ChainLink<P>>,
        /// Body that carries it: 0 for the vehicle, i + 1 for the link of joint i.
        body: usize,
        /// Rotation to the frame of the last joint (of the vehicle, if there is none).
        rotation: [[P; 3]; 3],
        /// Position in that frame, m.
        position: [P; 3],
    }
}

numbers! {
    /// Kinematics of a joint: [`JointTerms`] without the body.
    #[derive(Debug, Clone, PartialEq)]
    struct ChainLink<P> {
        /// Index among all joints.
        index: usize,
        placement: JointPlacement<P>,
        offset: P,
        screw: JointScrew<P>,
    }
}

impl EndEffector {
    /// End effector of a checked scene: the vehicle frame if it has no arm.
    pub fn new(scene: &Scene) -> Self {
        let compiled = compile(scene);
        Self::on(&compiled.system.joints, compiled.system.payload_body, &compiled.tip)
    }

    /// Frames of the arm's base and of all links of a checked scene, each with the chain that leads to it; none without arm.
    pub fn links(scene: &Scene) -> Vec<Self> {
        let compiled = compile(scene);
        compiled.frames.iter().map(|(body, frame)| Self::on(&compiled.system.joints, *body, frame)).collect()
    }

    /// Frames of the fixtures of a checked scene; their poses are in the world.
    pub fn fixtures(scene: &Scene) -> Vec<Self> {
        let compiled = compile(scene);
        let joints = &compiled.system.joints;
        let robot = joints.len() - scene.fixtures.len();
        (robot..joints.len()).map(|k| Self::on(joints, k + 1, &compiled.links[k])).collect()
    }

    /// Number of the moving body that carries it: 0 for the vehicle and i + 1 for the link of joint i.
    pub fn body(&self) -> usize {
        self.body
    }

    /// A frame at `tip` in the frame of this body.
    fn on(joints: &[JointTerms<Shared<f64>>], body: usize, tip: &Pose<f64>) -> Self {
        let link = |index: usize| {
            let JointTerms { placement, offset, screw, .. } = joints[index];
            ChainLink { index, placement, offset, screw }
        };
        // The chain ends at the vehicle or, for a fixture, at the world.
        let moving = |body: usize| (1..=joints.len()).contains(&body).then_some(body);
        let carrier = |&body: &usize| moving(joints[body - 1].carrier(body - 1));
        let mut path: Vec<_> = std::iter::successors(moving(body), carrier).map(|body| link(body - 1)).collect();
        path.reverse();
        let (rotation, position) = (tip.rotation.0.map(|row| row.map(Shared)), tip.position.0.map(Shared));
        Self { joints: path, body, rotation, position }
    }

    /// Rotation to the vehicle frame and position in it, m, at joint coordinates `q`. `[MLS94 sec. 3.2]`
    pub fn pose(&self, q: &Joints) -> (na::Matrix3<f64>, na::Vector3<f64>) {
        let Pose { rotation, position } = self.at(q);
        (na::Matrix3::from_fn(|i, k| rotation.0[i][k]), position.0.into())
    }
}

impl<P: Copy> EndEffector<P> {
    /// Number of the body that carries it, 0 for the vehicle and i + 1 for the link of joint i, and its pose in that body.
    #[inline(always)]
    pub fn tip<L: Lane>(&self) -> (usize, Pose<L>)
    where
        P: Param<L>,
    {
        (self.body, Pose::of(&self.rotation, &self.position))
    }

    /// Pose in the vehicle frame at joint coordinates `q`.
    #[inline(always)]
    pub fn at<L: Lane>(&self, q: &[L; JOINTS]) -> Pose<L>
    where
        P: Param<L>,
    {
        let mut pose = Pose::of(&self.rotation, &self.position);
        L::call(&mut ForwardKinematics { end_effector: self, q, pose: &mut pose });
        pose
    }

    /// Composes the pose of [`Self::at`] from the tip, at which `pose` is, towards the vehicle.
    #[inline(always)]
    fn compose<L: Lane>(&self, q: &[L; JOINTS], pose: &mut Pose<L>)
    where
        P: Param<L>,
    {
        // By columns, which transform like the position.
        pose.rotation = pose.rotation.transposed();
        let mut i = self.joints.len();
        while i > 0 {
            i -= 1;
            let joint = &self.joints[i];
            let coordinate = q[joint.index] + joint.offset.get();
            let screw = match joint.screw.theta {
                Some([sin, cos]) => screw_z(sin.get(), cos.get(), Some(coordinate)),
                None => {
                    let (sin, cos) = sin_cos(coordinate);
                    screw_z(sin, cos, get_option(joint.screw.d))
                }
            };
            to_parent(&screw, pose);
            joint.placement.pose_to_parent(pose);
        }
        pose.rotation = pose.rotation.transposed();
    }
}

/// [`EndEffector::compose`], which several kernels share.
struct ForwardKinematics<'a, P, L: Lane> {
    end_effector: &'a EndEffector<P>,
    q: &'a [L; JOINTS],
    pose: &'a mut Pose<L>,
}

impl<P: Param<L>, L: Lane> Routine<L> for ForwardKinematics<'_, P, L> {
    const PORTABLE: bool = true;

    #[inline(always)]
    fn run(&mut self) {
        self.end_effector.compose(self.q, self.pose);
    }
}

impl<P: Copy> JointPlacement<P> {
    /// Transforms a pose, its rotation stored by columns, from the joint's frame at zero to the parent's.
    #[inline(always)]
    pub fn pose_to_parent<L: Lane>(&self, pose: &mut Pose<L>)
    where
        P: Param<L>,
    {
        to_parent(&screw_x(self.twist, self.a), pose);
        match self.before {
            None => {}
            Some(Before::Screw(turn, d)) => to_parent(&constant_screw_z(turn, d), pose),
            Some(Before::Pose(rotation, position)) => {
                let placement = Pose::of(&rotation, &position);
                for k in 0..3 {
                    pose.rotation.0[k] = placement.rotation.apply(Vector3(pose.rotation.0[k])).0;
                }
                pose.position = placement.rotation.apply(pose.position) + placement.position;
            }
        }
    }
}

/// Transforms a pose, its rotation stored by columns, from the child frame to the parent frame.
#[inline(always)]
pub fn to_parent<L: Lane, T: Param<L>, S: Param<L>, const ALONG: usize>(
    screw: &Screw<T, S, ALONG>,
    pose: &mut Pose<L>,
) {
    for k in 0..3 {
        pose.rotation.0[k] = screw.rotate(Vector3(pose.rotation.0[k])).0;
    }
    pose.position = screw.transform_point(pose.position);
}
