//! A curve through a state with given accelerations, for central differences.

use nalgebra::{DVector, Rotation3, Vector6};
use uvms_gym::system::State;

/// State after `dt`, accurate to second order.
pub fn advance(state: &State, accelerations: &DVector<f64>, dt: f64) -> State {
    let mean: Vector6<f64> = state.twist + accelerations.fixed_rows::<6>(0) * (0.5 * dt);
    let turn = Rotation3::new(mean.fixed_rows::<3>(3) * dt).into_inner();
    let half = Rotation3::new(mean.fixed_rows::<3>(3) * (0.5 * dt)).into_inner();
    let mut after = State {
        position: state.position + state.rotation * half * mean.fixed_rows::<3>(0) * dt,
        rotation: state.rotation * turn,
        twist: state.twist + accelerations.fixed_rows::<6>(0) * dt,
        time: state.time + dt,
        ..state.clone()
    };
    for i in 0..accelerations.len() - 6 {
        after.q[i] += state.qd[i] * dt + 0.5 * accelerations[6 + i] * dt * dt;
        after.qd[i] += accelerations[6 + i] * dt;
    }
    after
}
