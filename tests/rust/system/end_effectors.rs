//! Named end effectors: poses and Jacobians, the choice of one, and payloads on them.

use nalgebra::{Matrix3, Matrix6xX, Vector3, Vector6};
use uvms_gym::batch::Inputs;
use uvms_gym::description::{
    Body, DEFAULT_END_EFFECTOR, EndEffectorFrame, Frame, InertiaPoint, Payload, Scene, SceneEditor,
};
use uvms_gym::dynamics::ClosedFormModel;
use uvms_gym::dynamics::dense::DensePose;
use uvms_gym::system::{EndEffector, State};

use crate::cases::{moved, run};
use crate::random_scene::{Options, random_scene, random_state};

/// Scenes with an arm that branches, and end effectors on any of its bodies.
fn trees() -> impl Iterator<Item = (u64, Scene)> {
    let options = Options { branching: Some(true), ..Options::default() };
    (0..60).map(move |seed| (seed, random_scene(seed, options))).filter(|(_, scene)| scene.arm.is_some())
}

#[test]
fn pose_and_jacobian_of_each_end_effector_agree_with_the_kernel_and_with_differences() {
    let h = 1e-6;
    for (seed, scene) in trees() {
        let (state, n) = (random_state(seed, &scene), scene.joints().count());
        let model = ClosedFormModel::new(&scene).unwrap();
        for name in scene.end_effector_names() {
            let of = model.end_effector(Some(&name)).unwrap();
            let pose = |state: &State| model.at(state, Vector3::zeros()).pose_of(of);
            let form = model.at(&state, Vector3::zeros());
            let here = pose(&state);

            let chosen = scene.with_end_effector(&name).unwrap();
            let (rotation, position) = EndEffector::new(&chosen).pose(&state.q);
            let kernel =
                DensePose { rotation: state.rotation, position: state.position } * DensePose { rotation, position };
            assert!((kernel.rotation - here.rotation).norm() < 1e-13, "{seed} {name}");
            assert!((kernel.position - here.position).norm() < 1e-13, "{seed} {name}");

            let columns: Vec<Vector6<f64>> = (0..6 + n)
                .map(|k| {
                    let (before, after) = (pose(&moved(&state, n, k, -h)), pose(&moved(&state, n, k, h)));
                    let omega = here.rotation.transpose() * (after.rotation - before.rotation) / (2.0 * h);
                    let v = here.rotation.transpose() * (after.position - before.position) / (2.0 * h);
                    Vector6::new(v.x, v.y, v.z, omega.m32, omega.m13, omega.m21)
                })
                .collect();
            assert!((Matrix6xX::from_columns(&columns) - form.jacobian_of(of)).norm() < 1e-8, "{seed} {name}");
            // The dense twin of the scene that uses it.
            let twin = ClosedFormModel::new(&chosen).unwrap();
            assert_eq!(twin.at(&state, Vector3::zeros()).jacobian(), form.jacobian_of(of), "{seed} {name}");
        }
    }
}

#[test]
fn the_choice_of_an_end_effector_changes_only_which_one_is_in_use() {
    for (seed, scene) in trees() {
        assert_eq!(scene.end_effector_names(), ["default", "left", "right"]);
        let (right, state) = (scene.with_end_effector("right").unwrap(), random_state(seed, &scene));
        assert_eq!(right.end_effector_names(), ["default", "left", "right"]);
        assert_eq!(right.with_end_effector("right").unwrap(), right);
        let back = right.with_end_effector(DEFAULT_END_EFFECTOR).unwrap();
        assert_eq!(back.arm.as_ref().unwrap().end_effector, scene.arm.as_ref().unwrap().end_effector);
        let [one, other] = [&scene, &right].map(|scene| ClosedFormModel::new(scene).unwrap());
        let forms = [one.at(&state, Vector3::zeros()), other.at(&state, Vector3::zeros())];
        // The payload stays where it is.
        let difference = forms[0].mass_matrix() - forms[1].mass_matrix();
        assert!(difference.norm() < 1e-13 * forms[0].mass_matrix().norm(), "{seed}");
        assert_eq!(Scene::from_toml_str(&right.to_toml_string(), "written").unwrap(), right);
    }
}

#[test]
fn a_payload_on_a_named_end_effector_is_a_part_of_its_link() {
    for (seed, mut scene) in trees() {
        scene.payload = None;
        let arm = scene.arm.as_mut().unwrap();
        let Some(on) = arm.links.iter().rev().find(|link| link.body.is_some()).map(|link| link.name.clone()) else {
            continue;
        };
        // At the link's origin, so that the sum is easy.
        arm.end_effectors.insert("right".into(), EndEffectorFrame { on: Some(on.clone()), ..Default::default() });
        let mut laden = scene.clone();
        let payload = Body { inertia: Matrix3::identity() * 0.01, ..Body::point(1.5) };
        laden.payload = Some(Payload { on: Some("right".into()), frame: Frame::default(), body: payload.clone() });
        laden.check().unwrap();
        let link = scene.arm.as_mut().unwrap().links.iter_mut().find(|link| link.name == on).unwrap();
        let body = link.body.as_mut().unwrap();
        let about_origin = {
            let c = body.center_of_mass.cross_matrix();
            body.inertia_about_com() - body.mass * c * c
        };
        body.center_of_mass *= body.mass / (body.mass + 1.5);
        (body.mass, body.inertia, body.weight) = (body.mass + 1.5, about_origin + payload.inertia, None);
        body.inertia_at = InertiaPoint::Origin;

        let state = random_state(seed, &scene);
        let [a, b] = [&laden, &scene].map(|scene| {
            let model = ClosedFormModel::new(scene).unwrap();
            let form = model.at(&state, Vector3::zeros());
            (form.mass_matrix().clone(), form.bias().clone())
        });
        assert!((&a.0 - &b.0).norm() < 1e-12 * b.0.norm(), "{seed}");
        // A scene with a fixed vehicle and no joints has no bias.
        let (difference, size) = ((&a.1 - &b.1).norm(), b.1.norm());
        assert!(difference <= 1e-12 * size, "{seed}: {difference:e} of {size:e}");
        let [a, b] = [&laden, &scene].map(|scene| run(scene, "mk4", 1e-3, &state, &Inputs::default(), 1));
        assert!((a.twist - b.twist).norm() < 1e-12 * b.twist.norm().max(1.0), "{seed}");
    }
}

#[test]
fn unknown_names_are_refused_in_one_line() {
    let (_, scene) = trees().next().unwrap();
    let error = scene.with_end_effector("third").unwrap_err().to_string();
    let expected = "end_effector: is \"third\", but must be one of the end effectors: \"default\", \"left\", \"right\"";
    assert!(error.ends_with(expected) && !error.contains('\n'), "{error}");
    let bare = Scene::shipped("bluerov2-heavy").unwrap();
    assert_eq!(bare.end_effector_names(), ["default"]);
    assert!(bare.with_end_effector("default").is_ok() && bare.with_end_effector("left").is_err());
    for (edit, key) in [
        ("arm.end_effector.on", "arm.end_effector.on: is \"nothing\", but must be one of the bodies"),
        ("arm.end_effectors.left.on", "arm.end_effectors.left.on: is \"nothing\", but must be one of the bodies"),
        ("payload.on", "payload.on: is \"nothing\", but must be one of the end effectors"),
    ] {
        let mut laden = scene.clone();
        laden.payload = Some(Payload { on: None, frame: Frame::default(), body: Body::point(1.0) });
        let editor = SceneEditor::new(&laden, vec![edit.to_owned()]).unwrap();
        let error = editor.edited(["nothing".into()], "scene").unwrap_err().to_string();
        assert!(error.contains(key), "{error}");
    }
}
