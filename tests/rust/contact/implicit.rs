//! Contact in the matrix of the linearly implicit methods.

use nalgebra::{Vector3, Vector6};
use uvms_gym::batch::{Inputs, Simulator, SimulatorOptions};
use uvms_gym::description::Scene;
use uvms_gym::dynamics::ClosedFormModel;
use uvms_gym::system::State;

use super::friction::{block, resting};
use super::scenes::{Numbers, ball};

const METHODS: [&str; 2] = ["ros2", "ros3"];

fn simulator(scene: &Scene, state: &State, integrator: &str, dt: f64) -> Simulator {
    let options = SimulatorOptions { dt, integrator: integrator.into(), ..Default::default() };
    let mut simulator = Simulator::new(scene.clone(), options).unwrap();
    simulator.set_state(0, state);
    simulator
}

/// A ball of 10 kg comes to rest at the depth `m g / k + e / 2`, whatever stiffness and step. The explicit methods need steps below
/// `2.8 sqrt(m / k)`: 0.1 ms at the last stiffness.
#[test]
fn val_a_body_rests_on_a_floor_of_any_stiffness_at_any_step() {
    let (mass, g, ramp) = (10.0, 1.0, 5e-4);
    for stiffness in [5e4, 5e5, 5e7, 5e9] {
        let numbers = Numbers { stiffness, dissipation: 2.0, ramp, friction: 0.4, slip_speed: 1e-6 };
        let scene = ball(mass, [0.0, 0.0, -g], numbers);
        // On the ramp the stiffness is far smaller.
        let on_ramp = |x: f64| stiffness * x.powi(3) / (ramp * ramp) * (1.0 - x / (2.0 * ramp));
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..200 {
            let x = 0.5 * (low + high);
            let force = if x < ramp { on_ramp(x) } else { stiffness * (x - 0.5 * ramp) };
            if force < mass * g { low = x } else { high = x }
        }
        for integrator in METHODS {
            for dt in [0.002, 0.01, 0.05] {
                let state = State { position: Vector3::new(0.0, 0.0, 0.1 - 0.9 * low), ..State::default() };
                let mut simulator = simulator(&scene, &state, integrator, dt);
                simulator.step(&Inputs::default(), (4.0 / dt) as usize).unwrap();
                let state = simulator.state(0);
                let (depth, speed) = (0.1 - state.position.z, state.twist.norm());
                println!(
                    "{integrator} {stiffness:e} N/m at {dt} s: depth {depth:e}, expected {low:e}, speed {speed:e}"
                );
                assert!((depth / low - 1.0).abs() < 0.02 && speed < 2e-3, "{integrator} {stiffness:e} {dt}: {depth:e}");
            }
        }
    }
}

/// Friction of a slip speed of a micrometre per second, at steps of 20 ms: explicit methods would need 0.5 microseconds.
#[test]
fn val_a_block_creeps_by_micrometres_at_long_steps() {
    let (slope, slip_speed): (f64, f64) = (0.2, 1e-6);
    let mut scene = block(slope);
    scene.contact.as_mut().unwrap().slip_speed = slip_speed;
    let g = scene.water.gravity;
    let (force, limit) = (g.x, -0.4 * g.z);
    let creep = slip_speed * force / (limit * limit - force * force).sqrt();
    for integrator in METHODS {
        let mut simulator = simulator(&scene, &resting(&scene), integrator, 0.02);
        simulator.step(&Inputs::default(), 200).unwrap();
        let twist: Vector6<f64> = simulator.state(0).twist;
        println!("{integrator}: creep {}, closed form {creep}", twist[0]);
        assert!((twist[0] / creep - 1.0).abs() < 1e-6, "{integrator}: {} m/s, not {creep}", twist[0]);
    }
}

/// Through bounces, with spin and friction: root mean square errors of 64 starts.
#[test]
fn val_bounces_keep_the_orders_of_the_implicit_methods() {
    let numbers = Numbers { stiffness: 2000.0, dissipation: 1.0, ramp: 0.02, friction: 0.3, slip_speed: 0.3 };
    let (scene, instances) = (ball(2.0, [0.0; 3], numbers), 64);
    let end = |integrator: &str, dt: f64| -> Vec<State> {
        let options = SimulatorOptions { dt, instances, integrator: integrator.into(), ..Default::default() };
        let mut simulator = Simulator::new(scene.clone(), options).unwrap();
        for i in 0..instances {
            let height = 0.11 + 0.004 * i as f64 / instances as f64;
            let mut state = State { position: Vector3::new(0.0, 0.0, height), ..State::default() };
            state.twist = Vector6::new(0.3, 0.1, -0.5, 1.0, 2.0, 3.0);
            simulator.set_state(i, &state);
        }
        simulator.step(&Inputs::default(), (0.256 / dt).round() as usize).unwrap();
        (0..instances).map(|i| simulator.state(i)).collect()
    };
    let exact = end("mk4", 5e-5);
    for (integrator, order) in METHODS.into_iter().zip([2.0, 3.0]) {
        let errors = [4e-4, 2e-4, 1e-4].map(|dt| {
            let found = end(integrator, dt);
            let squares = exact.iter().zip(&found).map(|(exact, found)| crate::cases::distance(exact, found).powi(2));
            (squares.sum::<f64>() / instances as f64).sqrt()
        });
        let orders = [errors[0] / errors[1], errors[1] / errors[2]].map(f64::log2);
        println!("{integrator}: errors {errors:?}, orders {orders:?}");
        assert!(orders.iter().all(|found| (found - order).abs() < 0.15), "{integrator}: {errors:?} {orders:?}");
    }
}

/// No bounce gains energy at any step, whatever the phase of the impact in the step.
#[test]
fn bounces_on_a_stiff_floor_gain_no_energy() {
    let numbers = Numbers { stiffness: 5e5, dissipation: 2.0, ramp: 5e-4, friction: 0.4, slip_speed: 1e-3 };
    let scene = ball(10.0, [0.0, 0.0, -1.0], numbers);
    let model = ClosedFormModel::new(&scene).unwrap();
    let energy = |state: &State| model.at(state, Vector3::zeros()).energy().total();
    for integrator in METHODS {
        for dt in [0.005, 0.02, 0.05] {
            for phase in 0..20 {
                let position = Vector3::new(0.0, 0.0, 0.102 + 0.3 * dt * f64::from(phase) / 20.0);
                let twist = Vector6::new(0.1, 0.0, -0.3, 0.0, 0.0, 0.0);
                let state = State { position, twist, ..State::default() };
                let mut simulator = simulator(&scene, &state, integrator, dt);
                let (start, mut most) = (energy(&state), f64::MIN);
                for _ in 0..(2.0 / dt) as usize {
                    simulator.step(&Inputs::default(), 1).unwrap();
                    most = most.max(energy(&simulator.state(0)));
                }
                let gain = (most - start) / (0.5 * 10.0 * 0.1);
                assert!(gain < 0.01, "{integrator} at {dt} s, phase {phase}: gains {gain}");
            }
        }
    }
}
