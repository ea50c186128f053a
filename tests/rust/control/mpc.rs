//! Model predictive control: the plan is the best one within the limits.

use nalgebra::{DVector, Vector6};
use proptest::prelude::*;
use uvms_gym::control::mpc::model::{LinearModel, MOVES};
use uvms_gym::control::mpc::{Mpc, PARAMETERS, PLAN};
use uvms_gym::control::{ActionKind, ActionMap, Allocation, MpcGains, Observer, ObserverGains};
use uvms_gym::description::Scene;

fn observer(scene: &Scene) -> Observer {
    Observer::new(ObserverGains::default(), 0.0, scene, 0.1)
}

fn mpc(name: &str) -> Mpc {
    let scene = Scene::shipped(name).unwrap();
    let actions = ActionMap::new(ActionKind::Wrench, Allocation::new(&scene.vehicle).unwrap(), Vec::new());
    Mpc::new(MpcGains::default(), &scene, &observer(&scene), &actions)
}

fn model(mpc: &Mpc, name: &str) -> LinearModel {
    let scene = Scene::shipped(name).unwrap();
    LinearModel::new(observer(&scene).plant(), &scene.home(), mpc.unit, mpc.gains(), 0.1)
}

fn cost(model: &LinearModel, plan: &DVector<f64>, parameters: &DVector<f64>) -> f64 {
    model.residuals(plan.as_slice(), parameters.as_slice()).iter().map(|x| x * x).sum()
}

/// Errors up to 1 m and 1 rad, speeds up to 0.5, wrenches up to 100.
fn parameters() -> impl Strategy<Value = DVector<f64>> {
    prop::collection::vec(-1.0..1.0f64, PARAMETERS).prop_map(|mut all| {
        all[6..12].iter_mut().for_each(|x| *x *= 0.5);
        all[12..].iter_mut().for_each(|x| *x *= 100.0);
        DVector::from_vec(all)
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn no_plan_within_the_limits_costs_less(
        name in prop::sample::select(vec!["petasus-pum", "bluerov2-heavy", "bluerov2-heavy-alpha5"]),
        parameters in parameters(),
        other in prop::collection::vec(-1.0..1.0f64, PLAN),
    ) {
        let mpc = mpc(name);
        let model = model(&mpc, name);
        let free = &mpc.gain * &parameters;
        let best = mpc.solve(&(&mpc.cross * &parameters)).unwrap();
        let over = |plan: &DVector<f64>| {
            (0..MOVES.len()).map(|k| (&mpc.bounds * plan.rows(6 * k, 6)).max()).fold(0.0, f64::max)
        };
        prop_assert!(over(&best) < 1.0 + 1e-6, "{}", over(&best));
        let minimum = cost(&model, &best, &parameters);
        prop_assert!(cost(&model, &free, &parameters) <= minimum * (1.0 + 1e-9));
        if over(&free) < 0.99 {
            prop_assert!((&free - &best).amax() < 1e-4, "{}", (&free - &best).amax());
        }
        for plan in [free, DVector::from_vec(other), DVector::zeros(PLAN)] {
            let plan = &plan / over(&plan).max(1.0);
            prop_assert!(minimum <= cost(&model, &plan, &parameters) * (1.0 + 1e-6) + 1e-9);
            // On the way there, too.
            let near = &best + (plan - &best) * 1e-3;
            prop_assert!(minimum <= cost(&model, &near, &parameters) * (1.0 + 1e-6) + 1e-9);
        }
    }
}

#[test]
fn at_rest_on_target_the_plan_is_to_hold_against_what_disturbs() {
    let mpc = mpc("petasus-pum");
    let mut parameters = DVector::zeros(PARAMETERS);
    let besides = [20.0, -10.0, 15.0, 2.0, -3.0, 1.0];
    for k in 0..6 {
        (parameters[12 + k], parameters[18 + k], parameters[24 + k]) = (-besides[k], -besides[k], besides[k]);
    }
    let wrench = mpc.plan(&parameters);
    assert!((wrench + Vector6::from(besides)).amax() < 1e-6, "{wrench}");
}
