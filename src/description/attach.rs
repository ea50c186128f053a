//! Attaches the arm of a part to a body of a scene.

use toml::{Table, Value};

use super::read::deserialize;
use super::{Arm, BASE, EndEffectorFrame, Mount, Parent, VEHICLE, path};
use crate::error::Problem;
use crate::keys::{Fault, none_of};

/// Attachment of an arm: the values of an entry of `[[arms]]` besides the part.
pub struct Attachment {
    /// Key of the entry.
    pub key: String,
    /// Name of the arm, by which its links are called.
    pub name: String,
    on: String,
    mount: Option<Mount>,
}

impl Attachment {
    /// Takes the values from an entry.
    pub fn take(entry: &mut Table, key: &str) -> Result<Self, Fault> {
        let mut text = |name: &str| match entry.remove(name) {
            Some(Value::String(text)) => Ok(Some(text)),
            None => Ok(None),
            Some(value) => {
                let reason = "invalid type, expected a string".to_owned();
                Err(Fault::new(path::join(key, name), Problem::Form { reason, value: path::short(&value) }))
            }
        };
        let name = text("name")?.ok_or_else(|| Fault::new(path::join(key, "name"), Problem::Missing))?;
        let on = text("on")?.unwrap_or_else(|| VEHICLE.to_owned());
        let mount = match entry.remove("mount") {
            Some(mount) => Some(deserialize(&mount).map_err(|fault| fault.below(&path::join(key, "mount")))?),
            None => None,
        };
        Ok(Self { key: key.to_owned(), name, on, mount })
    }

    /// True where the mount is not the part's.
    pub fn states_mount(&self) -> bool {
        self.mount.is_some()
    }

    /// Name in the scene of a body or sphere of the arm.
    pub fn body(&self, name: &str) -> String {
        format!("{}-{name}", self.name)
    }

    /// Name in the scene of a body of the arm, or of the body that carries it.
    pub fn carrier(&self, arm: &Arm, body: Parent) -> Result<String, Fault> {
        match body {
            Parent::Link(i) => Ok(self.body(&arm.links[i].name)),
            // Without a mount the frames of vehicle and base are the same.
            Parent::Vehicle if arm.mount != Mount::default() && self.mount.is_none() => Ok(self.on.clone()),
            Parent::Vehicle if arm.mount != Mount::default() => {
                let reason = "cannot move this arm: some of its links are on the vehicle of its part";
                Err(Fault::new(path::join(&self.key, "mount"), Problem::Invalid { reason }))
            }
            Parent::Vehicle | Parent::Base => Ok(self.body(BASE)),
        }
    }

    /// An end effector of the arm, by the names of the scene.
    fn end_effector(&self, arm: &Arm, end_effector: &EndEffectorFrame) -> Result<Value, Fault> {
        let on =
            arm.carrier(end_effector).map_or(Ok(end_effector.on.clone()), |body| self.carrier(arm, body).map(Some))?;
        Ok(value(&EndEffectorFrame { on, ..end_effector.clone() }))
    }

    /// The link that connects the arm to the body that carries it.
    fn base(&self, arm: &Arm) -> Result<Value, Fault> {
        let mount = self.mount.as_ref().unwrap_or(&arm.mount);
        let mut link = toml::toml! { joint = { kind = "fixed" } };
        if let Some(joint) = &mount.joint {
            if arm.base.is_none() {
                return Err(Fault::new(path::join(&self.key, "base"), Problem::MasslessBase));
            }
            link.insert("joint".to_owned(), value(joint));
        }
        let frame = mount.joint.as_ref().map_or(mount.frame.clone(), |joint| mount.frame.then(&joint.frame));
        link["joint"].as_table_mut().expect("a joint is a table").insert("frame".to_owned(), value(&frame));
        link.insert("name".to_owned(), self.body(BASE).into());
        link.insert("parent".to_owned(), self.on.clone().into());
        link.extend(arm.base.iter().map(|base| ("body".to_owned(), value(base))));
        link.insert("meshes".to_owned(), value(&arm.meshes));
        Ok(link.into())
    }
}

/// Plain data as a tree of values.
fn value(data: &impl serde::Serialize) -> Value {
    Value::try_from(data).expect("plain data")
}

/// Names of the links in a table `[arm]`.
fn link_names(arm: &Table) -> Vec<&str> {
    let links = arm.get("links").and_then(Value::as_array).into_iter().flatten();
    links.filter_map(|link| link.get("name")?.as_str()).collect()
}

/// True where a table `[arm]` has bodies of its own.
pub fn has_bodies(arm: &Table) -> bool {
    arm.contains_key("base") || arm.contains_key("links")
}

/// Adds the arm of a part to the table `[arm]` of a scene. Its end effector has the arm's name; that of the first arm is also
/// the scene's.
pub fn attach(scene: &mut Table, arm: &Arm, attachment: &Attachment) -> Result<(), Fault> {
    let not_table = |key: &str| {
        let reason = "must be a table, beside [[arms]]";
        Fault::new(key, Problem::Invalid { reason })
    };
    let own = scene.entry("arm").or_insert(Table::new().into()).as_table_mut().ok_or_else(|| not_table("arm"))?;
    let names = link_names(own);
    let known: Vec<_> =
        [VEHICLE, BASE].into_iter().filter(|name| *name == VEHICLE || own.contains_key(BASE)).chain(names).collect();
    if !known.contains(&attachment.on.as_str()) {
        let key = path::join(&attachment.key, "on");
        return Err(none_of(&attachment.on, "bodies before it", known.into_iter(), key));
    }
    let end_effector = attachment.end_effector(arm, &arm.end_effector)?;
    let mut named = vec![(attachment.name.clone(), end_effector.clone())];
    for (name, other) in &arm.end_effectors {
        named.push((attachment.body(name), attachment.end_effector(arm, other)?));
    }
    let mut links = vec![attachment.base(arm)?];
    for (i, link) in arm.links.iter().enumerate() {
        let mut link = link.clone();
        if let Some(parent) = arm.parent(i) {
            link.parent = Some(attachment.carrier(arm, parent)?);
        }
        link.name = attachment.body(&link.name);
        links.push(value(&link));
    }
    if has_bodies(own) {
        // The arm's own end effector stays on its last link.
        let last = link_names(own).last().map_or(BASE, |name| *name).to_owned();
        let end_effector = own.entry("end_effector").or_insert(Table::new().into());
        end_effector.as_table_mut().map(|table| table.entry("on").or_insert(last.into()));
    } else {
        own.entry("end_effector").or_insert(end_effector);
    }
    let list = own.entry("links").or_insert(Value::Array(Vec::new()));
    list.as_array_mut().ok_or_else(|| not_table("arm.links"))?.extend(links);
    let table = own.entry("end_effectors").or_insert(Table::new().into());
    table.as_table_mut().ok_or_else(|| not_table("arm.end_effectors"))?.extend(named);
    Ok(())
}
