//! Reflected rotor inertia of joints over whole motions.

use uvms_gym::description::Scene;
use uvms_gym::system::State;

use crate::cases::{distance, drift, lossless, orders, simulator_at, tumbling};

/// A tumbling vehicle whose arm moves freely, without losses and gravity; every joint has the same rotor inertia, kg m2.
fn tumbling_with_rotors(inertia: f64) -> (Scene, State) {
    let (scene, state) = tumbling(false);
    let mut scene = lossless(&scene);
    scene.arm.as_mut().unwrap().links.iter_mut().for_each(|link| link.joint.rotor_inertia = inertia);
    (scene, state)
}

fn energy(scene: &Scene, state: &State) -> f64 {
    simulator_at(scene, "mk4", 0.01, state).closed_form(0, |form| form.energy().total())
}

#[test]
fn energy_of_rotors_is_conserved_with_that_of_the_bodies() {
    let (scene, state) = tumbling_with_rotors(0.2);
    let start = energy(&scene, &state);
    // Over 1 s.
    let end = |dt: f64| drift(&scene, "mk4", dt, &state, (1.0 / dt).round() as usize);
    let drifts = [0.01, 0.005].map(|dt| (energy(&scene, &end(dt)) / start - 1.0).abs());
    println!("relative change of the energy: {drifts:?}");
    assert!(drifts[0] < 1e-6 && drifts[1] < drifts[0] / 14.0, "{drifts:?}");
    // Rotors take part: without theirs the same start has another energy.
    let (scene, state) = tumbling_with_rotors(0.0);
    assert!((start - energy(&scene, &state)) / start > 1e-3);
}

#[test]
fn integrators_keep_their_order_with_rotors() {
    let (scene, state) = tumbling_with_rotors(0.2);
    let end = drift(&scene, "mk4", 1.0 / 4096.0, &state, 4096);
    for (integrator, order) in [("mk4", 4), ("ros2", 2)] {
        let errors =
            [128, 256].map(|steps| distance(&end, &drift(&scene, integrator, 1.0 / steps as f64, &state, steps)));
        let observed = orders(&errors)[0];
        println!("{integrator}: {errors:?}, order {observed:.2}");
        assert!((observed - f64::from(order)).abs() < 0.2, "{integrator}: {observed}");
    }
}
