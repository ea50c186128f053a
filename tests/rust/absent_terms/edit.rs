//! Scenes as trees of values, and changes of them.

use toml::{Table, Value};
use uvms_gym::description::Scene;

/// Changes of a table, separated by `;`: `-damping.linear` removes a key, `damping.linear = ZEROS` sets one. A change that begins
/// with `*` concerns every body of the scene.
pub type Edit = &'static str;

/// The kind of table that a term stands in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Place {
    /// Only the vehicle's body.
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
    /// Paths of the tables of this kind; a path through a list concerns each of its tables.
    fn paths(self) -> &'static [&'static str] {
        match self {
            Place::Vehicle => &["vehicle.body"],
            Place::Links => &["arm.links.body"],
            Place::Bodies => &["vehicle.body", "arm.base", "arm.links.body", "payload.body"],
            Place::Joints => &["arm.mount.joint", "arm.links.joint"],
            Place::Root => &[""],
        }
    }

    /// The scene with its tables of this kind changed.
    pub fn edited(self, scene: &Value, changes: &str) -> Value {
        let mut scene = scene.clone();
        for change in changes.split(';').map(str::trim).filter(|change| !change.is_empty()) {
            let (place, change) = change.strip_prefix('*').map_or((self, change), |change| (Place::Bodies, change));
            place.paths().iter().for_each(|path| edit_at(&mut scene, path, change));
        }
        scene
    }
}

fn edit_at(value: &mut Value, path: &str, change: &str) {
    match value {
        Value::Array(list) => list.iter_mut().for_each(|value| edit_at(value, path, change)),
        Value::Table(table) if path.is_empty() => edit(table, change),
        _ => {
            let (key, rest) = path.split_once('.').unwrap_or((path, ""));
            value.get_mut(key).into_iter().for_each(|part| edit_at(part, rest, change));
        }
    }
}

/// A table within a table, made if there is none.
fn table<'a>(parent: &'a mut Table, key: &str) -> &'a mut Table {
    parent.entry(key).or_insert_with(|| Table::new().into()).as_table_mut().unwrap()
}

fn edit(root: &mut Table, change: &str) {
    let Some(path) = change.strip_prefix('-') else {
        let [zeros, rows] = [format!("{:?}", [0.0; 6]), format!("{:?}", [[0.0; 6]; 6])];
        return merge(root, change.replace("ZEROS", &zeros).replace("ZERO_ROWS", &rows).parse().unwrap());
    };
    let (parents, key) = path.rsplit_once('.').map_or(("", path), |parts| parts);
    parents.split('.').filter(|part| !part.is_empty()).fold(root, |parent, part| table(parent, part)).remove(key);
}

fn merge(root: &mut Table, changes: Table) {
    for (key, value) in changes {
        match value {
            Value::Table(changes) => merge(table(root, &key), changes),
            value => drop(root.insert(key, value)),
        }
    }
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
    let mut plain = Place::Root.edited(&fixed_loading, "-payload; -arm.base");
    plain["arm"]["links"].as_array_mut().unwrap().truncate(3);
    let mut loaded = golden("random-joint-loading");
    loaded.as_table_mut().unwrap().insert("payload".into(), fixed_loading["payload"].clone());
    [("plain arm", plain), ("loaded arm", loaded)].map(|(name, scene)| {
        let scene = Place::Root.edited(
            &scene,
            "water.current = [0.3, -0.2, 0.1]; vehicle.servo.kp = [40.0, 40.0, 40.0, 5.0, 5.0, 5.0]; \
             vehicle.servo.kd = [60.0, 60.0, 60.0, 8.0, 8.0, 8.0]",
        );
        // The states are beyond these limits.
        let joints = "servo = { kp = 8.0, kd = 0.5 }; limits.lower = -0.1; limits.upper = 0.1; \
                      friction.static = 0.9; friction.stribeck_speed = 0.3; \
                      spring = { stiffness = 2.0, rest = 0.1 }; detent = { torque = 0.3, period = 0.7, offset = 0.1 }";
        (name, Place::Joints.edited(&scene, joints))
    })
}
