//! Friction: stops, creep and grips against closed forms.

use nalgebra::{Vector3, Vector6};
use uvms_gym::batch::{Inputs, Simulator, SimulatorOptions};
use uvms_gym::description::Scene;
use uvms_gym::system::State;

const MASS: f64 = 2.0;
const G: f64 = 9.81;
const MU: f64 = 0.4;
const SLIP: f64 = 0.01;
const STIFFNESS: f64 = 5000.0;
const RAMP: f64 = 0.001;

/// A block on a floor that falls by `slope` (rad) along x. Its four feet touch in the plane of its centre of mass, so that friction does
/// not tilt it.
fn block(slope: f64) -> Scene {
    let gravity = [G * slope.sin(), 0.0, -G * slope.cos()];
    let feet = [[1, 1], [1, -1], [-1, 1], [-1, -1]].map(|[x, y]| {
        format!("{{ name = 'foot{x}{y}', on = 'vehicle', position = [{x}.0, {y}.0, 0.1], radius = 0.1 }}")
    });
    let text = format!(
        "name = 'block'\nwater = {{ density = 0.0, gravity = {gravity:?} }}\n[vehicle]\nname = 'block'\n\
         body = {{ mass = {MASS}, inertia = [1.0, 1.0, 1.0] }}\n[contact]\nstiffness = {STIFFNESS:?}\n\
         dissipation = 5.0\nramp = {RAMP:?}\nfriction = {MU}\nslip_speed = {SLIP}\nspheres = [{}]\n\
         shapes = [{{ name = 'floor', kind = 'plane' }}]\n",
        feet.join(", ")
    );
    Scene::from_toml_str(&text, "block").unwrap()
}

/// At rest on its feet, each with a quarter of the weight.
fn resting(scene: &Scene) -> State {
    let load = -scene.water.gravity.z * MASS / 4.0;
    // k (x - e / 2) = load.
    let depth = load / STIFFNESS + 0.5 * RAMP;
    State { position: Vector3::new(0.0, 0.0, -depth), ..State::default() }
}

fn simulator(scene: &Scene, state: &State, dt: f64) -> Simulator {
    let mut simulator = Simulator::new(scene.clone(), SimulatorOptions { dt, ..Default::default() }).unwrap();
    simulator.set_state(0, state);
    simulator
}

/// A floor without a slope, on which the block slides: `v' = -mu g v / sqrt(v^2 + v_s^2)` has `sqrt(v^2 + v_s^2) + ...` as its integral:
/// `sqrt(v0^2 + v_s^2) - v_s artanh(v_s / sqrt(v0^2 + v_s^2)) - (same at v) = mu g t`.
#[test]
fn val_a_block_slides_as_the_closed_form_says() {
    let scene = block(0.0);
    let (start, t) = (0.5, 0.1);
    let way = |v: f64| {
        let w = v.hypot(SLIP);
        w - SLIP * (SLIP / w).atanh()
    };
    let (mut low, mut high) = (1e-12, start);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if way(middle) > way(start) - MU * G * t { high = middle } else { low = middle }
    }
    let mut state = resting(&scene);
    state.twist[0] = start;
    let mut simulator = simulator(&scene, &state, 1e-4);
    simulator.step(&Inputs::default(), 1000).unwrap();
    let speed = simulator.state(0).twist[0];
    println!("speed {speed}, closed form {low}");
    assert!((speed - low).abs() < 1e-6 * start, "{speed}, not {low}");
}

/// Below the angle of friction a block creeps at `v_s F / sqrt((mu f)^2 - F^2)` under the force F along the slope.
#[test]
fn val_a_block_creeps_on_a_slope() {
    let slope: f64 = 0.2;
    let scene = block(slope);
    let (force, load) = (MASS * G * slope.sin(), MASS * G * slope.cos());
    let creep = SLIP * force / ((MU * load).powi(2) - force * force).sqrt();
    let mut simulator = simulator(&scene, &resting(&scene), 1e-3);
    simulator.step(&Inputs::default(), 3000).unwrap();
    let twist: Vector6<f64> = simulator.state(0).twist;
    println!("creep {}, closed form {creep}", twist[0]);
    assert!((twist[0] / creep - 1.0).abs() < 1e-6, "{} m/s, not {creep}", twist[0]);
}

/// Feet brake the same motion together: sub-steps resolve the friction of all of them, and a body comes to rest on any number.
#[test]
fn a_heavy_body_comes_to_rest_on_any_number_of_feet() {
    for feet in [3, 8, 16] {
        let spheres: Vec<String> = (0..feet)
            .map(|k| {
                let (y, x) = (std::f64::consts::TAU * f64::from(k) / f64::from(feet)).sin_cos();
                format!("{{ name = 'foot{k}', on = 'vehicle', position = [{x:?}, {y:?}, 0.1], radius = 0.1 }}")
            })
            .collect();
        let text = format!(
            "name = 'stool'\nwater = {{ density = 0.0, gravity = [0.0, 0.0, -{G}] }}\n[vehicle]\nname = 'stool'\n\
             body = {{ mass = {MASS}, inertia = [20.0, 20.0, 20.0] }}\n[contact]\nstiffness = {STIFFNESS:?}\nramp = {RAMP:?}\n\
             friction = {MU}\nslip_speed = 0.001\nspheres = [{}]\nshapes = [{{ name = 'floor', kind = 'plane' }}]\n",
            spheres.join(", ")
        );
        let scene = Scene::from_toml_str(&text, "stool").unwrap();
        let depth = MASS * G / f64::from(feet) / STIFFNESS + 0.5 * RAMP;
        let mut state = State { position: Vector3::new(0.0, 0.0, -depth), ..State::default() };
        state.twist = Vector6::new(0.05, 0.02, 0.0, 0.0, 0.0, 0.0);
        for integrator in ["mk4", "mk3", "mk2", "ros2", "ros3"] {
            for dt in [0.01, 0.002] {
                let options = SimulatorOptions { dt, integrator: integrator.into(), ..Default::default() };
                let mut simulator = Simulator::new(scene.clone(), options).unwrap();
                simulator.set_state(0, &state);
                simulator.step(&Inputs::default(), (0.5 / dt).round() as usize).unwrap();
                let speed = simulator.state(0).twist.fixed_rows::<2>(0).norm();
                assert!(speed < 1e-7, "{integrator} at {dt} s on {feet} feet: {speed:e}");
            }
        }
    }
}

/// Two opposed fingers that slide on the rim of a wheel turn it with `2 mu f r`.
#[test]
fn val_a_rim_is_turned_by_two_mu_f_r() {
    let (radius, tube, ball) = (0.2, 0.02, 0.01);
    let depth = 0.002;
    let position = radius + tube + ball - depth;
    let text = format!(
        "name = 'rim'\nwater = {{ density = 0.0, gravity = [0.0, 0.0, 0.0] }}\n[vehicle]\nname = 'hand'\nfixed = true\n\
         body = {{ mass = 1.0, inertia = [1.0, 1.0, 1.0] }}\n[contact]\nstiffness = {STIFFNESS:?}\n\
         dissipation = 1.0\nramp = {RAMP:?}\nfriction = {MU}\nslip_speed = 1e-4\nspheres = [\n\
         {{ name = 'one', on = 'vehicle', position = [{position:?}, 0.0, 0.0], radius = {ball} }},\n\
         {{ name = 'two', on = 'vehicle', position = [-{position:?}, 0.0, 0.0], radius = {ball} }}]\n\
         shapes = [{{ name = 'rim', on = 'wheel', kind = 'torus', radius = {radius}, tube = {tube} }}]\n\
         [[fixtures]]\nname = 'wheel'\njoint = {{ kind = 'revolute', axis = [0.0, 0.0, 1.0], rotor_inertia = 0.5 }}\n"
    );
    let scene = Scene::from_toml_str(&text, "rim").unwrap();
    let mut simulator = simulator(&scene, &State::default(), 1e-3);
    let mut state = State::default();
    state.qd[0] = -2.0;
    simulator.set_state(0, &state);
    let torque = 0.5 * simulator.forward_dynamics(&Inputs::default()).unwrap()[6];
    let load = STIFFNESS * (depth - 0.5 * RAMP);
    // Where both surfaces would touch, in the middle of the penetration.
    let speed = 2.0 * (radius + tube - 0.5 * depth);
    let slides = speed / speed.hypot(1e-4);
    let expected = 2.0 * MU * load * (radius + tube - 0.5 * depth) * slides;
    println!("torque {torque}, closed form {expected}");
    assert!((torque / expected - 1.0).abs() < 1e-9, "{torque}, not {expected}");
}
