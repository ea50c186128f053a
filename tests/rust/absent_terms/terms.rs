//! The table: every term of a scene, how to leave it out, and every way to state zero for it.

use uvms_gym::hydro::CoefficientMatrix;
use uvms_gym::lane::Shared;
use uvms_gym::spatial::SpatialInertia;
use uvms_gym::system::{BodyTerms, Compiled, JointTerms, RareTerms, UnscaledBodyTerms};

use super::edit::{Edit, Place};

/// A term of a scene.
#[derive(Clone, Copy)]
pub struct Term {
    pub name: &'static str,
    pub places: &'static [Place],
    /// Removes the term's keys.
    pub absent: Edit,
    /// States zero for it, in each way.
    pub zero: &'static [Edit],
    /// Whether the compiled scene lacks it in a place.
    pub dropped: fn(Place, &Compiled) -> bool,
}

type Body = BodyTerms<Shared<f64>>;
type Parts = UnscaledBodyTerms<Shared<f64>>;

/// Whether a condition holds for all bodies of a place.
fn bodies(place: Place, compiled: &Compiled, holds: fn(&Body, &Parts) -> bool) -> bool {
    let system = &compiled.system;
    let all = std::iter::once(&system.vehicle).chain(system.joints.iter().map(|joint| &joint.body));
    let is_concerned = |k: usize| place != if k == 0 { Place::Links } else { Place::Vehicle };
    all.zip(&compiled.unscaled).enumerate().all(|(k, (body, parts))| !is_concerned(k) || holds(body, parts))
}

fn joints(compiled: &Compiled, holds: fn(&JointTerms<Shared<f64>>) -> bool) -> bool {
    compiled.system.joints.iter().all(holds)
}

fn rare(joint: &JointTerms<Shared<f64>>) -> RareTerms<Shared<f64>> {
    joint.rare.as_deref().copied().unwrap_or_default()
}

fn no_added(parts: &Parts) -> bool {
    parts.added == SpatialInertia::zero().map(Shared)
}

const BODIES: &[Place] = &[Place::Vehicle, Place::Links, Place::Bodies];

pub const TERMS: [Term; 17] = [
    Term {
        name: "added mass",
        places: BODIES,
        absent: "-added_mass",
        zero: &["added_mass = ZEROS", "added_mass = ZERO_ROWS"],
        dropped: |place, compiled| bodies(place, compiled, |_, parts| no_added(parts)),
    },
    Term {
        name: "linear drag",
        places: BODIES,
        absent: "-damping.linear",
        zero: &["damping.linear = ZEROS", "damping.linear = ZERO_ROWS"],
        dropped: |place, compiled| {
            bodies(place, compiled, |body, _| body.damping.iter().all(|d| d.linear == CoefficientMatrix::None))
        },
    },
    Term {
        name: "quadratic drag",
        places: BODIES,
        absent: "-damping.quadratic",
        zero: &["damping.quadratic = ZEROS", "damping.quadratic = ZERO_ROWS"],
        dropped: |place, compiled| {
            bodies(place, compiled, |body, _| body.damping.iter().all(|d| d.quadratic == CoefficientMatrix::None))
        },
    },
    Term {
        name: "all forces of the water on motion",
        places: BODIES,
        absent: "-added_mass; -damping; -hydrodynamic_frame",
        zero: &[
            "-added_mass; -damping",
            "-added_mass; -damping; damping = {}",
            "added_mass = ZERO_ROWS; damping = { linear = ZERO_ROWS, quadratic = ZERO_ROWS }",
        ],
        dropped: |place, compiled| bodies(place, compiled, |body, parts| body.damping.is_empty() && no_added(parts)),
    },
    Term {
        name: "buoyancy",
        places: BODIES,
        absent: "-volume; -buoyancy; -center_of_buoyancy",
        zero: &["-volume; -buoyancy", "-buoyancy; volume = 0.0", "-volume; buoyancy = 0.0"],
        dropped: |place, compiled| {
            bodies(place, compiled, |_, parts| {
                parts.displaced.net_mass.0 == 0.0 && parts.displaced.moment.iter().all(|m| m.0 == 0.0)
            })
        },
    },
    Term {
        name: "friction",
        places: &[Place::Joints],
        absent: "-friction",
        zero: &[
            "-friction; friction = {}",
            "friction = { viscous = 0.0, coulomb = 0.0, static = 0.0 }",
            "-friction.viscous; friction.coulomb = 0.0; friction.static = 0.0",
        ],
        dropped: |_, compiled| joints(compiled, |joint| joint.friction.is_none() && rare(joint).break_away.is_none()),
    },
    Term {
        name: "Coulomb friction",
        places: &[Place::Joints],
        absent: "-friction.coulomb; -friction.coulomb_speed; -friction.static; -friction.stribeck_speed",
        zero: &["friction.coulomb = 0.0; friction.static = 0.0", "-friction.coulomb; friction.static = 0.0"],
        dropped: |_, compiled| {
            let dry = |joint: &JointTerms<Shared<f64>>| joint.friction.is_some_and(|f| f.coulomb.is_some());
            joints(compiled, |joint| rare(joint).break_away.is_none()) && !compiled.system.joints.iter().any(dry)
        },
    },
    Term {
        name: "static friction",
        places: &[Place::Joints],
        absent: "friction.coulomb = 0.2; -friction.static; -friction.stribeck_speed",
        zero: &["friction.coulomb = 0.2; friction.static = 0.2"],
        dropped: |_, compiled| joints(compiled, |joint| rare(joint).break_away.is_none()),
    },
    Term {
        name: "spring",
        places: &[Place::Joints],
        absent: "-spring",
        zero: &["spring.stiffness = 0.0"],
        dropped: |_, compiled| joints(compiled, |joint| rare(joint).spring.is_none()),
    },
    Term {
        name: "detent",
        places: &[Place::Joints],
        absent: "-detent",
        zero: &["detent.torque = 0.0"],
        dropped: |_, compiled| joints(compiled, |joint| rare(joint).detent.is_none()),
    },
    Term {
        name: "end stops",
        places: &[Place::Joints],
        absent: "-limits",
        zero: &["limits = { stiffness = 0.0, damping = 0.0 }", "limits.stiffness = 0.0; -limits.damping"],
        dropped: |_, compiled| joints(compiled, |joint| joint.limits.is_none()),
    },
    Term {
        name: "damping of the end stops",
        places: &[Place::Joints],
        absent: "-limits.damping",
        zero: &["limits.damping = 0.0"],
        dropped: |_, compiled| joints(compiled, |joint| joint.limits.is_some_and(|limits| limits.stop[1].0 == 0.0)),
    },
    Term {
        name: "servo",
        places: &[Place::Joints],
        absent: "-servo",
        zero: &["servo = { kp = 0.0, kd = 0.0 }"],
        dropped: |_, compiled| joints(compiled, |joint| joint.servo.is_none()),
    },
    Term {
        name: "gravity",
        places: &[Place::Root],
        absent: "water.gravity = [0.0, 0.0, 0.0]; *-volume; *-buoyancy; *-center_of_buoyancy",
        zero: &["water.gravity = [0.0, 0.0, 0.0]; *-buoyancy"],
        dropped: |_, compiled| bodies(Place::Bodies, compiled, |body, _| body.restoring.is_none()),
    },
    Term {
        name: "buoyancy of all",
        places: &[Place::Root],
        absent: "*-volume; *-buoyancy",
        zero: &["water.density = 0.0; *-buoyancy"],
        dropped: |_, compiled| bodies(Place::Bodies, compiled, |_, parts| parts.displaced.net_mass.0 == 0.0),
    },
    Term {
        name: "station keeping",
        places: &[Place::Root],
        absent: "-vehicle.servo",
        zero: &["vehicle.servo = { kp = ZEROS, kd = ZEROS }"],
        dropped: |_, compiled| compiled.system.vehicle_servo.is_none(),
    },
    Term {
        name: "arm",
        places: &[Place::Root],
        absent: "-arm; -payload",
        zero: &["-payload; -arm.base; -arm.mount; -arm.links", "-payload; -arm.base; -arm.mount; arm.links = []"],
        dropped: |_, compiled| compiled.system.joints.is_empty(),
    },
];
