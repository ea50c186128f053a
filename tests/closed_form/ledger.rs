//! Laws of the books: energy, momentum, power.

use nalgebra::{DVector, Vector3, Vector6};
use uvms_gym::balance::{Balance, Loads, seen_from_water};
use uvms_gym::description::Scene;
use uvms_gym::system::State;

use crate::awkward_scene::{LOADINGS, current, dry, for_joints, lossless, scene, state, vector6};
use crate::motion::advance;

const H: f64 = 1e-5;

/// The rate of `book` along the motion of the system under `loads`.
fn rate<const N: usize>(
    balance: &Balance,
    state: &State,
    accelerations: &DVector<f64>,
    book: impl Fn(&uvms_gym::balance::ClosedForm) -> nalgebra::SVector<f64, N>,
) -> nalgebra::SVector<f64, N> {
    let at = |dt| book(&balance.at(&advance(state, accelerations, dt), Vector3::zeros()));
    (at(H) - at(-H)) / (2.0 * H)
}

/// Everything pushes at once.
fn external(scene: &Scene) -> Vec<Vector6<f64>> {
    (0..=scene.joints().count()).map(|i| 10.0 * vector6(0.3 + i as f64)).collect()
}

#[test]
fn energy_changes_by_the_powers_put_in() {
    for loading in LOADINGS {
        for held in [false, true] {
            let mut scene = scene(loading);
            scene.vehicle.fixed = held;
            let balance = Balance::new(&scene).unwrap();
            let mut state = state(&scene, 0.0);
            if held {
                state.twist = Vector6::zeros();
            }
            let command: Vec<f64> = (0..scene.joints().count()).map(|i| 4.0 - 3.0 * i as f64).collect();
            let external = external(&scene);
            let loads = Loads { thrust: &[15.0, -8.0], external: &external, joint_command: &command };
            let form = balance.at(&state, Vector3::zeros());
            let accelerations = form.accelerations(&loads).unwrap();
            let power = form.power(&loads).unwrap();
            let energy = rate(&balance, &state, &accelerations, |form| nalgebra::Vector1::new(form.energy().total()));
            let scale = power.drag.abs() + power.external.abs() + power.joint_command.abs();
            assert!((energy.x - power.total()).abs() < 1e-7 * scale, "{} {}", energy.x, power.total());
            // No entry of the books is empty, and losses are losses.
            assert!(power.drag < 0.0 && power.friction < 0.0 && power.end_stop < 0.0);
            assert!(power.external != 0.0 && power.joint_command != 0.0 && (held || power.thrust != 0.0));
            assert!(form.energy().elastic > 0.0);
        }
    }
}

#[test]
fn energy_balances_in_a_current_for_an_observer_who_drifts_with_it() {
    for loading in LOADINGS {
        let scene = scene(loading);
        let balance = Balance::new(&scene).unwrap();
        let state = state(&scene, 3.5);
        let external = external(&scene);
        let loads = Loads { thrust: &[5.0, 9.0], external: &external, ..Loads::default() };
        let accelerations = balance.at(&state, current()).accelerations(&loads).unwrap();
        let energy = |dt| {
            let seen = seen_from_water(&advance(&state, &accelerations, dt), &current());
            balance.at(&seen, Vector3::zeros()).energy().total()
        };
        let rate = (energy(H) - energy(-H)) / (2.0 * H);
        let power = balance.at(&seen_from_water(&state, &current()), Vector3::zeros()).power(&loads).unwrap().total();
        assert!((rate - power).abs() < 1e-7 * power.abs().max(100.0), "{rate} {power}");
    }
}

#[test]
fn kinetic_energy_is_half_the_mass_matrix_form() {
    let scene = scene(LOADINGS[1]);
    let balance = Balance::new(&scene).unwrap();
    let state = state(&scene, 4.5);
    let n = scene.joints().count();
    let form = balance.at(&state, Vector3::zeros());
    let nu = DVector::from_iterator(6 + n, state.twist.iter().chain(&state.qd[..n]).copied());
    let energy = form.energy();
    let expected = 0.5 * nu.dot(&(form.mass_matrix() * &nu));
    assert!((energy.kinetic_rigid + energy.kinetic_added - expected).abs() < 1e-13 * expected);
}

#[test]
fn momentum_is_conserved_without_water() {
    for loading in LOADINGS {
        let scene = dry(&scene(loading));
        conserves(&scene, |form| form.momentum().rigid, |form| form.momentum().rigid_scale);
    }
}

#[test]
fn impulse_is_conserved_in_still_water_without_drag_and_gravity() {
    for loading in LOADINGS {
        let scene = lossless(&scene(loading));
        conserves(&scene, |form| form.momentum().total(), |form| form.momentum().total_scale);
    }
}

/// Whatever the joints do.
fn conserves(
    scene: &Scene,
    momentum: impl Fn(&uvms_gym::balance::ClosedForm) -> Vector6<f64>,
    scale: impl Fn(&uvms_gym::balance::ClosedForm) -> [f64; 2],
) {
    let balance = Balance::new(scene).unwrap();
    let state = state(scene, 5.5);
    let command: Vec<f64> = (0..scene.joints().count()).map(|i| 6.0 - 5.0 * i as f64).collect();
    let form = balance.at(&state, Vector3::zeros());
    let accelerations = form.accelerations(&Loads { joint_command: &command, ..Loads::default() }).unwrap();
    let drift = rate(&balance, &state, &accelerations, &momentum);
    let [linear, angular] = scale(&form);
    assert!(drift.fixed_rows::<3>(0).norm() < 1e-8 * linear, "{drift}");
    assert!(drift.fixed_rows::<3>(3).norm() < 1e-8 * angular, "{drift}");
    // There is momentum to lose, the scale bounds it, and the bodies do accelerate.
    let total = momentum(&form);
    assert!(total.fixed_rows::<3>(0).norm() > 0.1 && total.fixed_rows::<3>(0).norm() <= linear);
    assert!(total.fixed_rows::<3>(3).norm() > 0.1 && total.fixed_rows::<3>(3).norm() <= angular);
    assert!(accelerations.norm() > 1.0);
}

#[test]
fn momentum_changes_by_the_wrench_about_the_world_origin() {
    let mut scene = lossless(&scene(LOADINGS[1]));
    for_joints(&mut scene, |joint| joint.friction.viscous = 2.0);
    let balance = Balance::new(&scene).unwrap();
    let state = state(&scene, 6.5);
    let external = external(&scene);
    let form = balance.at(&state, Vector3::zeros());
    let accelerations = form.accelerations(&Loads { external: &external, ..Loads::default() }).unwrap();
    let drift = rate(&balance, &state, &accelerations, |form| form.momentum().total());
    let wrench: Vector6<f64> =
        form.body_poses().iter().zip(&external).map(|(pose, wrench)| pose.wrench_to_parent(wrench)).sum();
    assert!((drift - wrench).norm() < 1e-7 * wrench.norm());
}

#[test]
fn books_of_the_water_go_by_the_twist_relative_to_it() {
    for loading in LOADINGS {
        let scene = lossless(&scene(loading));
        let balance = Balance::new(&scene).unwrap();
        let state = state(&scene, 7.5);
        let (flowing, seen) = (balance.at(&state, current()), seen_from_water(&state, &current()));
        let still = balance.at(&seen, Vector3::zeros());
        let energies = [flowing.energy().kinetic_added, still.energy().kinetic_added];
        assert!((energies[0] - energies[1]).abs() < 1e-13 * energies[1]);
        // Linear impulse is conserved in a current too; angular is not, the water's being left behind.
        let accelerations = flowing.accelerations(&Loads::default()).unwrap();
        let impulse = |dt| balance.at(&advance(&state, &accelerations, dt), current()).momentum().total();
        let drift = (impulse(H) - impulse(-H)) / (2.0 * H);
        assert!(drift.fixed_rows::<3>(0).norm() < 1e-8 * flowing.momentum().total_scale[0]);
    }
}
