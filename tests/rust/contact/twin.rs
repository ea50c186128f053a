//! The kernel against the dense twin, in all lanes that the batch tests do not see.

use nalgebra::Vector3;
use uvms_gym::batch::{Inputs, Simulator, SimulatorOptions};
use uvms_gym::description::{Detent, Fixture, JointSpring};
use uvms_gym::dynamics::aba::ArmLoads;
use uvms_gym::dynamics::{ClosedFormModel, Loads, linearize};
use uvms_gym::system::{Flow, JOINTS, State, compile};

use super::scenes::wrestling;
use crate::random_scene::{Random, random_state};

/// Random states near the shapes.
pub fn states(count: u64) -> Vec<State> {
    let scene = wrestling();
    let near = |seed| {
        let mut random = Random::new(seed ^ 0xC0);
        let mut state = random_state(seed, &scene);
        state.position = Vector3::new(0.2, 0.1, 0.1) + random.vector(0.3);
        state
    };
    (0..count).map(near).collect()
}

#[test]
fn accelerations_are_those_of_the_twin() {
    let mut scene = wrestling();
    assert!(!scene.fixtures.is_empty());
    for Fixture { joint, .. } in &mut scene.fixtures {
        joint.spring = Some(JointSpring { stiffness: 3.0, rest: 0.4 });
        joint.detent = Some(Detent { torque: 0.5, period: 0.6, offset: 0.1 });
        joint.friction.break_away = Some(joint.friction.coulomb + 0.3);
        joint.friction.stribeck_speed = Some(0.2);
    }
    let (model, states) = (ClosedFormModel::new(&scene).unwrap(), states(40));
    let flow = Flow { velocity: Vector3::new(0.1, -0.2, 0.05), acceleration: Vector3::new(0.02, 0.01, -0.03) };
    let options = SimulatorOptions { instances: states.len(), ..SimulatorOptions::default() };
    let mut simulator = Simulator::new(scene.clone(), options).unwrap();
    for (i, state) in states.iter().enumerate() {
        simulator.set_state(i, state);
        simulator.set_flow(i, flow);
    }
    let kernel = simulator.forward_dynamics(&Inputs::default()).unwrap();
    let (mut touching, width) = ([0; 4], kernel.len() / states.len());
    for (state, kernel) in states.iter().zip(kernel.chunks_exact(width)) {
        let form = model.at(state, flow);
        let mut twin = form.accelerations(&Loads::default()).unwrap().as_slice().to_vec();
        twin.extend(form.fixture_accelerations(&[]).unwrap());
        for contact in form.contacts() {
            touching[contact.shape] += usize::from(contact.depth > 0.0);
        }
        let scale = twin.iter().fold(1.0, |scale, x| f64::max(scale, x.abs()));
        for (k, (kernel, twin)) in kernel.iter().zip(&twin).enumerate() {
            assert!((kernel - twin).abs() < 1e-11 * scale, "entry {k}: {kernel}, twin {twin}");
        }
    }
    println!("contacts of each shape: {touching:?}");
    assert!(touching.iter().all(|count| *count > 5), "{touching:?}");
}

/// Differences of the kernel's accelerations along the entries of A.
#[test]
fn linearization_contains_contacts() {
    let scene = wrestling();
    let (compiled, n) = (compile(&scene), scene.coordinates().count());
    let mut simulator = Simulator::new(scene.clone(), SimulatorOptions::default()).unwrap();
    for state in states(6) {
        let fins = compiled.system.terms.deflections();
        let linear = linearize(&compiled.system, &state, &Vector3::zeros().into(), &[0.0; 6], &fins, &ArmLoads::none());
        let mut accelerations = |state: &State| {
            simulator.set_state(0, state);
            simulator.forward_dynamics(&Inputs::default()).unwrap()
        };
        for k in 0..n.min(JOINTS) {
            let h = 1e-6;
            let mut at = |step: f64| {
                let mut moved = state.clone();
                moved.q[k] += step;
                accelerations(&moved)
            };
            let (after, before) = (at(h), at(-h));
            for row in 0..6 + n {
                let (slope, exact) = ((after[row] - before[row]) / (2.0 * h), linear.a[(6 + n + row, 6 + k)]);
                assert!(
                    (slope - exact).abs() < 1e-4 * (1.0 + exact.abs() + 1e-2 * after[row].abs()),
                    "{row} by joint {k}: {exact}, {slope}"
                );
            }
        }
    }
}
