//! Model predictive control: the plan is the best one within the limits.

use nalgebra::{DVector, Vector6};
use proptest::prelude::*;
use uvms_gym::control::mpc::model::{LinearModel, MOVES};
use uvms_gym::control::mpc::{Mpc, PARAMETERS};
use uvms_gym::control::{MpcGains, Observer, ObserverGains};
use uvms_gym::description::Scene;

struct Case {
    mpc: Mpc,
    model: LinearModel,
}

fn case(name: &str) -> Case {
    let scene = Scene::shipped(name).unwrap();
    let observer = Observer::new(ObserverGains::default(), 0.0, &scene, 0.1);
    let (actions, gains) = (super::actions(&scene, &[]), MpcGains::default());
    let mpc = Mpc::new(&gains, &scene, &observer, &actions);
    let model = LinearModel::new(observer.model(), &scene.home(), actions.allocation().wrench_limits(), &gains, 0.1);
    Case { mpc, model }
}

impl Case {
    /// Cost of a plan, by its Hessians.
    fn cost(&self, plan: &DVector<f64>, parameters: &DVector<f64>) -> f64 {
        let idle = self.model.cost(&[0.0; 6 * MOVES.len()], parameters.as_slice());
        idle + plan.dot(&(&self.mpc.hessian * plan + 2.0 * (&self.mpc.cross * parameters)))
    }

    /// A plan from numbers in [-1, 1], within the limits.
    fn within(&self, numbers: &[f64]) -> DVector<f64> {
        let [lower, upper] = &self.mpc.bounds;
        DVector::from_fn(lower.len(), |k, _| numbers[k].max(lower[k]).min(upper[k]))
    }
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
        other in prop::collection::vec(-1.0..1.0f64, 64),
    ) {
        let case = case(name);
        let free = &case.mpc.gain * &parameters;
        let best = case.mpc.best(&parameters);
        prop_assert_eq!(&best, &case.within(best.as_slice()));
        let minimum = case.cost(&best, &parameters);
        prop_assert!(case.cost(&free, &parameters) <= minimum * (1.0 + 1e-9));
        for plan in [case.within(free.as_slice()), case.within(&other), DVector::zeros(best.len())] {
            prop_assert!(minimum <= case.cost(&plan, &parameters) * (1.0 + 1e-9) + 1e-9);
            // On the way there, too.
            let near = &best + (plan - &best) * 1e-3;
            prop_assert!(minimum <= case.cost(&near, &parameters) * (1.0 + 1e-9) + 1e-9);
        }
    }

    #[test]
    fn the_cost_of_a_plan_is_that_of_its_wrenches_on_the_model(
        parameters in parameters(),
        wrenches in prop::collection::vec(-50.0..50.0f64, 6 * MOVES.len()),
    ) {
        // Thrusts that do not cancel each other cost nothing of their own.
        let case = case("bluerov2-heavy");
        let thrusts = wrenches.chunks_exact(6).map(|wrench| &case.mpc.thrusts.inverse * Vector6::from_column_slice(wrench));
        let plan = DVector::from_vec(thrusts.flat_map(|thrusts| thrusts.as_slice().to_vec()).collect());
        let expected = case.model.cost(&wrenches, parameters.as_slice());
        let cost = case.cost(&plan, &parameters);
        prop_assert!((cost - expected).abs() < 1e-6 * expected, "{} {}", cost, expected);
    }
}

#[test]
fn at_rest_on_target_the_plan_is_to_hold_against_what_disturbs() {
    let mpc = case("petasus-pum").mpc;
    let mut parameters = DVector::zeros(PARAMETERS);
    let besides = [20.0, -10.0, 15.0, 2.0, -3.0, 1.0];
    for k in 0..6 {
        (parameters[12 + k], parameters[18 + k], parameters[24 + k]) = (-besides[k], -besides[k], besides[k]);
    }
    let wrench = mpc.plan(&parameters);
    assert!((wrench + Vector6::from(besides)).amax() < 1e-6, "{wrench}");
}
