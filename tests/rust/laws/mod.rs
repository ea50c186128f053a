//! Laws of physics and of convergence, on whole simulated motions.

mod adaptive;
mod baselines;
mod bodies;
mod end_stops;
mod energy;
mod flow;
mod joints;
mod links;
mod momentum;
mod order;
mod prescribed;
mod rotors;
mod stiffness;
mod table1;

use uvms_gym::batch::{Inputs, Simulator, SimulatorOptions};
use uvms_gym::description::Scene;
use uvms_gym::system::State;

/// One instance of a scene at a state.
fn simulator(scene: &Scene, integrator: &str, dt: f64, state: &State) -> Simulator {
    let options = SimulatorOptions { integrator: integrator.into(), dt, ..SimulatorOptions::default() };
    let mut simulator = Simulator::new(scene.clone(), options).unwrap();
    simulator.set_state(0, state);
    simulator
}

/// The state after `steps` free steps.
fn drift(scene: &Scene, integrator: &str, dt: f64, state: &State, steps: usize) -> State {
    let mut simulator = simulator(scene, integrator, dt, state);
    simulator.step(&Inputs::default(), steps).unwrap();
    simulator.state(0)
}

/// Maximum difference of any entry of two states.
fn distance(a: &State, b: &State) -> f64 {
    let joints = a.q.iter().chain(&a.qd).zip(b.q.iter().chain(&b.qd)).map(|(x, y)| (x - y).abs());
    let vehicle = [(a.position - b.position).amax(), (a.rotation - b.rotation).amax(), (a.twist - b.twist).amax()];
    joints.chain(vehicle).fold(0.0, |maximum, x| if x <= maximum { maximum } else { x })
}
