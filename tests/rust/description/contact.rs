//! Tables of contact and fixtures.

use nalgebra::Vector3;
use uvms_gym::description::{ContactGeometry, Provenance, Scene, WORLD};

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
    let cases: [(&str, &str, &[&str]); 32] = [
        ("friction = 0.3", "friction = -0.3", &["contact.friction: is -0.3, but must be >= 0"]),
        ("friction = 0.3", "ramp = 0.0", &["contact.ramp: is 0.0, but must be > 0"]),
        ("friction = 0.3", "dissipation = -1.0", &["contact.dissipation: is -1.0"]),
        ("friction = 0.3", "slip_speed = 0.0", &["contact.slip_speed: is 0.0", "> 0 where there is friction"]),
        ("friction = 0.3", "spheres = 3", &["contact.spheres"]),
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
        ("on = \"valve\"", "on = \"forearm\"", &["contact.shapes[3].on (rim)", "forearm", "fixtures"]),
        ("\"tip\"", "\"skid\"", &["contact.spheres[1].name (skid)", "taken"]),
        ("on = \"forearm\"", "on = \"hand\"", &["contact.spheres[1].on (tip)", "hand", "\"base\", \"yaw\""]),
        ("on = \"forearm\"", "on = \"valve\"", &["contact.spheres[1].on (tip)", "valve", "spheres are on the robot"]),
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
