//! Momentum of the bodies and impulse of the water of a scene at a state.

use nalgebra::Vector6;

use super::closed_form::ClosedForm;
use super::dense::{angular, linear};

/// Momentum `[linear; angular]` in world axes about the world origin, N s and N m s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Momentum {
    /// Momentum of the rigid bodies, by absolute twists.
    pub rigid: Vector6<f64>,
    /// Impulse of the water, by twists relative to it.
    pub added: Vector6<f64>,
    /// Sum over bodies of the magnitudes of their linear and angular `rigid`: the scale for drifts.
    pub rigid_scale: [f64; 2],
    /// Sum over bodies of the magnitudes of their linear and angular `rigid + added`.
    pub total_scale: [f64; 2],
}

impl Momentum {
    /// `rigid + added`, N s and N m s.
    pub fn total(&self) -> Vector6<f64> {
        self.rigid + self.added
    }
}

impl ClosedForm<'_> {
    /// Momentum of the bodies and impulse of the water.
    pub fn momentum(&self) -> Momentum {
        let mut momentum =
            Momentum { rigid: Vector6::zeros(), added: Vector6::zeros(), rigid_scale: [0.0; 2], total_scale: [0.0; 2] };
        for (k, motion) in self.equations.bodies.iter().enumerate() {
            let pose = self.world_pose(k);
            let rigid = pose.wrench_to_parent(&(motion.body.rigid * motion.twist));
            let added = pose.wrench_to_parent(&(motion.body.added * self.relative_twist(k)));
            momentum.rigid += rigid;
            momentum.added += added;
            add_magnitudes(&mut momentum.rigid_scale, &rigid);
            add_magnitudes(&mut momentum.total_scale, &(rigid + added));
        }
        momentum
    }
}

fn add_magnitudes(scale: &mut [f64; 2], momentum: &Vector6<f64>) {
    scale[0] += linear(momentum).norm();
    scale[1] += angular(momentum).norm();
}
