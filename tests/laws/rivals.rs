//! What the rivals are known for.

use nalgebra::{Rotation3, Vector3, Vector6};
use uvms_gym::description::Scene;
use uvms_gym::system::{State, rotation_vector};

use crate::drift;

/// A body that pitches through 90 degrees with a little roll and yaw, and the angle by which RK4 on its Euler angles is
/// off from mk4 then.
fn off(pitch: f64) -> f64 {
    let mut scene = Scene::shipped("free-body").unwrap();
    scene.vehicle.body.inertia = nalgebra::Matrix3::from_diagonal(&Vector3::new(1.0, 1.2, 1.1));
    let rotation = Rotation3::from_euler_angles(0.0, pitch, 0.0).into_inner();
    let state = State { rotation, twist: Vector6::new(0.0, 0.0, 0.0, 0.02, 1.0, -0.03), ..State::default() };
    let [angles, exact] = ["euler-angles-rk4", "mk4"].map(|name| drift(&scene, name, 0.05, &state, 20).rotation);
    rotation_vector(&(exact.transpose() * angles)).norm()
}

#[test]
fn euler_angles_fail_near_a_pitch_of_90_degrees() {
    let (far, through) = (off(-0.7), off(0.9));
    println!("RK4 on Euler angles: off by {far:.1e} rad away from a pitch of 90 degrees, {through:.1e} rad through it");
    assert!(far < 1e-6, "{far}");
    assert!(through > 1e-3, "{through}");
}
