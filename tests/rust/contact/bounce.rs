//! A ball that bounces off a floor.

use nalgebra::Vector3;
use uvms_gym::batch::{Inputs, Simulator, SimulatorOptions};
use uvms_gym::system::State;

use super::scenes::{Numbers, ball};

const RADIUS: f64 = 0.1;

/// Exit speed by `v_i - ln(1 + d v_i)/d = -v_o - ln(1 - d v_o)/d`, by bisection.
fn exit_speed(entry: f64, dissipation: f64) -> f64 {
    let loss = |v: f64| -v - (-dissipation * v).ln_1p() / dissipation;
    let target = entry - (dissipation * entry).ln_1p() / dissipation;
    let (mut low, mut high) = (0.0, (1.0 / dissipation).min(entry));
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if loss(middle) < target { low = middle } else { high = middle }
    }
    low
}

/// Deepest point: `k S(x) = m (v_i/d - ln(1 + d v_i)/d^2)` with `S = x^2/2 - e x/2 + 3 e^2/20` beyond the ramp.
fn deepest(mass: f64, entry: f64, numbers: Numbers) -> f64 {
    let Numbers { stiffness, dissipation: d, ramp: e, .. } = numbers;
    let work = mass * (entry / d - (d * entry).ln_1p() / (d * d)) / stiffness;
    // Roots of x^2/2 - e x/2 + 3 e^2/20 - work.
    0.5 * e + (0.25 * e * e - 2.0 * (0.15 * e * e - work)).sqrt()
}

/// Exit speed and deepest point of a ball thrown at the floor, with steps of `dt`.
fn bounce(mass: f64, entry: f64, numbers: Numbers, integrator: &str, dt: f64) -> (f64, f64) {
    let scene = ball(mass, [0.0; 3], numbers);
    let options = SimulatorOptions { integrator: integrator.into(), dt, ..SimulatorOptions::default() };
    let mut simulator = Simulator::new(scene, options).unwrap();
    let mut state = State { position: Vector3::new(0.3, -0.2, RADIUS + 1e-3), ..State::default() };
    state.twist[2] = -entry;
    simulator.set_state(0, &state);
    let mut lowest: Vec<(f64, f64)> = Vec::new();
    for _ in 0..100_000 {
        simulator.step(&Inputs::default(), 1).unwrap();
        let state = simulator.state(0);
        lowest.push((RADIUS - state.position.z, state.twist[2]));
        if state.twist[2] > 0.0 && state.position.z > RADIUS + 1e-4 {
            break;
        }
    }
    // Between two steps of opposite speed: the parabola through depth and speed.
    let turn = lowest.windows(2).find(|pair| pair[0].1 <= 0.0 && pair[1].1 > 0.0).unwrap();
    let ((x, v), (_, w)) = (turn[0], turn[1]);
    (simulator.state(0).twist[2], x + 0.5 * v * v / (w - v) * dt)
}

const CASES: [(f64, f64, Numbers); 3] = [
    (0.5, 0.2, Numbers { stiffness: 5000.0, dissipation: 2.0, ramp: 0.001, friction: 0.4, slip_speed: 0.01 }),
    (20.0, 0.5, Numbers { stiffness: 40000.0, dissipation: 1.0, ramp: 0.0005, friction: 0.0, slip_speed: 0.01 }),
    (1.0, 0.1, Numbers { stiffness: 2000.0, dissipation: 20.0, ramp: 0.0003, friction: 0.2, slip_speed: 0.01 }),
];

#[test]
fn val_exit_speed_and_deepest_point_are_those_of_the_closed_form() {
    for (mass, entry, numbers) in CASES {
        let expected = (exit_speed(entry, numbers.dissipation), deepest(mass, entry, numbers));
        let (speed, depth) = bounce(mass, entry, numbers, "mk4", 2e-6);
        println!("{numbers:?}: exit {speed} {} depth {depth} {}", expected.0, expected.1);
        assert!((speed / expected.0 - 1.0).abs() < 1e-8, "{numbers:?}: exit speed {speed}, not {}", expected.0);
        assert!((depth / expected.1 - 1.0).abs() < 1e-8, "{numbers:?}: depth {depth}, not {}", expected.1);
    }
}
