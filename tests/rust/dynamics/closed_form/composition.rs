//! Laws of the composition of systems.

use nalgebra::{DVector, Matrix3, Vector3, Vector6};
use uvms_gym::description::{Body, InertiaPoint, Link, Scene, Water};
use uvms_gym::dynamics::dense::DenseBody;
use uvms_gym::dynamics::dense::DensePose;
use uvms_gym::dynamics::dense::joint_pose;
use uvms_gym::dynamics::{ClosedForm, ClosedFormModel, Composite, Equations, Loads};
use uvms_gym::system::State;

use super::motion::advance;
use super::relative;
use crate::cases::{current, dry, scene, scenes, vector6, velocities};
use crate::random_scene::random_state;

/// The largest relative difference of M, C [V; q'], W and accelerations.
fn difference(a: &ClosedForm, b: &ClosedForm) -> f64 {
    let loads = Loads::default();
    [
        relative(a.mass_matrix(), b.mass_matrix()),
        relative(a.bias(), b.bias()),
        relative(&a.wrench_influence(), &b.wrench_influence()),
        relative(&a.accelerations(&loads).unwrap(), &b.accelerations(&loads).unwrap()),
    ]
    .into_iter()
    .fold(0.0, f64::max)
}

fn own(link: &Link) -> &Body {
    link.body.as_ref().unwrap()
}

#[test]
fn two_bodies_fixed_together_are_one_body_of_their_summed_inertia() {
    let water = Water { density: 0.0, gravity: Vector3::zeros(), current: Vector3::zeros() };
    let scene = scene(false);
    let arm = scene.arm.as_ref().unwrap();
    let in_com = |body: &Body| Body { inertia: body.inertia_about_com(), inertia_at: InertiaPoint::Com, ..dry(body) };
    let (a, b) = (in_com(own(&arm.links[0])), in_com(own(&arm.links[1])));
    let mount = DensePose::from_frame(&arm.mount.frame);

    let b_center = mount.rotation * b.center_of_mass + mount.position;
    let mass = a.mass + b.mass;
    let center = (a.center_of_mass * a.mass + b_center * b.mass) / mass;
    let about = |inertia: Matrix3<f64>, mass: f64, from: Vector3<f64>| {
        let r = (from - center).cross_matrix();
        inertia - r * r * mass
    };
    let whole = Body {
        mass,
        center_of_mass: center,
        inertia: about(a.inertia, a.mass, a.center_of_mass)
            + about(mount.rotation * b.inertia * mount.rotation.transpose(), b.mass, b_center),
        ..a.clone()
    };

    let rigid = |body| Composite::rigid_body(DenseBody::new(body, &water));
    let (parts, whole) = (rigid(&a).fixed_loading(0, mount, rigid(&b)), rigid(&whole));
    let twist = vector6(4);
    let (parts, whole) = (parts.at(&twist, &[], &[], &current()), whole.at(&twist, &[], &[], &current()));
    assert!(relative(&parts.mass_matrix, &whole.mass_matrix) < 1e-14);
    assert!(relative(&parts.bias, &whole.bias) < 1e-13);
}

#[test]
fn composing_is_associative() {
    for joint_loading in [false, true] {
        let scene = scene(joint_loading);
        let rigid = |body| Composite::rigid_body(DenseBody::new(body, &scene.water));
        let arm = scene.arm.as_ref().unwrap();
        let links = &arm.links;
        let payload = scene.payload.as_ref().unwrap();
        let mount = DensePose::from_frame(&arm.mount.frame);
        let grip = DensePose::from_frame(&arm.end_effector.frame()) * DensePose::from_frame(&payload.frame);
        let here = DensePose::identity();
        let onto = |parent: Composite, at, child| match &arm.mount.joint {
            None => parent.fixed_loading(at, mount, child),
            Some(joint) => parent.joint_loading(at, mount, joint.clone(), child),
        };
        let joined =
            |parent: Composite, at, k: usize, child| parent.joint_loading(at, here, links[k].joint.clone(), child);

        // From the tip inwards ...
        let tip = rigid(own(&links[2])).fixed_loading(0, grip, rigid(&payload.body));
        let tip = joined(rigid(own(&links[1])), 0, 2, tip);
        let tip = joined(rigid(own(&links[0])), 0, 1, tip);
        let inwards = onto(rigid(&scene.vehicle.body), 0, joined(rigid(arm.base.as_ref().unwrap()), 0, 0, tip));
        // ... from the vehicle outwards ...
        let mut outwards = onto(rigid(&scene.vehicle.body), 0, rigid(arm.base.as_ref().unwrap()));
        for (k, link) in links.iter().enumerate() {
            outwards = joined(outwards, 1 + k, k, rigid(own(link)));
        }
        let outwards = outwards.fixed_loading(4, grip, rigid(&payload.body));
        // ... and two halves.
        let half =
            onto(rigid(&scene.vehicle.body), 0, joined(rigid(arm.base.as_ref().unwrap()), 0, 0, rigid(own(&links[0]))));
        let other = joined(rigid(own(&links[1])), 0, 2, rigid(own(&links[2])));
        let other = other.fixed_loading(1, grip, rigid(&payload.body));
        let halves = joined(half, 2, 1, other);

        let state = random_state(1, &scene);
        let n = scene.joints().count();
        let model = ClosedFormModel::new(&scene).unwrap();
        let drifts = |equations: &Equations| {
            DVector::from_iterator(36, equations.bodies.iter().flat_map(|body| body.drift.as_slice().to_vec()))
        };
        let at = |system| Composite::at(system, &state.twist, &state.q[..n], &state.qd[..n], &current());
        let reference = at(&model.system);
        for system in [&inwards, &outwards, &halves] {
            assert_eq!((system.bodies(), system.joints()), (6, n));
            let got = at(system);
            assert!(relative(&got.mass_matrix, &reference.mass_matrix) < 1e-13);
            assert!(relative(&got.bias, &reference.bias) < 1e-12);
            assert!(relative(&got.wrench_influence, &reference.wrench_influence) < 1e-13);
            assert_eq!(got.torque_influence, reference.torque_influence);
            assert!(got.bodies.iter().zip(&reference.bodies).all(|(a, b)| a.carrier == b.carrier));
            assert!(relative(&drifts(&got), &drifts(&reference)) < 1e-12);
        }
    }
}

#[test]
fn payload_and_fixed_base_belong_to_the_bodies_that_carry_them() {
    let scene = scene(false);
    let model = ClosedFormModel::new(&scene).unwrap();
    let form = model.at(&random_state(0, &scene), Vector3::zeros());
    let n = scene.joints().count();
    assert_eq!(form.wrench_influence().shape(), (6 + n, 6 * (n + 1)));
    assert_eq!(form.torque_influence().shape(), (6 + n, n));
    assert_eq!(form.body_poses().len(), n + 1);
    // Weight alone, by hand: the last body's restoring wrench has the weight and buoyancy of link and payload.
    let restoring = form.restoring();
    let link = scene.arm.as_ref().unwrap().links[n - 1].body.as_ref().unwrap();
    let payload = &scene.payload.as_ref().unwrap().body;
    let net = |body: &Body| body.mass - scene.water.density * body.displaced_volume(&scene.water);
    let expected = scene.water.gravity.norm() * (net(link) + net(payload)).abs();
    assert!((restoring[n].fixed_rows::<3>(0).norm() - expected).abs() < 1e-12 * expected);
}

#[test]
fn bodies_fixed_in_sequence_belong_to_the_vehicle() {
    let mut scene = scene(false);
    scene.arm.as_mut().unwrap().links.clear();
    let state = random_state(0, &scene);
    let model = ClosedFormModel::new(&scene).unwrap();
    let form = model.at(&state, current());
    // The vehicle's block of W is the identity, so its merged wrenches are the sum over all bodies' own columns.
    let still = model.system.at(&Vector6::zeros(), &[], &[], &Vector3::zeros());
    let gravity = state.rotation.tr_mul(&scene.water.gravity);
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
    let grip = DensePose::from_frame(&arm.end_effector.frame()) * DensePose::from_frame(&payload.frame);
    let outwards = rigid(&scene.vehicle.body)
        .fixed_loading(0, DensePose::from_frame(&arm.mount.frame), rigid(arm.base.as_ref().unwrap()))
        .fixed_loading(1, grip, rigid(&payload.body));
    for motion in &outwards.at(&Vector6::zeros(), &[], &[], &Vector3::zeros()).bodies {
        assert_eq!(motion.carrier, 0);
        assert!((motion.in_carrier.adjoint() - motion.pose.adjoint()).norm() < 1e-14);
    }
}

#[test]
fn end_effector_sits_on_the_last_body() {
    for joint_loading in [false, true] {
        let mut scene = scene(joint_loading);
        let state = random_state(8, &scene);
        let end_effector = DensePose::from_frame(&scene.arm.as_ref().unwrap().end_effector.frame());
        let end = |scene: &Scene| {
            let model = ClosedFormModel::new(scene).unwrap();
            let form = model.at(&state, Vector3::zeros());
            (form.body_poses(), form.end_effector_pose())
        };
        let (poses, pose) = end(&scene);
        assert_eq!(pose, *poses.last().unwrap() * end_effector);
        // Of the arm's base without links, of the vehicle without an arm.
        let arm = scene.arm.as_mut().unwrap();
        arm.links.clear();
        let mount = DensePose::from_frame(&arm.mount.frame);
        let motion = arm.mount.joint.as_ref().map_or(DensePose::identity(), |joint| joint_pose(joint, state.q[0]));
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
fn arm_alone_has_the_rows_of_the_arm_on_a_held_vehicle() {
    let scene = scene(false);
    let (arm, payload) = (scene.arm.as_ref().unwrap(), scene.payload.as_ref().unwrap());
    let rigid = |body| Composite::rigid_body(DenseBody::new(body, &scene.water));
    let here = DensePose::identity();
    let links = arm.links.iter().enumerate();
    let alone = links.fold(rigid(arm.base.as_ref().unwrap()), |alone, (k, link)| {
        alone.joint_loading(k, here, link.joint.clone(), rigid(own(link)))
    });
    let grip = DensePose::from_frame(&arm.end_effector.frame()) * DensePose::from_frame(&payload.frame);
    let alone = alone.fixed_loading(3, grip, rigid(&payload.body));
    let at = State { twist: Vector6::zeros(), ..random_state(3, &scene) };
    let model = ClosedFormModel::new(&scene).unwrap();
    let whole = model.at(&at, Vector3::zeros());
    let arm = alone.at(&Vector6::zeros(), &at.q[..3], &at.qd[..3], &Vector3::zeros());
    let whole_mass = whole.mass_matrix().view((6, 6), (3, 3)).into_owned();
    assert!(relative(&arm.mass_matrix.view((6, 6), (3, 3)).into_owned(), &whole_mass) < 1e-14);
    assert!(relative(&arm.bias.rows(6, 3).into_owned(), &whole.bias().rows(6, 3).into_owned()) < 1e-13);
}

#[test]
fn joint_loading_is_one_more_link() {
    let loaded = scene(true);
    let mut linked = loaded.clone();
    let arm = linked.arm.as_mut().unwrap();
    let (joint, body) = (arm.mount.joint.take().unwrap(), arm.base.take());
    let link = Link { name: "base".into(), parent: None, joint, body, meshes: Vec::new() };
    arm.links.insert(0, link);
    let at = random_state(4, &loaded);
    let (loaded, linked) = (ClosedFormModel::new(&loaded).unwrap(), ClosedFormModel::new(&linked).unwrap());
    assert!(difference(&loaded.at(&at, current()), &linked.at(&at, current())) < 1e-13);
}

#[test]
fn twists_are_the_rates_of_poses_and_drifts_those_of_jacobians() {
    for (seed, scene) in scenes() {
        let model = ClosedFormModel::new(&scene).unwrap();
        let at = random_state(seed, &scene);
        let n = scene.joints().count();
        let acceleration = DVector::from_fn(6 + n, |i, _| (i as f64).cos());
        let h = 1e-5;
        let (before, after) = (advance(&at, &acceleration, -h), advance(&at, &acceleration, h));
        let form = |state| model.at(state, Vector3::zeros());
        let (now, before, after) = (form(&at), form(&before), form(&after));

        let twist_of = |now: &DensePose, before: &DensePose, after: &DensePose| {
            let omega = now.rotation.transpose() * (after.rotation - before.rotation) / (2.0 * h);
            let v = now.rotation.transpose() * (after.position - before.position) / (2.0 * h);
            Vector6::new(v.x, v.y, v.z, omega.m32, omega.m13, omega.m21)
        };
        let (poses, twists) = (now.body_poses(), now.body_twists());
        for k in 0..=n {
            let twist = twist_of(&poses[k], &before.body_poses()[k], &after.body_poses()[k]);
            assert!((twist - twists[k]).norm() < 1e-8);
        }
        let end = twist_of(&now.end_effector_pose(), &before.end_effector_pose(), &after.end_effector_pose());
        assert!((end - now.jacobian() * velocities(&at, n)).norm() < 1e-8);

        let equations = |state: &State| model.system.at(&state.twist, &state.q[..n], &state.qd[..n], &Vector3::zeros());
        let (states, forms) = ([advance(&at, &acceleration, -h), advance(&at, &acceleration, h)], equations(&at));
        let [before, after] = [equations(&states[0]), equations(&states[1])];
        for k in 0..forms.bodies.len() {
            let rate = (after.bodies[k].twist - before.bodies[k].twist) / (2.0 * h);
            let expected = forms.body_jacobian(k) * &acceleration + forms.bodies[k].drift;
            assert!((rate - expected).norm() < 1e-8);
        }
    }
}
