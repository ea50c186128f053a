//! Scenes as trees of values, and what is edited in them.

use toml::{Table, Value};
use uvms_gym::description::Scene;

/// Change of a table of the scene.
pub type Edit = fn(&mut Table);

/// The kind of table that a term stands in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Place {
    /// The vehicle's body alone.
    Vehicle,
    /// The links' bodies.
    Links,
    /// Every body: of vehicle, arm base, links and payload.
    Bodies,
    /// Every joint.
    Joints,
    /// The whole scene.
    Root,
}

impl Place {
    /// The scene with its tables of this kind changed.
    pub fn edited(self, scene: &Value, edit: Edit) -> Value {
        let mut scene = scene.clone();
        let root = scene.as_table_mut().unwrap();
        match self {
            Place::Root => edit(root),
            Place::Vehicle => edit(vehicle(root)),
            Place::Links => links(root).into_iter().for_each(|link| edit(table(link, "body"))),
            Place::Joints => {
                if let Some(q0) = table(table(root, "arm"), "mount").get_mut("joint") {
                    edit(q0.as_table_mut().unwrap());
                }
                links(root).into_iter().for_each(|link| edit(table(link, "joint")));
            }
            Place::Bodies => {
                bodies(root, edit);
            }
        }
        scene
    }
}

/// Changes every body of a scene.
pub fn bodies(root: &mut Table, edit: Edit) {
    edit(vehicle(root));
    if root.contains_key("arm") {
        if let Some(base) = table(root, "arm").get_mut("base") {
            edit(base.as_table_mut().unwrap());
        }
        links(root).into_iter().for_each(|link| edit(table(link, "body")));
    }
    if let Some(payload) = root.get_mut("payload") {
        edit(table(payload.as_table_mut().unwrap(), "body"));
    }
}

/// A table within a table, made if there is none.
pub fn table<'a>(parent: &'a mut Table, key: &str) -> &'a mut Table {
    parent.entry(key).or_insert_with(|| Table::new().into()).as_table_mut().unwrap()
}

fn vehicle(root: &mut Table) -> &mut Table {
    table(table(root, "vehicle"), "body")
}

fn links(root: &mut Table) -> Vec<&mut Table> {
    let links = table(root, "arm").get_mut("links").and_then(Value::as_array_mut).unwrap();
    links.iter_mut().map(|link| link.as_table_mut().unwrap()).collect()
}

/// Numbers as a list.
pub fn list(values: &[f64]) -> Value {
    values.iter().map(|&x| Value::Float(x)).collect::<Vec<_>>().into()
}

/// Rows of six by six zeros.
pub fn zeros() -> Value {
    vec![list(&[0.0; 6]); 6].into()
}

pub fn read(scene: &Value) -> Scene {
    Scene::from_value(scene.clone(), "edited scene").unwrap()
}

fn golden(name: &str) -> Value {
    let path = format!("{}/tests/golden/scenes/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    std::fs::read_to_string(path).unwrap().parse::<Table>().unwrap().into()
}

/// A free vehicle with an arm of three links and nothing else that moves with them; and one with joint loading, an arm
/// base and a payload. Both have every term that a scene can have, full matrices, a current and servos.
pub fn scenes() -> [(&'static str, Value); 2] {
    let fixed_loading = golden("random-fixed-loading");
    let mut plain = fixed_loading.clone();
    let root = plain.as_table_mut().unwrap();
    root.remove("payload");
    table(root, "arm").remove("base");
    table(root, "arm")["links"].as_array_mut().unwrap().truncate(3);

    let mut loaded = golden("random-joint-loading");
    loaded.as_table_mut().unwrap().insert("payload".into(), fixed_loading["payload"].clone());
    let complete = |mut scene: Value| {
        let root = scene.as_table_mut().unwrap();
        table(root, "water").insert("current".into(), list(&[0.3, -0.2, 0.1]));
        let servo = table(table(root, "vehicle"), "servo");
        servo.insert("kp".into(), list(&[40.0, 40.0, 40.0, 5.0, 5.0, 5.0]));
        servo.insert("kd".into(), list(&[60.0, 60.0, 60.0, 8.0, 8.0, 8.0]));
        Place::Joints.edited(&scene, |joint| {
            table(joint, "servo").extend([("kp".into(), 8.0.into()), ("kd".into(), 0.5.into())]);
            // The states are beyond these.
            table(joint, "limits").extend([("lower".into(), (-0.1).into()), ("upper".into(), 0.1.into())]);
        })
    };
    [("plain arm", complete(plain)), ("loaded arm", complete(loaded))]
}
