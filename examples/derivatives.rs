//! Derivatives of a step: Jacobians by dual numbers, and a gradient by the adjoint, against a difference.

use uvms_gym::batch::{Argument, Inputs, Simulator, SimulatorOptions};
use uvms_gym::description::Scene;

const STEPS: usize = 50;

/// Vehicle's x after the steps under a wrench, m.
fn distance(wrench: &[f64; 6]) -> Result<f64, Box<dyn std::error::Error>> {
    let mut simulator = Simulator::new(Scene::load("bluerov2-heavy")?, SimulatorOptions::default())?;
    simulator.step(&Inputs { wrench: Some(wrench), ..Inputs::default() }, STEPS)?;
    Ok(simulator.state(0).position.x)
}

pub fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut simulator = Simulator::new(Scene::load("bluerov2-heavy")?, SimulatorOptions::default())?;
    let wrench = [30.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let inputs = Inputs { wrench: Some(&wrench), ..Inputs::default() };

    // Rows: coordinates of the next state, [xi; dq; dV; dq'; dT]. Columns: state, then each input given.
    let jacobians = simulator.step_jacobians(&inputs, STEPS, &[])?;
    let columns: usize = jacobians.arguments.iter().map(|(_, width)| width).sum();
    let before: usize = jacobians.arguments.iter().take_while(|(a, _)| *a != Argument::Wrench).map(|(_, w)| w).sum();
    let forward = jacobians.numbers[before];
    println!("{} x {columns} Jacobian; d x / d force = {forward:.6e} m/N", jacobians.size);

    // The same number from one reverse pass: the cotangent of x times the Jacobian.
    let mut cotangent = vec![0.0; jacobians.size];
    cotangent[0] = 1.0;
    let gradient = simulator.step_vjp(&inputs, STEPS, &[], &cotangent)?;
    assert!((gradient[before] / forward - 1.0).abs() < 1e-9);

    // xi is in body axes; the vehicle here moves along x without turning.
    let h = 1e-3;
    let difference =
        (distance(&[30.0 + h, 0.0, 0.0, 0.0, 0.0, 0.0])? - distance(&[30.0 - h, 0.0, 0.0, 0.0, 0.0, 0.0])?) / (2.0 * h);
    println!("difference: {difference:.6e} m/N");
    assert!((difference / forward - 1.0).abs() < 0.05);
    Ok(())
}
