//! Tables of contact and fixtures.

use nalgebra::Vector3;
use uvms_gym::description::{
    BASE, Contact, ContactGeometry, ContactShape, Frame, Parent, Provenance, Scene, Sphere, VEHICLE, WORLD,
};
use uvms_gym::system::EndEffector;

use super::compose::Folder;
use crate::random_scene::{Options, random_scene};

/// A valve, a button and all kinds of shapes, for the scene with the paper's arm.
const TABLES: &str = r#"
[contact]
friction = 0.3

[[contact.spheres]]
name = "skid"
on = "vehicle"
position = [0.2, 0.1, -0.3]
radius = 0.02
[[contact.spheres]]
name = "tip"
on = "forearm"
position = [0.1, 0.0, 0.0]
radius = 0.01

[[contact.shapes]]
name = "seabed"
kind = "plane"
frame.position = [0.0, 0.0, -3.0]
stiffness = 2000.0
[[contact.shapes]]
name = "panel"
on = "world"
kind = "box"
size = [0.02, 1.0, 2.0]
frame = { position = [4.0, 0.0, 0.0], rpy = [0.0, 0.0, 0.1] }
[[contact.shapes]]
name = "cap"
on = "button"
kind = "cylinder"
radius = 0.02
length = 0.01
friction = 0.0
slip_speed = 0.0
[[contact.shapes]]
name = "rim"
on = "valve"
kind = "torus"
radius = 0.059
tube = 0.006

[[fixtures]]
name = "valve"
joint = { kind = "revolute", axis = [0.0, 0.0, 2.0], rotor_inertia = 0.01, frame.position = [3.9, 0.0, 0.0], home = 0.5 }
[[fixtures]]
name = "button"
joint = { kind = "prismatic", axis = [1.0, 0.0, 0.0], limits = { lower = 0.0, upper = 0.01, stiffness = 1e5 } }
body = { mass = 0.1, inertia = [1e-4, 1e-4, 1e-4] }
"#;

fn text() -> String {
    let mut scene = Scene::shipped("petasus-pum").unwrap();
    scene.provenance = Provenance::default();
    scene.to_toml_string() + TABLES
}

fn scene() -> Scene {
    Scene::from_toml_str(&text(), "my.toml").unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn tables_are_read_and_written() {
    let scene = scene();
    assert_eq!(Scene::from_toml_str(&scene.to_toml_string(), "dumped").unwrap(), scene);
    let contact = scene.contact.as_ref().unwrap();
    assert_eq!((contact.stiffness, contact.friction, contact.ramp), (5000.0, 0.3, 0.0005));
    let [seabed, panel, cap, rim] = &contact.shapes[..] else { panic!("{:?}", contact.shapes) };
    assert_eq!((seabed.on.as_str(), seabed.geometry), (WORLD, ContactGeometry::Plane));
    assert_eq!(panel.geometry, ContactGeometry::Box { size: Vector3::new(0.02, 1.0, 2.0) });
    assert_eq!(cap.geometry, ContactGeometry::Cylinder { radius: 0.02, length: 0.01 });
    assert_eq!(rim.geometry, ContactGeometry::Torus { radius: 0.059, tube: 0.006 });
    let (own, common) = (contact.law(seabed), contact.law(rim));
    assert_eq!((own.stiffness, own.friction, common.stiffness), (2000.0, 0.3, 5000.0));
    let none = Scene::from_toml_str(&text().replacen(TABLES, "", 1), "none").unwrap();
    assert!(none.contact.is_none() && !none.to_toml_string().contains("fixtures"));
}

#[test]
fn coordinates_are_joints_and_then_fixtures() {
    let scene = scene();
    assert_eq!(scene.joints().count() + 2, scene.coordinates().count());
    assert_eq!(scene.coordinate_names()[5..], ["valve", "button"]);
    assert_eq!(scene.coordinate_keys()[5..], ["fixtures[0].joint", "fixtures[1].joint"]);
    assert_eq!(scene.coordinates().nth(5).unwrap().axis, Vector3::z(), "normalised");
    assert_eq!(scene.home()[5..7], [0.5, 0.0]);
    assert!((scene.masses().0 - scene.robot().masses().0).abs() < 1e-12, "fixtures do not weigh on the robot");
}

#[test]
fn robot_is_the_scene_without_contact_and_fixtures() {
    let mut scene = scene();
    for (key, text) in [("water", "w"), ("contact.spheres[tip].radius", "r"), ("fixtures[valve]", "v")] {
        scene.provenance.0.insert(key.to_owned(), format!("assumed: {text}"));
    }
    scene.check().unwrap();
    let robot = scene.robot();
    robot.check().unwrap();
    assert_eq!(robot.provenance.0.len(), 1);
    let text = text().replacen(TABLES, "", 1);
    assert_eq!(Scene { provenance: Provenance::default(), ..robot }, Scene::from_toml_str(&text, "bare").unwrap());
}

#[test]
fn malformed_tables_are_refused_in_one_line() {
    let cases: [(&str, &str, &[&str]); 31] = [
        ("friction = 0.3", "friction = -0.3", &["contact.friction: is -0.3, but must be >= 0"]),
        ("friction = 0.3", "ramp = 0.0", &["contact.ramp: is 0.0, but must be > 0"]),
        ("friction = 0.3", "dissipation = -1.0", &["contact.dissipation: is -1.0"]),
        ("friction = 0.3", "slip_speed = 0.0", &["contact.slip_speed: is 0.0", "> 0 where there is friction"]),
        ("friction = 0.3", "damping = 3.0", &["contact.damping", "unknown key with value 3.0", "dissipation"]),
        ("stiffness = 2000.0", "stiffness = 0.0", &["contact.shapes[0].stiffness (seabed): is 0.0, but must be > 0"]),
        ("stiffness = 2000.0", "ramp = -1e-4", &["contact.shapes[0].ramp (seabed): is -0.0001"]),
        ("stiffness = 2000.0", "tube = 0.1", &["contact.shapes[0].tube (seabed): unknown key", "0.1", "plane"]),
        ("friction = 0.0", "friction = 0.1", &["contact.shapes[2].slip_speed (cap)", "> 0 where there is friction"]),
        ("\"box\"", "\"sphere\"", &["contact.shapes[1].kind (panel)", "sphere", "torus"]),
        ("\"box\"", "\"cylinder\"", &["contact.shapes[1].size (panel): unknown key", "radius and length"]),
        ("tube = 0.006", "length = 0.006", &["contact.shapes[3].length (rim): unknown key", "radius and tube"]),
        ("tube = 0.006", "", &["contact.shapes[3].tube (rim): missing"]),
        ("tube = 0.006", "tube = 0.06", &["contact.shapes[3].tube (rim): is 0.06", "less than radius"]),
        ("length = 0.01", "length = 0.0", &["contact.shapes[2].length (cap): is 0.0"]),
        ("size = [0.02,", "size = [0.0,", &["contact.shapes[1].size[0] (panel): is 0.0, but must be > 0"]),
        ("size = [0.02,", "size = [", &["contact.shapes[1].size (panel)", "expected 3 numbers, found 2"]),
        ("\"rim\"", "\"cap\"", &["contact.shapes[3].name (cap)", "taken"]),
        (
            "on = \"valve\"",
            "on = \"wheel\"",
            &["contact.shapes[3].on (rim)", "wheel", "\"world\", \"valve\", \"button\""],
        ),
        ("on = \"valve\"", "on = \"forearm\"", &["contact.shapes[3].on (rim)", "forearm", "bodies that carry shapes"]),
        ("\"tip\"", "\"skid\"", &["contact.spheres[1].name (skid)", "taken"]),
        ("on = \"forearm\"", "on = \"hand\"", &["contact.spheres[1].on (tip)", "hand", "\"base\", \"yaw\""]),
        (
            "on = \"forearm\"",
            "on = \"valve\"",
            &[
                "contact.spheres[1].on (tip)",
                "\"valve\", but must be one of the bodies of the robot: \"vehicle\", \"base\"",
            ],
        ),
        ("on = \"forearm\"", "on = \"world\"", &["contact.spheres[1].on (tip)", "world", "\"vehicle\""]),
        ("radius = 0.01", "radius = 0.0", &["contact.spheres[1].radius (tip): is 0.0, but must be > 0"]),
        ("name = \"button\"", "name = \"valve\"", &["fixtures[1].name (valve)", "taken"]),
        ("name = \"button\"", "name = \"world\"", &["fixtures[1].name (world)", "reserved"]),
        ("name = \"button\"", "name = \"forearm\"", &["fixtures[1].name (forearm)", "taken by a link"]),
        (
            "\"prismatic\", axis = [1.0, 0.0, 0.0]",
            "\"fixed\"",
            &["fixtures[1].joint.kind (button)", "shape on the world"],
        ),
        ("rotor_inertia = 0.01, ", "", &["fixtures[0].joint.rotor_inertia (valve): is 0.0", "no body"]),
        ("home = 0.5", "homes = 0.5", &["fixtures[0].joint.homes (valve)", "unknown key"]),
    ];
    for (old, new, parts) in cases {
        assert!(TABLES.contains(old), "no {old}");
        let tables = TABLES.replacen(old, new, 1);
        let message = match Scene::from_toml_str(&text().replacen(TABLES, &tables, 1), "my.toml") {
            Ok(_) => panic!("{old} -> {new} is accepted"),
            Err(error) => error.to_string(),
        };
        for part in ["my.toml"].iter().chain(parts) {
            assert!(message.contains(part), "{old} -> {new}: '{message}' has no '{part}'");
        }
        assert!(!message.contains('\n'), "{message}");
    }
    let mut many = scene();
    for i in 0..10 {
        let mut fixture = many.fixtures[0].clone();
        fixture.name = format!("more-{i}");
        many.fixtures.push(fixture);
    }
    let message = many.check().unwrap_err().to_string();
    assert!(message.contains("fixtures: 17 moving joints") && message.contains("fixtures included"), "{message}");
    many.fixtures.pop();
    many.check().unwrap();
    let mut vehicle = Scene::shipped("free-body").unwrap();
    vehicle.contact = many.contact;
    vehicle.fixtures = many.fixtures;
    let message = vehicle.check().unwrap_err().to_string();
    assert!(
        message.contains("contact.spheres[1].on (tip): is \"forearm\"") && message.contains("\"vehicle\""),
        "{message}"
    );
}

#[test]
fn spheres_and_bodies_of_fixtures_may_be_in_fossens_axes() {
    let turned = TABLES
        .replacen("position = [0.2, 0.1, -0.3]", "axes = \"ned\"\nposition = [0.2, -0.1, 0.3]", 1)
        .replacen("mass = 0.1,", "mass = 0.1, center_of_mass = [0.1, -0.2, -0.3], axes = \"ned\",", 1);
    let plain = TABLES.replacen("mass = 0.1,", "mass = 0.1, center_of_mass = [0.1, 0.2, 0.3],", 1);
    let read = |tables: &str| Scene::from_toml_str(&text().replacen(TABLES, tables, 1), "my.toml").unwrap();
    assert_eq!(read(&turned), read(&plain));
    let frames = TABLES.replacen("kind = \"torus\"", "kind = \"torus\"\naxes = \"ned\"", 1);
    let message = Scene::from_toml_str(&text().replacen(TABLES, &frames, 1), "my.toml").unwrap_err().to_string();
    assert!(message.contains("contact.shapes[3].axes (rim): unknown key"), "the world's axes are z up: {message}");
}

#[test]
fn distances_are_of_the_nearest_point_of_the_surface() {
    let cases = [
        (ContactGeometry::Plane, [3.0, 4.0, -0.5], -0.5),
        (ContactGeometry::Box { size: Vector3::new(2.0, 4.0, 6.0) }, [4.0, 6.0, 0.0], 5.0),
        (ContactGeometry::Box { size: Vector3::new(2.0, 4.0, 6.0) }, [0.0, -1.75, 0.0], -0.25),
        (ContactGeometry::Cylinder { radius: 1.0, length: 2.0 }, [0.0, 4.0, -5.0], 5.0),
        (ContactGeometry::Cylinder { radius: 1.0, length: 2.0 }, [0.3, 0.4, 0.0], -0.5),
        (ContactGeometry::Cylinder { radius: 1.0, length: 2.0 }, [0.0, 0.0, 0.75], -0.25),
        (ContactGeometry::Torus { radius: 2.0, tube: 0.5 }, [3.0, 4.0, 4.0], 4.5),
        (ContactGeometry::Torus { radius: 2.0, tube: 0.5 }, [0.0, 2.25, 0.0], -0.25),
    ];
    for (geometry, point, distance) in cases {
        assert!((geometry.distance(&point.into()) - distance).abs() < 1e-15, "{geometry:?}");
    }
}

#[test]
fn spheres_inside_shapes_at_the_start_are_doubted() {
    let warnings = |change: &dyn Fn(&mut Scene)| -> Vec<String> {
        let mut scene = scene();
        change(&mut scene);
        scene.check().unwrap();
        let texts = scene.lint().into_iter().map(|warning| warning.to_string());
        texts.filter(|text| text.starts_with("contact")).collect()
    };
    assert_eq!(warnings(&|_| {}), Vec::<String>::new());
    // The skid's centre is 0.3 m below the vehicle's.
    let seabed = |scene: &mut Scene, z: f64| {
        let contact = scene.contact.as_mut().unwrap();
        contact.spheres.truncate(1);
        contact.shapes[0].frame.position.z = z;
    };
    let found = warnings(&|scene| seabed(scene, -0.29));
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(
        found[0].contains("contact.spheres[0] (skid): its centre is 0.0100 m inside the shape 'seabed'"),
        "{found:?}"
    );
    let touching = warnings(&|scene| seabed(scene, -0.31));
    assert!(touching.is_empty(), "its surface alone is inside: {touching:?}");
    let found = warnings(&|scene| {
        scene.fixtures[1].joint.limits.as_mut().unwrap().upper = 1.0;
        (scene.fixtures[1].joint.home, scene.fixtures[1].joint.frame.position) = (0.2, Vector3::new(0.0, 0.1, -0.3));
    });
    assert!(found.len() == 1 && found[0].contains("'cap'"), "a fixture at home carries its shape: {found:?}");
    let found = warnings(&|scene| scene.contact.as_mut().unwrap().shapes[2].stiffness = Some(1e9));
    assert!(found.len() == 2 && found[1].contains("(tip): 1000000000 N/m on the"), "{found:?}");
}

#[test]
fn spheres_start_where_the_kernel_has_their_bodies() {
    const SIZE: f64 = 2e-6;
    let options = Options { branching: Some(true), ..Options::default() };
    for mut scene in (0..60).map(|seed| random_scene(seed, options)).filter(|scene| scene.arm.is_some()) {
        let (_, place) = EndEffector::new(&scene).pose(&scene.home());
        let arm = scene.arm.as_ref().unwrap();
        let on = match arm.carrier(&arm.end_effector).unwrap() {
            Parent::Vehicle => VEHICLE.to_owned(),
            Parent::Base => BASE.to_owned(),
            Parent::Link(i) => arm.links[i].name.clone(),
        };
        let sphere = Sphere { name: "tip".to_owned(), on, position: arm.end_effector.position, radius: 0.1 };
        let mut inside = |offset: f64| {
            let shape = ContactShape {
                name: "box".to_owned(),
                on: WORLD.to_owned(),
                frame: Frame { position: place + Vector3::new(offset, 0.0, 0.0), rpy: Vector3::zeros() },
                geometry: ContactGeometry::Box { size: Vector3::repeat(SIZE) },
                stiffness: None,
                dissipation: None,
                ramp: None,
                friction: None,
                slip_speed: None,
                colour: None,
            };
            scene.contact = Some(Contact { spheres: vec![sphere.clone()], shapes: vec![shape], ..Contact::default() });
            scene.lint().iter().any(|warning| warning.to_string().contains("inside the shape 'box'"))
        };
        assert!(inside(0.0) && !inside(SIZE), "{}", scene.name);
    }
}

/// A vehicle and an arm of files of their own, with spheres.
const PARTS: [(&str, &str); 2] = [
    (
        "hull.toml",
        r#"
        contact.spheres = [{ name = "skid", on = "vehicle", position = [0.1, 0.2, -0.3], radius = 0.02, axes = "ned" }]
        [vehicle]
        file = "petasus"
        [provenance]
        contact = "cited: the hull"
        "#,
    ),
    (
        "gripper.toml",
        r#"
        [arm]
        file = "pum"
        [contact]
        stiffness = 1.0
        [[contact.spheres]]
        name = "tip"
        on = "gripper"
        position = [0.2, 0.0, 0.0]
        radius = 0.01
        [[contact.spheres]]
        name = "foot"
        on = "base"
        position = [0.0, 0.0, 0.0]
        radius = 0.05
        [[contact.shapes]]
        name = "floor"
        kind = "plane"
        [provenance]
        "contact.spheres" = "measured: the arm"
        "contact.spheres[tip].radius" = "cited: the tip"
        "#,
    ),
];

#[test]
fn spheres_come_with_their_parts() {
    let scene = r#"
        name = "composed"
        [vehicle]
        file = "hull.toml"
        [arm]
        file = "gripper.toml"
        [[arms]]
        file = "gripper.toml"
        name = "left"
        [contact]
        friction = 0.1
        "#;
    let own = scene.to_owned()
        + r#"
        [[contact.spheres]]
        name = "own"
        on = "left-yaw"
        position = [0.0, 0.0, 0.0]
        radius = 0.1
        "#;
    let replaced = scene.to_owned() + "spheres.left-tip.radius = 0.03\n";
    let [hull, gripper] = PARTS;
    let files = [
        hull,
        gripper,
        ("own.toml", &own),
        ("replaced.toml", &replaced),
        ("unknown.toml", &replaced.replace("left-tip", "tap")),
    ];
    let folder = Folder::new("spheres", &files);
    let scene = folder.scene("own.toml").unwrap_or_else(|error| panic!("{error}"));
    let contact = scene.contact.as_ref().unwrap();
    assert_eq!((contact.friction, contact.stiffness, contact.shapes.len()), (0.1, 5000.0, 0), "the scene's law alone");
    let found: Vec<_> = contact.spheres.iter().map(|sphere| (sphere.name.as_str(), sphere.on.as_str())).collect();
    let expected = [
        ("skid", "vehicle"),
        ("tip", "gripper"),
        ("foot", "base"),
        ("left-tip", "left-gripper"),
        ("left-foot", "left-base"),
        ("own", "left-yaw"),
    ];
    assert_eq!(found, expected);
    assert_eq!(contact.spheres[0].position, Vector3::new(0.1, -0.2, 0.3));
    let text = |key: &str| scene.provenance_of(key).map(|(_, text)| text);
    assert_eq!(text("contact.spheres[skid].position"), Some("the hull"));
    assert_eq!(text("contact.spheres[left-foot].radius"), Some("the arm"));
    assert_eq!(text("contact.spheres[left-tip].radius"), Some("the tip"));
    assert_eq!((text("contact.friction"), text("contact.spheres[own].radius")), (None, None));

    let scene = folder.scene("replaced.toml").unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(scene.contact.as_ref().unwrap().spheres[3].radius, 0.03);
    let text = |key: &str| scene.provenance_of(key).map(|(_, text)| text);
    assert_eq!(text("contact.spheres[left-tip].radius"), Some("stated in place of the part's"));
    assert_eq!(text("contact.spheres[left-tip].position"), Some("the arm"));
    let error = folder.scene("unknown.toml").unwrap_err();
    assert!(error.contains("contact.spheres: the part has no \"tap\"") && error.contains("\"left-tip\""), "{error}");
}

#[test]
fn a_bare_vehicle_has_the_spheres_on_it_alone() {
    let mut scene = scene();
    scene.provenance.0.insert("contact.spheres[tip]".to_owned(), "assumed: the tip".to_owned());
    let bare = scene.bare_vehicle();
    bare.check().unwrap();
    assert_eq!(bare.contact.unwrap().spheres.len(), 1);
    assert_eq!(bare.fixtures.len(), 2);
}
