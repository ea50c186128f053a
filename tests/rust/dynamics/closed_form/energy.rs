//! Laws of energy, momentum and power.

use nalgebra::{DVector, SVector, Vector1, Vector3, Vector6};
use uvms_gym::description::Scene;
use uvms_gym::dynamics::{ClosedForm, ClosedFormModel, Loads, relative_to_water};
use uvms_gym::system::State;

use super::motion::advance;
use crate::cases::{RandomLoads, current, lossless, scene, scenes, vacuum, velocities};
use crate::random_scene::random_state;

const H: f64 = 1e-5;

/// Rate of `quantity` along the motion of the system under `loads`.
fn rate<const N: usize>(
    model: &ClosedFormModel,
    state: &State,
    accelerations: &DVector<f64>,
    quantity: impl Fn(&ClosedForm) -> SVector<f64, N>,
) -> SVector<f64, N> {
    let at = |dt| quantity(&model.at(&advance(state, accelerations, dt), Vector3::zeros()));
    (at(H) - at(-H)) / (2.0 * H)
}

#[test]
fn energy_changes_by_the_powers_put_in() {
    let (mut entries, mut elastic) = (Vector6::zeros(), 0.0);
    for (seed, mut scene) in scenes() {
        for held in [false, true] {
            scene.vehicle.fixed = held;
            let model = ClosedFormModel::new(&scene).unwrap();
            let state = random_state(seed, &scene);
            let random = RandomLoads::new(seed, &scene);
            let form = model.at(&state, Vector3::zeros());
            let accelerations = form.accelerations(&random.loads()).unwrap();
            let power = form.power(&random.loads()).unwrap();
            let energy = rate(&model, &state, &accelerations, |form| Vector1::new(form.energy().total()));
            let parts =
                [power.damping, power.friction, power.end_stop, power.thrust, power.external, power.joint_command];
            let scale = 1.0 + parts.map(f64::abs).iter().sum::<f64>();
            assert!((energy.x - power.total()).abs() < 1e-7 * scale, "{seed}: {} {}", energy.x, power.total());
            assert!(power.damping <= 0.0 && power.friction <= 0.0 && power.end_stop <= 0.0, "losses are losses");
            entries += Vector6::from(parts).abs();
            elastic += form.energy().elastic;
        }
    }
    assert!(entries.min() > 0.1 && elastic > 0.1, "no entry of the books was empty: {entries} {elastic}");
}

#[test]
fn energy_balances_in_a_current_for_an_observer_who_drifts_with_it() {
    for (seed, scene) in scenes() {
        let model = ClosedFormModel::new(&scene).unwrap();
        let state = random_state(seed, &scene);
        let random = RandomLoads::new(seed, &scene);
        let accelerations = model.at(&state, current()).accelerations(&random.loads()).unwrap();
        let energy = |dt| {
            let seen = relative_to_water(&advance(&state, &accelerations, dt), &current());
            model.at(&seen, Vector3::zeros()).energy().total()
        };
        let rate = (energy(H) - energy(-H)) / (2.0 * H);
        let still = model.at(&relative_to_water(&state, &current()), Vector3::zeros());
        let power = still.power(&random.loads()).unwrap().total();
        assert!((rate - power).abs() < 1e-7 * power.abs().max(100.0), "{seed}: {rate} {power}");
    }
}

#[test]
fn kinetic_energy_is_half_the_mass_matrix_form() {
    for (seed, scene) in scenes() {
        let model = ClosedFormModel::new(&scene).unwrap();
        let state = random_state(seed, &scene);
        let form = model.at(&state, Vector3::zeros());
        let nu = velocities(&state, form.joints());
        let energy = form.energy();
        let expected = 0.5 * nu.dot(&(form.mass_matrix() * &nu));
        assert!((energy.kinetic_rigid + energy.kinetic_added - expected).abs() < 1e-13 * expected);
    }
}

#[test]
fn momentum_is_conserved_without_water() {
    for (seed, scene) in scenes() {
        conserves(seed, &vacuum(&scene), |form| form.momentum().rigid, |form| form.momentum().rigid_scale);
    }
}

#[test]
fn impulse_is_conserved_in_still_water_without_damping_and_gravity() {
    for (seed, scene) in scenes() {
        let scene = lossless(&scene);
        conserves(seed, &scene, |form| form.momentum().total(), |form| form.momentum().total_scale);
    }
}

/// With any motion of the joints.
fn conserves(
    seed: u64,
    scene: &Scene,
    momentum: impl Fn(&ClosedForm) -> Vector6<f64>,
    scale: impl Fn(&ClosedForm) -> [f64; 2],
) {
    let model = ClosedFormModel::new(scene).unwrap();
    let state = random_state(seed, scene);
    let random = RandomLoads::new(seed, scene);
    let form = model.at(&state, Vector3::zeros());
    let loads = Loads { joint_command: &random.joint_command, ..Loads::default() };
    let accelerations = form.accelerations(&loads).unwrap();
    let drift = rate(&model, &state, &accelerations, &momentum);
    let total = momentum(&form);
    for (part, scale) in scale(&form).into_iter().enumerate() {
        assert!(drift.fixed_rows::<3>(3 * part).norm() < 1e-8 * scale, "{seed}: {drift}");
        let length = total.fixed_rows::<3>(3 * part).norm();
        assert!(length > 0.1 && length <= scale * (1.0 + 1e-15), "there is momentum to lose, and the scale bounds it");
    }
}

#[test]
fn momentum_changes_by_the_wrench_about_the_world_origin() {
    let scene = lossless(&scene(true));
    let model = ClosedFormModel::new(&scene).unwrap();
    let state = random_state(6, &scene);
    let random = RandomLoads::new(6, &scene);
    let form = model.at(&state, Vector3::zeros());
    let loads = Loads { thrust: &[], ..random.loads() };
    let accelerations = form.accelerations(&loads).unwrap();
    let drift = rate(&model, &state, &accelerations, |form| form.momentum().total());
    let wrench: Vector6<f64> =
        form.body_poses().iter().zip(&random.external).map(|(pose, wrench)| pose.wrench_to_parent(wrench)).sum();
    assert!((drift - wrench).norm() < 1e-7 * wrench.norm());
}

#[test]
fn energy_and_impulse_of_the_water_depend_on_the_relative_twist() {
    for (seed, scene) in scenes() {
        let scene = lossless(&scene);
        let model = ClosedFormModel::new(&scene).unwrap();
        let state = random_state(seed, &scene);
        let (flowing, seen) = (model.at(&state, current()), relative_to_water(&state, &current()));
        let still = model.at(&seen, Vector3::zeros());
        let energies = [flowing.energy().kinetic_added, still.energy().kinetic_added];
        assert!((energies[0] - energies[1]).abs() < 1e-13 * energies[1]);
        // Linear impulse is conserved in a current too; angular is not, the water's being left behind.
        let accelerations = flowing.accelerations(&Loads::default()).unwrap();
        let impulse = |dt| model.at(&advance(&state, &accelerations, dt), current()).momentum().total();
        let drift = (impulse(H) - impulse(-H)) / (2.0 * H);
        assert!(drift.fixed_rows::<3>(0).norm() < 1e-8 * flowing.momentum().total_scale[0]);
    }
}
