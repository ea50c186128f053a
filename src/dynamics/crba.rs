//! Composite-rigid-body algorithm: the mass matrix of a serial chain. `[RF08 ch. 6]`

use super::dense::Pose;
use super::serial_chain::{MassMatrix, SerialChain, inertia_to_parent, wrench_to_parent};
use crate::system::JOINTS;

impl SerialChain {
    /// M, (6+n, 6+n) and identity past it, from the child poses of the joints.
    pub(super) fn mass_matrix(&self, poses: &[Pose; JOINTS]) -> MassMatrix {
        let n = self.joints();
        let mut mass = MassMatrix::identity();
        let mut composite = self.bodies[n].inertia;
        for i in (0..n).rev() {
            let axis = &self.joints[i].axis;
            let mut force = composite * axis;
            mass[(6 + i, 6 + i)] = axis.dot(&force) + self.joints[i].rotor_inertia();
            for j in (0..i).rev() {
                force = wrench_to_parent(&poses[j + 1], &force);
                let entry = self.joints[j].axis.dot(&force);
                (mass[(6 + i, 6 + j)], mass[(6 + j, 6 + i)]) = (entry, entry);
            }
            force = wrench_to_parent(&poses[0], &force);
            mass.fixed_view_mut::<6, 1>(0, 6 + i).copy_from(&force);
            mass.fixed_view_mut::<1, 6>(6 + i, 0).copy_from(&force.transpose());
            composite = self.bodies[i].inertia + inertia_to_parent(&poses[i], &composite);
        }
        mass.fixed_view_mut::<6, 6>(0, 0).copy_from(&composite);
        mass
    }
}
