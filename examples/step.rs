//! Step a scene: a BlueROV2 with an arm under forward thrust for two seconds.

use uvms_gym::batch::{Inputs, Simulator, SimulatorOptions};
use uvms_gym::description::Scene;

pub fn main() -> Result<(), Box<dyn std::error::Error>> {
    // A scene that comes with the crate, or the path of a TOML file.
    let scene = Scene::load("bluerov2-heavy-alpha5")?;
    let mut simulator = Simulator::new(scene, SimulatorOptions { instances: 2, dt: 0.01, ..Default::default() })?;

    // Inputs have one row per instance: 20 N forward on the first vehicle, none on the second.
    let mut wrench = [0.0; 12];
    wrench[0] = 20.0;
    simulator.step(&Inputs { wrench: Some(&wrench), ..Inputs::default() }, 200)?;

    for i in 0..simulator.instances() {
        let state = simulator.state(i);
        println!(
            "instance {i} at t = {:.2} s: x = {:.3} m, u = {:.3} m/s",
            state.time, state.position.x, state.twist[0]
        );
    }
    assert!(simulator.state(0).position.x > 0.5 && simulator.state(1).position.x.abs() < 0.1);

    // The closed form of the equations of motion at the present state: M [V'; q''] + C [V; q'] = W F + L tau.
    let energy = simulator.closed_form(0, |form| form.energy());
    println!("kinetic energy of the bodies of instance 0: {:.2} J", energy.kinetic_rigid);
    Ok(())
}
