//! Parts of composed scenes: shipped ones by name, or files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use toml::{Table, Value};

use super::{Scene, Sphere, VEHICLE, compose, parse_toml, path, read_file, shipped};
use crate::error::{DescriptionError, Problem};
use crate::keys::Fault;

/// Maximum number of files, each of which is a part of the one before.
const MAX_DEPTH: usize = 8;

/// A scene of which other scenes take the vehicle or the arm, checked.
pub struct Part {
    /// The part, its missing tables filled in.
    pub scene: Scene,
    /// Name by which the scene calls it.
    name: String,
    /// Tables that it has.
    tables: Table,
}

impl Part {
    /// Its table `vehicle`, `arm`, `water` or `integration`.
    pub fn table(&self, key: &str) -> Option<Value> {
        self.tables.get(key).cloned()
    }

    /// Spheres on its vehicle, or on its arm. A part without vehicle has an arm alone.
    pub fn spheres(&self, of_vehicle: bool) -> impl Iterator<Item = &Sphere> {
        let spheres = self.scene.contact.iter().flat_map(|contact| &contact.spheres);
        let has_vehicle = self.tables.contains_key(VEHICLE);
        spheres.filter(move |sphere| (sphere.on == VEHICLE && has_vehicle) == of_vehicle)
    }

    /// The fault of a part without this table.
    pub fn lacks(&self, table: &str, key: &str) -> Fault {
        Fault::new(key, Problem::Part { value: self.name.clone(), reason: format!("it has no table [{table}]") })
    }
}

/// Parts by their files, each read and checked once.
#[derive(Default)]
pub struct Parts {
    known: BTreeMap<String, Rc<Part>>,
    open: Vec<String>,
}

impl Parts {
    /// The part that the value of `key` names: a shipped one, or a file relative to `directory`.
    ///
    /// # Errors
    /// A fault of the value, converted by `error`; or an error of the part, which names its file.
    pub fn load(
        &mut self,
        value: &Value,
        key: &str,
        directory: &Path,
        error: &impl Fn(Fault) -> DescriptionError,
    ) -> Result<Rc<Part>, DescriptionError> {
        let Some(name) = value.as_str() else {
            let reason = "a part is the name of a shipped one or the path of a TOML file".to_owned();
            return Err(error(Fault::new(key, Problem::Form { reason, value: path::short(value) })));
        };
        let refused = |reason: String| error(Fault::new(key, Problem::Part { value: name.to_owned(), reason }));
        let file = directory.join(name);
        let id = if name.ends_with(".toml") {
            let found = file.canonicalize().map_err(|problem| refused(format!("{}: {problem}", file.display())))?;
            found.display().to_string()
        } else {
            name.to_owned()
        };
        if let Some(part) = self.known.get(&id) {
            return Ok(Rc::clone(part));
        }
        if self.open.contains(&id) {
            return Err(refused(format!("it is a part of itself: {} -> {id}", self.open.join(" -> "))));
        }
        if self.open.len() >= MAX_DEPTH {
            return Err(refused(format!("more than {MAX_DEPTH} files are parts of each other")));
        }
        let (text, source_name, folder) = match shipped::text(name) {
            Some(text) => (text.to_owned(), format!("{name}.toml"), PathBuf::new()),
            None if name.ends_with(".toml") => {
                let (text, source_name) = read_file(&file)?;
                (text, source_name, file.parent().unwrap_or(directory).to_owned())
            }
            None => {
                let known = shipped::parts().collect::<Vec<_>>().join(", ");
                return Err(refused(format!("give a path that ends in .toml, or one of {known}")));
            }
        };
        self.open.push(id.clone());
        let tree = compose::expand(parse_toml(&text, &source_name)?, &source_name, &folder, self)?;
        self.open.pop();
        let part = Rc::new(read(tree, name, &source_name)?);
        self.known.insert(id, Rc::clone(&part));
        Ok(part)
    }
}

/// Checks a part, of which all tables but one may be missing.
fn read(mut tree: Value, name: &str, source_name: &str) -> Result<Part, DescriptionError> {
    let root = tree.as_table_mut().expect("a scene is a table");
    let stated: Vec<_> =
        ["vehicle", "arm", "water", "integration"].into_iter().filter(|key| root.contains_key(*key)).collect();
    let missing: Table = toml::toml! {
        name = "part"
        water = { density = 1000.0, gravity = [0.0, 0.0, -9.81] }
        vehicle = { name = "none", body = { mass = 1.0, inertia = [1.0, 1.0, 1.0] } }
    };
    for (key, value) in missing {
        root.entry(key).or_insert(value);
    }
    let (mut scene, _) = Scene::from_tree(&tree).map_err(|fault| fault.in_source(source_name, &tree))?;
    let water = scene.water.clone();
    for body in scene.bodies_mut() {
        // A weight only repeats mass and gravity. A buoyancy holds in this water; a volume in any.
        body.weight = None;
        if let (Some(_), true) = (body.buoyancy, stated.contains(&"water")) {
            (body.volume, body.buoyancy) = (Some(body.displaced_volume(&water)), None);
        }
    }
    let mut tables: Table = scene.to_tree().try_into().expect("a scene is a table");
    tables.retain(|key, _| stated.contains(&key));
    Ok(Part { scene, name: name.to_owned(), tables })
}
