//! Prescribed joints over whole motions.

use nalgebra::{DVector, Vector6};
use uvms_gym::batch::{Inputs, Precision};
use uvms_gym::description::{JointServo, Scene};
use uvms_gym::dynamics::Loads;
use uvms_gym::integrate::Integrator;
use uvms_gym::system::{Factors, State};

use super::joints::Sway;
use crate::cases::{self, batch, distance, orders, simulator_at, slope};
use crate::random_scene::{Options, Random, random_scene, random_state};

/// Joints of the arm of petasus-pum that are prescribed; the others have their servos.
const PRESCRIBED: [usize; 3] = [0, 2, 3];

fn arm(prescribed: &[usize]) -> Scene {
    let mut scene = Scene::shipped("petasus-pum").unwrap();
    scene.joints_mut().enumerate().for_each(|(k, joint)| joint.prescribed = prescribed.contains(&k));
    scene
}

/// A motion of the arm from its first second on, and the state at its start.
fn motion(scene: &Scene) -> (Sway, State) {
    let sway = Sway::about(scene.home(), scene.joints().count());
    let mut state = State { twist: Vector6::new(0.2, -0.1, 0.1, 0.1, 0.2, -0.3), ..State::default() };
    sway.start(&mut state);
    (sway, state)
}

/// The state after `seconds` of the motion.
fn after(scene: &Scene, integrator: &str, steps: usize, seconds: usize) -> State {
    let (sway, state) = motion(scene);
    let mut simulator = simulator_at(scene, integrator, 1.0 / steps as f64, &state);
    for second in 0..seconds {
        let target = sway.target(second as f64);
        simulator.step(&Inputs { joint_target: Some(&target), ..Inputs::default() }, steps).unwrap();
    }
    simulator.state(0)
}

#[test]
fn every_integrator_follows_the_target_exactly() {
    for entry in Integrator::NAMES {
        let scene = arm(&PRESCRIBED);
        let (sway, _) = motion(&scene);
        let end = after(&scene, entry.name, 100, 2);
        let target = sway.target(2.0);
        for k in PRESCRIBED {
            let miss = [end.q[k] - target[4 * k], end.qd[k] - target[4 * k + 1]];
            assert!(miss.iter().all(|x| x.abs() < 1e-14), "{}, joint {k}: {miss:?}", entry.name);
        }
        // The servos of the others lag.
        assert!((end.q[1] - target[4]).abs() > 1e-4);
    }
}

#[test]
fn integrators_keep_their_order_with_prescribed_joints() {
    let scene = arm(&PRESCRIBED);
    let exact = after(&scene, "mk4", 2048, 1);
    for (integrator, order) in [("mk2", 2.0), ("mk3", 3.0), ("mk4", 4.0), ("ros2", 2.0)] {
        let errors = [64, 128].map(|steps| distance(&exact, &after(&scene, integrator, steps, 1)));
        let observed = orders(&errors)[0];
        println!("{integrator}: {errors:?}, order {observed:.2}");
        assert!(observed > order - 0.2, "{integrator}: {observed}");
    }
}

/// The stiffer the servos, the nearer the motion is to the motion of prescribed joints: the difference falls with 1 / kp.
#[test]
fn servos_of_growing_stiffness_approach_prescribed_joints() {
    let joints = [0, 1, 2, 3, 4];
    let prescribed = after(&arm(&joints), "mk4", 1000, 1);
    let differences = [1e3, 1e4, 1e5].map(|kp: f64| {
        let mut scene = arm(&[]);
        for joint in scene.joints_mut() {
            // Rotors of 1 kg m2 make the mode of each joint about sqrt(kp), well damped.
            joint.servo = Some(JointServo { kp, kd: 2.0 * kp.sqrt() });
            (joint.effort, joint.rotor_inertia) = (None, 1.0);
        }
        distance(&after(&scene, "mk4", 5000, 1), &prescribed)
    });
    println!("difference by stiffness: {differences:?}");
    assert!(differences[2] < 1e-3 && differences[2] < differences[0] / 30.0, "{differences:?}");
}

/// Both forms on random systems with random prescribed joints, and the torques of the drives by inverse dynamics.
#[test]
fn hybrid_dynamics_agree_between_the_forms() {
    let (mut checked, mut worst) = (0, [0.0_f64; 2]);
    for seed in 0..200 {
        let mut scene = random_scene(seed, Options { fixed: Some(seed % 6 == 0), ..Options::default() });
        let mut random = Random::new(seed);
        scene.joints_mut().for_each(|joint| joint.prescribed = random.between(0.0, 1.0) < 0.5);
        let n = scene.joints().count();
        if scene.joints().all(|joint| !joint.prescribed) {
            continue;
        }
        let state = random_state(seed, &scene);
        let target: Vec<f64> = (0..n)
            .flat_map(|k| [state.q[k], state.qd[k], random.between(-2.0, 2.0), random.between(-2.0, 2.0)])
            .collect();
        let torque: Vec<f64> =
            scene.joints().map(|joint| if joint.prescribed { 0.0 } else { random.between(-1.0, 1.0) }).collect();
        // Servos of the other joints have their targets met.
        let inputs = Inputs { joint_target: Some(&target), joint_torque: Some(&torque), ..Inputs::default() };
        let mut simulator = simulator_at(&scene, "mk4", 0.01, &state);
        let articulated = DVector::from_vec(simulator.forward_dynamics(&inputs).unwrap());
        let applied = &simulator.applied_loads(&inputs).unwrap()[0];
        simulator.closed_form(0, |form| {
            let loads = applied.loads();
            let closed = form.accelerations(&loads).unwrap();
            for (k, _) in scene.joints().enumerate().filter(|(_, joint)| joint.prescribed) {
                assert_eq!(closed[6 + k], 2.0 * target[4 * k + 2]);
                assert!(
                    (articulated[6 + k] - closed[6 + k]).abs() < 1e-11 * closed.norm().max(1.0),
                    "seed {seed}, joint {k}"
                );
            }
            // With the drives' torques applied, nothing is missing.
            let rest = form.inverse_dynamics(&articulated, &loads).unwrap();
            let force = form.generalized_force(&loads).unwrap().norm() + form.bias().norm();
            let scale = force + form.mass_matrix().norm() * closed.norm();
            let missing = if scene.vehicle.fixed { 0.0 } else { rest.wrench.norm() };
            worst[0] = worst[0].max((&articulated - &closed).norm() / closed.norm().max(1.0));
            worst[1] = worst[1].max((missing + rest.joint_torques.norm()) / scale);
            checked += 1;
        });
    }
    println!("{checked} systems: accelerations differ by {:e}, the balance by {:e}", worst[0], worst[1]);
    assert!(checked > 100 && worst[0] < 1e-10 && worst[1] < 1e-12, "{checked}, {worst:?}");
}

/// Alone or in a batch, with own parameters or without: the same bits.
#[test]
fn prescribed_joints_give_the_same_bits_in_all_lanes() {
    let scene = arm(&PRESCRIBED);
    let n = 19;
    let own = |i: usize| Factors { mass: 1.0 + 0.01 * i as f64, payload: 0.1 * i as f64, ..Factors::ONE };
    let target = |i: usize| -> Vec<f64> {
        (0..5).flat_map(|k| [scene.home()[k], 0.01 * i as f64, 0.05 * k as f64, -0.02 * (i % 3) as f64]).collect()
    };
    for (integrator, precision, varied) in [
        ("mk4", Precision::Double, false),
        ("mk4", Precision::Single, false),
        ("mk4", Precision::Double, true),
        ("ros2", Precision::Double, false),
        ("ros2", Precision::Single, true),
        ("rk4-normalise", Precision::Double, false),
    ] {
        let run = |ids: std::ops::Range<usize>| {
            let mut simulator = batch(&scene, integrator, 0.01, precision, ids.len());
            if varied {
                simulator.set_factors(&ids.clone().map(own).collect::<Vec<_>>()).unwrap();
            }
            let targets: Vec<f64> = ids.flat_map(target).collect();
            simulator.step(&Inputs { joint_target: Some(&targets), ..Inputs::default() }, 20).unwrap();
            simulator
        };
        let together = run(0..n);
        for i in 0..n {
            assert_eq!(run(i..i + 1).state(0), together.state(i), "{integrator}, {precision:?}, instance {i}");
        }
    }
}

/// The torques of the drives come from inverse dynamics, and vanish for a joint that moves as it would freely.
#[test]
fn a_drive_that_moves_a_joint_as_it_would_move_freely_has_no_torque() {
    let free = arm(&[]);
    let (_, state) = motion(&free);
    let simulator = simulator_at(&arm(&[1]), "mk4", 0.01, &state);
    let accelerations = simulator.closed_form(0, |form| form.accelerations(&Loads::default())).unwrap();
    let free = simulator_at(&free, "mk4", 0.01, &state);
    let acceleration = free.closed_form(0, |form| form.accelerations(&Loads::default())).unwrap();
    let mut target = [0.0; 20];
    target[4 + 2] = acceleration[7] / 2.0;
    // Targets of joints with servos would turn these on: their entries are met.
    let joint_acceleration: Vec<f64> = (0..5).map(|k| 2.0 * target[4 * k + 2]).collect();
    let loads = Loads { joint_acceleration: &joint_acceleration, ..Loads::default() };
    let torque = simulator.closed_form(0, |form| form.drive_torques(&loads)).unwrap();
    assert!(torque.amax() < 1e-12, "{torque}");
    let held = simulator.closed_form(0, |form| form.drive_torques(&Loads::default())).unwrap();
    assert!(held[1].abs() > 1e-3 && accelerations[7] == 0.0, "{held}");
}

/// The linearization with prescribed joints is the derivative of the accelerations.
#[test]
fn linearization_keeps_the_accelerations_of_prescribed_joints() {
    let scene = arm(&PRESCRIBED);
    let (sway, state) = motion(&scene);
    let simulator = simulator_at(&scene, "mk4", 0.01, &state);
    let target = sway.target(0.0);
    let inputs = Inputs { joint_target: Some(&target), ..Inputs::default() };
    let linear = simulator.linearize(&inputs, 0).unwrap();
    let mut servoless = scene.clone();
    servoless.joints_mut().for_each(|joint| joint.servo = None);
    let mut bare = cases::simulator(&servoless, "mk4", 0.01);
    for k in [0, 1, 2, 3, 4] {
        let numeric = slope(&mut bare, &state, &inputs, 6 + k);
        let exact = linear.a.view((11, 6 + k), (11, 1)).column(0).into_owned();
        assert!((&numeric - &exact).norm() < 1e-5 * exact.norm().max(1.0), "joint {k}: {numeric} {exact}");
        assert!(PRESCRIBED.iter().all(|&p| exact[6 + p] == 0.0));
    }
}
