//! Trim: equilibrium attitude, righting moment, and thrust that holds a level vehicle.

use nalgebra::{Matrix3, Vector3, Vector6};

use crate::batch::simulator::Simulator;
use crate::system::State;

/// Balance of a free vehicle at rest in still water, joints at home.
#[derive(Debug, Clone, PartialEq)]
pub struct Trim {
    /// Mass of all bodies, kg.
    pub mass: f64,
    /// Weight less buoyancy, N.
    pub net_weight: f64,
    /// Roll and pitch at which weight and buoyancy have no moment about the vehicle's origin, rad; None where they have none at
    /// any attitude.
    pub equilibrium: Option<[f64; 2]>,
    /// Moment about the origin per radian of tilt from the equilibrium, N m/rad.
    pub righting_moment: f64,
    /// Thrusts that hold the level vehicle, N, and each as a share of its limit in that direction.
    pub thrusts: Vec<(f64, f64)>,
    /// Wrench, N and N m, that the thrusters lack in order to hold the level vehicle.
    pub missing: [f64; 6],
    /// Torque or force of each joint's actuator, N m or N, and its share of the effort, 0 for unlimited effort.
    pub joint_torques: Vec<(f64, f64)>,
}

/// Share of a limit; 0 for no force.
fn share(force: f64, limit: f64) -> f64 {
    if force == 0.0 { 0.0 } else { (force / limit).abs() }
}

/// Wrench and torques that hold the system at home, the vehicle at an attitude.
fn hold(simulator: &Simulator, rotation: Matrix3<f64>) -> (Vector6<f64>, Vec<f64>) {
    let state = State { q: simulator.scene().home(), rotation, ..State::default() };
    let held = simulator.closed_form_model.trim(&state, Vector3::zeros()).expect("a composed scene");
    (held.wrench, held.joint_torques.iter().copied().collect())
}

/// Trim of a scene with gravity whose vehicle is free.
pub(super) fn trim(simulator: &Simulator) -> Option<Trim> {
    let scene = simulator.scene();
    let gravity = scene.water.gravity;
    if scene.vehicle.fixed || gravity.norm() == 0.0 {
        return None;
    }
    let down = gravity.normalize();
    // The moment of weight and buoyancy is s x d, with the direction d of gravity in body axes.
    let level = hold(simulator, Matrix3::identity());
    let moment = |rotation: Matrix3<f64>| -hold(simulator, rotation).0.fixed_rows::<3>(3).into_owned();
    // Rotations that put each body axis downward; s is determined by its products with two of them.
    let facing = |axis: Vector3<f64>| nalgebra::Rotation3::rotation_between(&axis, &down).map(|r| r.into_inner());
    let along_x = facing(Vector3::x()).map_or_else(Vector3::zeros, moment);
    let along_y = facing(Vector3::y()).map_or_else(Vector3::zeros, moment);
    // s x e_x = (0, s_z, -s_y), s x e_y = (-s_z, 0, s_x).
    let s = Vector3::new(along_y.z, -along_x.z, along_x.y);
    let righting_moment = s.norm();
    let weight: f64 = scene.masses().0 * gravity.norm();
    let equilibrium = (righting_moment > 1e-9 * weight).then(|| {
        let d = s / righting_moment;
        // d = R^T down for R = Ry(pitch) Rx(roll) and gravity along -z.
        [(-d.y).atan2(-d.z), d.x.clamp(-1.0, 1.0).asin()].map(|angle| angle + 0.0)
    });
    let allocation = simulator.allocation();
    let thrusts = allocation.unsaturated(&level.0);
    // Rounding counts as none.
    let tidy = |x: f64, size: f64| if x.abs() > 1e-6 * size { x } else { 0.0 };
    let held = (0..allocation.count()).map(|i| {
        let ([lower, upper], thrust) = (allocation.limits(i), tidy(thrusts[i], level.0.amax()));
        (thrust, share(thrust, if thrust > 0.0 { upper } else { lower }))
    });
    let missing = level.0 - allocation.wrench(&thrusts);
    let most = level.1.iter().fold(0.0, |most: f64, torque| most.max(torque.abs()));
    let torques = level.1.iter().zip(scene.joints()).map(|(torque, joint)| {
        let torque = tidy(*torque, most);
        (torque, joint.effort.map_or(0.0, |effort| share(torque, effort)))
    });
    Some(Trim {
        mass: scene.masses().0,
        net_weight: -level.0.fixed_rows::<3>(0).dot(&down),
        equilibrium,
        righting_moment,
        thrusts: held.collect(),
        missing: missing.map(|x| tidy(x, level.0.amax())).into(),
        joint_torques: torques.collect(),
    })
}
