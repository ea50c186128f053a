//! Laws of the closed form: what composing systems must give.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Vector3, Vector6};
use uvms_gym::balance::body::DenseBody;
use uvms_gym::balance::dense::{Pose, cross};
use uvms_gym::balance::joint::joint_pose;
use uvms_gym::balance::{Balance, ClosedForm, Composite, Loads};
use uvms_gym::description::{Body, Damping, Frame, InertiaPoint, Joint, JointKind, Link, Scene, Water};
use uvms_gym::error::BalanceError;
use uvms_gym::system::State;

use crate::awkward_scene::{LOADINGS, Loading, body, current, for_joints, frame, joint, scene, state, vector, vector6};
use crate::motion::advance;

fn relative(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
    (a - b).norm() / b.norm()
}

fn relative_v(a: &DVector<f64>, b: &DVector<f64>) -> f64 {
    (a - b).norm() / b.norm()
}

/// The largest relative difference of M, C [V; q'], W and accelerations.
fn difference(a: &ClosedForm, b: &ClosedForm) -> f64 {
    let loads = Loads::default();
    [
        relative(a.mass_matrix(), b.mass_matrix()),
        relative_v(a.bias(), b.bias()),
        relative(&a.wrench_influence(), &b.wrench_influence()),
        relative_v(&a.accelerations(&loads).unwrap(), &b.accelerations(&loads).unwrap()),
    ]
    .into_iter()
    .fold(0.0, f64::max)
}

/// A slender dry link along x with its joint about `axis` at `x`.
fn planar_link(x: f64, axis: Vector3<f64>, center: f64, inertia: f64, mass: f64) -> Link {
    let mut joint: Joint = joint(0.0, JointKind::Revolute);
    joint.frame = Frame { position: Vector3::new(x, 0.0, 0.0), rpy: Vector3::zeros() };
    joint.axis = axis;
    joint.friction = Default::default();
    joint.limits = None;
    let body = Body {
        center_of_mass: Vector3::new(center, 0.0, 0.0),
        inertia: Matrix3::from_diagonal_element(inertia),
        volume: None,
        added_mass: Matrix6::zeros(),
        damping: Damping::default(),
        ..body(0.0, mass)
    };
    Link { name: String::new(), joint, body }
}

fn planar_arm(links: Vec<Link>) -> Scene {
    let mut scene = scene(Loading::Fixed);
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
    let balance = Balance::new(&scene).unwrap();
    let acceleration = balance.at(&state, Vector3::zeros()).accelerations(&Loads::default()).unwrap();
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

    let balance = Balance::new(&scene).unwrap();
    let form = balance.at(&state, Vector3::zeros());
    assert!(relative(&form.mass_matrix().view((6, 6), (2, 2)).into_owned(), &mass) < 1e-14);
    let bias = form.bias().rows(6, 2).into_owned();
    assert!(relative_v(&bias, &(coriolis * DVector::from_row_slice(&[qd1, qd2]))) < 1e-13);
}

#[test]
fn two_bodies_screwed_together_are_one_body_of_their_summed_inertia() {
    let water = Water { density: 0.0, gravity: Vector3::zeros(), current: Vector3::zeros() };
    let dry = |seed, mass| Body { added_mass: Matrix6::zeros(), ..body(seed, mass) };
    let (a, b, mount) = (dry(0.3, 4.0), dry(0.8, 7.0), Pose::from_frame(&frame(2.0)));

    let b_center = mount.rotation * b.center_of_mass + mount.position;
    let mass = a.mass + b.mass;
    let center = (a.center_of_mass * a.mass + b_center * b.mass) / mass;
    let about = |inertia: Matrix3<f64>, mass: f64, from: Vector3<f64>| {
        let r = cross(&(from - center));
        inertia - r * r * mass
    };
    let whole = Body {
        mass,
        center_of_mass: center,
        inertia: about(a.inertia, a.mass, a.center_of_mass)
            + about(mount.rotation * b.inertia * mount.rotation.transpose(), b.mass, b_center),
        inertia_at: InertiaPoint::Com,
        ..a.clone()
    };

    let rigid = |body| Composite::rigid_body(DenseBody::new(body, &water));
    let (parts, whole) = (rigid(&a).fixed_loading(0, mount, rigid(&b)), rigid(&whole));
    let twist = vector6(0.4);
    let (parts, whole) = (parts.at(&twist, &[], &[], &current()), whole.at(&twist, &[], &[], &current()));
    assert!(relative(&parts.mass_matrix, &whole.mass_matrix) < 1e-14);
    assert!(relative_v(&parts.bias, &whole.bias) < 1e-13);
}

#[test]
fn composing_is_associative() {
    for loading in LOADINGS {
        let scene = scene(loading);
        let rigid = |body| Composite::rigid_body(DenseBody::new(body, &scene.water));
        let arm = scene.arm.as_ref().unwrap();
        let links = &arm.links;
        let payload = scene.payload.as_ref().unwrap();
        let mount = Pose::from_frame(&arm.mount.frame);
        let grip = Pose::from_frame(&arm.end_effector) * Pose::from_frame(&payload.frame);
        let here = Pose::identity();
        let onto = |parent: Composite, at, child| match &arm.mount.joint {
            None => parent.fixed_loading(at, mount, child),
            Some(joint) => parent.joint_loading(at, mount, joint.clone(), child),
        };
        let joined =
            |parent: Composite, at, k: usize, child| parent.joint_loading(at, here, links[k].joint.clone(), child);

        // From the tip inwards ...
        let tip = rigid(&links[2].body).fixed_loading(0, grip, rigid(&payload.body));
        let tip = joined(rigid(&links[1].body), 0, 2, tip);
        let tip = joined(rigid(&links[0].body), 0, 1, tip);
        let inwards = onto(rigid(&scene.vehicle.body), 0, joined(rigid(arm.base.as_ref().unwrap()), 0, 0, tip));
        // ... from the vehicle outwards ...
        let mut outwards = onto(rigid(&scene.vehicle.body), 0, rigid(arm.base.as_ref().unwrap()));
        for (k, link) in links.iter().enumerate() {
            outwards = joined(outwards, 1 + k, k, rigid(&link.body));
        }
        let outwards = outwards.fixed_loading(4, grip, rigid(&payload.body));
        // ... and two halves.
        let half =
            onto(rigid(&scene.vehicle.body), 0, joined(rigid(arm.base.as_ref().unwrap()), 0, 0, rigid(&links[0].body)));
        let other = joined(rigid(&links[1].body), 0, 2, rigid(&links[2].body));
        let other = other.fixed_loading(1, grip, rigid(&payload.body));
        let halves = joined(half, 2, 1, other);

        let state = state(&scene, 1.0);
        let n = scene.joints().count();
        let balance = Balance::new(&scene).unwrap();
        let evaluate = |system: &Composite| {
            assert_eq!((system.bodies(), system.joints()), (6, n));
            let equations = system.at(&state.twist, &state.q[..n], &state.qd[..n], &current());
            let carriers: Vec<_> = equations.bodies.iter().map(|body| body.carrier).collect();
            let drift: Vec<f64> =
                equations.bodies.iter().flat_map(|body| body.drift.iter().copied().collect::<Vec<_>>()).collect();
            (
                equations.mass_matrix,
                equations.bias,
                equations.wrench_influence,
                equations.torque_influence,
                carriers,
                DVector::from_vec(drift),
            )
        };
        let reference = evaluate(&balance.system);
        for system in [&inwards, &outwards, &halves] {
            let got = evaluate(system);
            assert!(relative(&got.0, &reference.0) < 1e-13);
            assert!(relative_v(&got.1, &reference.1) < 1e-12);
            assert!(relative(&got.2, &reference.2) < 1e-13);
            assert_eq!(got.3, reference.3);
            assert_eq!(got.4, reference.4);
            assert!(relative_v(&got.5, &reference.5) < 1e-12);
        }
    }
}

#[test]
fn payload_and_fixed_base_belong_to_the_bodies_that_carry_them() {
    let scene = scene(Loading::Fixed);
    let balance = Balance::new(&scene).unwrap();
    let form = balance.at(&state(&scene, 0.0), Vector3::zeros());
    let n = scene.joints().count();
    assert_eq!(form.wrench_influence().shape(), (6 + n, 6 * (n + 1)));
    assert_eq!(form.torque_influence().shape(), (6 + n, n));
    assert_eq!(form.body_poses().len(), n + 1);
    // Weight alone, by hand: the last body's restoring wrench has the weight and buoyancy of link and payload.
    let restoring = form.restoring();
    let link = &scene.arm.as_ref().unwrap().links[n - 1].body;
    let payload = &scene.payload.as_ref().unwrap().body;
    let net = |body: &Body| body.mass - scene.water.density * body.volume.unwrap();
    let expected = scene.water.gravity.norm() * (net(link) + net(payload)).abs();
    assert!((restoring[n].fixed_rows::<3>(0).norm() - expected).abs() < 1e-12 * expected);
}

#[test]
fn what_is_screwed_onto_the_screwed_belongs_to_the_vehicle() {
    let mut scene = scene(Loading::Fixed);
    scene.arm.as_mut().unwrap().links.clear();
    let balance = Balance::new(&scene).unwrap();
    let form = balance.at(&state(&scene, 0.0), current());
    // The vehicle's block of W is the identity, so its merged wrenches are the sum over all bodies' own columns.
    let still = balance.system.at(&Vector6::zeros(), &[], &[], &Vector3::zeros());
    let gravity = state(&scene, 0.0).rotation.tr_mul(&scene.water.gravity);
    let expected: Vector6<f64> = (still.bodies.iter().enumerate())
        .map(|(k, motion)| {
            still.body_jacobian(k).tr_mul(&motion.body.restoring(&motion.pose.rotation.tr_mul(&gravity)))
        })
        .map(|wrench| Vector6::from_column_slice(wrench.as_slice()))
        .sum();
    let restoring = form.restoring();
    assert_eq!((restoring.len(), still.bodies.len()), (1, 3));
    assert!((restoring[0] - expected).norm() < 1e-13 * expected.norm());

    // Screwed on one after the other, from the vehicle outwards: everything is where it was.
    let (arm, payload) = (scene.arm.as_ref().unwrap(), scene.payload.as_ref().unwrap());
    let rigid = |body| Composite::rigid_body(DenseBody::new(body, &scene.water));
    let grip = Pose::from_frame(&arm.end_effector) * Pose::from_frame(&payload.frame);
    let outwards = rigid(&scene.vehicle.body)
        .fixed_loading(0, Pose::from_frame(&arm.mount.frame), rigid(arm.base.as_ref().unwrap()))
        .fixed_loading(1, grip, rigid(&payload.body));
    for motion in &outwards.at(&Vector6::zeros(), &[], &[], &Vector3::zeros()).bodies {
        assert_eq!(motion.carrier, 0);
        assert!((motion.in_carrier.adjoint() - motion.pose.adjoint()).norm() < 1e-14);
    }
}

#[test]
fn end_effector_sits_on_the_last_body() {
    for loading in LOADINGS {
        let mut scene = scene(loading);
        let state = state(&scene, 8.0);
        let end_effector = Pose::from_frame(&scene.arm.as_ref().unwrap().end_effector);
        let end = |scene: &Scene| {
            let balance = Balance::new(scene).unwrap();
            let form = balance.at(&state, Vector3::zeros());
            (form.body_poses(), form.end_effector_pose())
        };
        let (poses, pose) = end(&scene);
        assert_eq!(pose, *poses.last().unwrap() * end_effector);
        // Of the arm's base without links, of the vehicle without an arm.
        let arm = scene.arm.as_mut().unwrap();
        arm.links.clear();
        let mount = Pose::from_frame(&arm.mount.frame);
        let motion = arm.mount.joint.as_ref().map_or(Pose::identity(), |joint| joint_pose(joint, state.q[0]));
        let (poses, pose) = end(&scene);
        let base = poses[0] * (mount * motion);
        assert!((pose.position - (base * end_effector).position).norm() < 1e-14);
        assert!((pose.rotation - (base * end_effector).rotation).norm() < 1e-14);
        scene.arm = None;
        let (poses, pose) = end(&scene);
        assert_eq!(pose, poses[0]);
    }
}

#[test]
fn arm_with_a_fixed_base_is_the_lower_rows_of_the_free_one() {
    let mut scene = scene(Loading::Joint);
    let mut at = state(&scene, 2.0);
    at.twist = Vector6::zeros();
    let free = Balance::new(&scene).unwrap();
    scene.vehicle.fixed = true;
    let held = Balance::new(&scene).unwrap();
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
fn arm_alone_has_the_rows_of_the_arm_on_a_held_vehicle() {
    let scene = scene(Loading::Fixed);
    let balance = Balance::new(&scene).unwrap();
    let at = State { twist: Vector6::zeros(), rotation: Matrix3::identity(), ..state(&scene, 3.0) };
    let whole = balance.at(&at, Vector3::zeros());
    let arm = balance.arm.as_ref().unwrap().at(&Vector6::zeros(), &at.q[..3], &at.qd[..3], &Vector3::zeros());
    let whole_mass = whole.mass_matrix().view((6, 6), (3, 3)).into_owned();
    assert!(relative(&arm.mass_matrix.view((6, 6), (3, 3)).into_owned(), &whole_mass) < 1e-14);
    assert!(relative_v(&arm.bias.rows(6, 3).into_owned(), &whole.bias().rows(6, 3).into_owned()) < 1e-13);
}

#[test]
fn joint_loading_is_one_more_link() {
    let loaded = scene(Loading::Joint);
    let mut linked = loaded.clone();
    let arm = linked.arm.as_mut().unwrap();
    let link = Link { name: "base".into(), joint: arm.mount.joint.take().unwrap(), body: arm.base.take().unwrap() };
    arm.links.insert(0, link);
    let at = state(&loaded, 4.0);
    let (loaded, linked) = (Balance::new(&loaded).unwrap(), Balance::new(&linked).unwrap());
    assert!(difference(&loaded.at(&at, current()), &linked.at(&at, current())) < 1e-13);
}

#[test]
fn twists_are_the_rates_of_poses_and_drifts_those_of_jacobians() {
    for loading in LOADINGS {
        let scene = scene(loading);
        let balance = Balance::new(&scene).unwrap();
        let at = state(&scene, 5.0);
        let n = scene.joints().count();
        let acceleration = DVector::from_fn(6 + n, |i, _| (i as f64).cos());
        let h = 1e-5;
        let (before, after) = (advance(&at, &acceleration, -h), advance(&at, &acceleration, h));
        let form = |state| balance.at(state, Vector3::zeros());
        let (now, before, after) = (form(&at), form(&before), form(&after));

        let twist_of = |now: &Pose, before: &Pose, after: &Pose| {
            let omega = now.rotation.transpose() * (after.rotation - before.rotation) / (2.0 * h);
            let v = now.rotation.transpose() * (after.position - before.position) / (2.0 * h);
            Vector6::new(v.x, v.y, v.z, omega.m32, omega.m13, omega.m21)
        };
        let (poses, twists) = (now.body_poses(), now.body_twists());
        for k in 0..=n {
            let twist = twist_of(&poses[k], &before.body_poses()[k], &after.body_poses()[k]);
            assert!((twist - twists[k]).norm() < 1e-8);
        }
        let rates = DVector::from_iterator(6 + n, at.twist.iter().chain(&at.qd[..n]).copied());
        let end = twist_of(&now.end_effector_pose(), &before.end_effector_pose(), &after.end_effector_pose());
        assert!((end - now.jacobian() * rates).norm() < 1e-8);

        let equations =
            |state: &State| balance.system.at(&state.twist, &state.q[..n], &state.qd[..n], &Vector3::zeros());
        let (states, forms) = ([advance(&at, &acceleration, -h), advance(&at, &acceleration, h)], equations(&at));
        let [before, after] = [equations(&states[0]), equations(&states[1])];
        for k in 0..forms.bodies.len() {
            let rate = (after.bodies[k].twist - before.bodies[k].twist) / (2.0 * h);
            let expected = forms.body_jacobian(k) * &acceleration + forms.bodies[k].drift;
            assert!((rate - expected).norm() < 1e-8);
        }
    }
}

#[test]
fn inverse_dynamics_undoes_forward_dynamics() {
    for loading in LOADINGS {
        let scene = scene(loading);
        let balance = Balance::new(&scene).unwrap();
        let form = balance.at(&state(&scene, 6.0), current());
        let n = form.joints();
        let command: Vec<f64> = (0..n).map(|i| 3.0 * (i as f64).sin() + 1.0).collect();
        let external: Vec<_> = (0..=n).map(|i| 5.0 * vector6(i as f64)).collect();
        let thrust = [12.0, -7.0];
        let loads = Loads { thrust: &thrust, external: &external, joint_command: &command };
        let acceleration = form.accelerations(&loads).unwrap();
        let residual = form.residual(&acceleration, &loads).unwrap();
        assert!(residual.norm < 1e-14 * residual.scale);

        let mut passive = external.clone();
        passive[0] = Vector6::zeros();
        let effort = form.inverse_dynamics(&acceleration, &Loads { external: &passive, ..Loads::default() }).unwrap();
        let wrench = external[0] + form.body_wrenches(&loads).unwrap().thrust;
        assert!((effort.wrench - wrench).norm() < 1e-11 * wrench.norm());
        assert!((effort.joint_torques - DVector::from_vec(command)).norm() < 1e-10);
    }
}

#[test]
fn trim_holds_the_system_at_rest() {
    let scene = scene(Loading::Joint);
    let balance = Balance::new(&scene).unwrap();
    let moving = state(&scene, 7.0);
    for water in [Vector3::zeros(), current()] {
        let effort = balance.trim(&moving, water).unwrap();
        let mut external = vec![Vector6::zeros(); 5];
        external[0] = effort.wrench;
        let loads = Loads { external: &external, joint_command: effort.joint_torques.as_slice(), ..Loads::default() };
        let rest = State { twist: Vector6::zeros(), qd: [0.0; 9], ..moving.clone() };
        assert!(balance.at(&rest, water).accelerations(&loads).unwrap().norm() < 1e-10);
        assert!(effort.wrench.norm() > 10.0);
    }
}

#[test]
fn bad_input_is_refused_with_its_numbers() {
    let mut bad = scene(Loading::Joint);
    let balance = Balance::new(&bad).unwrap();
    let form = balance.at(&state(&bad, 0.0), Vector3::zeros());
    let wrong = |loads: Loads| form.accelerations(&loads).unwrap_err();
    assert_eq!(
        wrong(Loads { thrust: &[1.0], ..Loads::default() }),
        BalanceError::Length { what: "thrust", expected: 2, got: 1 }
    );
    assert!(matches!(
        wrong(Loads { external: &[Vector6::zeros()], ..Loads::default() }),
        BalanceError::Length { expected: 5, got: 1, .. }
    ));
    assert!(matches!(
        wrong(Loads { joint_command: &[0.0; 3], ..Loads::default() }),
        BalanceError::Length { expected: 4, got: 3, .. }
    ));
    assert!(form.inverse_dynamics(&DVector::zeros(4), &Loads::default()).is_err());

    let arm = bad.arm.as_mut().unwrap();
    arm.links.truncate(1);
    arm.links[0].body = Body { mass: 0.0, inertia: Matrix3::zeros(), added_mass: Matrix6::zeros(), ..body(0.0, 0.0) };
    bad.payload = None;
    let massless = Balance::new(&bad).unwrap();
    let form = massless.at(&state(&bad, 0.0), Vector3::zeros());
    assert_eq!(form.accelerations(&Loads::default()).unwrap_err(), BalanceError::NotPositiveDefinite);

    let link = bad.arm.as_ref().unwrap().links[0].clone();
    bad.arm.as_mut().unwrap().links = vec![link; 9];
    assert_eq!(Balance::new(&bad).unwrap_err(), BalanceError::Joints { joints: 10, max: 9 });
}

#[test]
fn joints_resist_as_described() {
    let mut scene = scene(Loading::Fixed);
    for_joints(&mut scene, |joint| joint.axis = vector(0.2).normalize());
    let mut at = State::default();
    at.q[..3].copy_from_slice(&[0.6, 0.1, -0.9]);
    at.qd[..3].copy_from_slice(&[-2.0, 0.0, 0.5]);
    let balance = Balance::new(&scene).unwrap();
    let torques = balance.at(&at, Vector3::zeros()).joint_torques(&Loads::default()).unwrap();
    let close = |got: f64, expected: f64| assert!((got - expected).abs() < 1e-13, "{got} {expected}");
    close(torques.friction[0], 1.0 + 0.2 * 2.0 / (4.0_f64 + 0.0025).sqrt());
    close(torques.friction[1], 0.0);
    close(torques.end_stop[0], -40.0 * 0.2 + 3.0 * 0.2 * 2.0);
    close(torques.end_stop[1], 0.0);
    close(torques.end_stop[2], 40.0 * 0.4 - 3.0 * 0.4 * 0.5);
}
