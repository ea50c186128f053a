//! Fossen's form: `M nu' + C(nu) nu + D(nu) nu + g(eta) = tau`.

use nalgebra::{DMatrix, DVector, Vector3};
use uvms_gym::description::Scene;
use uvms_gym::dynamics::{ClosedForm, ClosedFormModel, FossenForm, Loads, relative_to_water};
use uvms_gym::system::{Flow, State};

use crate::cases::{RandomLoads, current, lossless, moved, scenes, velocities};
use crate::random_scene::{Options, random_scene, random_state};

/// Random scenes on a free vehicle, one on a fixed vehicle, and the shipped scenes.
fn all_scenes() -> impl Iterator<Item = (u64, Scene)> {
    let fixed = random_scene(40, Options { fixed: Some(true), links: Some(3), ..Options::default() });
    let shipped = Scene::shipped_names().into_iter().map(|name| Scene::shipped(name).unwrap());
    scenes().chain([(40, fixed)]).chain((50..).zip(shipped))
}

/// tau of the loads: thrusters, fins, tether, external wrenches and actuators.
fn tau(form: &ClosedForm, loads: &Loads) -> DVector<f64> {
    let wrenches = form.body_wrenches(loads).unwrap();
    let mut applied = wrenches.external.clone();
    applied[0] += wrenches.thrust + wrenches.terms.fins + wrenches.terms.tether;
    let stacked = DVector::from_iterator(6 * applied.len(), applied.iter().flatten().copied());
    form.wrench_influence() * stacked + form.torque_influence() * form.joint_torques(loads).unwrap().command
}

#[test]
fn val_fossens_form_holds_for_the_accelerations() {
    let flows = [
        Flow::from(Vector3::zeros()),
        Flow::from(current()),
        Flow { velocity: current(), acceleration: Vector3::new(-0.3, 0.2, 0.5) },
    ];
    for (seed, scene) in all_scenes() {
        let (model, state) = (ClosedFormModel::new(&scene).unwrap(), random_state(seed, &scene));
        let random = RandomLoads::new(seed, &scene);
        for flow in flows {
            let form = model.at(&state, flow);
            let mut rate = form.accelerations(&random.loads()).unwrap();
            let in_body = |v: &Vector3<f64>| state.rotation.tr_mul(v);
            let turning = state.twist.fixed_rows::<3>(3).cross(&in_body(&flow.velocity));
            let mut linear = rate.fixed_rows_mut::<3>(0);
            linear += turning - in_body(&flow.acceleration);
            let FossenForm { mass_matrix, coriolis, damping, restoring, .. } = form.fossen_form(None).unwrap();
            let terms = [&mass_matrix * &rate, coriolis, damping, restoring, -tau(&form, &random.loads())];
            let first = if scene.vehicle.fixed { 6 } else { 0 };
            let rows = |x: &DVector<f64>| x.rows(first, x.len() - first).into_owned();
            let residual = terms.iter().map(rows).sum::<DVector<f64>>().norm();
            let scale: f64 = terms.iter().map(|term| rows(term).norm()).sum();
            assert!(residual <= 1e-11 * scale, "{} {seed}: {residual:e} of {scale:e}", scene.name);
        }
    }
}

#[test]
fn val_coriolis_without_water_forces_is_the_closed_forms() {
    for (seed, scene) in scenes() {
        let scene = lossless(&scene);
        let (model, state) = (ClosedFormModel::new(&scene).unwrap(), random_state(seed, &scene));
        let form = model.at(&state, Vector3::zeros());
        let given = velocities(&state, form.joints());
        for terms in [form.fossen_form(None).unwrap(), form.fossen_form(Some(&given)).unwrap()] {
            assert_eq!(&terms.coriolis, form.bias());
            assert_eq!(&terms.mass_matrix, form.mass_matrix());
            let free = &terms.mass_matrix * form.accelerations(&Loads::default()).unwrap();
            assert!((&free + &terms.coriolis).norm() < 1e-12 * terms.coriolis.norm(), "{seed}");
            assert!(terms.damping.norm() + terms.restoring.norm() < 1e-12, "{seed}");
        }
    }
}

#[test]
fn val_damping_vanishes_at_rest_and_takes_the_lost_power() {
    for (seed, scene) in all_scenes() {
        let (model, state) = (ClosedFormModel::new(&scene).unwrap(), random_state(seed, &scene));
        let form = model.at(&state, current());
        let rest = form.fossen_form(Some(&DVector::zeros(6 + form.joints()))).unwrap();
        assert!(rest.damping.iter().chain(&rest.coriolis).all(|x| *x == 0.0), "{seed}");
        let seen = model.at(&relative_to_water(&state, &current()), Vector3::zeros());
        let power = seen.power(&Loads::default()).unwrap();
        let lost = power.damping + power.terms.forward_damping + power.friction + power.end_stop;
        let moving = form.fossen_form(None).unwrap();
        let taken = moving.velocity.dot(&moving.damping);
        assert!((taken + lost).abs() <= 1e-12 * lost.abs(), "{} {seed}: {taken} {lost}", scene.name);
    }
}

#[test]
fn val_restoring_is_the_gradient_of_the_potential_energy() {
    const H: f64 = 1e-5;
    for (seed, scene) in all_scenes() {
        let (model, state) = (ClosedFormModel::new(&scene).unwrap(), random_state(seed, &scene));
        let potential = |k: usize, h: f64| {
            let energy = model.at(&moved(&state, scene.joints().count(), k, h), Vector3::zeros()).energy();
            energy.potential + energy.elastic
        };
        let g = model.at(&state, current()).fossen_form(None).unwrap().restoring;
        let slope = DVector::from_fn(g.len(), |k, _| (potential(k, H) - potential(k, -H)) / (2.0 * H));
        let size = g.norm() + potential(0, 0.0).abs();
        assert!((&g - &slope).norm() <= 1e-7 * size, "{} {seed}: {g} {slope}", scene.name);
    }
}

#[test]
fn val_ned_axes_change_signs_of_rows_and_columns() {
    let scene = Scene::shipped("bluerov2-heavy-alpha5").unwrap();
    let (model, state) = (ClosedFormModel::new(&scene).unwrap(), random_state(0, &scene));
    let form = model.at(&state, current());
    let (flu, ned) = (form.fossen_form(None).unwrap(), form.fossen_form(None).unwrap().in_ned_axes());
    let signs = DVector::from_fn(6 + form.joints(), |k, _| if [1, 2, 4, 5].contains(&k) { -1.0 } else { 1.0 });
    let t = DMatrix::from_diagonal(&signs);
    assert_eq!(ned.mass_matrix, &t * &flu.mass_matrix * &t);
    assert_eq!(ned.velocity, &t * &flu.velocity);
    assert_eq!(ned.coriolis, &t * &flu.coriolis);
    assert_eq!(ned.damping, &t * &flu.damping);
    assert_eq!(ned.restoring, &t * &flu.restoring);
    assert!(form.fossen_form(Some(&DVector::zeros(5))).is_err());
}

/// The example of the notation page gives the terms that the page states, and the shipped scene's.
#[test]
fn val_documented_example_is_the_shipped_vehicle() {
    let page = include_str!("../../../../docs/fossen-notation.md");
    let table = page.split("```toml").nth(1).and_then(|rest| rest.split("```").next()).unwrap();
    let text = format!("name = \"example\"\n[water]\ndensity = 1000.0\ngravity = [0.0, 0.0, -9.81]\n{table}");
    let (scene, shipped) = (Scene::from_toml_str(&text, "example").unwrap(), Scene::shipped("bluerov2-heavy").unwrap());
    assert_eq!(scene.vehicle.body, shipped.vehicle.body);
    let model = ClosedFormModel::new(&scene).unwrap();
    let terms = model.at(&State::default(), Vector3::zeros()).fossen_form(None).unwrap().in_ned_axes();
    assert!((terms.mass_matrix[(0, 0)] - 19.0).abs() < 1e-12 && (terms.mass_matrix[(0, 4)] - 0.27).abs() < 1e-12);
    assert!((terms.restoring[2] - 2.0).abs() < 2e-3, "{}", terms.restoring);
    assert!(terms.restoring.iter().enumerate().all(|(k, g)| k == 2 || *g == 0.0), "{}", terms.restoring);
}
