//! Numbers from shapes: against the shipped scene that was derived by hand, and against each other.

mod lamb;
mod solid;
mod tables;

use nalgebra::{Matrix6, Rotation3, Vector3};
use uvms_gym::description::{Body, Scene, SceneWarning};
use uvms_gym::estimate::{Estimate, Outline};

fn estimate(text: &str) -> Estimate {
    Outline::from_toml_str(text, "shapes.toml").unwrap_or_else(|error| panic!("{error}")).estimate()
}

fn refused(text: &str) -> String {
    let message = Outline::from_toml_str(text, "shapes.toml").unwrap_err().to_string();
    assert!(message.starts_with("shapes.toml: ") && !message.contains('\n'), "{message}");
    message
}

/// Entries of a diagonal, which stand in the scene with `figures` digits.
fn agree(what: &str, derived: &Matrix6<f64>, scene: &Matrix6<f64>, tolerance: f64) {
    for i in 0..6 {
        for j in 0..6 {
            let (a, b) = (derived[(i, j)], scene[(i, j)]);
            assert!((a - b).abs() <= tolerance * b.abs(), "{what}[{i}][{j}]: {a} is not {b}");
        }
    }
}

/// All that the scene's comments derive from a shape, within its rounding to three or four figures.
fn agree_with_scene(derived: &Body, scene: &Body) {
    assert!((derived.mass / scene.mass - 1.0).abs() < 1e-3, "{} {}", derived.mass, scene.mass);
    assert!((derived.volume.unwrap() / scene.volume.unwrap() - 1.0).abs() < 1e-3);
    assert!(
        (derived.inertia - scene.inertia).amax() < 1e-3 * scene.inertia.amax(),
        "{} {}",
        derived.inertia,
        scene.inertia
    );
    assert_eq!(derived.hydrodynamic_frame, scene.hydrodynamic_frame);
    agree("added mass", &derived.added_mass, &scene.added_mass, 2e-3);
    agree("quadratic drag", &derived.damping.quadratic, &scene.damping.quadratic, 6e-3);
    agree("linear drag", &derived.damping.linear, &scene.damping.linear, 6e-3);
}

#[test]
fn the_cylinders_of_petasus_pum_come_out_as_its_comments_derive_them() {
    let arm = Scene::shipped("petasus-pum").unwrap().arm.unwrap();
    for (link, length, radius, axis, position) in [
        (0, 0.10, 0.050, "z", [0.0, 0.0, 0.05]),
        (1, 0.40, 0.045, "x", [0.2, 0.0, 0.0]),
        (2, 0.35, 0.040, "x", [0.175, 0.0, 0.0]),
        (3, 0.15, 0.040, "x", [0.075, 0.0, 0.0]),
    ] {
        let derived = estimate(&format!(
            "speed = [0.1, 0.5]\n[[shapes]]\nends = 'joined'\nrelative_density = 1.02\nposition = {position:?}\n\
             cylinder = {{ radius = {radius}, length = {length}, axis = '{axis}' }}"
        ));
        let own = arm.links[link].body.as_ref().unwrap();
        agree_with_scene(&derived.body, own);
        assert_eq!(derived.body.center_of_mass, own.center_of_mass);
        assert_eq!(derived.body.center_of_buoyancy, own.center_of_buoyancy);
    }
}

#[test]
fn the_perforated_cube_of_petasus_pum_comes_out_as_its_comments_derive_it() {
    let scene = Scene::shipped("petasus-pum").unwrap().vehicle.body;
    let derived = estimate(
        "[[shapes]]\nbox = [0.7, 0.7, 0.7]\ndisplaced = 0.3\nmass = 102.763\nperforation = [0.5, 0.5, 0.34]\n\
         solidity = [0.7, 0.7, 0.85]",
    );
    agree_with_scene(&derived.body, &scene);
}

/// A body in two halves about the origin, and its mirror image turned by a right angle.
#[test]
fn shapes_add_up_by_parallel_axes() {
    let half = |x: f64| format!("[[shapes]]\nbox = [0.2, 0.4, 0.3]\nposition = [{x}, 0.0, 0.1]\n");
    let one = estimate("[[shapes]]\nbox = [0.2, 0.4, 0.3]").body;
    let two = estimate(&(half(0.5) + &half(-0.5))).body;
    assert!((two.mass - 2.0 * one.mass).abs() < 1e-6 * two.mass);
    assert_eq!(two.center_of_mass, Vector3::new(0.0, 0.0, 0.1));
    assert!((two.inertia[(2, 2)] - 2.0 * (one.inertia[(2, 2)] + one.mass * 0.25)).abs() < 1e-5);
    let (a, b) = (&one.added_mass, &two.added_mass);
    assert!((b[(0, 0)] - 2.0 * a[(0, 0)]).abs() < 1e-5 * b[(0, 0)]);
    assert!((b[(5, 5)] - 2.0 * (a[(5, 5)] + a[(1, 1)] * 0.25)).abs() < 1e-5 * b[(5, 5)]);
    // Surge turns the body about y, as its water lies above the origin: A_xq = z A_xx.
    assert!((b[(0, 4)] - 0.1 * b[(0, 0)]).abs() < 1e-5 * b[(0, 0)] && b[(0, 4)] == b[(4, 0)]);
    assert!(b[(0, 5)] == 0.0 && b[(0, 1)] == 0.0);
    let (a, b) = (&one.damping.quadratic, &two.damping.quadratic);
    assert!((b[(5, 5)] - 2.0 * (a[(5, 5)] + a[(1, 1)] * 0.125)).abs() < 1e-5 * b[(5, 5)]);
}

#[test]
fn a_turned_shape_is_the_same_body_in_other_axes() {
    let quarter = std::f64::consts::FRAC_PI_2;
    let along_x = estimate("[[shapes]]\ncylinder = { radius = 0.1, length = 0.8, axis = 'x' }").body;
    let turned = estimate(&format!(
        "[[shapes]]\nrpy = [0.0, {quarter}, 0.0]\ncylinder = {{ radius = 0.1, length = 0.8, axis = 'z' }}"
    ));
    let r = Rotation3::from_euler_angles(0.0, quarter, 0.0).into_inner();
    assert!((r * Vector3::z() - Vector3::x()).norm() < 1e-15);
    assert!((turned.body.inertia - along_x.inertia).amax() < 1e-6);
    assert_eq!(turned.body.added_mass[(2, 2)], along_x.added_mass[(0, 0)]);
    // A second, tiny shape brings the same numbers to the body's axes.
    let grain = "[[shapes]]\nellipsoid = [1e-4, 1e-4, 1e-4]\n";
    let summed = estimate(&format!(
        "{grain}[[shapes]]\nrpy = [0.0, {quarter}, 0.0]\ncylinder = {{ radius = 0.1, length = 0.8, axis = 'z' }}"
    ));
    assert!((summed.body.added_mass - along_x.added_mass).amax() < 1e-5 * along_x.added_mass.amax());
    assert!(
        (summed.body.damping.quadratic - along_x.damping.quadratic).amax() < 1e-5 * along_x.damping.quadratic.amax()
    );
}

/// Whatever the shapes, a scene takes the body, and the text says the same as the numbers.
#[test]
fn estimates_are_scenes_that_pass_their_checks() {
    let shapes = [
        "[[shapes]]\nbox = [0.457, 0.338, 0.254]\nperforation = 0.3\nmass = 11.5",
        "[[shapes]]\nellipsoid = [0.8, 0.2, 0.15]\n[[shapes]]\ncapsule = { radius = 0.05, length = 0.3, axis = 'y' }\nposition = [-0.3, 0.1, 0.2]\nrpy = [0.3, 0.2, 0.7]",
        "[[shapes]]\ncylinder = { radius = 0.1, length = 0.02, axis = 'z' }\nposition = [0.4, 0.0, 0.0]\n[[shapes]]\ncylinder = { radius = 0.02, length = 1.5 }\nends = 'joined'\nrpy = [0.1, 0.5, 0.0]\n[[shapes]]\nbox = [0.3, 0.02, 0.1]\nends = 'joined'",
    ];
    for text in shapes {
        let Estimate { body, formulas } = estimate(text);
        let mut scene = Scene::shipped("free-body").unwrap();
        scene.vehicle.body = body;
        scene.provenance = Default::default();
        let warnings = scene.check().unwrap_or_else(|error| panic!("{error}"));
        assert!(warnings.iter().all(|w| matches!(w, SceneWarning::DampingAddsEnergy { .. })), "{warnings:?}");

        let table = Estimate { body: scene.vehicle.body.clone(), formulas: formulas.clone() }.to_toml("vehicle.body");
        let whole = format!(
            "name = 'x'\n[water]\ndensity = 1000\ngravity = [0, 0, -9.81]\n[vehicle]\nname = 'x'\n{table}\
             'water' = 'assumed: fresh'\n"
        );
        let read = Scene::from_toml_str(&whole, "x.toml").unwrap_or_else(|error| panic!("{error}\n{whole}"));
        assert_eq!(read.vehicle.body, scene.vehicle.body);
        assert!(formulas.iter().all(|(key, text)| table.contains(&format!("# derived: {text}\n{key} = "))), "{table}");
        assert!(
            read.numbers().iter().all(|(key, _, origin)| !key.starts_with("vehicle.body.added") || origin.is_some())
        );
    }
}

#[test]
fn a_malformed_outline_is_one_line_with_key_and_value() {
    for (text, parts) in [
        ("", &["shapes", "missing"][..]),
        ("shapes = []", &["shapes", "missing"]),
        ("[[shapes]]\nname = 'hull'", &["shapes[0]", "exactly one of box", "hull"]),
        ("[[shapes]]\nbox = [1, 1, 1]\nellipsoid = [1, 1, 1]", &["shapes[0]", "exactly one"]),
        ("[[shapes]]\nbox = [1, -1, 1]", &["shapes[0].box", "-1.0"]),
        ("[[shapes]]\nbox = [1, 1]", &["shapes[0].box", "expected 3 numbers, found 2"]),
        ("[[shapes]]\nname = 'leg'\ncylinder = { radius = 0.0, length = 1.0 }", &["shapes[0].cylinder", "0.0"]),
        ("[[shapes]]\ncylinder = { radius = 0.1 }", &["shapes[0].cylinder.length", "missing"]),
        ("[[shapes]]\nbox = [1, 1, 1]\nperforation = 0.8", &["shapes[0].perforation", "0.8", "their parts"]),
        ("[[shapes]]\nbox = [1, 1, 1]\nperforation = [0.1, 0.2]", &["shapes[0].perforation", "found 2"]),
        ("[[shapes]]\nbox = [1, 1, 1]\nmass = 3\nrelative_density = 1", &["shapes[0].mass", "not both", "3"]),
        ("[[shapes]]\nbox = [1, 1, 1]\nmass = nan", &["shapes[0].mass", "NaN"]),
        ("[[shapes]]\nbox = [1, 1, 1]\ncolour = 'red'", &["shapes[0].colour", "unknown key", "perforation"]),
        ("density = -1\n[[shapes]]\nbox = [1, 1, 1]", &["density", "-1.0"]),
        ("[[shapes]\n", &["line 1"]),
    ] {
        let message = refused(text);
        for part in parts {
            assert!(message.contains(part), "{text}: '{message}' has no '{part}'");
        }
    }
}
