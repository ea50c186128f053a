//! Compare integrators: errors of a second of motion at a step of 10 ms, against steps of 0.1 ms.

use uvms_gym::batch::{Inputs, Simulator, SimulatorOptions};
use uvms_gym::description::Scene;
use uvms_gym::integrate::{Integrator, IntegratorKind};
use uvms_gym::system::State;

/// State after a second in which the thrusters turn the vehicle and the arm falls.
fn end(integrator: &str, dt: f64) -> Result<State, Box<dyn std::error::Error>> {
    let options = SimulatorOptions { dt, integrator: integrator.into(), ..Default::default() };
    let mut simulator = Simulator::new(Scene::load("bluerov2-heavy-alpha5")?, options)?;
    let wrench = [20.0, 0.0, 0.0, 0.0, 0.0, 4.0];
    simulator.step(&Inputs { wrench: Some(&wrench), ..Inputs::default() }, (1.0 / dt).round() as usize)?;
    Ok(simulator.state(0))
}

pub fn main() -> Result<(), Box<dyn std::error::Error>> {
    let reference = end("mk4", 1e-4)?;
    for entry in Integrator::NAMES.iter().filter(|entry| entry.kind == IntegratorKind::Production) {
        let error = |state: State| (state.position - reference.position).norm();
        let errors = [error(end(entry.name, 0.02)?), error(end(entry.name, 0.01)?)];
        println!(
            "{:6} order {}: {:.1e} m at 20 ms, {:.1e} m at 10 ms",
            entry.name,
            entry.integrator.order(),
            errors[0],
            errors[1]
        );
        assert!(errors[1] < 1e-2, "{}: {:.1e} m", entry.name, errors[1]);
    }
    Ok(())
}
