//! The table: every term of a scene, how to leave it out, and every way of stating nothing of it.

use uvms_gym::hydro::CoefficientMatrix;
use uvms_gym::lane::Shared;
use uvms_gym::spatial::SpatialInertia;
use uvms_gym::system::{BodyTerms, Compiled, JointTerms, UnscaledBodyTerms};

use super::edit::{Edit, Place, bodies, list, table, zeros};

/// A term of a scene.
pub struct Term {
    pub what: &'static str,
    pub place: Place,
    /// Takes the term's keys away.
    pub absent: Edit,
    /// States in each way that there is nothing of it.
    pub nothing: &'static [Edit],
    /// Whether the kernel lacks it.
    pub dropped: Dropped,
}

type Body = BodyTerms<Shared<f64>>;
type Parts = UnscaledBodyTerms<Shared<f64>>;

/// Where the kernel would have a term.
#[derive(Clone, Copy)]
pub enum Dropped {
    Body(BodyLacks),
    Joint(JointLacks),
    System(SystemLacks),
}

impl Dropped {
    /// Whether the compiled scene lacks the term in the bodies or joints of a place.
    pub fn holds(self, place: Place, compiled: &Compiled) -> bool {
        let system = &compiled.system;
        let all = || std::iter::once(&system.vehicle).chain(system.joints.iter().map(|joint| &joint.body));
        match self {
            Dropped::System(dropped) => dropped(compiled),
            Dropped::Joint(dropped) => system.joints.iter().all(dropped),
            Dropped::Body(dropped) => {
                let concerned = match place {
                    Place::Vehicle => 0..1,
                    Place::Links => 1..compiled.unscaled.len(),
                    _ => 0..compiled.unscaled.len(),
                };
                all().zip(&compiled.unscaled).skip(concerned.start).take(concerned.len()).all(|(b, p)| dropped(b, p))
            }
        }
    }
}

fn no_linear(body: &Body) -> bool {
    body.damping.iter().all(|damping| damping.linear == CoefficientMatrix::None)
}

fn no_quadratic(body: &Body) -> bool {
    body.damping.iter().all(|damping| damping.quadratic == CoefficientMatrix::None)
}

fn no_added(parts: &Parts) -> bool {
    parts.added == SpatialInertia::zero().map(Shared)
}

/// A term, how to take its keys away, each way of stating nothing of it, and whether a part of the kernel lacks it.
type Row<Lacks> = (&'static str, Edit, &'static [Edit], Lacks);

type BodyLacks = fn(&Body, &Parts) -> bool;
type JointLacks = fn(&JointTerms<Shared<f64>>) -> bool;
type SystemLacks = fn(&Compiled) -> bool;

/// What a body can have, each with its ways of having nothing of it.
const BODY: [Row<BodyLacks>; 5] = [
    (
        "added mass",
        |body| drop(body.remove("added_mass")),
        &[
            |body| drop(body.insert("added_mass".into(), list(&[0.0; 6]))),
            |body| drop(body.insert("added_mass".into(), zeros())),
        ],
        |_, parts| no_added(parts),
    ),
    (
        "linear drag",
        |body| drop(table(body, "damping").remove("linear")),
        &[
            |body| drop(table(body, "damping").insert("linear".into(), list(&[0.0; 6]))),
            |body| drop(table(body, "damping").insert("linear".into(), zeros())),
        ],
        |body, _| no_linear(body),
    ),
    (
        "quadratic drag",
        |body| drop(table(body, "damping").remove("quadratic")),
        &[
            |body| drop(table(body, "damping").insert("quadratic".into(), list(&[0.0; 6]))),
            |body| drop(table(body, "damping").insert("quadratic".into(), zeros())),
        ],
        |body, _| no_quadratic(body),
    ),
    (
        "all that water does by motion",
        |body| ["added_mass", "damping", "hydrodynamic_frame"].into_iter().for_each(|key| drop(body.remove(key))),
        &[
            |body| ["added_mass", "damping"].into_iter().for_each(|key| drop(body.remove(key))),
            |body| {
                body.remove("added_mass");
                table(body, "damping").clear();
            },
            |body| {
                body.insert("added_mass".into(), zeros());
                for key in ["linear", "quadratic"] {
                    table(body, "damping").insert(key.into(), zeros());
                }
            },
        ],
        |body, parts| body.damping.is_empty() && no_added(parts),
    ),
    (
        "buoyancy",
        |body| ["volume", "buoyancy", "center_of_buoyancy"].into_iter().for_each(|key| drop(body.remove(key))),
        &[
            |body| ["volume", "buoyancy"].into_iter().for_each(|key| drop(body.remove(key))),
            |body| {
                body.remove("buoyancy");
                body.insert("volume".into(), 0.0.into());
            },
            |body| {
                body.remove("volume");
                body.insert("buoyancy".into(), 0.0.into());
            },
        ],
        |_, parts| parts.displaced.net_mass.0 == 0.0 && parts.displaced.moment.iter().all(|m| m.0 == 0.0),
    ),
];

const JOINT: [Row<JointLacks>; 5] = [
    (
        "friction",
        |joint| drop(joint.remove("friction")),
        &[
            |joint| table(joint, "friction").clear(),
            |joint| {
                table(joint, "friction").extend([("viscous".into(), 0.0.into()), ("coulomb".into(), 0.0.into())]);
            },
            |joint| {
                table(joint, "friction").remove("viscous");
                table(joint, "friction").insert("coulomb".into(), 0.0.into());
            },
        ],
        |joint| joint.friction.is_none(),
    ),
    (
        "Coulomb friction",
        |joint| ["coulomb", "coulomb_speed"].into_iter().for_each(|key| drop(table(joint, "friction").remove(key))),
        &[
            |joint| drop(table(joint, "friction").insert("coulomb".into(), 0.0.into())),
            |joint| drop(table(joint, "friction").remove("coulomb")),
        ],
        |joint| joint.friction.is_some_and(|friction| friction.coulomb.is_none()),
    ),
    (
        "end stops",
        |joint| drop(joint.remove("limits")),
        &[
            |joint| {
                table(joint, "limits").extend([("stiffness".into(), 0.0.into()), ("damping".into(), 0.0.into())]);
            },
            |joint| {
                table(joint, "limits").insert("stiffness".into(), 0.0.into());
                table(joint, "limits").remove("damping");
            },
        ],
        |joint| joint.limits.is_none(),
    ),
    (
        "damping of the end stops",
        |joint| drop(table(joint, "limits").remove("damping")),
        &[|joint| drop(table(joint, "limits").insert("damping".into(), 0.0.into()))],
        |joint| joint.limits.is_some_and(|limits| limits.stop[1].0 == 0.0),
    ),
    (
        "servo",
        |joint| drop(joint.remove("servo")),
        &[|joint| table(joint, "servo").extend([("kp".into(), 0.0.into()), ("kd".into(), 0.0.into())])],
        |joint| joint.servo.is_none(),
    ),
];

const SCENE: [Row<SystemLacks>; 4] = [
    (
        "gravity",
        |root| {
            table(root, "water").insert("gravity".into(), list(&[0.0; 3]));
            bodies(root, |body| {
                ["volume", "buoyancy", "center_of_buoyancy"].into_iter().for_each(|key| drop(body.remove(key)));
            });
        },
        &[|root| {
            table(root, "water").insert("gravity".into(), list(&[0.0; 3]));
            bodies(root, |body| drop(body.remove("buoyancy")));
        }],
        |compiled| {
            let system = &compiled.system;
            system.vehicle.restoring.is_none() && system.joints.iter().all(|joint| joint.body.restoring.is_none())
        },
    ),
    (
        "buoyancy of all",
        |root| bodies(root, |body| ["volume", "buoyancy"].into_iter().for_each(|key| drop(body.remove(key)))),
        &[|root| {
            table(root, "water").insert("density".into(), 0.0.into());
            bodies(root, |body| drop(body.remove("buoyancy")));
        }],
        |compiled| compiled.unscaled.iter().all(|parts| parts.displaced.net_mass.0 == 0.0),
    ),
    (
        "station keeping",
        |root| drop(table(root, "vehicle").remove("servo")),
        &[|root| {
            let servo = table(table(root, "vehicle"), "servo");
            servo.extend([("kp".into(), list(&[0.0; 6])), ("kd".into(), list(&[0.0; 6]))]);
        }],
        |compiled| compiled.system.vehicle_servo.is_none(),
    ),
    (
        "arm",
        |root| ["arm", "payload"].into_iter().for_each(|key| drop(root.remove(key))),
        &[
            |root| {
                root.remove("payload");
                table(root, "arm").retain(|key, _| ["name", "end_effector"].contains(&key));
            },
            |root| {
                root.remove("payload");
                table(root, "arm").insert("links".into(), toml::Value::Array(Vec::new()));
                ["base", "mount"].into_iter().for_each(|key| drop(table(root, "arm").remove(key)));
            },
        ],
        |compiled| compiled.system.joints.is_empty(),
    ),
];

/// Every term in every place.
pub fn terms() -> Vec<Term> {
    let body = BODY.into_iter().flat_map(|(what, absent, nothing, dropped)| {
        [Place::Vehicle, Place::Links, Place::Bodies].map(|place| Term {
            what,
            place,
            absent,
            nothing,
            dropped: Dropped::Body(dropped),
        })
    });
    let joint = JOINT.into_iter().map(|(what, absent, nothing, dropped)| Term {
        what,
        place: Place::Joints,
        absent,
        nothing,
        dropped: Dropped::Joint(dropped),
    });
    let scene = SCENE.into_iter().map(|(what, absent, nothing, dropped)| Term {
        what,
        place: Place::Root,
        absent,
        nothing,
        dropped: Dropped::System(dropped),
    });
    body.chain(joint).chain(scene).collect()
}
