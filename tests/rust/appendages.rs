//! Laws of fins, tether and linear actuators.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Rotation3, Vector3, Vector6};
use uvms_gym::batch::{Inputs, Simulator, SimulatorOptions, States};
use uvms_gym::description::{Fin, LinearActuator, Scene, Tether};
use uvms_gym::dynamics::dense::{angular, linear, stack};
use uvms_gym::integrate::Integrator;
use uvms_gym::system::{Flow, State, compile};

use crate::cases::{self, PRECISIONS, orders, simulator, simulator_at, slope, wrench_of};
use crate::random_scene::{Random, random_state};
use crate::thrusters;

const RHO: f64 = 1000.0;
const ARM: &str = "bluerov2-heavy-alpha5";

/// A neutral body that water does not brake, with one fin at its origin.
fn fin(change: impl Fn(&mut Fin)) -> Scene {
    let text = "name = 'fin'\nposition = [0.0, 0.0, 0.0]\nchord = [1.0, 0.0, 0.0]\naxis = [0.0, 1.0, 0.0]\narea = 0.02\nlift_slope = 3.0";
    let mut scene = cases::body(|body| body.volume = Some(0.01));
    scene.vehicle.fins = vec![toml::from_str(text).unwrap()];
    change(&mut scene.vehicle.fins[0]);
    scene.check().unwrap();
    scene
}

/// Wrench of the fins by the kernel at a twist of the body through still water.
fn wrench(scene: &Scene, twist: Vector6<f64>, deflection: f64) -> Vector6<f64> {
    let mut simulator = simulator_at(scene, "mk4", 0.01, &State { twist, ..State::default() });
    let fins = vec![deflection; scene.vehicle.fins.len()];
    wrench_of(&simulator.forward_dynamics(&Inputs { fin: Some(&fins), ..Inputs::default() }).unwrap(), &twist)
}

/// Lift and drag coefficients at an angle of attack, at a speed.
fn coefficients(scene: &Scene, alpha: f64, speed: f64) -> [f64; 2] {
    let flow = Vector3::new(alpha.cos(), 0.0, -alpha.sin());
    let force = linear(&wrench(scene, stack(&flow, &Vector3::zeros()) * speed, 0.0));
    let across = Vector3::new(alpha.sin(), 0.0, alpha.cos());
    let pressure = 0.5 * RHO * speed * speed * scene.vehicle.fins[0].area;
    [force.dot(&across) / pressure, -force.dot(&flow) / pressure]
}

fn complete(fin: &mut Fin) {
    (fin.drag, fin.induced_drag, fin.stall) = (0.02, 0.1, Some(0.3));
}

#[test]
fn lift_rises_by_its_slope_from_nothing() {
    let scene = fin(complete);
    assert_eq!(coefficients(&scene, 0.0, 2.0)[0], 0.0);
    for speed in [0.01, 1.0, 7.0] {
        let [lift, _] = coefficients(&scene, 1e-4, speed);
        assert!((lift / 1e-4 - 3.0).abs() < 1e-6, "{lift}");
        assert!((coefficients(&scene, -1e-4, speed)[0] + lift).abs() < 1e-15);
    }
    assert_eq!(wrench(&scene, Vector6::zeros(), 0.1), Vector6::zeros());
}

#[test]
fn lift_is_across_the_flow() {
    let scene = fin(|_| {});
    for k in 0..20 {
        let alpha = 0.33 * f64::from(k) - 3.1;
        let [lift, drag] = coefficients(&scene, alpha, 1.3);
        assert!(drag.abs() < 1e-14, "{alpha}: {drag}");
        assert!((lift - 3.0 * alpha.sin() * alpha.cos()).abs() < 1e-13, "{alpha}: {lift}");
    }
}

#[test]
fn drag_polar_is_a_parabola_below_stall() {
    let scene = fin(complete);
    for alpha in [0.0, 0.02, 0.05, 0.08] {
        let [lift, drag] = coefficients(&scene, alpha, 2.0);
        assert!((drag - 0.02 - 0.1 * lift * lift).abs() < 1e-4, "{alpha}: {drag}");
    }
}

#[test]
fn fins_stall_smoothly() {
    let scene = fin(complete);
    let plate = |alpha: f64| 1.2 * alpha.sin() * alpha.cos();
    let [lift, _] = coefficients(&scene, 0.3, 2.0);
    let attached = 3.0 * 0.3_f64.sin() * 0.3_f64.cos();
    assert!((lift - 0.5 * (attached + plate(0.3))).abs() < 1e-12, "half of it has stalled: {lift}");
    // A plate far beyond: no lift broadside, all drag.
    assert!((coefficients(&scene, 1.0, 2.0)[0] - plate(1.0)).abs() < 1e-3);
    let [lift, drag] = coefficients(&scene, PI / 2.0, 2.0);
    assert!(lift.abs() < 1e-12 && (drag - 1.22).abs() < 1e-3, "{lift} {drag}");
    // Smooth: second differences are small everywhere, all around.
    let all: Vec<f64> = (0..=6400).map(|k| coefficients(&scene, 1e-3 * f64::from(k) - PI, 1.0)[0]).collect();
    let bend = all.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).abs() / 1e-6).fold(0.0, f64::max);
    assert!(bend < 100.0, "{bend}");
    let most = all.iter().copied().fold(0.0, f64::max);
    assert!((0.5..0.8).contains(&most), "{most}");
}

/// A fin never drives the body, whatever the flow and its deflection.
#[test]
fn fins_take_power() {
    let scene = fin(|f| {
        complete(f);
        (f.position, f.limits) = (Vector3::new(-0.5, 0.2, 0.1), Some([-1.0, 1.0]));
    });
    let mut random = Random::new(3);
    for _ in 0..200 {
        let twist = Vector6::from_fn(|_, _| random.between(-2.0, 2.0));
        assert!(wrench(&scene, twist, random.between(-1.0, 1.0)).dot(&twist) <= 1e-12);
    }
}

/// The same fin in turned axes makes the same wrench, turned.
#[test]
fn fins_know_no_axes() {
    let mut random = Random::new(5);
    for _ in 0..20 {
        let turn = random.rotation();
        let position = random.vector(0.5);
        let place = |turn: Matrix3<f64>| {
            fin(|f| {
                complete(f);
                f.limits = Some([-1.0, 1.0]);
                (f.position, f.chord, f.axis) = (turn * position, turn * Vector3::x(), turn * Vector3::y());
            })
        };
        let (v, w, deflection) = (random.vector(2.0), random.vector(2.0), random.between(-0.6, 0.6));
        let a = wrench(&place(Matrix3::identity()), stack(&v, &w), deflection);
        let b = wrench(&place(turn), stack(&(turn * v), &(turn * w)), deflection);
        let turned = stack(&(turn * linear(&a)), &(turn * angular(&a)));
        assert!((turned - b).norm() < 1e-11 * (1.0 + a.norm()), "{turned} {b}");
    }
}

/// A deflected fin is a fin whose axes are turned; beyond its limits it does not go.
#[test]
fn deflection_turns_the_fin_about_its_axis() {
    let moving = fin(|f| {
        complete(f);
        f.limits = Some([-0.2, 0.3]);
    });
    let twist = Vector6::new(1.5, 0.0, 0.1, 0.0, 0.2, 0.0);
    for (asked, angle) in [(0.1, 0.1), (-0.2, -0.2), (9.0, 0.3), (-9.0, -0.2), (0.0, 0.0)] {
        let turned = fin(|f| {
            complete(f);
            f.chord = Rotation3::from_axis_angle(&Vector3::y_axis(), angle) * f.chord;
        });
        let fixed = fin(|f| {
            complete(f);
            f.deflection = angle;
        });
        let expected = wrench(&turned, twist, 0.0);
        assert!((wrench(&moving, twist, asked) - expected).norm() < 1e-12);
        assert!((wrench(&fixed, twist, 0.7) - expected).norm() < 1e-12, "it does not move");
    }
    // Leading edge down at the tail: nose up.
    let tail = fin(|f| (f.position, f.limits) = (Vector3::new(-1.0, 0.0, 0.0), Some([-1.0, 1.0])));
    assert!(wrench(&tail, Vector6::ith(0, 1.0), 0.1)[4] < 0.0);
}

fn remus() -> Scene {
    Scene::shipped("remus-100").unwrap()
}

/// Coefficients of Prestero 2001 (z down): Y_uudr = 9.64, N_uudr = -6.15, Z_uw = -28.6, M_uw = 24.0.
#[test]
fn val_remus_has_prestero_s_lift() {
    let scene = remus();
    let mut simulator = simulator(&scene, "mk4", 0.01);
    // Net of added mass: M_uw holds the Munk moment, which is in the bias.
    let mut wrench = |twist: Vector6<f64>, fins: [f64; 6]| {
        simulator.set_state(0, &State { twist, ..State::default() });
        let loads = simulator.applied_loads(&Inputs { fin: Some(&fins), ..Inputs::default() }).unwrap();
        simulator.closed_form(0, |form| {
            let fins = form.body_wrenches(&loads[0].loads()).unwrap().terms.fins;
            fins - Vector6::from_column_slice(form.bias().as_slice())
        })
    };
    let (u, small) = (1.5, 1e-5);
    let ahead = Vector6::ith(0, u);
    // A rudder turned about z (up) by -delta_r is one turned about z down by delta_r; y and n change sign with the axes.
    let rudder = wrench(ahead, [-small, -small, 0.0, 0.0, 0.0, 0.0]) / (u * u * small);
    assert!((rudder[1] + 9.64).abs() < 0.01 && (rudder[5] - 6.15).abs() < 0.01, "{rudder}");
    let sinking = wrench(ahead + Vector6::ith(2, -small), [0.0; 6]) / (u * small);
    assert!((-sinking[2] + 28.6).abs() < 0.01, "Z_uw: {sinking}");
    assert!((-sinking[4] - 24.0).abs() < 0.05, "M_uw: {sinking}");
}

/// Neutral and without propeller torque it goes straight ahead, where thrust balances axial drag, `u = sqrt(X / 1.62)`; with the
/// rudder over it turns, to one side as to the other.
#[test]
fn remus_cruises_and_turns() {
    let mut scene = remus();
    scene.vehicle.body.buoyancy = Some(30.48 * 9.81);
    scene.vehicle.thrusters[0].induced = None;
    let cruise = (3.86_f64 / 1.62).sqrt();
    let run = |rudder: f64| {
        let start = State { twist: Vector6::ith(0, cruise), ..State::default() };
        let fins = [rudder, rudder, 0.0, 0.0, 0.0, 0.0];
        let inputs = Inputs { thrust: Some(&[3.86]), fin: Some(&fins), ..Inputs::default() };
        cases::run(&scene, "mk4", 0.02, &start, &inputs, 1000).twist
    };
    let straight = run(0.0);
    assert!((straight - Vector6::ith(0, cruise)).norm() < 1e-6, "{straight}");
    // Leading edges to the left at the tail push the tail to the left: a turn to the right.
    let (left, right) = (run(-0.1), run(0.1));
    assert!(left[5] > 0.05 && right[5] < -0.05, "{left} {right}");
    assert!((left[5] + right[5]).abs() < 1e-9 && left[0] < straight[0], "{left} {right}");
}

#[test]
fn fins_keep_the_order_of_the_integrator() {
    let scene = remus();
    let end = |steps: usize| {
        let start = State { twist: Vector6::new(1.5, 0.2, -0.1, 0.1, 0.3, -0.2), ..State::default() };
        let inputs = Inputs { fin: Some(&[0.1, 0.05, 0.2, -0.1, 0.0, 0.0]), ..Inputs::default() };
        cases::run(&scene, "mk4", 0.4 / steps as f64, &start, &inputs, steps).twist
    };
    let exact = end(512);
    let errors = [8, 16, 32].map(|steps| (end(steps) - exact).norm());
    assert!(orders(&errors).iter().all(|order| *order > 3.6), "{errors:?}");
}

/// Everything at once: arm, thrusters with dynamics, fins that stall, tether, damping by forward speed.
fn loaded(name: &str) -> Scene {
    let mut scene = thrusters::complete(name);
    scene.vehicle.fins = fin(complete).vehicle.fins;
    scene.vehicle.fins.extend(remus().vehicle.fins.into_iter().take(3));
    scene.vehicle.tether = Some(cable());
    scene.vehicle.forward_damping = Some(crate::forward_damping::eca_a9());
    scene.check().unwrap();
    scene
}

fn cable() -> Tether {
    Tether { position: Vector3::new(-0.2, 0.0, 0.1), length: 40.0, diameter: 0.008, mass_per_length: 0.06, drag: 1.2 }
}

#[test]
fn both_forms_feel_the_same_thrusters_and_appendages() {
    for (seed, name) in (0..20).flat_map(|seed| [ARM, "petasus-pum", "rexrov"].map(|name| (seed, name))) {
        let (scene, mut random) = (loaded(name), Random::new(seed));
        let mut simulator = simulator(&scene, "mk4", 0.01);
        let (mut state, m) = (random_state(seed, &scene), scene.vehicle.thrusters.len());
        (0..m).for_each(|k| state.thrust[k] = random.between(-30.0, 30.0));
        simulator.set_state(0, &state);
        simulator.set_flow(0, Flow { velocity: random.vector(0.5), acceleration: random.vector(0.5) });
        let fins: Vec<f64> = (0..4).map(|_| random.between(-0.3, 0.3)).collect();
        let commands: Vec<f64> = (0..m).map(|_| random.between(-40.0, 40.0)).collect();
        let inputs = Inputs { fin: Some(&fins), thrust: Some(&commands), ..Inputs::default() };
        let loads = simulator.applied_loads(&inputs).unwrap();
        let expected = simulator.closed_form(0, |form| form.accelerations(&loads[0].loads()).unwrap());
        let got = simulator.forward_dynamics(&inputs).unwrap();
        for (a, b) in got.iter().zip(expected.iter()) {
            assert!((a - b).abs() < 1e-9 * (1.0 + expected.norm()), "{name}, {seed}: {a} {b}");
        }
    }
}

/// The linearization is the derivative of the accelerations.
#[test]
fn linearization_knows_the_appendages() {
    let scene = loaded(ARM);
    let state = random_state(4, &scene);
    let mut simulator = simulator_at(&scene, "mk4", 0.01, &state);
    let fins = [0.0, 0.1, 0.2, -0.1];
    let inputs = Inputs { fin: Some(&fins), ..Inputs::default() };
    let linear = simulator.linearize(&inputs, 0).unwrap();
    let rates = 6 + simulator.joints();
    for k in 0..6 {
        for (row, slope) in slope(&mut simulator, &state, &inputs, rates + k).iter().enumerate() {
            let got = linear.a[(rates + row, rates + k)];
            assert!((got - slope).abs() < 1e-5 * (1.0 + slope.abs()), "{row} {k}: {got} {slope}");
        }
    }
}

#[test]
fn a_tether_pulls_by_weight_and_drag() {
    let mut scene = fin(|_| {});
    scene.vehicle.fins.clear();
    scene.water.gravity = Vector3::new(0.0, 0.0, -9.81);
    scene.vehicle.tether = Some(Tether { position: Vector3::new(0.0, 0.0, 0.5), ..cable() });
    // Half of 40 m, less the water it displaces.
    let net = 20.0 * (0.06 - 1000.0 * PI * 0.004 * 0.004);
    let at_rest = wrench(&scene, Vector6::zeros(), 0.0);
    assert!((at_rest - Vector6::new(0.0, 0.0, -9.81 * net, 0.0, 0.0, 0.0)).norm() < 1e-12);
    let drag = 0.5 * 1000.0 * 1.2 * 0.008 * 20.0 * 0.3 * 0.3;
    let moving = wrench(&scene, Vector6::ith(0, 0.3), 0.0) - at_rest;
    assert!((moving - Vector6::new(-drag, 0.0, 0.0, 0.0, -0.5 * drag, 0.0)).norm() < 1e-12, "{moving}");
    // Stated as nothing it is not there.
    let with = compile(&scene).system;
    scene.vehicle.tether = Some(Tether { length: 0.0, ..cable() });
    let nothing = compile(&scene).system;
    scene.vehicle.tether = None;
    assert!(nothing == compile(&scene).system && nothing != with);
}

#[test]
fn an_instance_depends_neither_on_its_neighbours_nor_on_threads() {
    let scene = loaded(ARM);
    let run = |instances: usize, threads, precision, integrator: &str| {
        let options =
            SimulatorOptions { instances, threads, precision, integrator: integrator.into(), ..Default::default() };
        let mut simulator = Simulator::new(scene.clone(), options).unwrap();
        (0..instances).for_each(|i| simulator.set_state(i, &random_state(i as u64, &scene)));
        let fins: Vec<f64> = (0..4 * instances).map(|k| 0.01 * (k / 4) as f64).collect();
        let thrust: Vec<f64> = (0..8 * instances).map(|k| 50.0 * (k as f64).sin()).collect();
        simulator.step(&Inputs { fin: Some(&fins), thrust: Some(&thrust), ..Inputs::default() }, 3).unwrap();
        // Without command they go back to where the scene has them.
        simulator.step(&Inputs::default(), 3).unwrap();
        let numbers = simulator.save();
        let width = numbers.len() / instances;
        numbers.chunks(width).map(|row| row.iter().map(|x| x.to_bits()).collect()).collect::<Vec<Vec<u64>>>()
    };
    for integrator in Integrator::NAMES.map(|entry| entry.name) {
        for precision in PRECISIONS {
            let many = run(19, Some(1), precision, integrator);
            assert!(many == run(19, Some(4), precision, integrator), "{integrator}, {precision:?}: threads");
            assert!(many[..3] == run(3, None, precision, integrator)[..], "{integrator}, {precision:?}: few");
        }
    }
}

const ACTUATOR: LinearActuator = LinearActuator { base: 0.3, lever: 0.08, angle: 1.2, force: 500.0 };

/// Drives the second joint by a linear actuator, which is returned.
fn actuated(scene: &mut Scene) -> &mut LinearActuator {
    let joint = &mut scene.arm.as_mut().unwrap().links[1].joint;
    (joint.effort, joint.limits) = (None, None);
    joint.actuator.insert(ACTUATOR)
}

/// stroke(q) by the law of cosines, torque by virtual work, and the joint saturates at it.
#[test]
fn a_linear_actuator_limits_torque_by_its_lever() {
    let actuator = ACTUATOR;
    for q in [-0.9, -0.3, 0.0, 0.4, 1.1] {
        let slope = (actuator.stroke(q + 1e-6) - actuator.stroke(q - 1e-6)) / 2e-6;
        assert!((actuator.arm(q) - slope).abs() < 1e-8);
    }
    let mut scene = Scene::shipped(ARM).unwrap();
    actuated(&mut scene).force = 20.0;
    scene.arm.as_mut().unwrap().links[1].joint.friction.viscous = 0.0;
    scene.check().unwrap();
    let compiled = compile(&scene);
    assert!(
        compiled.system.joints[1].rare.as_deref().is_some_and(|rare| rare.actuator.is_some())
            && compiled.system.joints[1].effort.is_none()
    );
    for q in [-0.5, 0.0, 0.6] {
        let mut state = State::default();
        state.q[1] = q;
        let mut simulator = simulator_at(&scene, "mk4", 0.01, &state);
        let mut under = |torque: f64| {
            let torques = [0.0, torque, 0.0, 0.0];
            simulator.forward_dynamics(&Inputs { joint_torque: Some(&torques), ..Inputs::default() }).unwrap()
        };
        let maximum = 20.0 * actuator.arm(q);
        assert!((scene.joints().nth(1).unwrap().effort_at(q) - maximum).abs() < 1e-12);
        for sign in [1.0, -1.0] {
            let (beyond, at) = (under(sign * 1e3), under(sign * maximum));
            for (a, b) in beyond.iter().zip(&at) {
                assert!((a - b).abs() < 1e-9 * (1.0 + b.abs()), "{q}: {a} {b}");
            }
            assert!((under(sign * 0.9 * maximum)[7] - at[7]).abs() > 1e-3);
        }
    }
}

#[test]
fn what_cannot_be_is_refused_by_key() {
    type Case = (fn(&mut Scene), &'static str);
    let cases: [Case; 13] = [
        (|s| s.vehicle.fins[0].area = -1.0, "vehicle.fins[0].area (fin): is -1.0, but must be >= 0"),
        (
            |s| s.vehicle.fins[0].axis = Vector3::zeros(),
            "vehicle.fins[0].axis (fin): is [0.0, 0.0, 0.0], but must have a nonzero length",
        ),
        (|s| s.vehicle.fins[1].chord = Vector3::z(), "vehicle.fins[1].chord (rudder-top)"),
        (|s| s.vehicle.fins[0].stall = Some(2.0), "vehicle.fins[0].stall (fin): is 2.0, but must be from 0.01"),
        (|s| s.vehicle.fins[1].deflection = 0.5, "vehicle.fins[1].limits (rudder-top)"),
        (|s| s.vehicle.fins[0].deflection = 9.0, "vehicle.fins[0].deflection (fin): is 9.0"),
        (|s| s.vehicle.fins[1].name = "fin".into(), "vehicle.fins[1].name (fin): the name 'fin' is taken"),
        (|s| s.vehicle.fins = vec![s.vehicle.fins[0].clone(); 9], "vehicle.fins: 9 elements"),
        (|s| s.vehicle.tether.as_mut().unwrap().diameter = -1.0, "vehicle.tether.diameter: is -1.0"),
        (|s| actuated(s).lever = 0.0, "joint.actuator.lever"),
        (|s| actuated(s).force = -1.0, "joint.actuator.force"),
        (|s| actuated(s).angle = 3.2, "joint.actuator.angle"),
        (
            |s| {
                actuated(s);
                s.arm.as_mut().unwrap().links[1].joint.effort = Some(1.0);
            },
            "its force takes the place of effort",
        ),
    ];
    for (change, expected) in cases {
        let mut scene = loaded(ARM);
        change(&mut scene);
        let error = scene.check().unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn scenes_with_appendages_round_trip() {
    let mut scene = loaded(ARM);
    actuated(&mut scene);
    let again = Scene::from_toml_str(&scene.to_toml_string(), "again").unwrap();
    assert_eq!(again, scene);
    // Dicts of states too: nothing of these is a state.
    let mut simulator = simulator(&scene, "mk4", 0.01);
    assert!(simulator.set_states(&States { time: Some(&[1.0]), ..Default::default() }).is_ok());
}
