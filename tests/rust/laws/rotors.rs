//! Reflected rotor inertia of joints over whole motions.

use uvms_gym::description::Scene;
use uvms_gym::system::State;

use super::order::tumbling;
use super::{distance, drift, simulator};
use crate::cases::lossless;

/// A tumbling vehicle whose arm moves freely, without losses and gravity; every joint has the same rotor inertia, kg m2.
fn tumbling_with_rotors(inertia: f64) -> (Scene, State) {
    let (scene, state) = tumbling(false);
    let mut scene = lossless(&scene);
    scene.arm.as_mut().unwrap().links.iter_mut().for_each(|link| link.joint.rotor_inertia = inertia);
    (scene, state)
}

/// Relative change of the energy over 1 s.
fn energy_drift(inertia: f64, dt: f64) -> f64 {
    let (scene, state) = tumbling_with_rotors(inertia);
    let energy = |state: &State| simulator(&scene, "mk4", dt, state).closed_form(0, |form| form.energy().total());
    let end = drift(&scene, "mk4", dt, &state, (1.0 / dt).round() as usize);
    (energy(&end) / energy(&state) - 1.0).abs()
}

#[test]
fn energy_of_rotors_is_conserved_with_that_of_the_bodies() {
    let drifts = [0.01, 0.005].map(|dt| energy_drift(0.2, dt));
    println!("relative change of the energy: {drifts:?}");
    assert!(drifts[0] < 1e-6 && drifts[1] < drifts[0] / 14.0, "{drifts:?}");
    // Rotors take part: without theirs the same start has another energy.
    let of = |inertia: f64| {
        let (scene, state) = tumbling_with_rotors(inertia);
        simulator(&scene, "mk4", 0.01, &state).closed_form(0, |form| form.energy().total())
    };
    assert!((of(0.2) - of(0.0)) / of(0.2) > 1e-3);
}

#[test]
fn integrators_keep_their_order_with_rotors() {
    let (scene, state) = tumbling_with_rotors(0.2);
    let end = drift(&scene, "mk4", 1.0 / 4096.0, &state, 4096);
    for (integrator, order) in [("mk4", 4), ("ros2", 2)] {
        let errors =
            [128, 256].map(|steps| distance(&end, &drift(&scene, integrator, 1.0 / steps as f64, &state, steps)));
        let observed = (errors[0] / errors[1]).log2();
        println!("{integrator}: {errors:?}, order {observed:.2}");
        assert!((observed - f64::from(order)).abs() < 0.2, "{integrator}: {observed}");
    }
}
