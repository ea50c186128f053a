//! A term that a scene states as nothing equals one that it does not state, bit for bit, and the kernel never sees it.

mod edit;
mod terms;

use nalgebra::Vector3;
use toml::Value;
use uvms_gym::batch::{Inputs, Precision};
use uvms_gym::description::Scene;
use uvms_gym::integrate::Integrator;
use uvms_gym::system::{Compiled, Factors, Flow, compile};

use crate::cases::{PRECISIONS, batch, numbers};
use crate::random_scene::{Random, random_state};
use edit::{Edit, Place, read, scenes};
use terms::{TERMS, Term};

const INSTANCES: usize = 3;
const STEPS: usize = 25;
const DT: f64 = 0.001;

fn compiled(scene: &Value) -> Compiled {
    compile(&read(scene))
}

/// Every number of the motion's end, as bits. Servos and stations are on where the scene has them.
fn motion(scene: &Scene, integrator: &str, precision: Precision, factors: Option<Factors<f64>>) -> Vec<u64> {
    let mut simulator = batch(scene, integrator, DT, precision, INSTANCES);
    if let Some(factors) = factors {
        simulator.set_factors(&[factors; INSTANCES]).unwrap();
    }
    let joints = scene.joints().count();
    let mut random = Random::new(7);
    let mut within =
        |count: usize, size: f64| -> Vec<f64> { (0..INSTANCES * count).map(|_| random.between(-size, size)).collect() };
    let (wrench, torque) = (within(6, 20.0), within(joints, 0.3));
    let (external, target) = (within(6 * (joints + 1), 1.0), within(joints, 0.5));
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
    let end: Vec<f64> = (0..INSTANCES).flat_map(|i| numbers(&simulator.state(i))).collect();
    // Added mass as a lagged force is not stable where there is much of it.
    assert!(end.iter().all(|x| x.is_finite()) || integrator == "lagged-added-mass", "{integrator}");
    end.into_iter().map(f64::to_bits).collect()
}

/// Asserts bit equality of the motions of two scenes by every integrator in both number types.
fn assert_same_motion(what: &str, a: &Value, b: &Value) {
    let (a, b) = (read(a), read(b));
    for integrator in Integrator::NAMES.map(|entry| entry.name) {
        for precision in PRECISIONS {
            let motions = [&a, &b].map(|scene| motion(scene, integrator, precision, None));
            assert!(motions[0] == motions[1], "{what}, {integrator}, {precision:?}");
        }
    }
}

/// Every term in every place of a scene where its absence can be seen: on links only if nothing else is fixed to them.
fn terms(scene: &str) -> impl Iterator<Item = (Place, Term)> {
    let all = TERMS.into_iter().flat_map(|term| term.places.iter().map(move |&place| (place, term)));
    all.filter(move |(place, _)| *place != Place::Links || scene == "plain arm")
}

#[test]
fn absent_terms_are_dropped_by_the_compiler() {
    let mut checked = 0;
    for (name, base) in scenes() {
        for (place, Term { name: term, absent, zero, dropped, .. }) in terms(name) {
            let what = format!("{name}: {term} of {place:?}");
            let without = compiled(&place.edited(&base, absent));
            assert!(dropped(place, &without), "{what}: there where it is absent");
            assert!(!dropped(place, &compiled(&base)), "{what}: not there to begin with");
            for zero in zero {
                let stated = compiled(&place.edited(&base, zero));
                assert!(stated.system == without.system && stated.unscaled == without.unscaled, "{what}: {zero}");
                checked += 1;
            }
        }
    }
    assert!(checked > 60, "{checked}");
}

#[test]
fn absent_terms_move_as_if_they_had_never_been() {
    for (name, base) in scenes() {
        for (place, Term { name: term, absent, zero, .. }) in terms(name) {
            let what = format!("{name}: {term} of {place:?}");
            let without = place.edited(&base, absent);
            zero.iter()
                .for_each(|zero| assert_same_motion(&format!("{what}: {zero}"), &place.edited(&base, zero), &without));
            // The term has an effect on this motion.
            let [with, without] = [&base, &without].map(|s| motion(&read(s), "mk4", Precision::Double, None));
            assert!(with != without, "{what} does not act");
        }
    }
}

/// Keys whose default is stated, and keys of something that is not there.
#[test]
fn keys_without_effect_have_none() {
    let keys: [(Place, Edit, Edit); 8] = [
        (Place::Root, "-water.current", "water.current = [0.0, 0.0, 0.0]"),
        (Place::Root, "-vehicle.fixed", "vehicle.fixed = false"),
        (
            Place::Root,
            "",
            "vehicle.thrusters = [{ name = 'idle', position = [0.1, 0.2, 0.3], axis = [1.0, 0.0, 0.0], limits = [-9.0, 9.0] }]",
        ),
        (Place::Root, NO_VOLUME, "*-volume; *-buoyancy; water.density = 3.0"),
        (Place::Bodies, "-center_of_mass", "center_of_mass = [0.0, 0.0, 0.0]"),
        (
            Place::Bodies,
            "-hydrodynamic_frame",
            "hydrodynamic_frame = { position = [0.0, 0.0, 0.0], rpy = [0.0, 0.0, 0.0] }",
        ),
        (Place::Joints, "-speed", "speed = 0.4"),
        (Place::Joints, "-friction", "-friction; friction.coulomb_speed = 0.7"),
    ];
    for (name, base) in scenes() {
        let scene = read(&base);
        let weight = format!("vehicle.body.weight = {:?}", scene.vehicle.body.mass * scene.water.gravity.norm());
        for (place, absent, stated) in keys.into_iter().chain([(Place::Root, "", &weight[..])]) {
            let (absent, stated_scene) = (place.edited(&base, absent), place.edited(&base, stated));
            assert!(compiled(&absent).system == compiled(&stated_scene).system, "{name}: {stated}");
            assert_same_motion(&format!("{name}: {stated}"), &absent, &stated_scene);
        }
    }
}

/// No body displaces water.
const NO_VOLUME: Edit = "*-volume; *-buoyancy";

/// Bounds that are never reached: the kernel has them, and the motion is the same.
#[test]
fn bounds_out_of_reach_change_no_bit() {
    for (name, base) in scenes() {
        let free = Place::Joints.edited(&base, "-effort; -limits");
        let bounds = "limits = { lower = -1e6, upper = 1e6, stiffness = 50.0, damping = 5.0 }; effort = 1e9";
        let bounded = Place::Joints.edited(&free, bounds);
        assert!(compiled(&free).system != compiled(&bounded).system);
        assert_same_motion(name, &bounded, &free);
    }
}

#[test]
fn diagonals_given_as_rows_stay_diagonals() {
    let entries = [3.0, 4.0, 5.0, 0.6, 0.7, 0.8];
    let rows: [[f64; 6]; 6] = std::array::from_fn(|i| std::array::from_fn(|k| if i == k { entries[i] } else { 0.0 }));
    for (name, base) in scenes() {
        let [diagonal, rows] = [format!("{entries:?}"), format!("{rows:?}")].map(|matrix| {
            let change = format!("added_mass = {matrix}; damping = {{ linear = {matrix}, quadratic = {matrix} }}");
            Place::Bodies.edited(&base, &change)
        });
        assert!(compiled(&diagonal).system == compiled(&rows).system, "{name}");
        assert_same_motion(name, &diagonal, &rows);
    }
}

/// An instance whose factor on a parameter is 0 moves as a scene without it.
#[test]
fn factors_of_zero_take_terms_away() {
    type Way = (fn(&mut Factors<f64>), Edit);
    let ways: [Way; 4] = [
        (|f| f.added_mass = 0.0, "*-added_mass"),
        (|f| f.linear_damping = 0.0, "*-damping.linear"),
        (|f| f.quadratic_damping = 0.0, "*-damping.quadratic"),
        (|f| f.volume = 0.0, NO_VOLUME),
    ];
    for (name, base) in scenes() {
        for (set, edit) in ways {
            let mut factors = Factors::ONE;
            set(&mut factors);
            for precision in PRECISIONS {
                let with = motion(&read(&base), "mk4", precision, Some(factors));
                let without = motion(&read(&Place::Root.edited(&base, edit)), "mk4", precision, None);
                assert!(with == without, "{name}: {edit}, {precision:?}");
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
            let mut simulator = batch(&scene, integrator, DT, precision, 1);
            simulator.set_state(0, &random_state(3, &scene));
            simulator.step(inputs, STEPS).unwrap();
            numbers(&simulator.state(0)).into_iter().map(f64::to_bits).collect::<Vec<_>>()
        };
        let none = Inputs::default();
        let inputs = [
            Inputs { thrust: Some(&[]), ..none },
            Inputs { wrench: Some(&zeros[..6]), ..none },
            Inputs { joint_torque: Some(&zeros[..joints]), ..none },
            Inputs { external: Some(&zeros), ..none },
        ];
        for integrator in Integrator::NAMES.map(|entry| entry.name) {
            for precision in PRECISIONS {
                let still = run(&none, integrator, precision);
                for (i, inputs) in inputs.iter().enumerate() {
                    assert!(run(inputs, integrator, precision) == still, "{name}: input {i}, {integrator}");
                }
            }
        }
    }
}

/// There is no payload, and no arm base, without mass.
#[test]
fn bodies_without_mass_are_refused() {
    let [_, (_, loaded)] = scenes();
    for key in ["payload.body.mass", "arm.base.mass"] {
        let scene = Place::Root.edited(&loaded, &format!("{key} = 0.0"));
        let error = Scene::from_value(scene, "edited scene").unwrap_err().to_string();
        assert!(error.contains(key), "{error}");
    }
}
