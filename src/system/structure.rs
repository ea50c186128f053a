//! Structure of compiled scenes: which terms they have, and in which form.

use super::Compiled;
use super::model::{BodyTerms, JointTerms, System};
use crate::hydro::Restoring;
use crate::lane::Shared;

/// The first difference in structure between two compiled scenes, by a scene's keys; none where only numbers differ. `joints` are the
/// keys of the joints (`arm.links[0].joint`).
pub fn structural_difference(one: &Compiled, other: &Compiled, joints: &[String]) -> Option<String> {
    let (a, b) = (one.system.map(|_| ()), other.system.map(|_| ()));
    if a.joints.len() != b.joints.len() {
        return Some(format!("{} joints, not {}", b.joints.len(), a.joints.len()));
    }
    let first = |key: &str, terms: &[(&str, bool, &str)]| {
        let (name, _, what) = terms.iter().find(|(_, differs, _)| *differs)?;
        Some(format!("{key}{name}, in {what}"))
    };
    let bodies = std::iter::once("vehicle").chain(joints.iter().map(|key| key.trim_end_matches(".joint")));
    let terms = |system: &System<()>| -> Vec<BodyTerms<()>> {
        std::iter::once(&system.vehicle).chain(system.joints.iter().map(|joint| &joint.body)).cloned().collect()
    };
    let has_weight = |compiled: &Compiled, k: usize| {
        let acts =
            |mass: &Restoring<Shared<f64>>| mass.net_mass.0 != 0.0 || mass.moment.iter().any(|entry| entry.0 != 0.0);
        acts(&compiled.unscaled[k].weight) || acts(&compiled.unscaled[k].displaced)
    };
    let body_difference = |k: usize, key: &str, a: &BodyTerms<()>, b: &BodyTerms<()>| {
        let [one_parts, other_parts] = [one, other].map(|compiled| compiled.unscaled[k].map(|_| ()));
        let weight = a.restoring != b.restoring || has_weight(one, k) != has_weight(other, k);
        let differences = [
            (
                a.damping != b.damping || one_parts.damping != other_parts.damping,
                "whether damping is 0, diagonal or full",
            ),
            (
                a.central != b.central || one_parts != other_parts,
                "which centres (of mass, buoyancy, added mass, damping) coincide or lie on a frame axis",
            ),
            (weight, "whether weight and buoyancy cancel or are 0"),
        ];
        first(key, &differences.map(|(differs, what)| ("", differs, what)))
    };
    let on_axes = |compiled: &Compiled| compiled.payload_attachment.map(|x| x != 0.0);
    let entries = "whether it is there, or which of its numbers are 0 or absent";
    let whole_scene = [
        ("vehicle.servo", a.vehicle_servo != b.vehicle_servo, entries),
        ("contact", a.contact != b.contact, "which spheres and shapes there are, and on which bodies"),
        ("vehicle.thrusters", a.thrusters != b.thrusters, entries),
        ("inertia, added_mass", a.sparse != b.sparse, "which products are 0"),
        (
            "arm.end_effector",
            on_axes(one) != on_axes(other),
            "which coordinates in the frame of the joint that carries it are 0",
        ),
    ];
    let difference = first("vehicle.fixed", &[("", a.fixed != b.fixed, "its value")])
        .or_else(|| {
            let (a, b) = (terms(&a), terms(&b));
            bodies.enumerate().find_map(|(k, key)| body_difference(k, key, &a[k], &b[k]))
        })
        .or_else(|| {
            let pairs = joints.iter().zip(a.joints.iter().zip(&b.joints));
            pairs.into_iter().find_map(|(key, (a, b))| first(key, &joint_differences(a, b)))
        })
        .or_else(|| first("", &whole_scene))
        .or_else(|| first("", &a.terms.differences(&b.terms).map(|(key, differs)| (key, differs, entries))));
    debug_assert!(difference.is_some() || a == b, "a difference without a name");
    difference.or_else(|| (a != b).then(|| "a term".to_owned()))
}

/// Terms of a joint: key, whether two joints differ in it, and how.
fn joint_differences(a: &JointTerms<()>, b: &JointTerms<()>) -> [(&'static str, bool, &'static str); 12] {
    let absent = "whether it is 0 or absent";
    let [one, other] = [a, b].map(|joint| joint.rare.as_deref().copied().unwrap_or_default());
    [
        (".kind", a.is_prismatic() != b.is_prismatic(), "whether it is prismatic"),
        (".prescribed", a.prescribed != b.prescribed, "its value"),
        (
            ".frame",
            a.placement != b.placement || a.screw != b.screw,
            "whether an angle or a distance to the next axis is 0 or 90 degrees",
        ),
        (".rotor_inertia", a.rotor_inertia != b.rotor_inertia, absent),
        (".friction", a.friction != b.friction, absent),
        (".limits", a.limits != b.limits, absent),
        (".servo", a.servo != b.servo, absent),
        (".effort", a.effort != b.effort, absent),
        (".actuator", one.actuator != other.actuator, absent),
        (".spring", one.spring != other.spring, absent),
        (".detent", one.detent != other.detent, absent),
        (".friction.static", one.break_away != other.break_away, "whether it exceeds coulomb"),
    ]
}
