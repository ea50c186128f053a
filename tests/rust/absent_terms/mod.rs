//! A term that a scene states as nothing equals one that it does not state, bit for bit, and the kernel never sees it.

mod edit;
mod terms;

use nalgebra::Vector3;
use toml::Value;
use uvms_gym::batch::{Inputs, Precision, Simulator, SimulatorOptions};
use uvms_gym::description::Scene;
use uvms_gym::integrate::Integrator;
use uvms_gym::system::{Compiled, Factors, Flow, State, compile};

use crate::random_scene::{Random, random_state};
use edit::{Edit, Place, bodies, list, read, scenes, table};
use terms::{Term, terms};

const INSTANCES: usize = 3;
const STEPS: usize = 25;
const DT: f64 = 0.001;
const DIAGONAL: [f64; 6] = [3.0, 4.0, 5.0, 0.6, 0.7, 0.8];

fn compiled(scene: &Value) -> Compiled {
    compile(&read(scene))
}

/// Every number of the motion's end, as bits. Servos and stations are on where the scene has them.
fn motion(scene: &Scene, integrator: &str, precision: Precision, factors: Option<Factors<f64>>) -> Vec<u64> {
    let options = SimulatorOptions {
        instances: INSTANCES,
        dt: DT,
        integrator: integrator.into(),
        precision,
        threads: Some(1),
        ..SimulatorOptions::default()
    };
    let mut simulator = Simulator::new(scene.clone(), options).unwrap();
    if let Some(factors) = factors {
        simulator.set_factors(&[factors; INSTANCES]).unwrap();
    }
    let joints = scene.joints().count();
    let mut random = Random::new(7);
    let mut numbers =
        |count: usize, size: f64| -> Vec<f64> { (0..INSTANCES * count).map(|_| random.between(-size, size)).collect() };
    let (wrench, torque) = (numbers(6, 20.0), numbers(joints, 0.3));
    let (external, target) = (numbers(6 * (joints + 1), 1.0), numbers(joints, 0.5));
    let station = [0.1, -0.2, 0.3, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0].repeat(INSTANCES);
    for i in 0..INSTANCES {
        // Beyond some limits, so that the end stops push; everything moves.
        simulator.set_state(i, &random_state(i as u64, scene));
        if scene.water.gravity.norm() > 0.0 {
            let acceleration = Vector3::new(0.05, -0.04, 0.03);
            simulator.set_flow(i, Flow { acceleration, ..simulator.flow(i) });
        }
    }
    let servo = scene.joints().any(|joint| joint.servo.is_some());
    let inputs = Inputs {
        wrench: Some(&wrench),
        joint_torque: Some(&torque),
        external: Some(&external),
        joint_target: servo.then_some(&target),
        pose_target: scene.vehicle.servo.is_some().then_some(&station),
        ..Inputs::default()
    };
    simulator.step(&inputs, STEPS).unwrap();
    let states: Vec<State> = (0..INSTANCES).map(|i| simulator.state(i)).collect();
    let bits = states.iter().flat_map(numbers_of).map(f64::to_bits).collect();
    // Added mass as a lagged force is not stable where there is much of it.
    let finite = states.iter().flat_map(numbers_of).all(f64::is_finite);
    assert!(finite || integrator == "lagged-added-mass", "{integrator}");
    bits
}

fn numbers_of(state: &State) -> Vec<f64> {
    let vehicle = state.position.iter().chain(&state.rotation).chain(&state.twist);
    vehicle.chain(&state.q).chain(&state.qd).copied().collect()
}

/// Asserts bit equality of the motions of two scenes by every integrator in both number types.
fn assert_same_motion(what: &str, a: &Value, b: &Value) {
    let (a, b) = (read(a), read(b));
    for integrator in Integrator::NAMES.map(|entry| entry.name) {
        for precision in [Precision::Double, Precision::Single] {
            let motions = [&a, &b].map(|scene| motion(scene, integrator, precision, None));
            assert!(motions[0] == motions[1], "{what}, {integrator}, {precision:?}");
        }
    }
}

/// Whether a term can be told apart in a place: links with nothing else fixed to them, or all bodies together.
fn applies(scene: &str, place: Place) -> bool {
    place != Place::Links || scene == "plain arm"
}

#[test]
fn absent_terms_are_dropped_by_the_compiler() {
    let mut checked = 0;
    for (name, base) in scenes() {
        for Term { what, place, absent, nothing, dropped } in terms() {
            if !applies(name, place) {
                continue;
            }
            let what = format!("{name}: {what} of {place:?}");
            let without = compiled(&place.edited(&base, absent));
            assert!(dropped.holds(place, &without), "{what}: there where it is absent");
            assert!(!dropped.holds(place, &compiled(&base)), "{what}: not there to begin with");
            for (i, &nothing) in nothing.iter().enumerate() {
                let stated = compiled(&place.edited(&base, nothing));
                assert!(stated.system == without.system, "{what}, form {i} of nothing");
                assert!(stated.unscaled == without.unscaled, "{what}, form {i} of nothing");
                checked += 1;
            }
        }
    }
    assert!(checked > 60, "{checked}");
}

#[test]
fn absent_terms_move_as_if_they_had_never_been() {
    for (name, base) in scenes() {
        for Term { what, place, absent, nothing, .. } in terms() {
            if !applies(name, place) {
                continue;
            }
            let what = format!("{name}: {what} of {place:?}");
            let without = place.edited(&base, absent);
            for (i, &nothing) in nothing.iter().enumerate() {
                assert_same_motion(&format!("{what}, form {i} of nothing"), &place.edited(&base, nothing), &without);
            }
            // The motion would tell.
            let [with, without] = [&base, &without].map(|s| motion(&read(s), "mk4", Precision::Double, None));
            assert!(with != without, "{what} does not act");
        }
    }
}

/// Keys that change nothing where they are stated as they are by default, or where what they speak of is not there.
#[test]
fn keys_without_effect_have_none() {
    let keys: [(&str, Place, Edit, Edit); 9] = [
        (
            "current",
            Place::Root,
            |r| drop(table(r, "water").remove("current")),
            |r| {
                table(r, "water").insert("current".into(), list(&[0.0; 3]));
            },
        ),
        (
            "fixed",
            Place::Root,
            |r| drop(table(r, "vehicle").remove("fixed")),
            |r| {
                table(r, "vehicle").insert("fixed".into(), false.into());
            },
        ),
        (
            "idle thrusters",
            Place::Root,
            |_| {},
            |r| {
                let thruster = [
                    ("name".into(), "idle".into()),
                    ("position".into(), list(&[0.1, 0.2, 0.3])),
                    ("axis".into(), list(&[1.0, 0.0, 0.0])),
                    ("limits".into(), list(&[-9.0, 9.0])),
                ];
                table(r, "vehicle").insert("thrusters".into(), vec![toml::Table::from_iter(thruster)].into());
            },
        ),
        (
            "density without volumes",
            Place::Root,
            |r| bodies(r, no_volume),
            |r| {
                bodies(r, no_volume);
                table(r, "water").insert("density".into(), 3.0.into());
            },
        ),
        (
            "weight",
            Place::Root,
            |_| {},
            |r| {
                let gravity = table(r, "water")["gravity"].as_array().unwrap().iter();
                let gravity = gravity.map(|g| g.as_float().unwrap().powi(2)).sum::<f64>().sqrt();
                let body = table(table(r, "vehicle"), "body");
                let mass = body["mass"].as_float().unwrap();
                body.insert("weight".into(), (mass * gravity).into());
            },
        ),
        (
            "centre of mass",
            Place::Bodies,
            |b| drop(b.remove("center_of_mass")),
            |b| {
                b.insert("center_of_mass".into(), list(&[0.0; 3]));
            },
        ),
        (
            "hydrodynamic frame",
            Place::Bodies,
            |b| drop(b.remove("hydrodynamic_frame")),
            |b| {
                let zero = [("position".into(), list(&[0.0; 3])), ("rpy".into(), list(&[0.0; 3]))];
                b.insert("hydrodynamic_frame".into(), toml::Table::from_iter(zero).into());
            },
        ),
        (
            "speed of references",
            Place::Joints,
            |j| drop(j.remove("speed")),
            |j| drop(j.insert("speed".into(), 0.4.into())),
        ),
        ("smoothing without Coulomb friction", Place::Joints, no_coulomb, |j| {
            no_coulomb(j);
            table(j, "friction").insert("coulomb_speed".into(), 0.7.into());
        }),
    ];
    for (name, base) in scenes() {
        for (what, place, absent, stated) in keys {
            let (absent, stated) = (place.edited(&base, absent), place.edited(&base, stated));
            assert!(compiled(&absent).system == compiled(&stated).system, "{name}: {what}");
            assert_same_motion(&format!("{name}: {what}"), &absent, &stated);
        }
    }
}

fn no_volume(body: &mut toml::Table) {
    ["volume", "buoyancy"].into_iter().for_each(|key| drop(body.remove(key)));
}

fn no_coulomb(joint: &mut toml::Table) {
    ["coulomb", "coulomb_speed"].into_iter().for_each(|key| drop(table(joint, "friction").remove(key)));
}

/// Bounds that are never reached: the kernel has them, and the motion is the same.
#[test]
fn bounds_out_of_reach_change_no_bit() {
    for (name, base) in scenes() {
        let free =
            Place::Joints.edited(&base, |j| ["effort", "limits"].into_iter().for_each(|key| drop(j.remove(key))));
        let bounded = Place::Joints.edited(&free, |j| {
            let stops = [("lower", -1e6), ("upper", 1e6), ("stiffness", 50.0), ("damping", 5.0)];
            j.insert("limits".into(), toml::Table::from_iter(stops.map(|(k, x)| (k.into(), x.into()))).into());
            j.insert("effort".into(), 1e9.into());
        });
        assert!(compiled(&free).system != compiled(&bounded).system);
        assert_same_motion(name, &bounded, &free);
    }
}

fn rows() -> Value {
    let row = |i: usize| list(&std::array::from_fn::<f64, 6, _>(|k| if i == k { DIAGONAL[i] } else { 0.0 }));
    (0..6).map(row).collect::<Vec<_>>().into()
}

#[test]
fn diagonals_given_as_rows_stay_diagonals() {
    for (name, base) in scenes() {
        let as_diagonal: Edit = |body| {
            body.insert("added_mass".into(), list(&DIAGONAL));
            for key in ["linear", "quadratic"] {
                table(body, "damping").insert(key.into(), list(&DIAGONAL));
            }
        };
        let as_rows: Edit = |body| {
            body.insert("added_mass".into(), rows());
            for key in ["linear", "quadratic"] {
                table(body, "damping").insert(key.into(), rows());
            }
        };
        let [diagonal, rows] = [as_diagonal, as_rows].map(|edit| Place::Bodies.edited(&base, edit));
        assert!(compiled(&diagonal).system == compiled(&rows).system, "{name}");
        assert_same_motion(name, &diagonal, &rows);
    }
}

/// An instance whose factor on a parameter is 0 moves as a scene without it.
#[test]
fn factors_of_zero_take_terms_away() {
    type Way = (&'static str, fn(&mut Factors<f64>), Edit);
    let ways: [Way; 4] = [
        ("added mass", |f| f.added_mass = 0.0, |body| drop(body.remove("added_mass"))),
        ("linear drag", |f| f.linear_damping = 0.0, |body| drop(table(body, "damping").remove("linear"))),
        ("quadratic drag", |f| f.quadratic_damping = 0.0, |body| drop(table(body, "damping").remove("quadratic"))),
        ("volume", |f| f.volume = 0.0, no_volume),
    ];
    for (name, base) in scenes() {
        for (what, set, edit) in ways {
            let mut factors = Factors::ONE;
            set(&mut factors);
            for precision in [Precision::Double, Precision::Single] {
                let with = motion(&read(&base), "mk4", precision, Some(factors));
                let without = motion(&read(&Place::Bodies.edited(&base, edit)), "mk4", precision, None);
                assert!(with == without, "{name}: {what}, {precision:?}");
            }
        }
    }
}

/// Inputs of zeros are no inputs.
#[test]
fn inputs_of_zeros_are_none() {
    for (name, base) in scenes() {
        let scene = read(&base);
        let joints = scene.joints().count();
        let zeros = vec![0.0; 6 * (joints + 1)];
        let run = |inputs: &Inputs, integrator: &str, precision| {
            let options = SimulatorOptions { dt: DT, integrator: integrator.into(), precision, ..Default::default() };
            let mut simulator = Simulator::new(scene.clone(), options).unwrap();
            simulator.set_state(0, &random_state(3, &scene));
            simulator.step(inputs, STEPS).unwrap();
            numbers_of(&simulator.state(0)).into_iter().map(f64::to_bits).collect::<Vec<_>>()
        };
        let none = Inputs::default();
        let inputs = [
            Inputs { thrust: Some(&[]), ..none },
            Inputs { wrench: Some(&zeros[..6]), ..none },
            Inputs { joint_torque: Some(&zeros[..joints]), ..none },
            Inputs { external: Some(&zeros), ..none },
        ];
        for integrator in Integrator::NAMES.map(|entry| entry.name) {
            for precision in [Precision::Double, Precision::Single] {
                let still = run(&none, integrator, precision);
                for (i, inputs) in inputs.iter().enumerate() {
                    assert!(run(inputs, integrator, precision) == still, "{name}: input {i}, {integrator}");
                }
            }
        }
    }
}

/// Nothing can be held only by holding nothing: there is no payload, and no arm base, without mass.
#[test]
fn bodies_without_mass_are_refused() {
    let massless: [Edit; 2] = [
        |root| drop(table(table(root, "payload"), "body").insert("mass".into(), 0.0.into())),
        |root| drop(table(table(root, "arm"), "base").insert("mass".into(), 0.0.into())),
    ];
    let [_, (_, loaded)] = scenes();
    for (edit, key) in massless.into_iter().zip(["payload.body.mass", "arm.base.mass"]) {
        let error = Scene::from_value(Place::Root.edited(&loaded, edit), "edited scene").unwrap_err().to_string();
        assert!(error.contains(key), "{error}");
    }
}
