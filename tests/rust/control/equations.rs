//! The nominal model of vehicle and arm against the closed form, and its derivatives against differences.

use crate::random_scene::{Options, random_scene, random_state};
use nalgebra::{DMatrix, Vector3};
use uvms_gym::control::{ChainState, NominalModel, Velocities};
use uvms_gym::description::Scene;
use uvms_gym::dynamics::{ClosedFormModel, Loads};
use uvms_gym::system::State;

const PERIOD: f64 = 0.1;

fn scenes() -> impl Iterator<Item = Scene> {
    let random = (0..40).map(|seed| random_scene(seed, Options { fixed: Some(false), ..Options::default() }));
    Scene::shipped_names().into_iter().map(|name| Scene::shipped(name).unwrap()).chain(random)
}

/// Velocities, and the direction against gravity.
fn motion(scene: &Scene, state: &State) -> (Velocities, Vector3<f64>) {
    let velocities = Velocities::from_iterator(state.twist.iter().chain(&state.qd).copied());
    let up = -state.rotation.tr_mul(&scene.water.gravity);
    (velocities, if up == Vector3::zeros() { Vector3::z() } else { up })
}

#[test]
fn equations_of_motion_are_the_closed_form() {
    for (seed, scene) in scenes().enumerate() {
        let (model, chain) = (ClosedFormModel::new(&scene).unwrap(), NominalModel::new(&scene));
        let mut state = random_state(seed as u64, &scene);
        state.qd[chain.joints()..].fill(0.0);
        let (velocities, up) = motion(&scene, &state);
        let (form, size) = (model.at(&state, Vector3::zeros()), 6 + chain.joints());
        let at = ChainState { up: &up, q: &state.q, velocities: &velocities };
        let equations = chain.equations(at, 0.0);
        let (mass, all) = (form.mass_matrix(), form.mass_matrix().norm());
        let inertia = DMatrix::from_fn(size, size, |i, k| equations.inertia[(i, k)]);
        assert!((inertia - mass).norm() < 1e-12 * all, "{}", scene.name);
        let jacobian = equations.jacobian.columns(0, size) - form.jacobian();
        assert!(jacobian.norm() < 1e-12 * form.jacobian().norm(), "{}", scene.name);
        let rest = form.bias() - form.generalized_force(&Loads::default()).unwrap();
        for k in 0..size {
            assert!((equations.bias[k] - rest[k]).abs() < 1e-11 * rest.norm(), "{} {k}", scene.name);
        }
    }
}

/// `(M + T D) a + bias`
fn force(chain: &NominalModel, at: ChainState, acceleration: &Velocities) -> Velocities {
    let equations = chain.equations(at, PERIOD);
    equations.inertia * acceleration + equations.bias
}

#[test]
fn derivatives_are_those_of_differences() {
    let step = 1e-6;
    for (seed, scene) in scenes().enumerate() {
        let (chain, mut state) = (NominalModel::new(&scene), random_state(seed as u64, &scene));
        let n = chain.joints();
        state.qd[n..].fill(0.0);
        let (velocities, up) = motion(&scene, &state);
        let up = up.normalize();
        let at = ChainState { up: &up, q: &state.q, velocities: &velocities };
        let acceleration = Velocities::from_fn(|k, _| if k < 6 + n { (k as f64).sin() } else { 0.0 });
        let exact = chain.force_derivatives(at, &acceleration, PERIOD);
        let twists = chain.twist_derivatives(at);
        assert_eq!((exact.len(), twists.len()), (9 + 2 * n, n));
        for (k, column) in exact.iter().enumerate() {
            let differ = |by: f64| {
                let (mut up, mut q, mut velocities) = (up, state.q, velocities);
                match k {
                    0..3 => up[k] += by,
                    k if k < 3 + n => q[k - 3] += by,
                    k => velocities[k - 3 - n] += by,
                }
                let at = ChainState { up: &up, q: &q, velocities: &velocities };
                (force(&chain, at, &acceleration), chain.equations(at, 0.0).jacobian * velocities)
            };
            let ((more, further), (less, nearer)) = (differ(step), differ(-step));
            let difference = (more - less) / (2.0 * step);
            let size = force(&chain, at, &acceleration).norm() + difference.norm();
            assert!((column - difference).norm() < 1e-6 * size, "{} {k}: {column} {difference}", scene.name);
            if (3..3 + n).contains(&k) {
                let difference = (further - nearer) / (2.0 * step);
                assert!((twists[k - 3] - difference).norm() < 1e-7 * (1.0 + difference.norm()), "{} {k}", scene.name);
            }
        }
    }
}
