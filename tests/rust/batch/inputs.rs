//! Random inputs of many instances.

use uvms_gym::batch::Inputs;
use uvms_gym::description::Scene;

use crate::random_scene::{Random, random_state};

/// Sizes of random inputs: of thrusts, over their limits; of deflections, wrenches, torques and external wrenches; and the
/// coefficients of a servo target.
#[derive(Clone, Copy)]
pub struct Sizes {
    pub thrust: f64,
    pub fin: f64,
    pub wrench: f64,
    pub torque: f64,
    pub external: f64,
    pub terms: usize,
}

/// Inputs beyond the limits of thrusters and fins, and inputs within them.
pub const STRONG: Sizes = Sizes { thrust: 1.5, fin: 0.7, wrench: 5.0, torque: 1.0, external: 2.0, terms: 4 };
pub const GENTLE: Sizes = Sizes { thrust: 0.9, fin: 0.3, wrench: 5.0, torque: 0.1, external: 0.1, terms: 3 };

/// Every input of instances: thrusts, deflections, wrenches, torques, joint targets, external wrenches, pose targets.
#[derive(Default)]
pub struct RandomInputs([Vec<f64>; 7]);

impl RandomInputs {
    /// Inputs of one instance.
    pub fn new(seed: u64, scene: &Scene, sizes: Sizes) -> Self {
        let mut random = Random::new(seed ^ 0xBA7C);
        let n = scene.coordinates().count();
        let mut numbers = |count: usize, size: f64| (0..count).map(|_| random.between(-size, size)).collect::<Vec<_>>();
        let mut thrust = numbers(scene.vehicle.thrusters.len(), sizes.thrust);
        for (thrust, thruster) in thrust.iter_mut().zip(&scene.vehicle.thrusters) {
            *thrust *= thruster.limits[1].min(-thruster.limits[0]);
        }
        let target = random_state(seed + 100, scene);
        let rotation = target.rotation.transpose();
        Self([
            thrust,
            numbers(scene.vehicle.fins.len(), sizes.fin),
            numbers(6, sizes.wrench),
            numbers(n, sizes.torque),
            numbers(sizes.terms * n, 0.3),
            numbers(6 * (n + 1), sizes.external),
            target.position.iter().chain(&rotation).copied().collect(),
        ])
    }

    /// Inputs of several instances.
    pub fn of_all<'a>(instances: impl IntoIterator<Item = &'a Self>) -> Self {
        let mut all = Self::default();
        for instance in instances {
            all.0.iter_mut().zip(&instance.0).for_each(|(all, own)| all.extend(own));
        }
        all
    }

    /// Inputs of instances `0..count`, each of its own seed.
    pub fn of_count(count: usize, scene: &Scene, sizes: Sizes) -> Self {
        Self::of_all(&(0..count as u64).map(|seed| Self::new(seed, scene, sizes)).collect::<Vec<_>>())
    }

    /// The inputs that a scene takes: targets only where there are servos.
    pub fn inputs<'a>(&'a self, scene: &Scene) -> Inputs<'a> {
        let [thrust, fin, wrench, torque, target, external, pose] = &self.0;
        Inputs {
            thrust: Some(thrust),
            fin: Some(fin),
            wrench: Some(wrench),
            joint_torque: Some(torque),
            joint_target: scene.joints().any(|joint| joint.servo.is_some() || joint.prescribed).then_some(target),
            external: Some(external),
            pose_target: scene.vehicle.servo.is_some().then_some(pose),
        }
    }
}
