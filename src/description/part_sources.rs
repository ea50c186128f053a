//! Provenance of the numbers that come from parts.

use std::collections::BTreeMap;

use toml::{Table, Value};

use super::path::{self, Step};
use super::{Arm, BASE, Provenance, Scene};

/// Provenance of numbers of a scene that come from parts, by the keys of the scene.
#[derive(Default)]
pub struct PartSources {
    entries: BTreeMap<String, String>,
    replaced: Vec<String>,
    arms: Vec<AttachedArm>,
}

/// An attached arm.
struct AttachedArm {
    name: String,
    arm: Arm,
    is_default: bool,
}

impl AttachedArm {
    /// Keys of the scene for the key with these steps below the part's `arm`.
    fn keys(&self, steps: &[Step]) -> Vec<String> {
        let name = &self.name;
        let link = |link: &str| format!("arm.links[{name}-{link}]");
        let links = || self.arm.links.iter().map(|each| link(&each.name));
        let default = self.is_default.then(|| "arm.end_effector".to_owned());
        let end_effector = || default.iter().cloned().chain([format!("arm.end_effectors.{name}")]);
        let other = |other: &str| format!("arm.end_effectors.{name}-{other}");
        let others = || self.arm.end_effectors.keys().map(|each| other(each));
        let text = |step: &Step| match step {
            Step::Key(text) | Step::Element(text) => text.clone(),
        };
        let names: Vec<String> = steps.iter().map(text).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let (keys, used): (Vec<String>, usize) = match names[..] {
            [] => ([link(BASE)].into_iter().chain(links()).chain(end_effector()).chain(others()).collect(), 0),
            ["base", ..] => (vec![path::join(&link(BASE), "body")], 1),
            ["meshes", ..] => (vec![link(BASE)], 0),
            ["mount", "joint", ..] => (vec![path::join(&link(BASE), "joint")], 2),
            ["mount", ..] => (vec![path::join(&link(BASE), "joint")], 1),
            ["links", element, ..] if matches!(steps[1], Step::Element(_)) => {
                let index = element.parse().ok().and_then(|i: usize| self.arm.links.get(i));
                (vec![link(index.map_or(element, |each| &each.name))], 2)
            }
            ["links", ..] => (links().collect(), 1),
            ["end_effector", ..] => (end_effector().collect(), 1),
            ["end_effectors", each, ..] => (vec![other(each)], 2),
            ["end_effectors"] => (others().collect(), 1),
            _ => return Vec::new(),
        };
        keys.into_iter().map(|key| path::below(key, &steps[used..])).collect()
    }
}

impl PartSources {
    /// Adds the provenance of a table of a part, and keys whose numbers the scene replaces.
    pub fn add(&mut self, provenance: &Provenance, table: &str, replaced: Vec<String>) {
        let below =
            provenance.0.iter().filter(|(key, _)| path::parse(key).first() == Some(&Step::Key(table.to_owned())));
        self.entries.extend(below.map(|(key, text)| (key.clone(), text.clone())));
        self.replaced.extend(replaced);
    }

    /// Adds the provenance of a value that composition itself makes.
    pub fn add_default(&mut self, key: &str, text: &str) {
        self.entries.entry(key.to_owned()).or_insert_with(|| text.to_owned());
    }

    /// Adds the provenance of the arm of a part, and keys of the entry whose numbers the scene replaces.
    pub fn add_arm(
        &mut self,
        provenance: &Provenance,
        name: String,
        arm: Arm,
        is_default: bool,
        replaced: Vec<String>,
    ) {
        let arm = AttachedArm { name, arm, is_default };
        let mut given: Vec<_> = provenance.0.iter().map(|(key, text)| (path::parse(key), text)).collect();
        // The more specific key counts where several become one.
        given.sort_by_key(|(steps, _)| steps.len());
        for (steps, text) in given {
            if let Some((Step::Key(table), rest)) = steps.split_first()
                && table == "arm"
            {
                self.entries.extend(arm.keys(rest).into_iter().map(|key| (key, text.clone())));
            }
        }
        for key in replaced {
            // Without `arms[i]`.
            self.replaced.extend(arm.keys(&path::parse(&key)[2..]));
        }
        self.arms.push(arm);
    }

    /// Adds the provenance of a sphere of a part, by its name in the scene.
    pub fn add_sphere(&mut self, part: &Scene, name: &str, in_scene: &str) {
        let root = part.to_tree();
        for field in ["position", "radius"] {
            let found = path::resolve(&root, &format!("contact.spheres[{name}].{field}"));
            let text = found.and_then(|(steps, _)| part.provenance.text(&root, &steps));
            let key = format!("contact.spheres[{in_scene}].{field}");
            self.entries.extend(text.map(|text| (key, text.to_owned())));
        }
    }

    /// Adds keys whose numbers the scene replaces.
    pub fn add_replaced(&mut self, keys: Vec<String>) {
        self.replaced.extend(keys);
    }

    /// Names of the attached arms.
    pub fn arm_names(&self) -> impl Iterator<Item = &str> {
        self.arms.iter().map(|arm| arm.name.as_str())
    }

    /// Writes the provenance into the scene, where the scene's own counts first.
    pub fn write(self, scene: &mut Table) {
        // Anything else is refused on reading the scene.
        let own = scene.get("provenance").map_or(Some(BTreeMap::new()), |own| own.clone().try_into().ok());
        let Some(own): Option<BTreeMap<String, String>> = own else { return };
        let keys = own
            .into_iter()
            .flat_map(|(key, text)| self.scene_keys(&key).into_iter().map(move |key| (key, text.clone())));
        let stated = Provenance(keys.collect());
        let root = Value::Table(scene.clone());
        let mut entries = self.entries;
        entries.retain(|key, _| path::matches_anything(&path::parse(key), &root));
        entries.extend(stated.0.clone());
        let mut provenance = Provenance(entries);
        for key in self.replaced {
            let Some((steps, _)) = path::resolve(&root, &key) else { continue };
            let text = stated.text(&root, &steps).unwrap_or("assumed: stated in place of the part's");
            if provenance.text(&root, &steps) != Some(text) {
                provenance.0.insert(key, text.to_owned());
            }
        }
        let entries = provenance.0;
        let table: Table = entries.into_iter().map(|(key, text)| (key, text.into())).collect();
        scene.insert("provenance".to_owned(), table.into());
    }

    /// Keys of the scene for a key of the composed one: `arms` means all attached arms, `arms[NAME]` one.
    fn scene_keys(&self, key: &str) -> Vec<String> {
        let steps = path::parse(key);
        match steps.split_first() {
            Some((Step::Key(arms), rest)) if arms == "arms" => match rest.split_first() {
                Some((Step::Element(element), rest)) => {
                    let named = self.arms.iter().enumerate();
                    let named = named.filter(|(i, arm)| arm.name == *element || i.to_string() == *element);
                    named.flat_map(|(_, arm)| arm.keys(rest)).collect()
                }
                _ => self.arms.iter().flat_map(|arm| arm.keys(rest)).collect(),
            },
            _ => vec![key.to_owned()],
        }
    }
}
