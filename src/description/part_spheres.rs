//! Spheres of contact that come with parts.

use toml::{Table, Value};

use super::attach::Attachment;
use super::compose::override_values;
use super::part::Part;
use super::part_sources::PartSources;
use super::{Arm, Sphere};
use crate::keys::Fault;

/// Spheres of the parts of a scene, by the names of the scene.
#[derive(Default)]
pub struct PartSpheres(Vec<Sphere>);

impl PartSpheres {
    /// Adds the spheres on the vehicle of a part, or on its arm.
    pub fn add(&mut self, part: &Part, of_vehicle: bool, sources: &mut PartSources) {
        for sphere in part.spheres(of_vehicle) {
            sources.add_sphere(&part.scene, &sphere.name, &sphere.name);
            self.0.push(sphere.clone());
        }
    }

    /// Adds the spheres on the arm of a part that is attached; they are called as its links.
    pub fn add_attached(
        &mut self,
        part: &Part,
        arm: &Arm,
        attachment: &Attachment,
        sources: &mut PartSources,
    ) -> Result<(), Fault> {
        for sphere in part.spheres(false) {
            // An unknown body is refused on reading the scene.
            let on = match arm.body(&sphere.on, arm.links.len()) {
                Some(body) => attachment.carrier(arm, body)?,
                None => attachment.body(&sphere.on),
            };
            let name = attachment.body(&sphere.name);
            sources.add_sphere(&part.scene, &sphere.name, &name);
            self.0.push(Sphere { name, on, ..sphere.clone() });
        }
        Ok(())
    }

    /// Puts the spheres before the scene's own; a table in place of the list replaces values of theirs. Adds the keys of the
    /// numbers that it replaces.
    pub fn write(self, scene: &mut Table, replaced: &mut Vec<String>) -> Result<(), Fault> {
        if self.0.is_empty() {
            return Ok(());
        }
        let contact = scene.entry("contact").or_insert_with(|| Table::new().into());
        // Anything else is refused on reading the scene.
        let Some(contact) = contact.as_table_mut() else { return Ok(()) };
        let mut spheres = Value::try_from(self.0).expect("plain data");
        match (contact.remove("spheres"), spheres.as_array_mut()) {
            (Some(Value::Array(own)), Some(list)) => list.extend(own),
            (Some(own), _) => override_values(&mut spheres, own, "contact.spheres", replaced)?,
            (None, _) => {}
        }
        contact.insert("spheres".to_owned(), spheres);
        Ok(())
    }
}
