//! Recursive Newton-Euler algorithm: the bias of a serial chain in still water. `[RF08 ch. 5]`

use nalgebra::{Vector3, Vector6};

use super::dense::{Pose, ad, angular, linear, stack};
use super::serial_chain::{ChainBody, SerialChain, VELOCITIES, Velocities, twist_to_child, wrench_to_parent};
use crate::system::JOINTS;
use crate::terms::DenseInstant;

impl SerialChain {
    /// `C [V; q']` less damping, weight, buoyancy and the vehicle's terms, from the child poses of the joints: the generalized force
    /// of the motion with `[V'; q''] = 0`.
    pub(super) fn bias(&self, poses: &[Pose; JOINTS], up: &Vector3<f64>, velocities: &Velocities) -> Velocities {
        let n = self.joints();
        let mut forces = [Vector6::zeros(); VELOCITIES];
        let mut twist: Vector6<f64> = velocities.fixed_rows::<6>(0).into_owned();
        let (mut acceleration, mut gravity) = (Vector6::zeros(), up * -self.gravity);
        forces[0] = self.bodies[0].force(&twist, &acceleration, &gravity);
        let at = DenseInstant { density: self.density, gravity, relative: twist, deflections: &self.deflections };
        forces[0] -= self.vehicle.dense_term_wrenches(&at).into_array().iter().sum::<Vector6<f64>>();
        for (i, joint) in self.joints.iter().enumerate() {
            let own = joint.axis * velocities[6 + i];
            twist = twist_to_child(&poses[i], &twist) + own;
            acceleration = twist_to_child(&poses[i], &acceleration) - ad(&own) * twist;
            gravity = poses[i].rotation.tr_mul(&gravity);
            forces[1 + i] = self.bodies[1 + i].force(&twist, &acceleration, &gravity);
        }

        let mut bias = Velocities::zeros();
        for i in (0..n).rev() {
            bias[6 + i] = self.joints[i].axis.dot(&forces[1 + i]);
            let carried = wrench_to_parent(&poses[i], &forces[1 + i]);
            forces[i] += carried;
        }
        bias.fixed_rows_mut::<6>(0).copy_from(&forces[0]);
        bias
    }
}

impl ChainBody {
    /// Wrench that moves the body: `A V' - ad_V^T A V` less weight, buoyancy and damping.
    #[inline]
    fn force(&self, twist: &Vector6<f64>, acceleration: &Vector6<f64>, gravity: &Vector3<f64>) -> Vector6<f64> {
        let momentum = self.inertia * twist;
        let (p, l, v, omega) = (linear(&momentum), angular(&momentum), linear(twist), angular(twist));
        let mut force = self.inertia * acceleration + stack(&omega.cross(&p), &(omega.cross(&l) + v.cross(&p)));
        force -= stack(&(gravity * self.weight), &self.moment.cross(gravity));
        for damping in &self.dampings {
            let there = twist_to_child(&damping.pose, twist);
            let squared = there.component_mul(&there.abs());
            force += wrench_to_parent(&damping.pose, &(damping.linear * there + damping.quadratic * squared));
        }
        force
    }
}
