//! Bounces between stiff end stops, against their closed form.

use std::f64::consts::PI;

use uvms_gym::batch::{Inputs, Simulator, SimulatorOptions};
use uvms_gym::description::Scene;
use uvms_gym::system::State;

use crate::cases::PRECISIONS;

const INERTIA: f64 = 0.2;
const LIMIT: f64 = 0.5;
const SPEED: f64 = 5.0;
const DT: f64 = 0.002;

/// A link between two stops without friction, whose frequency times the step is `turn`.
fn link(turn: f64, damping: f64) -> Scene {
    let stiffness = INERTIA * (turn / DT).powi(2);
    let text = format!(
        "name = 'link'\nwater = {{ density = 0.0, gravity = [0.0, 0.0, 0.0] }}\n[vehicle]\nname = 'base'\nfixed = true\n\
         body = {{ mass = 1.0, inertia = [1.0, 1.0, 1.0] }}\n[arm]\nname = 'arm'\n[[arm.links]]\nname = 'link'\n\
         body = {{ mass = 0.5, inertia = [{INERTIA}, {INERTIA}, {INERTIA}] }}\n[arm.links.joint]\nkind = 'revolute'\n\
         axis = [0.0, 0.0, 1.0]\nlimits = {{ lower = -{LIMIT}, upper = {LIMIT}, stiffness = {stiffness:e}, damping = {:e} }}\n",
        damping * stiffness,
    );
    Scene::from_toml_str(&text, "link").unwrap()
}

/// State from the middle at an instance's speed.
fn start(i: usize) -> State {
    let mut state = State::default();
    state.qd[0] = SPEED * (1.0 - 0.1 * i as f64);
    state
}

fn simulator(scene: &Scene, integrator: &str, options: SimulatorOptions) -> Simulator {
    let options = SimulatorOptions { integrator: integrator.into(), dt: DT, error_estimate: Some(true), ..options };
    let mut simulator = Simulator::new(scene.clone(), options).unwrap();
    (0..simulator.instances()).for_each(|i| simulator.set_state(i, &start(i)));
    simulator
}

/// Coordinate at a time: from stop to stop at constant speed, and half an oscillation at each.
fn exact(turn: f64, t: f64) -> f64 {
    let (frequency, way) = (turn / DT, 2.0 * LIMIT / SPEED);
    let half = way + PI / frequency;
    let since = t + 0.5 * way;
    let (passed, side) = (since % half, if ((since / half) as u64).is_multiple_of(2) { 1.0 } else { -1.0 });
    let depth = SPEED / frequency * (frequency * (passed - way)).sin();
    side * if passed < way { SPEED * passed - LIMIT } else { LIMIT + depth }
}

/// Steps that lose a bounce lose it whatever their size: the estimate has to see it all the same.
#[test]
fn val_bounces_are_right_or_their_errors_said_to_be_unknown() {
    for integrator in ["ros2", "ros3"] {
        for turn in [0.05, 1.5, 4.0, 30.0] {
            let mut s = simulator(&link(turn, 0.0), integrator, SimulatorOptions::default());
            for part in 1..=10 {
                s.step(&Inputs::default(), 50).unwrap();
                let error = (s.state(0).q[0] - exact(turn, 0.1 * f64::from(part))).abs();
                let estimate = s.error_estimate(0).unwrap();
                println!("{integrator} {turn} {part}: {error:.3} rad, {} {}", estimate.relative, estimate.known());
                assert!(error < 0.2 || !estimate.known(), "{integrator} {turn}: {error} rad, {estimate:?}");
                assert!(
                    turn > 0.1 || error < 0.02 && estimate.known(),
                    "{integrator} {turn}: {error} rad, {estimate:?}"
                );
            }
            assert_eq!(s.warn_of_motion().is_some(), turn > 0.1, "{integrator} {turn}");
        }
    }
}

/// A damped stop against which a joint is pressed ends its bounces: nothing is lost.
#[test]
fn bounces_that_end_are_known() {
    for integrator in ["ros2", "ros3"] {
        for turn in [4.0, 30.0] {
            let mut s = simulator(&link(turn, 1.0), integrator, SimulatorOptions::default());
            for _ in 0..300 {
                s.step(&Inputs { joint_torque: Some(&[3.0]), ..Inputs::default() }, 5).unwrap();
            }
            let (state, estimate) = (s.state(0), s.error_estimate(0).unwrap());
            assert!((state.q[0] - LIMIT).abs() < 1e-3 && state.qd[0].abs() < 0.1, "{integrator} {turn}: {state:?}");
            assert!(estimate.known(), "{integrator} {turn}: {estimate:?}");
        }
    }
}

#[test]
fn bounces_of_an_instance_do_not_depend_on_others() {
    for precision in PRECISIONS {
        let run = |instances| {
            let options = SimulatorOptions { instances, precision, ..SimulatorOptions::default() };
            let mut s = simulator(&link(4.0, 0.1), "ros2", options);
            s.step(&Inputs::default(), 130).unwrap();
            (s.state(0), s.error_estimate(0))
        };
        let one = run(1);
        assert_eq!(one, run(5), "{precision:?}");
        assert!(!one.1.unwrap().known(), "{precision:?}");
    }
}
