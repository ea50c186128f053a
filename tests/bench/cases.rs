//! What the benchmarks step.

use uvms_gym::batch::{Inputs, Precision, Simulator, SimulatorOptions};
use uvms_gym::description::Scene;
use uvms_gym::system::State;

/// A batch in motion and the thrusts that drive it, on one thread.
pub struct Case {
    simulator: Simulator,
    thrust: Vec<f64>,
}

impl Case {
    /// `instances` of a shipped scene, each with a motion of its own.
    pub fn new(scene: &str, precision: Precision, integrator: &str, instances: usize) -> Self {
        let scene = Scene::shipped(scene).expect("shipped");
        let integrator = integrator.to_owned();
        // Without companions: the kernel by itself.
        let (threads, error_estimate) = (Some(1), Some(false));
        let options = SimulatorOptions {
            instances,
            precision,
            integrator,
            threads,
            error_estimate,
            ..SimulatorOptions::default()
        };
        let (home, thrusters) = (scene.home(), scene.vehicle.thrusters.len());
        let mut simulator = Simulator::new(scene, options).expect("shipped scenes compose");
        for i in 0..instances {
            let mut state = State { q: home, ..State::default() };
            for k in 0..6 {
                state.twist[k] = 0.1 * ((7 * i + 3 * k) as f64).sin();
            }
            simulator.set_state(i, &state);
        }
        let thrust = (0..instances * thrusters).map(|k| 2.0 * (k as f64).cos()).collect();
        Self { simulator, thrust }
    }

    /// Steps all instances.
    pub fn step(&mut self, substeps: usize) {
        let inputs = Inputs { thrust: Some(&self.thrust), ..Inputs::default() };
        self.simulator.step(&inputs, substeps).expect("inputs fit");
    }

    /// Refuses a motion that has left the finite numbers: NaN is fast.
    pub fn check(&self) {
        for i in 0..self.simulator.instances() {
            let State { position, twist, qd, .. } = self.simulator.state(i);
            assert!(position.iter().chain(twist.iter()).chain(&qd).all(|x| x.is_finite()), "instance {i}");
        }
    }
}

/// Both precisions, by name.
pub const PRECISIONS: [(&str, Precision); 2] = [("f64", Precision::Double), ("f32", Precision::Single)];
