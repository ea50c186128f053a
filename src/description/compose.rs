//! Composition of scenes from parts.
//!
//! `[vehicle] file = PART` and `[arm] file = PART` name another scene, whose table they become; their other keys override its
//! values. Each entry of `[[arms]]` attaches the arm of a part to a body. Expansion happens before the scene is checked.

use std::path::Path;

use toml::{Table, Value};

use super::attach::{Attachment, attach, has_bodies};
use super::part::Parts;
use super::part_sources::PartSources;
use super::part_spheres::PartSpheres;
use super::read::deserialize;
use super::{Arm, VEHICLE, mesh_file, path};
use crate::error::{DescriptionError, Problem};
use crate::keys::{Fault, check_names};

/// Keys of which a table has only one: an override of one removes the other.
const ALTERNATIVES: [(&str, &str); 2] = [("volume", "buoyancy"), ("effort", "actuator")];

/// The scene with its parts in place of their names; files of parts and meshes are relative to `directory`.
///
/// # Errors
/// As of a scene, from the scene or from a part, whose own file the message names.
pub fn expand(
    mut tree: Value,
    source_name: &str,
    directory: &Path,
    parts: &mut Parts,
) -> Result<Value, DescriptionError> {
    mesh_file::locate(&mut tree, directory);
    let composed = |key| tree.get(key).is_some_and(|table: &Value| table.get("file").is_some());
    if !composed(VEHICLE) && !composed("arm") && tree.get("arms").is_none() {
        return Ok(tree);
    }
    let in_source = |fault: Fault| fault.in_source(source_name, &tree);
    let Value::Table(mut scene) = tree.clone() else { return Ok(tree) };
    let mut sources = PartSources::default();
    let (mut integrations, mut spheres) = (Vec::new(), PartSpheres::default());

    for key in [VEHICLE, "arm"] {
        let Some(Value::Table(own)) = scene.get_mut(key) else { continue };
        let Some(file) = own.remove("file") else { continue };
        let file_key = path::join(key, "file");
        let part = parts.load(&file, &file_key, directory, &in_source)?;
        integrations.extend(part.table("integration"));
        let mut table = part.table(key).ok_or_else(|| in_source(part.lacks(key, &file_key)))?;
        let mut replaced = Vec::new();
        override_values(&mut table, std::mem::take(own).into(), key, &mut replaced).map_err(in_source)?;
        scene.insert(key.to_owned(), table);
        sources.add(&part.scene.provenance, key, replaced);
        spheres.add(&part, key == VEHICLE, &mut sources);
        if let (VEHICLE, Some(mut water)) = (key, part.table("water")) {
            let own = scene.remove("water").unwrap_or_else(|| Table::new().into());
            let mut replaced = Vec::new();
            override_values(&mut water, own, "water", &mut replaced).map_err(in_source)?;
            scene.insert("water".to_owned(), water);
            sources.add(&part.scene.provenance, "water", replaced);
        }
    }
    if let Some(list) = scene.remove("arms") {
        let entries = list.as_array().map(|list| list.iter().map(|entry| entry.as_table().cloned()).collect());
        let entries: Vec<Table> = entries.flatten().ok_or_else(|| {
            let reason = "expected a list of tables".to_owned();
            in_source(Fault::new("arms", Problem::Form { reason, value: path::short(&list) }))
        })?;
        let mut names = Vec::new();
        for (i, mut own) in entries.into_iter().enumerate() {
            let key = format!("arms[{i}]");
            let attachment = Attachment::take(&mut own, &key).map_err(in_source)?;
            let file_key = path::join(&key, "file");
            let file = own.remove("file").ok_or_else(|| in_source(Fault::new(&file_key, Problem::Missing)))?;
            let part = parts.load(&file, &file_key, directory, &in_source)?;
            integrations.extend(part.table("integration"));
            let mut table = part.table("arm").ok_or_else(|| in_source(part.lacks("arm", &file_key)))?;
            let mut replaced = Vec::new();
            override_values(&mut table, own.into(), &key, &mut replaced).map_err(in_source)?;
            let arm: Arm = deserialize(&table).map_err(|fault| in_source(fault.below(&key)))?;
            let is_first = !scene.get("arm").and_then(Value::as_table).is_some_and(has_bodies);
            attach(&mut scene, &arm, &attachment).map_err(in_source)?;
            spheres.add_attached(&part, &arm, &attachment, &mut sources).map_err(in_source)?;
            replaced.extend(attachment.states_mount().then(|| path::join(&key, "mount")));
            names.push(format!("{} ({})", arm.name, attachment.name));
            sources.add_arm(&part.scene.provenance, attachment.name, arm, is_first, replaced);
        }
        check_names(sources.arm_names(), &[], "arms").map_err(in_source)?;
        if let Some(arm) = scene.get_mut("arm").and_then(Value::as_table_mut) {
            arm.entry("name").or_insert(names.join(", ").into());
            if !arm.contains_key("mount") {
                arm.insert("mount".to_owned(), Table::new().into());
                sources.add_default("arm.mount", "derived: each attached arm has its own mount");
            }
        }
    }
    let mut replaced = Vec::new();
    spheres.write(&mut scene, &mut replaced).map_err(in_source)?;
    sources.add_replaced(replaced);
    // The part that needs the smallest step decides where the scene does not.
    let step = |table: &Value| table.get("step").and_then(Value::as_float).unwrap_or(f64::INFINITY);
    if let Some(integration) = integrations.into_iter().min_by(|one, other| step(one).total_cmp(&step(other))) {
        scene.entry("integration").or_insert(integration);
    }
    sources.write(&mut scene);
    Ok(scene.into())
}

/// Puts the values of `own`, of this key, in place of those of a part, table by table; the values of a table in place of a list
/// belong to the list's elements of these names. Adds the keys of the numbers that it replaces.
pub fn override_values(part: &mut Value, own: Value, key: &str, replaced: &mut Vec<String>) -> Result<(), Fault> {
    match (part, own) {
        (Value::Table(part), Value::Table(own)) => own.into_iter().try_for_each(|(name, value)| {
            let key = path::join(key, &name);
            if name == "axes" {
                let reason = "values in place of a part's are in x forward, y left, z up: leave this key out";
                return Err(Fault::new(key, Problem::Invalid { reason }));
            }
            for (one, other) in ALTERNATIVES.into_iter().flat_map(|(one, other)| [(one, other), (other, one)]) {
                if name == one {
                    part.remove(other);
                }
            }
            match part.get_mut(&name) {
                Some(place) => override_values(place, value, &key, replaced),
                None => override_values(part.entry(name).or_insert(Value::Boolean(false)), value, &key, replaced),
            }
        }),
        (Value::Array(list), Value::Table(own)) if list.iter().all(Value::is_table) => {
            own.into_iter().try_for_each(|(name, value)| {
                let names: Vec<_> = list.iter().filter_map(path::name_of).map(|name| format!("\"{name}\"")).collect();
                let expected = names.join(", ");
                let element = list.iter_mut().find(|element| path::name_of(element) == Some(&name));
                let Some(element) = element else {
                    return Err(Fault::new(key, Problem::NoSuchElement { value: name, expected }));
                };
                override_values(element, value, &format!("{key}[{name}]"), replaced)
            })
        }
        (place, own) => {
            if !path::numbers(&own).is_empty() {
                replaced.push(key.to_owned());
            }
            *place = own;
            Ok(())
        }
    }
}
