//! Scenes as data: what is read, and what follows from it.

use super::shipped;
use crate::random_scene::{Options, random_scene, random_state};
use nalgebra::{Matrix3, Vector3};
use uvms_gym::description::{InertiaPoint, MAX_JOINTS, Origin, Scene};

fn all_shipped() -> impl Iterator<Item = Scene> {
    Scene::shipped_names().into_iter().map(shipped)
}

#[test]
fn shipped_scenes_load_under_their_names_without_warnings() {
    for name in
        ["petasus-pum", "bluerov2-heavy-alpha5", "bluerov2-alpha5-pool", "bluerov2-heavy", "free-body", "rexrov"]
    {
        let scene = Scene::load(name).unwrap();
        assert_eq!(scene.name, name);
        assert_eq!(scene.check().unwrap(), []);
        assert!(!scene.summary.is_empty(), "{name}");
    }
    assert_eq!(Scene::shipped_names().len(), 11);
}

#[test]
fn every_number_of_every_shipped_scene_has_provenance() {
    for scene in all_shipped() {
        let numbers = scene.numbers();
        assert!(numbers.len() > 30, "{}: {}", scene.name, numbers.len());
        for (path, value, origin) in numbers {
            assert!(origin.is_some(), "{}: {path} = {value}", scene.name);
        }
    }
}

#[test]
fn a_scene_survives_its_own_toml() {
    for scene in all_shipped() {
        let text = scene.to_toml_string();
        let back = Scene::from_toml_str(&text, "back").unwrap();
        assert_eq!(back, scene);
        assert_eq!(back.to_toml_string(), text);
    }
}

#[test]
fn random_scenes_are_valid_and_repeatable() {
    for seed in 0..60 {
        let scene = random_scene(seed, Options::default());
        assert_eq!(scene, random_scene(seed, Options::default()));
        let back = Scene::from_toml_str(&scene.to_toml_string(), "random").unwrap();
        assert_eq!(back, scene, "seed {seed}");

        let state = random_state(seed, &scene);
        assert!((state.rotation.determinant() - 1.0).abs() < 1e-14);
        assert_eq!(scene.body_names().len(), scene.joints().count() + 1);
        assert_eq!(scene.vehicle.fixed, state.twist.norm() == 0.0);
    }
}

#[test]
fn the_papers_scene_has_eleven_degrees_of_freedom_and_joint_2_may_travel_45_degrees() {
    let scene = shipped("petasus-pum");
    assert_eq!(6 + scene.joints().count(), 11);
    assert_eq!(scene.vehicle.thrusters.len(), 6);
    let joint = scene.joints().nth(1).unwrap();
    let limits = joint.limits.as_ref().unwrap();
    let travel = std::f64::consts::FRAC_PI_4;
    assert!(joint.home + travel < limits.upper && joint.home > limits.lower);
    // Published: 1.2 m from the first joint to the tip.
    let arm = scene.arm.as_ref().unwrap();
    let joints: f64 = arm.links.iter().map(|link| link.joint.frame.position.norm()).sum();
    assert!((joints + arm.end_effector.position.norm() - 1.2).abs() < 1e-12);
}

#[test]
fn shipped_vehicles_are_nearly_neutral() {
    for scene in all_shipped().filter(|scene| scene.water.density > 0.0) {
        let bodies = || {
            let arm =
                scene.arm.iter().flat_map(|arm| arm.base.iter().chain(arm.links.iter().flat_map(|link| &link.body)));
            std::iter::once(&scene.vehicle.body).chain(arm)
        };
        let mass: f64 = bodies().map(|body| body.mass).sum();
        let displaced: f64 = bodies().map(|body| scene.water.density * body.displaced_volume(&scene.water)).sum();
        assert!((0.0..0.025).contains(&(displaced / mass - 1.0 + 1e-4)), "{}: {displaced} kg, {mass} kg", scene.name);
    }
}

#[test]
fn the_longest_provenance_key_counts() {
    let scene = shipped("bluerov2-heavy-alpha5");
    let origin = |path| scene.provenance_of(path).map(|(origin, _)| origin);
    assert_eq!(origin("vehicle.body.mass"), Some(Origin::Cited));
    assert_eq!(origin("vehicle.body.volume"), Some(Origin::Assumed));
    assert_eq!(origin("arm.links[1].body.mass"), Some(Origin::Cited));
    assert_eq!(origin("arm.links[elbow].body.center_of_buoyancy[0]"), Some(Origin::Assumed));
    assert_eq!(origin("arm.links[2].joint.friction.viscous"), Some(Origin::Cited));
    assert_eq!(origin("arm.links[7].body.mass"), None);
    assert_eq!(origin("arm.nothing"), None);

    let text = scene.to_toml_string() + "\"arm.links[elbow].body.mass\" = \"measured: on a scale\"\n";
    let scene = Scene::from_toml_str(&text, "weighed").unwrap();
    assert_eq!(scene.provenance_of("arm.links[2].body.mass"), Some((Origin::Measured, "on a scale")));
    assert_eq!(scene.provenance_of("arm.links[1].body.mass").unwrap().0, Origin::Cited);
}

#[test]
fn short_forms_mean_their_matrices() {
    let arm = shipped("bluerov2-heavy-alpha5").arm.unwrap();
    let inertia = arm.base.unwrap().inertia;
    let (xx, xy, xz, yy, yz, zz) = (83.66e-6, 14.45e-6, -38.27e-6, 998.81e-6, 3.14e-6, 1003.6e-6);
    assert!((inertia - Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)).amax() < 1e-15);
    let added = shipped("bluerov2-heavy").vehicle.body.added_mass;
    assert_eq!((added[(2, 2)], added[(1, 2)]), (14.6, 0.0));
}

#[test]
fn val_rexrov_added_mass_is_turned_to_z_up() {
    let added = shipped("rexrov").vehicle.body.added_mass;
    // Published with z down: surge-sway -6.8773, surge-roll 8.5426, sway-roll 409.44, heave-pitch -386.42.
    assert_eq!((added[(0, 1)], added[(0, 3)]), (6.8773, 8.5426));
    assert_eq!((added[(1, 3)], added[(2, 4)]), (-409.44, -386.42));
}

#[test]
fn reading_makes_axes_unit_and_matrices_symmetric() {
    let text = shipped("rexrov").to_toml_string();
    let text = text.replace("8.5426", "8.542600001").replacen("[0.0, 0.0, 1.0]", "[0, 0, 3]", 1);
    assert_ne!(text, shipped("rexrov").to_toml_string());
    // Only one of the two entries may differ, within rounding of the largest.
    let text = text.replacen("8.542600001", "8.5426", 1);
    let scene = Scene::from_toml_str(&text, "rounded").unwrap();
    let added = scene.vehicle.body.added_mass;
    assert_eq!(added, added.transpose());
    assert!((added[(0, 3)] - 8.5426000005).abs() < 1e-12);
    assert!(scene.vehicle.thrusters.iter().all(|thruster| (thruster.axis.norm() - 1.0).abs() < 1e-15));
}

#[test]
fn inertia_about_the_com_follows_from_that_about_the_origin() {
    // Two points of 1 kg at (+-1, 0, 0), seen from (0, -1, 0), and a little spread to make it a body.
    let mut body = shipped("free-body").vehicle.body;
    body.mass = 2.0;
    body.center_of_mass = Vector3::new(0.0, 1.0, 0.0);
    body.inertia_at = InertiaPoint::Origin;
    body.inertia = Matrix3::from_diagonal(&Vector3::new(2.1, 2.1, 4.1));
    let expected = Matrix3::from_diagonal(&Vector3::new(0.1, 2.1, 2.1));
    assert!((body.inertia_about_com() - expected).amax() < 1e-15);
}

#[test]
fn a_frame_rolls_then_pitches_then_yaws_about_parent_axes() {
    let mut frame = shipped("petasus-pum").arm.unwrap().end_effector.frame();
    let quarter = std::f64::consts::FRAC_PI_2;
    frame.rpy = Vector3::new(quarter, 0.0, quarter);
    // Roll takes y to z, yaw keeps it there; roll keeps x, yaw takes it to y.
    assert!((frame.rotation() * Vector3::y() - Vector3::z()).norm() < 1e-15);
    assert!((frame.rotation() * Vector3::x() - Vector3::y()).norm() < 1e-15);
}

#[test]
fn buoyancy_and_volume_displace_alike() {
    let mut scene = shipped("rexrov");
    let volume = scene.vehicle.body.volume.take().unwrap();
    scene.vehicle.body.buoyancy = Some(volume * 1028.0 * 9.81);
    assert_eq!(scene.check().unwrap(), []);
    assert!((scene.vehicle.body.displaced_volume(&scene.water) - volume).abs() < 1e-15);
}

#[test]
fn joints_are_named_after_what_they_carry_with_the_base_first() {
    let options = Options { branching: Some(false), joint_loading: Some(true), ..Options::default() };
    let scene = random_scene(3, Options { links: Some(2), ..options });
    assert_eq!(scene.joint_names(), ["base", "link-0", "link-1"]);
    assert_eq!(scene.body_names(), ["vehicle", "base", "link-0", "link-1"]);
    assert_eq!(scene.home()[0], scene.arm.as_ref().unwrap().mount.joint.as_ref().unwrap().home);
    assert_eq!(scene.home()[3..], [0.0; MAX_JOINTS - 3]);
    assert_eq!(scene.thruster_names().len(), 6);
}

#[test]
fn drag_that_drives_the_body_is_warned_of() {
    let mut scene = shipped("rexrov");
    scene.vehicle.body.damping.quadratic[(0, 1)] = 5e3;
    let warnings = scene.check().unwrap();
    assert_eq!(warnings.len(), 1);
    let text = warnings[0].to_string();
    assert!(text.contains("vehicle.body.damping.quadratic"), "{text}");
    // A small coupling takes less than the diagonal.
    scene.vehicle.body.damping.quadratic[(0, 1)] = 1.0;
    assert_eq!(scene.check().unwrap(), []);
}
