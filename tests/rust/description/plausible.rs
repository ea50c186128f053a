//! Plausibility warnings about scenes, and the template.

use super::shipped;
use nalgebra::{Matrix3, Matrix6, Vector3};
use toml::Value;
use uvms_gym::description::{Scene, ThrustMap};

fn texts(scene: &Scene) -> Vec<String> {
    scene.check().unwrap();
    scene.lint().iter().map(ToString::to_string).collect()
}

#[test]
fn shipped_scenes_that_hover_are_plausible() {
    for name in ["petasus-pum", "bluerov2-heavy-alpha5", "bluerov2-heavy", "free-body", "rexrov"] {
        assert_eq!(texts(&shipped(name)), Vec::<String>::new(), "{name}");
    }
}

#[test]
fn slips_are_reported_by_key_and_number() {
    fn changed(change: impl Fn(&mut Scene)) -> Vec<String> {
        let mut scene = shipped("bluerov2-heavy");
        change(&mut scene);
        texts(&scene)
    }
    let forward = |k: (usize, usize), x: f64| {
        changed(move |s| {
            let damping = s.vehicle.forward_damping.insert(crate::forward_damping::eca_a9());
            damping.matrix[k] = x;
        })
    };
    assert!(forward((0, 0), 8.0).is_empty());
    assert!(changed(|s| s.vehicle.thrusters[7].map = Some(ThrustMap::T200)).is_empty());
    let cases: [(&str, Vec<String>); 9] = [
        ("vehicle.body.volume: all bodies weigh 40.0000 kg", changed(|s| s.vehicle.body.mass = 40.0)),
        (
            "vehicle.body.volume: 13.5000 kg in 1.370e-5 m3 are 985401.4599 kg/m3",
            changed(|s| s.vehicle.body.volume = Some(1.37e-5)),
        ),
        (
            "vehicle.body.center_of_buoyancy: is 0.0300 m below",
            changed(|s| s.vehicle.body.center_of_buoyancy = Vector3::new(0.0, 0.0, -0.05)),
        ),
        (
            "vehicle.body.added_mass: is 0, but the body displaces",
            changed(|s| s.vehicle.body.added_mass = Matrix6::zeros()),
        ),
        ("vehicle.body.added_mass: 14600.0000 kg is", changed(|s| s.vehicle.body.added_mass *= 1000.0)),
        ("vehicle.body.damping: no damping in surge, sway", changed(|s| s.vehicle.body.damping = Default::default())),
        ("vehicle.forward_damping.matrix: adds energy ahead in pure sway: opposite sign?", forward((1, 1), -162.0)),
        ("vehicle.forward_damping.matrix: adds energy ahead in some motions", forward((5, 1), 1e3)),
        (
            "vehicle.thrusters[7].limits (vertical-rear-left): 1100 and 1900 us give -34.5 and 44.4 N at 14 V",
            changed(|s| (s.vehicle.voltage, s.vehicle.thrusters[7].map) = (Some(14.0), Some(ThrustMap::T200))),
        ),
    ];
    for (start, warnings) in cases {
        assert!(warnings.iter().any(|warning| warning.starts_with(start)), "{start}: {warnings:?}");
    }
}

#[test]
fn links_given_in_other_axes_than_their_joints_are_reported() {
    let published = |i: usize, centre: [f64; 3], inertia: [f64; 3]| {
        let mut scene = shipped("bluerov2-heavy-alpha5");
        let body = scene.arm.as_mut().unwrap().links[i].body.as_mut().unwrap();
        (body.center_of_mass, body.inertia) = (centre.into(), Matrix3::from_diagonal(&inertia.into()));
        texts(&scene)
    };
    // As the tables of the arm have them: x along the upper arm, and z of the wrist towards the base.
    let upper_arm = published(1, [0.073, 0.0, 0.0], [8.7e-5, 8.7e-4, 8.9e-4]);
    assert_eq!(upper_arm.len(), 1, "{upper_arm:?}");
    let start = "arm.links[1].body.inertia (upper-arm): has its long axis 75 degrees off the way";
    assert!(upper_arm[0].starts_with(start), "{upper_arm:?}");
    let wrist = published(3, [0.0, -0.003, -0.098], [5.1e-4, 5.4e-4, 7.6e-5]);
    assert_eq!(wrist.len(), 1, "{wrist:?}");
    let start = "arm.links[3].body.center_of_mass (wrist): lies 0.0980 m behind the joint";
    assert!(wrist[0].starts_with(start), "{wrist:?}");
}

#[test]
fn a_vacuum_and_a_held_vehicle_need_no_trim() {
    let mut scene = shipped("bluerov2-heavy");
    scene.vehicle.body.mass = 40.0;
    scene.vehicle.fixed = true;
    assert_eq!(texts(&scene), Vec::<String>::new());
    scene.vehicle.fixed = false;
    scene.water.density = 0.0;
    assert_eq!(texts(&scene), Vec::<String>::new());
}

#[test]
fn the_template_passes_its_own_check() {
    let scene = Scene::from_toml_str(Scene::TEMPLATE, "template.toml").unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(scene.check().unwrap(), []);
    assert_eq!(texts(&scene), Vec::<String>::new());
    assert!(scene.numbers().iter().all(|(_, _, origin)| origin.is_some()));
}

/// Paths of all tables of the template.
fn tables(node: &Value, path: Vec<String>, out: &mut Vec<Vec<String>>) {
    match node {
        Value::Table(table) => {
            for (key, below) in table {
                tables(below, [path.clone(), vec![key.clone()]].concat(), out);
            }
            out.push(path);
        }
        Value::Array(list) if list[0].is_table() => {
            for (i, element) in list.iter().enumerate() {
                tables(element, [path.clone(), vec![i.to_string()]].concat(), out);
            }
        }
        _ => {}
    }
}

fn at<'a>(root: &'a mut Value, path: &[String]) -> &'a mut Value {
    path.iter().fold(root, |node, step| match node {
        Value::Array(list) => &mut list[step.parse::<usize>().unwrap()],
        table => table.get_mut(step).unwrap(),
    })
}

/// Keys that a table may have, as the reader tells who asks for one that it has not.
fn known(root: &Value, path: &[String]) -> Vec<String> {
    let mut asked = root.clone();
    at(&mut asked, path).as_table_mut().unwrap().insert("zzz".to_owned(), Value::Integer(1));
    let message = Scene::from_value(asked, "template.toml").unwrap_err().to_string();
    let (_, expected) = message.split_once("expected ").unwrap_or_else(|| panic!("{message}"));
    let list = expected.trim_start_matches("one of ").replace(" or ", ", ");
    list.split(", ").map(str::to_owned).collect()
}

/// What a table is: its key, or that of its list; an arm's base is a body.
fn kind(path: &[String]) -> &str {
    match path {
        [.., list, element] if element.parse::<usize>().is_ok() => list,
        [.., last] if last == "base" => "body",
        [.., last] => last,
        [] => "",
    }
}

/// The template, and once more for each alternative in it, switched on.
fn variants() -> Vec<String> {
    let is_off = |line: &str| line.starts_with('#') && line[1..].starts_with(|c: char| c.is_ascii_lowercase());
    let lines: Vec<_> = Scene::TEMPLATE.lines().collect();
    let switched = (0..lines.len()).filter(|i| is_off(lines[*i])).map(|i| {
        let text: Vec<_> = lines.iter().enumerate().map(|(j, line)| if i == j { &line[1..] } else { *line }).collect();
        text.join("\n")
    });
    std::iter::once(Scene::TEMPLATE.to_owned()).chain(switched).collect()
}

#[test]
fn the_template_has_every_key_and_no_other() {
    let roots: Vec<Value> = variants().iter().map(|text| text.parse::<toml::Table>().unwrap().into()).collect();
    let mut shown = std::collections::BTreeSet::new();
    let mut asked = Vec::new();
    for root in &roots {
        let mut paths = Vec::new();
        tables(root, Vec::new(), &mut paths);
        // Their keys are names.
        paths.retain(|path| path.first().is_none_or(|key| key != "provenance"));
        paths.retain(|path| path.last().is_none_or(|key| key != "end_effectors"));
        for path in paths {
            for key in at(&mut root.clone(), &path).as_table().unwrap().keys() {
                shown.insert((kind(&path).to_owned(), key.clone()));
            }
            if asked.iter().all(|(_, other)| *other != path) {
                asked.push((root, path));
            }
        }
    }
    let mut keys = 0;
    for (root, path) in asked {
        for key in known(root, &path) {
            assert!(shown.contains(&(kind(&path).to_owned(), key.clone())), "{}: {key} is missing", path.join("."));
            keys += 1;
        }
    }
    assert!(keys > 120, "{keys}");
}

#[test]
fn each_alternative_of_the_template_can_be_switched_on() {
    let variants = variants();
    for text in &variants {
        if let Err(error) = Scene::from_toml_str(text, "template.toml") {
            let message = error.to_string();
            assert!(["give one of them", "takes the place of"].iter().any(|part| message.contains(part)), "{message}");
        }
    }
    assert!(variants.len() > 10, "{}", variants.len());
}
