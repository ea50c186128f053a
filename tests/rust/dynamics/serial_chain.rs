//! The serial chain of dense bodies against the closed form.

use nalgebra::{DMatrix, Rotation3, Vector3, Vector6};
use uvms_gym::description::Scene;
use uvms_gym::dynamics::{ClosedFormModel, Loads, SerialChain, Velocities};
use uvms_gym::system::State;

#[test]
fn serial_chain_is_the_closed_form() {
    let mut seed = 7u64;
    let mut draw = move || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    for name in Scene::shipped_names() {
        let scene = Scene::shipped(name).unwrap();
        let (model, chain) = (ClosedFormModel::new(&scene).unwrap(), SerialChain::new(&scene).unwrap());
        let n = chain.joints();
        for _ in 0..20 {
            let rotation = Rotation3::from_euler_angles(draw(), draw(), 3.0 * draw());
            let mut state = State { rotation: rotation.into_inner(), ..State::default() };
            state.twist = Vector6::from_fn(|_, _| draw());
            for k in 0..n {
                (state.q[k], state.qd[k]) = (2.0 * draw(), draw());
            }
            let form = model.at(&state, Vector3::zeros());
            let velocities = Velocities::from_fn(|k, _| match k {
                0..6 => state.twist[k],
                _ => state.qd[k - 6],
            });
            let up = state.rotation.row(2).transpose();
            let terms = chain.at(&up, &state.q, &velocities);
            let size = form.mass_matrix().norm();
            let mass = DMatrix::from_fn(6 + n, 6 + n, |i, k| terms.mass[(i, k)]);
            assert!((mass - form.mass_matrix()).norm() < 1e-13 * size, "{name}");
            assert!((terms.mass - terms.mass.transpose()).norm() < 1e-14 * size, "{name}");
            let jacobian = terms.jacobian.columns(0, 6 + n) - form.jacobian();
            assert!(jacobian.norm() < 1e-13 * form.jacobian().norm(), "{name}");
            let rest = form.bias() - form.generalized_force(&Loads::default()).unwrap();
            let own = form.joint_torques(&Loads::default()).unwrap().sum;
            for k in 0..6 + n {
                let passive = if k < 6 { 0.0 } else { chain.passive(k - 6, state.q[k - 6], state.qd[k - 6]).torque };
                assert!((terms.bias[k] - passive - rest[k]).abs() < 1e-12 * rest.norm(), "{name} {k}");
                assert!(k < 6 || (passive - own[k - 6]).abs() < 1e-12 * own.norm().max(1.0), "{name} {k}");
            }
        }
    }
}

#[test]
fn passive_torque_decreases_by_its_secants() {
    let scene = Scene::shipped("petasus-pum").unwrap();
    let chain = SerialChain::new(&scene).unwrap();
    for i in 0..5 {
        for (q, qd) in [(0.1, 0.3), (3.5, -0.2), (-3.4, 0.0)] {
            let passive = chain.passive(i, q, qd);
            let elastic = chain.passive(i, q, 0.0).torque;
            assert!((passive.torque - elastic + passive.damping * qd).abs() < 1e-12 * (1.0 + elastic.abs()));
            let stretched = chain.passive(i, q + 0.01 * q.signum(), 0.0).torque;
            assert!(
                (stretched - elastic + passive.stiffness * 0.01 * q.signum()).abs() < 1e-12 * (1.0 + elastic.abs())
            );
        }
    }
}
