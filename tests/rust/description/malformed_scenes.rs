//! Malformed scenes: each is refused by an error that names the source, the key and the value.

use nalgebra::Vector3;
use proptest::prelude::*;
use toml::Value;
use uvms_gym::batch::{Inputs, Simulator, SimulatorOptions};
use uvms_gym::description::{
    Body, Detent, Frame, Joint, JointSpring, LinearActuator, Scene, Tether, ThrustMap, ThrustTable,
};
use uvms_gym::error::DescriptionError;

fn text(name: &str) -> String {
    Scene::shipped(name).unwrap().to_toml_string()
}

/// Replaces `old` once by `new` in a shipped scene, and demands an error with all of `parts`.
fn refused(name: &str, old: &str, new: &str, parts: &[&str]) {
    let good = text(name);
    assert!(good.contains(old), "{name} has no {old}");
    let message = match Scene::from_toml_str(&good.replacen(old, new, 1), "my.toml") {
        Ok(_) => panic!("{old} -> {new} is accepted"),
        Err(error) => error.to_string(),
    };
    for part in ["my.toml"].iter().chain(parts) {
        assert!(message.contains(part), "{old} -> {new}: '{message}' has no '{part}'");
    }
    assert!(!message.contains('\n'), "{message}");
}

/// As [`refused`], for the keys of the free body, whose mass is 1 and inertia the identity.
fn refused_body(old: &str, new: &str, parts: &[&str]) {
    refused("free-body", old, new, parts);
}

const MASS: &str = "mass = 1.0\n";
const INERTIA: &str = "inertia = [1.0, 1.0, 1.0]";
const ADDED: &str = "added_mass = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]";

/// Six rows with the given diagonal and one pair of entries.
fn rows(diagonal: f64, upper: f64, lower: f64) -> String {
    let mut rows = [[0.0; 6]; 6];
    rows.iter_mut().enumerate().for_each(|(i, row)| row[i] = diagonal);
    rows[0][1] = upper;
    rows[1][0] = lower;
    format!("{rows:?}")
}

#[test]
fn a_missing_key() {
    refused_body(MASS, "", &["vehicle.body.mass", "missing"]);
    refused_body("density = 0.0", "", &["water.density", "missing"]);
    refused("petasus-pum", "axis = [0.0, -1.0, 0.0]\n", "", &["arm.links[1].joint.axis (upper-arm)", "missing"]);
    refused("petasus-pum", "kind = \"revolute\"", "", &["arm.links[0].joint.kind (yaw)", "missing"]);
}

#[test]
fn an_unknown_key() {
    refused_body(MASS, "mass = 1.0\nmas = 2.5\n", &["vehicle.body.mas", "2.5", "unknown", "center_of_mass"]);
    refused_body("density = 0.0", "density = 0.0\nwaves = true", &["water.waves", "true", "unknown"]);
    refused("petasus-pum", "kind = \"revolute\"", "kind = \"spherical\"", &["arm.links[0].joint.kind", "spherical"]);
}

#[test]
fn a_wrong_type() {
    refused_body(MASS, "mass = \"heavy\"\n", &["vehicle.body.mass", "heavy"]);
    refused_body(INERTIA, "inertia = [1, true, 1]", &["vehicle.body.inertia", "true"]);
    refused_body("gravity = [0.0, 0.0, 0.0]", "gravity = -9.81", &["water.gravity", "-9.81"]);
}

#[test]
fn a_wrong_length() {
    refused_body(INERTIA, "inertia = [1.0, 2.0]", &["vehicle.body.inertia", "[1.0, 2.0]", "found 2 numbers"]);
    refused_body(INERTIA, "inertia = [[1.0, 2.0], [3.0]]", &["vehicle.body.inertia", "found rows of lengths 2, 1"]);
    refused_body(INERTIA, "inertia = [1.0, [2.0], 1.0]", &["vehicle.body.inertia", "found numbers and rows mixed"]);
    refused_body(ADDED, "added_mass = [1.0, 2.0, 3.0, 4.0, 5.0]", &["vehicle.body.added_mass", "found 5 numbers"]);
    refused_body("gravity = [0.0, 0.0, 0.0]", "gravity = [0.0, -9.81]", &["water.gravity", "[0.0, -9.81]", "found 2"]);
    refused("rexrov", "kp = [", "kp = [1.0, ", &["vehicle.servo.kp", "expected 6 numbers, found 7"]);
    refused("rexrov", "limits = [", "limits = [1.0, ", &["vehicle.thrusters[0].limits", "expected 2 numbers, found 3"]);
}

#[test]
fn a_number_that_is_none() {
    refused_body(MASS, "mass = nan\n", &["vehicle.body.mass", "NaN"]);
    refused_body(INERTIA, "inertia = [1.0, 1.0, -inf]", &["vehicle.body.inertia[2]", "-inf"]);
    let added = format!("added_mass = {}", rows(1e13, 0.0, 0.0));
    refused_body(ADDED, &added, &["vehicle.body.added_mass[0][0]", "1000000"]);
    refused("petasus-pum", "viscous = 5.0", "viscous = nan", &["arm.links[2].joint.friction.viscous (forearm)", "NaN"]);
}

#[test]
fn an_asymmetric_or_indefinite_mass() {
    let added = |m: String| format!("added_mass = {m}");
    let key = "vehicle.body.added_mass";
    refused_body(ADDED, &added(rows(2.0, 0.5, 0.25)), &[key, "not symmetric", "[0][1]", "0.5", "0.25"]);
    refused_body(ADDED, &added(rows(2.0, 3.0, 3.0)), &[key, "semi-definite", "eigenvalue -1.0"]);
    refused_body(ADDED, "added_mass = [1.0, 1.0, -3.0, 0.0, 0.0, 0.0]", &[key, "semi-definite", "-3.0"]);
    let key = "vehicle.body.inertia";
    let asymmetric = "inertia = [[1.0, 0.1, 0.0], [0.2, 1.0, 0.0], [0.0, 0.0, 1.0]]";
    refused_body(INERTIA, asymmetric, &[key, "not symmetric", "0.1", "0.2"]);
    refused_body(INERTIA, "inertia = [1.0, 2.0, 0.0, 1.0, 0.0, 1.0]", &[key, "positive definite", "-1.0"]);
    refused_body(INERTIA, "inertia = [0.0, 1.0, 1.0]", &[key, "positive definite", "0.0"]);
    refused_body(MASS, "mass = 0.0\n", &["vehicle.body.mass", "is 0.0, but must be > 0"]);
    refused_body(MASS, "mass = -1.5\n", &["vehicle.body.mass", "-1.5"]);
    // About the origin the moments look right, but the offset of the centre of mass is more than they allow.
    let far = "center_of_mass = [2.0, 0.0, 0.0]\ninertia_at = \"origin\"";
    let body = text("free-body").replacen("inertia_at = \"com\"\n", "", 1);
    let body = body.replacen("center_of_mass = [0.0, 0.0, 0.0]", far, 1);
    let message = Scene::from_toml_str(&body, "my.toml").unwrap_err().to_string();
    assert!(message.contains("vehicle.body.inertia") && message.contains("-3.0"), "{message}");
}

#[test]
fn an_inertia_against_the_triangle_inequality() {
    refused_body(INERTIA, "inertia = [1.0, 1.0, 2.5]", &["vehicle.body.inertia", "triangle", "2.5000e0"]);
    // Rounded tables of flat bodies stay within a part in a million.
    let flat = text("free-body").replacen(INERTIA, "inertia = [1.0, 1.0, 2.000001]", 1);
    assert!(Scene::from_toml_str(&flat, "flat").is_ok());
}

#[test]
fn drag_that_pushes() {
    let linear = "linear = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]";
    let key = "vehicle.body.damping.linear";
    refused_body(linear, "linear = [1.0, 1.0, 1.0, 1.0, -0.5, 1.0]", &[key, "[4][4] is -0.5"]);
    refused_body(linear, &format!("linear = {}", rows(1.0, 3.0, 1.0)), &[key, "symmetric part", "-1.0"]);
    let lift = text("free-body").replacen(linear, &format!("linear = {}", rows(1.0, 3.0, -3.0)), 1);
    assert!(Scene::from_toml_str(&lift, "lift").is_ok(), "skew parts are lift");
    let quadratic = "quadratic = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]";
    let key = "vehicle.body.damping.quadratic";
    refused_body(quadratic, "quadratic = [1.0, -2.0, 1.0, 1.0, 1.0, 1.0]", &[key, "[1][1] is -2"]);
}

#[test]
fn weight_and_buoyancy_that_contradict() {
    let mass = "mass = 13.5\n";
    // The published weight of the BlueROV2 Heavy.
    let published = "mass = 13.5\nweight = 114.8\n";
    refused("bluerov2-heavy", mass, published, &["vehicle.body.weight", "114.8", "13.5", "9.81", "132.4"]);
    let right = text("bluerov2-heavy").replacen(mass, "mass = 13.5\nweight = 132.4\n", 1);
    assert!(Scene::from_toml_str(&right, "right").is_ok());
    let both = "mass = 13.5\nbuoyancy = 112.8\n";
    refused("bluerov2-heavy", mass, both, &["vehicle.body.buoyancy", "112.8", "0.0137"]);
    refused("bluerov2-heavy", "volume = 0.0", "volume = -0.0", &["vehicle.body.volume", "-0.0137", ">= 0"]);
    refused_body(MASS, "mass = 1.0\nbuoyancy = 2.5\n", &["vehicle.body.buoyancy", "2.5", "density is 0"]);
    refused_body("density = 0.0", "density = -1.0", &["water.density", "-1"]);
}

const SPEED: &str = "coulomb_speed = 0.1\n";
const HOME: &str = "home = 0.3\n";

#[test]
fn joints_that_cannot_be() {
    let cases: [(&str, &str, &[&str]); 21] = [
        ("axis = [0.0, -1.0, 0.0]", "axis = [0, 0, 0]", &["arm.links[1].joint.axis (upper-arm)", "[0.0, 0.0, 0.0]"]),
        ("upper = 1.4\n", "upper = -0.4\n", &["arm.links[1].joint.limits (upper-arm)", "[-0.35, -0.4]"]),
        ("home = 0.3\n", "home = 1.5\n", &["arm.links[1].joint.home", "1.5", "[-0.35, 1.4]"]),
        ("rotor_inertia = 2.56\n", "rotor_inertia = -0.1\n", &["arm.links[0].joint.rotor_inertia", "-0.1", ">= 0"]),
        ("viscous = 12.0\n", "viscous = -12.0\n", &["arm.links[1].joint.friction.viscous", "-12"]),
        ("coulomb_speed = 0.1\n", "coulomb_speed = 0.0\n", &["arm.links[0].joint.friction.coulomb_speed", "> 0"]),
        ("stiffness = 1500.0\n", "stiffness = -1500.0\n", &["arm.links[1].joint.limits.stiffness", "-1500"]),
        ("effort = 150.0\n", "effort = -150.0\n", &["arm.links[1].joint.effort", "-150"]),
        ("speed = 0.5\n", "speed = 0\n", &["arm.links[0].joint.speed", "is 0"]),
        ("kp = 2400.0\n", "kp = -2400.0\n", &["arm.links[1].joint.servo.kp", "-2400"]),
        (
            SPEED,
            "static = 0.1\nstribeck_speed = 0.1\n",
            &["arm.links[0].joint.friction.static (yaw)", "0.1", "coulomb"],
        ),
        (SPEED, "static = 9.0\n", &["arm.links[0].joint.friction.stribeck_speed (yaw)", "missing"]),
        (SPEED, "stribeck_speed = 0.1\n", &["arm.links[0].joint.friction.static (yaw)", "missing"]),
        (SPEED, "static = 9.0\nstribeck_speed = 0.0\n", &["joint.friction.stribeck_speed (yaw)", "> 0"]),
        (HOME, "spring = { stiffness = -1.0 }\nhome = 0.3\n", &["arm.links[1].joint.spring.stiffness", "-1", ">= 0"]),
        (HOME, "spring = { rest = 1.0 }\nhome = 0.3\n", &["arm.links[1].joint.spring", "stiffness"]),
        (HOME, "spring = { stiffness = 1.0, rest = nan }\nhome = 0.3\n", &["arm.links[1].joint.spring.rest", "NaN"]),
        (HOME, "detent = { torque = 1.0 }\nhome = 0.3\n", &["arm.links[1].joint.detent", "period"]),
        (HOME, "detent = { torque = 1.0, period = 0.0 }\nhome = 0.3\n", &["arm.links[1].joint.detent.period", "> 0"]),
        (HOME, "detent = { torque = -1.0, period = 1.0 }\nhome = 0.3\n", &["arm.links[1].joint.detent.torque", ">= 0"]),
        (
            HOME,
            "detent = { torque = 1.0, period = 1.0, step = 2 }\nhome = 0.3\n",
            &["arm.links[1].joint.detent", "step"],
        ),
    ];
    cases.into_iter().for_each(|(old, new, parts)| refused("petasus-pum", old, new, parts));
}

#[test]
fn lists_with_wrong_names_or_lengths() {
    let scene = "petasus-pum";
    refused(scene, "name = \"forearm\"", "name = \"yaw\"", &["arm.links[2].name", "'yaw'", "taken"]);
    refused(scene, "name = \"forearm\"", "name = \"vehicle\"", &["arm.links[2].name", "'vehicle'", "reserved"]);
    refused(scene, "name = \"forearm\"", "name = \"\"", &["arm.links[2].name", "empty"]);
    let thruster = "name = \"surge-left\"";
    refused(scene, "name = \"sway-top\"", thruster, &["vehicle.thrusters[2].name", "'surge-left'", "taken"]);
    refused(scene, "limits = [-100.0, 100.0]", "limits = [10, 100]", &["vehicle.thrusters[0].limits", "[10.0, 100.0]"]);
    refused(scene, "limits = [-100.0, 100.0]", "limits = [0, 0]", &["vehicle.thrusters[0].limits", "[0.0, 0.0]"]);

    let mut many = Scene::shipped(scene).unwrap();
    let links = &mut many.arm.as_mut().unwrap().links;
    for i in 0..12 {
        let mut link = links[0].clone();
        link.name = format!("more-{i}");
        links.push(link);
    }
    let message = many.check().unwrap_err().to_string();
    assert!(message.contains("petasus-pum") && message.contains("arm.links: 17 moving joints"), "{message}");
    let links = &mut many.arm.as_mut().unwrap().links;
    links.pop();
    many.check().unwrap();
}

#[test]
fn fixed_links_have_a_frame_alone_and_others_all() {
    let fixed = || {
        let mut scene = Scene::shipped("petasus-pum").unwrap();
        let joint = &mut scene.arm.as_mut().unwrap().links[3].joint;
        *joint = Joint::fixed(joint.frame.clone());
        scene
    };
    let text = fixed().to_toml_string();
    assert_eq!(Scene::from_toml_str(&text, "my.toml").unwrap(), fixed());
    assert_eq!(fixed().joint_names().len(), 4);
    let mut frame = fixed();
    frame.arm.as_mut().unwrap().links[3].body = None;
    assert_eq!(Scene::from_toml_str(&frame.to_toml_string(), "my.toml").unwrap(), frame);
    let refused = |change: &dyn Fn(&mut Scene), parts: [&str; 2]| {
        let mut scene = fixed();
        change(&mut scene);
        let message = scene.check().unwrap_err().to_string();
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    };
    let change = |scene: &mut Scene, change: fn(&mut Joint)| change(&mut scene.arm.as_mut().unwrap().links[3].joint);
    let only = "only kind and frame";
    refused(&|scene| change(scene, |joint| joint.home = 0.1), ["arm.links[3].joint.home", only]);
    refused(&|scene| change(scene, |joint| joint.axis.x = 1.0), ["arm.links[3].joint.axis", only]);
    refused(&|scene| change(scene, |joint| joint.effort = Some(1.0)), ["arm.links[3].joint.effort", only]);
    refused(&|scene| scene.arm.as_mut().unwrap().links[2].body = None, ["arm.links[2].body (forearm)", "missing"]);
    let mount = |scene: &mut Scene| {
        let arm = scene.arm.as_mut().unwrap();
        (arm.base, arm.mount.joint) = (Some(Body::point(1.0)), Some(Joint::fixed(Frame::default())));
    };
    refused(&mount, ["arm.mount.joint.kind", "revolute or prismatic"]);
}

#[test]
fn a_joint_loaded_base_needs_mass() {
    let mut scene = Scene::shipped("petasus-pum").unwrap();
    let arm = scene.arm.as_mut().unwrap();
    arm.mount.joint = Some(arm.links[0].joint.clone());
    let message = scene.check().unwrap_err().to_string();
    assert!(message.contains("arm.base"), "{message}");
}

#[test]
fn provenance_of_nothing_or_of_no_origin() {
    let old = "\"vehicle.body.mass\" = \"cited:";
    refused_body(old, "\"vehicle.body.mass\" = \"guess:", &["provenance.\"vehicle.body.mass\"", "guess:"]);
    refused_body(
        old,
        "\"vehicle.wings\" = \"cited:",
        &["provenance.\"vehicle.wings\"", "no key of this scene: remove this entry, or set provenance = {}"],
    );
}

#[test]
fn a_fixed_vehicle_may_weigh_nothing() {
    let fixed = text("free-body").replacen("fixed = false", "fixed = true", 1);
    let fixed = fixed.replacen(MASS, "mass = 0.0\n", 1).replacen(INERTIA, "inertia = [0.0, 0.0, 0.0]", 1);
    assert!(Scene::from_toml_str(&fixed, "fixed").is_ok());
}

#[test]
fn text_that_is_not_toml_is_refused_by_line_and_column() {
    let message = Scene::from_toml_str("name = \"x\"\n[water\n", "my.toml").unwrap_err().to_string();
    assert!(message.starts_with("my.toml: line 2, column "), "{message}");
}

#[test]
fn names_and_files_that_do_not_exist() {
    let message = Scene::load("bluerov3").unwrap_err().to_string();
    assert!(message.contains("'bluerov3'") && message.contains("petasus-pum, bluerov2-heavy-alpha5"), "{message}");
    let message = Scene::load("no/such/file.toml").unwrap_err().to_string();
    assert!(message.contains("no/such/file.toml"), "{message}");
}

#[test]
fn integers_stand_for_floats() {
    let ints = text("free-body").replace("1.0", "1").replace("0.0", "0");
    assert_eq!(Scene::from_toml_str(&ints, "ints").unwrap(), Scene::shipped("free-body").unwrap());
}

/// Every node of a tree of values, by the keys and indices that lead to it.
fn nodes(value: &Value) -> Vec<Vec<String>> {
    let children: Vec<(String, &Value)> = match value {
        Value::Table(table) => table.iter().map(|(key, child)| (key.clone(), child)).collect(),
        Value::Array(list) => list.iter().enumerate().map(|(i, child)| (i.to_string(), child)).collect(),
        _ => Vec::new(),
    };
    let below = children.into_iter().flat_map(|(key, child)| {
        let deeper = nodes(child).into_iter();
        let paths = std::iter::once(Vec::new()).chain(deeper);
        paths.map(move |path| std::iter::once(key.clone()).chain(path).collect::<Vec<_>>()).collect::<Vec<_>>()
    });
    below.collect()
}

/// Removes the node, or puts another value in its place.
fn mutate(root: &mut Value, path: &[String], new: Option<Value>) {
    let (last, parents) = path.split_last().expect("a path");
    let mut node = root;
    for step in parents {
        node = match node {
            Value::Table(table) => &mut table[step.as_str()],
            Value::Array(list) => &mut list[step.parse::<usize>().expect("an index")],
            _ => unreachable!(),
        };
    }
    match (node, new) {
        (Value::Table(table), Some(new)) => drop(table.insert(last.clone(), new)),
        (Value::Table(table), None) => drop(table.remove(last)),
        (Value::Array(list), Some(new)) => list[last.parse::<usize>().expect("an index")] = new,
        (Value::Array(list), None) => drop(list.remove(last.parse().expect("an index"))),
        _ => unreachable!(),
    }
}

/// A scene with the keys that no shipped one has.
fn everything() -> String {
    let mut scene = Scene::shipped("bluerov2-heavy-alpha5").unwrap();
    let thrusters = &mut scene.vehicle.thrusters;
    thrusters[0].map = Some(ThrustMap::T200);
    thrusters[1].map = Some(ThrustMap::Points(vec![[-40.0, -30.0], [0.0, 0.0], [60.0, 50.0]]));
    (thrusters[2].lag, thrusters[2].dead_band, thrusters[2].ambient_flow) = (Some(0.1), Some(2.0), Some(1.8));
    (thrusters[3].deduction, thrusters[3].induced) = (Some(0.1), Some([0.0, 0.0, 0.0, 0.01, 0.0, 0.0]));
    let bench = ThrustTable::new(vec![1100.0, 1900.0], vec![10.0, 20.0], vec![vec![0.0, 0.0], vec![20.0, 60.0]]);
    thrusters[4].map = Some(ThrustMap::Table(bench.unwrap()));
    scene.vehicle.thruster_lag = Some(0.2);
    scene.vehicle.voltage = Some(14.8);
    scene.vehicle.fins = Scene::shipped("remus-100").unwrap().vehicle.fins;
    let position = Vector3::new(-0.2, 0.0, 0.1);
    scene.vehicle.tether = Some(Tether { position, length: 40.0, diameter: 0.008, mass_per_length: 0.06, drag: 1.2 });
    scene.vehicle.forward_damping = Some(crate::forward_damping::eca_a9());
    let joint = &mut scene.arm.as_mut().unwrap().links[1].joint;
    (joint.effort, joint.limits) = (None, None);
    joint.actuator = Some(LinearActuator { base: 0.3, lever: 0.08, angle: 1.2, force: 500.0 });
    joint.spring = Some(JointSpring { stiffness: 2.0, rest: 0.1 });
    joint.detent = Some(Detent { torque: 0.1, period: 0.5, offset: 0.1 });
    (joint.friction.break_away, joint.friction.stribeck_speed) = (Some(0.5), Some(0.1));
    scene.to_toml_string()
}

fn replacement() -> impl Strategy<Value = Option<Value>> {
    prop_oneof![
        Just(None),
        Just(Some(Value::Float(f64::NAN))),
        Just(Some(Value::Float(f64::MAX))),
        Just(Some(Value::Float(-1e11))),
        Just(Some(Value::Float(1e12))),
        Just(Some(Value::Float(5e-324))),
        Just(Some(Value::Float(0.0))),
        Just(Some(Value::Integer(i64::MIN))),
        Just(Some(Value::Boolean(true))),
        Just(Some(Value::String("\u{e9}[".into()))),
        Just(Some(Value::Array(Vec::new()))),
        Just(Some(Value::Array(vec![Value::Array(vec![Value::Float(1.0)]); 6]))),
        Just(Some(Value::Table(toml::Table::new()))),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_mutated_scene_is_read_or_refused_by_key(
        scene in 0..8usize,
        node in any::<prop::sample::Index>(),
        new in replacement(),
    ) {
        let given = Scene::shipped_names().get(scene).map_or_else(everything, |name| text(name));
        let mut tree: Value = given.parse::<toml::Table>().unwrap().into();
        let paths = nodes(&tree);
        let path = &paths[node.index(paths.len())];
        mutate(&mut tree, path, new.clone());
        match Scene::from_value(tree, "<dict>") {
            Ok(scene) => {
                prop_assert!(scene.check().is_ok());
                // Whatever its numbers, it steps or is refused.
                if let Ok(mut simulator) = Simulator::new(scene, SimulatorOptions::default()) {
                    prop_assert!(simulator.step(&Inputs::default(), 2).is_ok());
                }
            }
            Err(DescriptionError::Value { source_name, key, .. }) => {
                prop_assert_eq!(source_name, "<dict>");
                prop_assert!(!key.is_empty());
                if new.as_ref().and_then(Value::as_float).is_some_and(|x| x.is_nan() || x > 1e12) {
                    let dotted: String = path.iter().map(|step| match step.parse::<usize>() {
                        Ok(i) => format!("[{i}]"),
                        Err(_) => format!(".{step}"),
                    }).collect();
                    prop_assert!(key.starts_with(dotted.trim_start_matches('.')), "{key} for {dotted}");
                }
            }
            Err(other) => prop_assert!(false, "{other}"),
        }
    }
}
