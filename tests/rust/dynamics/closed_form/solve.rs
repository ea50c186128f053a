//! Forward and inverse dynamics, trim, and refused input.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3, Vector6};
use uvms_gym::description::{Body, Frame, Friction, InertiaPoint, JointKind, JointLimits, Link, Scene};
use uvms_gym::dynamics::{ClosedFormModel, Loads};
use uvms_gym::error::DynamicsError;
use uvms_gym::system::{JOINTS, State};

use super::relative;
use crate::cases::{RandomLoads, current, dry, scene, scenes};
use crate::random_scene::random_state;

/// A slender dry link along x with its joint about `axis` at `x`.
fn planar_link(x: f64, axis: Vector3<f64>, center: f64, inertia: f64, mass: f64) -> Link {
    let mut link = scene(false).arm.unwrap().links.remove(0);
    link.joint.kind = JointKind::Revolute;
    link.joint.frame = Frame { position: Vector3::new(x, 0.0, 0.0), rpy: Vector3::zeros() };
    link.joint.axis = axis;
    link.body = Some(Body {
        mass,
        center_of_mass: Vector3::new(center, 0.0, 0.0),
        inertia: Matrix3::from_diagonal_element(inertia),
        inertia_at: InertiaPoint::Com,
        ..dry(link.body.as_ref().unwrap())
    });
    link
}

fn planar_arm(links: Vec<Link>) -> Scene {
    let mut scene = scene(false);
    scene.vehicle.fixed = true;
    scene.water.gravity = Vector3::new(0.0, 0.0, -9.81);
    scene.payload = None;
    let arm = scene.arm.as_mut().unwrap();
    arm.mount.frame = Frame::default();
    arm.links = links;
    scene
}

#[test]
fn compound_pendulum_falls_as_by_hand() {
    let (mass, center, inertia) = (2.0, 0.3, 0.05);
    let scene = planar_arm(vec![planar_link(0.0, Vector3::y(), center, inertia, mass)]);
    let mut state = State::default();
    (state.q[0], state.qd[0]) = (0.6, 1.7);
    let model = ClosedFormModel::new(&scene).unwrap();
    let acceleration = model.at(&state, Vector3::zeros()).accelerations(&Loads::default()).unwrap();
    // +q about y dips the link below the horizon: its weight speeds that up.
    let expected = mass * 9.81 * center * 0.6_f64.cos() / (inertia + mass * center * center);
    assert!((acceleration[6] - expected).abs() < 1e-13 * expected);
    assert_eq!(acceleration.rows(0, 6).norm(), 0.0);
}

/// M and C of the planar two-link arm as printed in [MLS94 section 4.3.3].
#[test]
fn val_planar_two_link_arm() {
    let ([m1, m2], [i1, i2], [r1, r2], l1) = ([2.0, 1.5], [0.05, 0.03], [0.3, 0.25], 0.7);
    let z = Vector3::z();
    let scene = planar_arm(vec![planar_link(0.0, z, r1, i1, m1), planar_link(l1, z, r2, i2, m2)]);
    let mut state = State::default();
    let (q2, qd1, qd2) = (0.9_f64, 0.8, -1.3);
    state.q[..2].copy_from_slice(&[0.4, q2]);
    state.qd[..2].copy_from_slice(&[qd1, qd2]);
    let alpha = i1 + i2 + m1 * r1 * r1 + m2 * (l1 * l1 + r2 * r2);
    let (beta, delta) = (m2 * l1 * r2, i2 + m2 * r2 * r2);
    let (s, c) = q2.sin_cos();
    let mass = DMatrix::from_row_slice(2, 2, &[alpha + 2.0 * beta * c, delta + beta * c, delta + beta * c, delta]);
    let coriolis = DMatrix::from_row_slice(2, 2, &[-beta * s * qd2, -beta * s * (qd1 + qd2), beta * s * qd1, 0.0]);

    let model = ClosedFormModel::new(&scene).unwrap();
    let form = model.at(&state, Vector3::zeros());
    assert!(relative(&form.mass_matrix().view((6, 6), (2, 2)).into_owned(), &mass) < 1e-14);
    let bias = form.bias().rows(6, 2).into_owned();
    assert!(relative(&bias, &(coriolis * DVector::from_row_slice(&[qd1, qd2]))) < 1e-13);
}

#[test]
fn arm_with_a_fixed_base_is_the_lower_rows_of_the_free_one() {
    let mut scene = scene(true);
    let at = State { twist: Vector6::zeros(), ..random_state(2, &scene) };
    let free = ClosedFormModel::new(&scene).unwrap();
    scene.vehicle.fixed = true;
    let held = ClosedFormModel::new(&scene).unwrap();
    let loads = Loads { joint_command: &[1.0, -2.0, 3.0, 0.5], ..Loads::default() };
    let acceleration = held.at(&at, current()).accelerations(&loads).unwrap();
    assert_eq!(acceleration.rows(0, 6).norm(), 0.0);
    let residual = held.at(&at, current()).residual(&acceleration, &loads).unwrap();
    assert!(residual.norm < 1e-14 * residual.scale);
    // The free system accelerates just so when the mooring's wrench is applied to it.
    let effort = held.at(&at, current()).inverse_dynamics(&acceleration, &loads).unwrap();
    assert!(effort.joint_torques.norm() < 1e-12 * effort.wrench.norm());
    let mut external = vec![Vector6::zeros(); 5];
    external[0] = effort.wrench;
    let again = free.at(&at, current()).accelerations(&Loads { external: &external, ..loads }).unwrap();
    assert!((again - &acceleration).norm() < 1e-11 * acceleration.norm());
}

#[test]
fn inverse_dynamics_undoes_forward_dynamics() {
    for (seed, scene) in scenes() {
        let model = ClosedFormModel::new(&scene).unwrap();
        let form = model.at(&random_state(seed, &scene), current());
        let random = RandomLoads::new(seed, &scene);
        let loads = random.loads();
        let acceleration = form.accelerations(&loads).unwrap();
        let residual = form.residual(&acceleration, &loads).unwrap();
        assert!(residual.norm < 1e-14 * residual.scale);

        let mut passive = random.external.clone();
        passive[0] = Vector6::zeros();
        let effort = form.inverse_dynamics(&acceleration, &Loads { external: &passive, ..Loads::default() }).unwrap();
        let wrench = random.external[0] + form.body_wrenches(&loads).unwrap().thrust;
        assert!((effort.wrench - wrench).norm() < 1e-11 * wrench.norm());
        assert!((effort.joint_torques - DVector::from_vec(random.joint_command)).norm() < 1e-10);
    }
}

#[test]
fn trim_holds_the_system_at_rest() {
    let scene = scene(true);
    let model = ClosedFormModel::new(&scene).unwrap();
    let moving = random_state(7, &scene);
    for water in [Vector3::zeros(), current()] {
        let effort = model.trim(&moving, water).unwrap();
        let mut external = vec![Vector6::zeros(); 5];
        external[0] = effort.wrench;
        let loads = Loads { external: &external, joint_command: effort.joint_torques.as_slice(), ..Loads::default() };
        let rest = State { twist: Vector6::zeros(), qd: [0.0; JOINTS], ..moving.clone() };
        assert!(model.at(&rest, water).accelerations(&loads).unwrap().norm() < 1e-10);
        assert!(effort.wrench.norm() > 10.0);
    }
}

#[test]
fn bad_input_is_refused_with_its_numbers() {
    let mut bad = scene(true);
    let model = ClosedFormModel::new(&bad).unwrap();
    let form = model.at(&random_state(0, &bad), Vector3::zeros());
    let wrong = |loads: Loads| form.accelerations(&loads).unwrap_err();
    assert_eq!(
        wrong(Loads { thrust: &[1.0], ..Loads::default() }),
        DynamicsError::Length { what: "thrust", expected: 6, got: 1 }
    );
    assert!(matches!(
        wrong(Loads { external: &[Vector6::zeros()], ..Loads::default() }),
        DynamicsError::Length { expected: 5, got: 1, .. }
    ));
    assert!(matches!(
        wrong(Loads { joint_command: &[0.0; 3], ..Loads::default() }),
        DynamicsError::Length { expected: 4, got: 3, .. }
    ));
    assert!(form.inverse_dynamics(&DVector::zeros(4), &Loads::default()).is_err());

    let arm = bad.arm.as_mut().unwrap();
    arm.links.truncate(1);
    let body = arm.links[0].body.as_mut().unwrap();
    *body = Body { mass: 0.0, inertia: Matrix3::zeros(), ..dry(body) };
    bad.payload = None;
    let massless = ClosedFormModel::new(&bad).unwrap();
    let form = massless.at(&random_state(0, &bad), Vector3::zeros());
    assert_eq!(form.accelerations(&Loads::default()).unwrap_err(), DynamicsError::NotPositiveDefinite);

    let link = bad.arm.as_ref().unwrap().links[0].clone();
    bad.arm.as_mut().unwrap().links = vec![link; JOINTS];
    assert_eq!(ClosedFormModel::new(&bad).unwrap_err(), DynamicsError::Joints { joints: JOINTS + 1, max: JOINTS });
}

#[test]
fn joints_resist_as_described() {
    let mut scene = scene(false);
    for link in &mut scene.arm.as_mut().unwrap().links {
        link.joint.friction = Friction { viscous: 0.5, coulomb: 0.2, coulomb_speed: 0.05, ..Friction::default() };
        link.joint.limits = Some(JointLimits { lower: -0.5, upper: 0.4, stiffness: 40.0, damping: 3.0 });
    }
    let mut at = State::default();
    at.q[..3].copy_from_slice(&[0.6, 0.1, -0.9]);
    at.qd[..3].copy_from_slice(&[-2.0, 0.0, 0.5]);
    let model = ClosedFormModel::new(&scene).unwrap();
    let torques = model.at(&at, Vector3::zeros()).joint_torques(&Loads::default()).unwrap();
    let close = |got: f64, expected: f64| assert!((got - expected).abs() < 1e-13, "{got} {expected}");
    close(torques.friction[0], 1.0 + 0.2 * 2.0 / (4.0_f64 + 0.0025).sqrt());
    close(torques.friction[1], 0.0);
    close(torques.end_stop[0], -40.0 * 0.2 + 3.0 * 0.2 * 2.0);
    close(torques.end_stop[1], 0.0);
    close(torques.end_stop[2], 40.0 * 0.4 - 3.0 * 0.4 * 0.5);
}
