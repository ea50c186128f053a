//! Nonlinear model-predictive control: its plan near rest is linear feedback, and keeps within the limits.

use nalgebra::{DMatrix, DVector, Vector6};

use super::{JOINT_TORQUES, actions, tracking_indices};
use uvms_gym::control::nmpc::real_time::PlanModel;
use uvms_gym::control::nmpc::vehicle::{HORIZON, PlanStart, VehicleNmpc};
use uvms_gym::control::{ActionMap, ArmState, NmpcGains, Observer, Plant, TrackingNmpc};
use uvms_gym::description::Scene;
use uvms_gym::system::JOINTS;

struct Case {
    scene: Scene,
    actions: ActionMap,
    nmpc: VehicleNmpc,
}

fn case(name: &str) -> Case {
    let scene = Scene::shipped(name).unwrap();
    let (actions, observer) = (actions(&scene, &[]), Observer::new(Default::default(), 0.0, &scene, 0.1));
    let nmpc = VehicleNmpc::new(&NmpcGains::default(), &scene, &observer, &actions);
    Case { scene, actions, nmpc }
}

impl Case {
    fn present(&self, state: [[f64; 6]; 3]) -> PlanStart {
        let arm = ArmState { q: self.scene.home(), qd: [0.0; JOINTS] };
        PlanStart { state, wrenches: [[0.0; 6]; 4], arms: [arm; 2] }
    }

    fn first(&self, present: &PlanStart) -> Vector6<f64> {
        self.nmpc.plan(present, None, &mut vec![0.0; self.nmpc.memory()]).into()
    }
}

#[test]
fn near_rest_the_plan_is_the_feedback_of_the_riccati_equation() {
    for name in ["petasus-pum", "bluerov2-heavy"] {
        let case = case(name);
        let rest = case.present([[0.0; 6]; 3]);
        let (dynamics, cost) = (case.nmpc.dynamics(&rest), &case.nmpc.cost);
        let (s, w) = (18, dynamics.ncols() - 18);
        let all: DMatrix<f64> = &cost.hessian + dynamics.tr_mul(&(&cost.end * &dynamics));
        let gain = all.view((s, s), (w, w)).into_owned().cholesky().unwrap().solve(&all.view((s, 0), (w, s)));
        let mut state = [[0.0; 6]; 3];
        for k in 0..6 {
            (state[0][k], state[1][k]) = (1e-4 * (1.0 + k as f64), -1e-4 * (3.0 - k as f64));
        }
        let thrusts = -gain * DVector::from_column_slice(state.as_flattened());
        let allocation = case.actions.allocation();
        let wrench: Vector6<f64> =
            (0..w).map(|i| allocation.column(i) * (allocation.range(i) * thrusts[i])).sum::<Vector6<f64>>();
        let rest_wrench = case.first(&rest);
        let planned = case.first(&case.present(state)) - rest_wrench;
        assert!((planned - wrench).norm() < 0.01 * wrench.norm(), "{name}: {planned} {wrench}");
    }
}

#[test]
fn thrusts_of_a_far_target_are_at_their_limits_and_within() {
    for name in ["petasus-pum", "bluerov2-heavy"] {
        let case = case(name);
        let mut memory = vec![0.0; case.nmpc.memory()];
        let far = case.present([[30.0, -20.0, 10.0, 0.3, 0.2, 1.0], [0.0; 6], [0.0; 6]]);
        for _ in 0..3 {
            case.nmpc.plan(&far, None, &mut memory);
            let allocation = case.actions.allocation();
            let mut saturated = 0;
            for thrusts in memory.chunks_exact(memory.len() / HORIZON) {
                for (i, u) in thrusts.iter().enumerate() {
                    let [lower, upper] = allocation.limits(i).map(|limit| limit / allocation.range(i));
                    assert!((lower..=upper).contains(u), "{name}: {u}");
                    saturated += usize::from(*u == lower || *u == upper);
                }
            }
            assert!(saturated > 0, "{name}");
        }
    }
}

#[test]
fn derivatives_of_a_tracking_period_are_those_of_differences() {
    let scene = Scene::shipped("petasus-pum").unwrap();
    let plant = Plant { scene: &scene, actions: actions(&scene, &JOINT_TORQUES), period: 0.1 };
    let nmpc = TrackingNmpc::new(&NmpcGains::tracking(0), tracking_indices(), plant);
    let mut row: Vec<f32> = (0..31).map(|k| 0.3 * (1.0 + k as f32).sin()).collect();
    row[12..15].copy_from_slice(&[0.28, -0.096, 0.955_176]);
    nmpc.at_first(&row, |model| {
        let (exact, x, step) = (model.dynamics(), model.present(), 1e-6);
        let u = model.layout.relative(&model.holding_effort());
        for k in 0..exact.ncols() {
            let end = |by: f64| {
                let (mut x, mut u) = (x.clone(), u.clone());
                if k < x.len() {
                    x[k] += by
                } else {
                    u[k - x.len()] += by
                }
                model.step(0, &x, &u)
            };
            let difference = (end(step) - end(-step)) / (2.0 * step);
            let miss = (exact.column(k) - &difference).norm();
            assert!(miss < 1e-6 * (1.0 + difference.norm()), "{k}: {miss} of {}", difference.norm());
        }
    });
}
