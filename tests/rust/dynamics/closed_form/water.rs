//! Water: Fossen's form, currents, frames of coefficients.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Vector3, Vector6};
use uvms_gym::description::{Body, Damping, Frame, InertiaPoint, Payload, Scene};
use uvms_gym::dynamics::dense::{angular, blocks, linear, stack};
use uvms_gym::dynamics::{ClosedFormModel, relative_to_water};
use uvms_gym::system::State;

use super::relative;
use crate::cases::{RandomLoads, current, dry, scenes, vehicle_alone};
use crate::random_scene::random_state;

/// A vehicle alone whose coefficients hold at its body frame.
fn aligned_vehicle() -> Scene {
    let mut scene = vehicle_alone();
    scene.vehicle.body.hydrodynamic_frame = Frame::default();
    scene
}

/// `S(a) b = a x b`. [F21 definition 2.2]
fn s(a: Vector3<f64>) -> Matrix3<f64> {
    a.cross_matrix()
}

/// M_RB nu' + C_RB(nu) nu + M_A nu_r' + C_A(nu_r) nu_r = tau + D-terms + g-terms, in Fossen's parametrisations.
#[test]
fn val_vehicle_alone_is_fossens_six_degree_form() {
    let scene = aligned_vehicle();
    let body = &scene.vehicle.body;
    let state = random_state(0, &scene);
    let (m, rg, ib) = (body.mass, body.center_of_mass, body.inertia_about_com());
    let io = ib - s(rg) * s(rg) * m;
    let (v1, v2) = (linear(&state.twist), angular(&state.twist));
    let m_rb = blocks(Matrix3::identity() * m, s(rg) * -m, s(rg) * m, io);
    // C_RB in the Lagrangian parametrisation. [F21 section 3.3]
    let upper = -s(v1) * m - s(s(v2) * rg) * m;
    let c_rb = blocks(Matrix3::zeros(), upper, upper, s(s(v1) * rg) * m - s(io * v2));
    // C_A from the hydrodynamic derivatives X_udot, ... = -M_A. [F21 section 6.3]
    let m_a = body.added_mass;
    for v_c in [Vector3::zeros(), current()] {
        let water = state.rotation.transpose() * v_c;
        let nu_r = state.twist - stack(&water, &Vector3::zeros());
        let d = -m_a * nu_r;
        let (a1, a2, a3, b1, b2, b3) = (d[0], d[1], d[2], d[3], d[4], d[5]);
        #[rustfmt::skip]
        let c_a = Matrix6::new(
            0.0, 0.0, 0.0, 0.0, -a3, a2,
            0.0, 0.0, 0.0, a3, 0.0, -a1,
            0.0, 0.0, 0.0, -a2, a1, 0.0,
            0.0, -a3, a2, 0.0, -b3, b2,
            a3, 0.0, -a1, b3, 0.0, -b1,
            -a2, a1, 0.0, -b2, b1, 0.0,
        );
        // nu_r' = nu' - [-S(nu_2) v_c; 0]. [F21 section 10.3]
        let turning = stack(&(s(v2) * water), &Vector3::zeros());
        let bias = c_rb * state.twist + m_a * turning + c_a * nu_r;

        let model = ClosedFormModel::new(&scene).unwrap();
        let form = model.at(&state, v_c);
        assert!((form.mass_matrix() - dynamic(&(m_rb + m_a))).norm() < 1e-13 * m_rb.norm());
        assert!((form.bias() - DVector::from_column_slice(bias.as_slice())).norm() < 1e-13 * bias.norm());

        let drag = -body.damping.linear * nu_r - body.damping.quadratic * nu_r.map(|x| x * x.abs());
        assert!((form.damping()[0] - drag).norm() < 1e-13 * drag.norm());
        let gravity = state.rotation.transpose() * scene.water.gravity;
        let (weight, buoyancy) = (gravity * m, -gravity * scene.water.density * body.displaced_volume(&scene.water));
        let moment = s(rg) * weight + s(body.center_of_buoyancy) * buoyancy;
        let restoring = stack(&(weight + buoyancy), &moment);
        assert!((form.restoring()[0] - restoring).norm() < 1e-13 * restoring.norm());
    }
}

fn dynamic(m: &Matrix6<f64>) -> DMatrix<f64> {
    DMatrix::from_column_slice(6, 6, m.as_slice())
}

#[test]
fn system_in_a_current_is_the_one_in_still_water_seen_from_the_moving_frame() {
    for (seed, scene) in scenes() {
        let state = random_state(seed, &scene);
        let model = ClosedFormModel::new(&scene).unwrap();
        let random = RandomLoads::new(seed, &scene);
        let loads = random.loads();
        let flowing = model.at(&state, current()).accelerations(&loads).unwrap();
        let still = model.at(&relative_to_water(&state, &current()), Vector3::zeros()).accelerations(&loads).unwrap();
        // V_r' = V' + [omega x R^T v_c; 0]; the joints do not care who looks.
        let mut expected = flowing.clone();
        let turning = state.twist.fixed_rows::<3>(3).cross(&(state.rotation.transpose() * current()));
        let mut head = expected.fixed_rows_mut::<3>(0);
        head += turning;
        assert!((still - &expected).norm() < 1e-12 * expected.norm());
    }
}

#[test]
fn damping_holds_in_the_frame_of_its_coefficients() {
    let mut scene = vehicle_alone();
    let lever = Vector3::new(0.1, -0.2, 0.3);
    let body = &mut scene.vehicle.body;
    body.hydrodynamic_frame = Frame { position: lever, rpy: Vector3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2) };
    body.damping = Damping {
        linear: Matrix6::zeros(),
        quadratic: Matrix6::from_diagonal(&Vector6::new(2.0, 30.0, 0.0, 0.0, 0.0, 0.0)),
    };
    // Forward motion crosses the drag frame's negative y axis.
    let state = State { twist: Vector6::new(1.5, 0.0, 0.0, 0.0, 0.0, 0.0), ..State::default() };
    let model = ClosedFormModel::new(&scene).unwrap();
    let drag = model.at(&state, Vector3::zeros()).damping()[0];
    let force = Vector3::new(-30.0 * 1.5 * 1.5, 0.0, 0.0);
    let moment = lever.cross(&force);
    assert!((drag - Vector6::new(force.x, 0.0, 0.0, moment.x, moment.y, moment.z)).norm() < 1e-12);
}

#[test]
fn added_mass_in_another_frame_is_the_same_inertia() {
    // A point of added mass m at the hydrodynamic frame behaves as a point mass there.
    let mut wet = vehicle_alone();
    let lever = Vector3::new(0.1, -0.2, 0.3);
    let point = 6.0;
    wet.vehicle.body = Body {
        hydrodynamic_frame: Frame { position: lever, rpy: Vector3::new(0.5, -0.9, 1.4) },
        added_mass: Matrix6::from_diagonal(&Vector6::new(point, point, point, 0.0, 0.0, 0.0)),
        ..dry(&wet.vehicle.body)
    };
    let mut solid = wet.clone();
    solid.vehicle.body.added_mass = Matrix6::zeros();
    let body = Body {
        mass: point,
        center_of_mass: Vector3::zeros(),
        inertia: Matrix3::zeros(),
        inertia_at: InertiaPoint::Com,
        ..solid.vehicle.body.clone()
    };
    solid.payload = Some(Payload { on: None, frame: Frame { position: lever, rpy: Vector3::zeros() }, body });
    let state = random_state(2, &wet);
    let (wet, solid) = (ClosedFormModel::new(&wet).unwrap(), ClosedFormModel::new(&solid).unwrap());
    let (wet, solid) = (wet.at(&state, Vector3::zeros()), solid.at(&state, Vector3::zeros()));
    assert!(relative(wet.mass_matrix(), solid.mass_matrix()) < 1e-13);
    assert!(relative(wet.bias(), solid.bias()) < 1e-13);
}
