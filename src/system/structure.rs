//! Structure of compiled scenes: which terms they have, and in which form.

use super::Compiled;
use super::model::{BodyTerms, JointTerms, System};
use crate::hydro::Restoring;
use crate::lane::Shared;

/// The first difference in structure between two compiled scenes, in terms of a scene's keys; none where their numbers alone
/// differ. `joints` are the keys of the joints (`arm.links[0].joint`).
pub fn structural_difference(one: &Compiled, other: &Compiled, joints: &[String]) -> Option<String> {
    let (a, b) = (one.system.map(|_| ()), other.system.map(|_| ()));
    if a.joints.len() != b.joints.len() {
        return Some(format!("{} joints, not {}", b.joints.len(), a.joints.len()));
    }
    let alone = |key: &str, what: &str| format!("{key}: {what} in one of them only");
    if a.fixed != b.fixed {
        return Some(alone("vehicle.fixed", "true"));
    }
    let bodies = std::iter::once("vehicle".to_owned());
    let bodies = bodies.chain(joints.iter().map(|key| key.trim_end_matches(".joint").to_owned()));
    let terms = |system: &System<()>| -> Vec<BodyTerms<()>> {
        std::iter::once(&system.vehicle).chain(system.joints.iter().map(|joint| &joint.body)).cloned().collect()
    };
    let weighty = |compiled: &Compiled, k: usize| {
        let parts = &compiled.unscaled[k];
        let some =
            |masses: &Restoring<Shared<f64>>| masses.net_mass.0 != 0.0 || masses.moment.iter().any(|x| x.0 != 0.0);
        some(&parts.weight) || some(&parts.displaced)
    };
    for (k, (key, (a, b))) in bodies.zip(terms(&a).iter().zip(&terms(&b))).enumerate() {
        let parts = |compiled: &Compiled| compiled.unscaled[k].map(|_| ());
        let what = if a.damping != b.damping || parts(one).damping != parts(other).damping {
            "damping that is 0, diagonal, full, or central to the body"
        } else if a.central != b.central || parts(one) != parts(other) {
            "centres of mass, buoyancy, added mass and damping that coincide, or lie on an axis,"
        } else if a.restoring != b.restoring || weighty(one, k) != weighty(other, k) {
            "weight and buoyancy that cancel, or are 0,"
        } else {
            continue;
        };
        return Some(alone(&key, what));
    }
    for (key, (a, b)) in joints.iter().zip(a.joints.iter().zip(&b.joints)) {
        if let Some((name, what)) = joint_difference(a, b) {
            return Some(alone(&format!("{key}{name}"), what));
        }
    }
    let of_vehicle = [
        ("vehicle.servo", a.vehicle_servo != b.vehicle_servo),
        ("vehicle.thrusters", a.thrusters != b.thrusters),
        ("vehicle.fins", a.fins != b.fins),
        ("vehicle.tether", a.tether != b.tether),
    ];
    if let Some((key, _)) = of_vehicle.into_iter().find(|(_, differs)| *differs) {
        return Some(alone(key, "an entry, or a term that is 0 or absent,"));
    }
    if a.sparse != b.sparse {
        return Some(alone("inertia, added_mass", "products that are 0"));
    }
    let on_axes = |compiled: &Compiled| compiled.payload_attachment.map(|x| x != 0.0);
    if on_axes(one) != on_axes(other) {
        return Some(alone("arm.end_effector", "a coordinate that is 0 in the last joint's frame"));
    }
    debug_assert_eq!(a, b, "a difference without a name");
    (a != b).then(|| alone("scene", "a term"))
}

/// The first term of a joint that one of two has alone, or in another form.
fn joint_difference(a: &JointTerms<()>, b: &JointTerms<()>) -> Option<(&'static str, &'static str)> {
    let absent = "0 or absent";
    let terms = [
        (".kind", a.is_prismatic() != b.is_prismatic(), "prismatic"),
        (".prescribed", a.prescribed != b.prescribed, "true"),
        (
            ".frame",
            a.placement != b.placement || a.screw != b.screw,
            "an angle or a distance of 0 or 90 degrees to the next axis",
        ),
        (".rotor_inertia", a.rotor_inertia != b.rotor_inertia, absent),
        (".friction", a.friction != b.friction, absent),
        (".limits", a.limits != b.limits, absent),
        (".servo", a.servo != b.servo, absent),
        (".effort", a.effort != b.effort, absent),
        (".actuator", a.actuator != b.actuator, absent),
    ];
    terms.into_iter().find(|(_, differs, _)| *differs).map(|(name, _, what)| (name, what))
}
