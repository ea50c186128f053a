//! Batches: an instance's result is its own, bit for bit, whoever sits beside it; fast turns are stepped finely; what
//! cannot be computed is NaN.

use crate::batch::inputs::{RandomInputs, STRONG};
use crate::cases::{bits, branched};
use crate::random_scene::{Random, random_state};
use nalgebra::{Matrix3, Rotation3, Vector3, Vector6};
use uvms_gym::batch::{Inputs, Precision, Simulator, SimulatorOptions};
use uvms_gym::description::Scene;
use uvms_gym::system::State;

/// State, current and inputs of the instance with an identity, wherever it sits.
fn own(id: u64, scene: &Scene) -> (State, Vector3<f64>, RandomInputs) {
    (random_state(id, scene), Random::new(id ^ 0xC0).vector(0.4), RandomInputs::new(id, scene, STRONG))
}

fn options(precision: Precision, instances: usize, threads: usize) -> SimulatorOptions {
    SimulatorOptions { instances, precision, threads: Some(threads), ..SimulatorOptions::default() }
}

/// Steps the instances `ids` together, in portions of `split` substeps.
fn run(scene: &Scene, options: SimulatorOptions, ids: &[u64], split: &[usize]) -> Simulator {
    let mut simulator = Simulator::new(scene.clone(), SimulatorOptions { instances: ids.len(), ..options }).unwrap();
    let mut all = Vec::new();
    for (i, &id) in ids.iter().enumerate() {
        let (state, current, inputs) = own(id, scene);
        simulator.set_state(i, &state);
        simulator.set_flow(i, current);
        all.push(inputs);
    }
    let all = RandomInputs::of_all(&all);
    let mut inputs = all.inputs(scene);
    if split.len() > 1 {
        // A target moves with the time since the call.
        inputs.joint_target = None;
    }
    for &substeps in split {
        simulator.step(&inputs, substeps).unwrap();
    }
    simulator
}

const STEPS: usize = 12;

#[test]
fn result_depends_on_no_other_instance_nor_on_threads() {
    let scenes = [Scene::shipped("petasus-pum").unwrap(), branched()];
    for (scene, precision) in scenes.iter().flat_map(|scene| [(scene, Precision::Double), (scene, Precision::Single)]) {
        let mut alone: Vec<Option<Vec<u64>>> = vec![None; 8];
        for id in 0..8 {
            let simulator = run(scene, options(precision, 1, 1), &[id], &[STEPS]);
            let state = simulator.state(0);
            assert!(state.twist.norm() > 0.0 && state.twist.iter().all(|x| x.is_finite()));
            alone[id as usize] = Some(bits(&state));
        }
        for n in [2, 7, 8, 9, 17, 64, 300, 900] {
            for threads in [1, 2, 3, 8] {
                if threads > 1 && n < 300 {
                    continue;
                }
                // The eight known instances lie in ever other places.
                let ids: Vec<u64> = (0..n as u64).map(|i| if n <= 17 { (i * 5 + 3) % 8 } else { i }).collect();
                let shifted: Vec<u64> = ids.iter().map(|id| (id + n as u64 / 3) % n.max(8) as u64).collect();
                let simulator = run(scene, options(precision, n, threads), &shifted, &[STEPS]);
                let mut seen = 0;
                for (i, &id) in shifted.iter().enumerate() {
                    if let Some(Some(expected)) = alone.get(id as usize) {
                        assert_eq!(&bits(&simulator.state(i)), expected, "{precision:?}, n = {n}, place {i}, id {id}");
                        seen += 1;
                    }
                }
                assert!(seen >= n.min(8) / 2, "{seen} of {n}");
            }
        }
    }
}

#[test]
fn accelerations_depend_on_no_other_instance() {
    let scene = Scene::shipped("bluerov2-heavy-alpha5").unwrap();
    let accelerations = |ids: &[u64]| {
        let mut simulator = run(&scene, options(Precision::Double, ids.len(), 1), ids, &[1]);
        simulator.forward_dynamics(&Inputs::default()).unwrap()
    };
    let width = 6 + scene.joints().count();
    let alone = accelerations(&[3]);
    let together = accelerations(&[7, 1, 2, 9, 4, 5, 6, 8, 10, 11, 3]);
    let bits = |x: &[f64]| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&alone), bits(&together[10 * width..]));
}

#[test]
fn substeps_may_be_split_over_calls() {
    let scene = Scene::shipped("petasus-pum").unwrap();
    for precision in [Precision::Double, Precision::Single] {
        let ids: Vec<u64> = (0..9).collect();
        let one = run(&scene, options(precision, 9, 1), &ids, &[5, 7]);
        for split in [&[1; 12][..], &[5, 7], &[7, 5], &[2, 3, 7]] {
            let other = run(&scene, options(precision, 9, 1), &ids, split);
            for i in 0..9 {
                let (a, b) = (one.state(i), other.state(i));
                // The clock adds up in other portions.
                assert_eq!(bits(&State { time: 0.0, ..a.clone() }), bits(&State { time: 0.0, ..b.clone() }));
                assert!((a.time - b.time).abs() < 1e-6);
            }
        }
    }
}

/// Spinning at `speed` rad/s about a direction in general position, arm at home.
fn spinning(scene: &Scene, speed: f64) -> State {
    let w = Vector3::new(0.5, -0.3, 0.8).normalize() * speed;
    let twist = Vector6::new(0.0, 0.0, 0.0, w.x, w.y, w.z);
    let rotation = Rotation3::new(Vector3::new(0.2, 0.4, -0.3)).into_inner();
    State { twist, rotation, q: scene.home(), ..State::default() }
}

/// A batch whose instance `place` spins at `speed`, the others moving slowly.
fn with_one_spinning(scene: &Scene, dt: f64, place: usize, speed: f64, substeps: usize) -> Simulator {
    let options = SimulatorOptions { dt, ..options(Precision::Double, 16, 1) };
    let mut simulator = Simulator::new(scene.clone(), options).unwrap();
    for i in 0..16 {
        simulator.set_state(i, &random_state(i as u64, scene));
    }
    simulator.set_state(place, &spinning(scene, speed));
    simulator.step(&Inputs::default(), substeps).unwrap();
    simulator
}

/// A free body, all but a ball, so that RK4 is accurate however far it turns in a step.
fn nearly_a_ball() -> Scene {
    let mut scene = Scene::shipped("free-body").unwrap();
    scene.vehicle.body.inertia = Matrix3::from_diagonal(&Vector3::new(1.0, 1.003, 1.001));
    scene
}

#[test]
fn turns_beyond_the_limit_are_stepped_finely_and_neighbours_do_not_feel_it() {
    let (scene, dt) = (nearly_a_ball(), 0.1);
    let slow = with_one_spinning(&scene, dt, 5, 0.3, 3);
    // A quarter revolution per step is 15.7 rad/s, half a one 31.4 rad/s.
    for speed in [15.5, 16.0, 31.0, 33.0, 70.0, 150.0, 1000.0] {
        let fast = with_one_spinning(&scene, dt, 5, speed, 3);
        for i in (0..16).filter(|&i| i != 5) {
            assert_eq!(bits(&fast.state(i)), bits(&slow.state(i)), "speed {speed}, instance {i}");
        }
        let finer = (speed * dt / 0.05).ceil();
        let exact = with_one_spinning(&scene, dt / finer, 5, speed, 3 * finer as usize).state(5);
        let got = fast.state(5);
        let spin = (got.twist - exact.twist).norm() / speed;
        let turn = (got.rotation - exact.rotation).norm() / (3.0 * dt * speed);
        println!("{speed} rad/s: off by {spin:.1e} of the twist and {turn:.1e} of the turn");
        assert!(spin < 1e-11 && turn < 1e-5, "speed {speed}: {spin:e} {turn:e}");
    }
}

/// A ball turns evenly: sub-stepping is exact up to 1024 quarter revolutions a step, and beyond them all is NaN.
#[test]
fn impossible_speeds_become_nan_and_never_a_wrong_number() {
    let scene = Scene::shipped("free-body").unwrap();
    let dt = 0.1;
    let mut lost = 0;
    for exponent in 0..60 {
        let speed = 10.0_f64.powf(1.0 + 0.2 * f64::from(exponent));
        let simulator = with_one_spinning(&scene, dt, 9, speed, 1);
        let state = simulator.state(9);
        let start = spinning(&scene, speed);
        let turn = Rotation3::new(start.twist.fixed_rows::<3>(3) * dt).into_inner();
        let expected = start.rotation * turn;
        let finite = bits(&state).iter().all(|&b| f64::from_bits(b).is_finite());
        if finite {
            let error = (state.rotation - expected).norm();
            assert!(error < 4e-13 * speed, "speed {speed:e}: {error:e}");
            assert!(speed * dt < 1024.0 * std::f64::consts::FRAC_PI_2, "speed {speed:e} cannot be right");
        } else {
            lost += 1;
            let State { position, rotation, twist, .. } = &state;
            let mut numbers = position.iter().chain(rotation.iter()).chain(twist.iter());
            assert!(numbers.all(|x| x.is_nan()), "speed {speed:e}: {state:?}");
            assert!(speed * dt > 1024.0 * std::f64::consts::FRAC_PI_2, "speed {speed:e} was given up");
        }
        for i in (0..16).filter(|&i| i != 9) {
            assert!(bits(&simulator.state(i)).iter().all(|&b| f64::from_bits(b).is_finite()));
        }
    }
    assert!(lost > 10);
}

/// In body axes the velocity of a body that flies straight turns as fast as the body does: no spin may make it grow.
#[test]
fn spin_does_not_speed_up_a_body_that_flies_straight() {
    for name in ["mk4", "mk3", "ros2"] {
        for spin in (1..100).step_by(3) {
            let options = SimulatorOptions { dt: 0.1, integrator: name.into(), ..SimulatorOptions::default() };
            let mut simulator = Simulator::new(Scene::shipped("free-body").unwrap(), options).unwrap();
            let twist = Vector6::new(0.7, 0.0, 0.2, 0.0, 0.0, f64::from(spin));
            simulator.set_state(0, &State { twist, ..State::default() });
            simulator.step(&Inputs::default(), 60).unwrap();
            let speed = simulator.state(0).twist.fixed_rows::<3>(0).norm();
            assert!(speed < 0.73, "{name}, {spin} rad/s: {speed} m/s from 0.728");
        }
    }
}

#[test]
fn neighbours_of_a_lost_instance_are_unaffected() {
    let scene = Scene::shipped("petasus-pum").unwrap();
    for precision in [Precision::Double, Precision::Single] {
        let run = |spoil: &dyn Fn(&mut State)| {
            let mut simulator = Simulator::new(scene.clone(), options(precision, 20, 1)).unwrap();
            for i in 0..20 {
                let mut state = random_state(i as u64, &scene);
                if i == 6 {
                    spoil(&mut state);
                }
                simulator.set_state(i, &state);
            }
            simulator.step(&Inputs::default(), 3).unwrap();
            simulator
        };
        let healthy = run(&|_| {});
        let spoils: [&dyn Fn(&mut State); 6] = [
            &|state| state.twist[4] = f64::NAN,
            &|state| state.rotation[(1, 1)] = f64::NAN,
            &|state| state.q[2] = f64::NAN,
            &|state| state.qd[0] = f64::INFINITY,
            &|state| state.twist[3] = 1e30,
            &|state| state.qd[1] = 1e25,
        ];
        for (case, spoil) in spoils.iter().enumerate() {
            let spoiled = run(spoil);
            let twist = spoiled.state(6).twist;
            assert!(twist.iter().any(|x| !x.is_finite()), "{precision:?}, case {case}: {twist}");
            for i in (0..20).filter(|&i| i != 6) {
                assert_eq!(
                    bits(&spoiled.state(i)),
                    bits(&healthy.state(i)),
                    "{precision:?}, case {case}, instance {i}"
                );
            }
        }
    }
}
