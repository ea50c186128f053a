//! The linearly implicit method: its kernel against dense matrices, its order, and stiff cases.

mod kernel;
mod order;
mod scenes;
mod stiff;

use uvms_gym::batch::{Inputs, Precision, Simulator, SimulatorOptions};
use uvms_gym::description::Scene;
use uvms_gym::system::State;

/// One instance of a scene at a state.
fn simulator(scene: &Scene, integrator: &str, dt: f64, precision: Precision, state: &State) -> Simulator {
    let options = SimulatorOptions { integrator: integrator.into(), dt, precision, ..SimulatorOptions::default() };
    let mut simulator = Simulator::new(scene.clone(), options).unwrap();
    simulator.set_state(0, state);
    simulator
}

/// The state after `steps` steps under `inputs`.
fn run(scene: &Scene, integrator: &str, dt: f64, state: &State, inputs: &Inputs, steps: usize) -> State {
    let mut simulator = simulator(scene, integrator, dt, Precision::Double, state);
    simulator.step(inputs, steps).unwrap();
    simulator.state(0)
}

/// Maximum difference of any entry of two states; infinite where one is not a number.
fn distance(a: &State, b: &State) -> f64 {
    let joints = a.q.iter().chain(&a.qd).zip(b.q.iter().chain(&b.qd)).map(|(x, y)| (x - y).abs());
    let vehicle = [(a.position - b.position).amax(), (a.rotation - b.rotation).amax(), (a.twist - b.twist).amax()];
    joints.chain(vehicle).fold(0.0, |maximum, x| if x <= maximum { maximum } else { x })
}
