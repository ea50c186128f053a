//! The vehicle in a robot's file: whether there is one, its body and its thrusters.

use nalgebra::Vector3;

use super::body::Built;
use super::lift::fins;
use super::merge::{Part, Rigid, compose};
use super::motion::{Frozen, is_propeller};
use super::tree::Tree;
use super::{InWater, RobotThruster};
use crate::description::{Body, Frame, Shape, ShapeKind, Thruster, Vehicle};

/// Minimum mass of a hull that only its mass marks as one, kg, and its minimum ratio to the mass of all that moves on it.
const HEAVY: f64 = 5.0;
const RATIO: f64 = 2.0;

/// Reason by mass alone.
pub const OUTWEIGHS: &str = "it outweighs all that moves on it";

/// Reason for which the root is the hull of a vehicle; none if it is the base of an arm.
pub fn reason(tree: &Tree, parts: &[Part], frozen: &Frozen, rigid: &[Rigid]) -> Option<&'static str> {
    let (hull, moving) = (&parts[0], rigid[1..].iter().map(|rigid| rigid.mass).sum::<f64>());
    let carries = |thruster: &RobotThruster| {
        let joint = thruster.joint.as_ref().and_then(|joint| tree.joints.get(joint.as_str())).map(|j| tree.child[*j]);
        let link = thruster.link.as_ref().and_then(|link| tree.links.get(link.as_str())).copied().or(joint);
        hull.links.iter().any(|(at, _)| Some(*at) == link)
    };
    // A volume alone, or a sensor without weight, is no hull.
    let states = |water: &InWater| water.has_added_mass() || water.has_damping();
    if tree.robot.thrusters.iter().any(carries) {
        Some("it carries thrusters")
    } else if hull.links.iter().any(|(link, _)| tree.robot.links[*link].water.as_ref().is_some_and(states)) {
        Some("the file states its hydrodynamics")
    } else if tree.floats(hull.links[0].0) {
        Some("it is on a floating joint")
    } else if frozen.rotors {
        Some("it carries propellers")
    } else if hull.links.iter().any(|(link, _)| is_propeller(&tree.robot.links[*link].name)) {
        Some("frames on it are called thruster or propeller")
    } else if parts.len() == 1 {
        Some("nothing moves on it")
    } else if rigid[0].mass >= HEAVY && rigid[0].mass > RATIO * moving {
        Some(OUTWEIGHS)
    } else {
        None
    }
}

/// The first link with a mass, below massless ones such as `world` that carry nothing else, on fixed joints: the hull's frame is
/// its.
pub fn first_body(tree: &Tree, root: usize, masses: &[f64]) -> usize {
    let mut at = root;
    loop {
        let link = &tree.robot.links[at];
        let mut heavy = tree.below[at].iter().filter(|joint| masses[tree.child[**joint]] > 0.0);
        match (heavy.next(), heavy.next()) {
            (Some(&joint), None) if link.inertial.is_none() && !tree.robot.joints[joint].moves() => {
                at = tree.child[joint]
            }
            _ => return at,
        }
    }
}

/// The vehicle of a hull, without servo.
pub fn vehicle(
    tree: &Tree,
    hull: &Part,
    propellers: &[usize],
    built: Built,
    weight: f64,
    notes: &mut Vec<String>,
) -> (Vehicle, Vec<(String, String)>) {
    let mut origins: Vec<(String, String)> =
        built.origins.iter().map(|(key, text)| (format!("body.{key}"), text.clone())).collect();
    let thrusters = thrusters(tree, hull, propellers, weight, notes, &mut origins);
    if thrusters.is_empty() {
        let name = &tree.robot.links[hull.links[0].0].name;
        notes.push(format!(
            "{name}: no thrusters in the file: write [[vehicle.thrusters]] into the scene, or choose a --vehicle"
        ));
    }
    let fins = fins(tree, hull, notes, &mut origins);
    let shape = shape(&built);
    if shape.is_some() {
        origins.push(("shape".to_owned(), "derived: box around the outline; the colour is assumed".to_owned()));
    }
    let vehicle = Vehicle {
        name: if tree.robot.name.is_empty() {
            tree.robot.links[hull.links[0].0].name.clone()
        } else {
            tree.robot.name.clone()
        },
        fixed: false,
        body: built.body,
        thrusters,
        thruster_lag: None,
        fins,
        tether: None,
        forward_damping: built.forward,
        servo: None,
        shape,
        meshes: hull.mesh_files(tree),
    };
    (vehicle, origins)
}

/// Box around the outline, for pictures.
fn shape(built: &Built) -> Option<Shape> {
    let (mut lower, mut upper) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    for shape in &built.shapes {
        let half = shape.solid()?.extent() / 2.0;
        let turned = Frame { position: shape.position, rpy: shape.rpy }.rotation().abs() * half;
        (lower, upper) = (lower.inf(&(shape.position - turned)), upper.sup(&(shape.position + turned)));
    }
    let size = upper - lower;
    (size.min() > 0.0 && size.amax() < 1e6).then(|| Shape {
        kind: ShapeKind::Box,
        size,
        position: (lower + upper) / 2.0,
        ..Shape::default()
    })
}

/// Thrusters at the ends of the hull that are called so.
fn frames(tree: &Tree, hull: &Part) -> Vec<RobotThruster> {
    let called = |link: usize| tree.below[link].is_empty() && is_propeller(&tree.robot.links[link].name);
    let links = hull.links.iter().map(|(link, _)| *link).filter(|link| called(*link));
    let of = |link: usize| {
        let name = tree.robot.links[link].name.clone();
        RobotThruster { name: name.clone(), link: Some(name), axis: Vector3::x(), ..RobotThruster::default() }
    };
    links.map(of).collect()
}

fn thrusters(
    tree: &Tree,
    hull: &Part,
    propellers: &[usize],
    weight: f64,
    notes: &mut Vec<String>,
    origins: &mut Vec<(String, String)>,
) -> Vec<Thruster> {
    let (robot, mut thrusters) = (tree.robot, Vec::new());
    let named = propellers.iter().map(|j| {
        let joint = &robot.joints[*j];
        RobotThruster { name: joint.name.clone(), joint: Some(joint.name.clone()), ..RobotThruster::default() }
    });
    let mut all: Vec<RobotThruster> = robot.thrusters.iter().cloned().chain(named).collect();
    if all.is_empty() {
        all = frames(tree, hull);
        for thruster in &all {
            notes.push(format!("{}: a thruster along its x axis, by its name", thruster.name));
        }
    }
    let default = (weight / all.len().max(1) as f64).max(1.0);
    let default: f64 = format!("{default:.1e}").parse().expect("it was written as a number");
    for thruster in &all {
        let mut name = thruster.name.clone();
        while thrusters.iter().any(|other: &Thruster| other.name == name) || name.is_empty() {
            name.push_str(if name.is_empty() { "thruster" } else { "-2" });
        }
        let joint = thruster.joint.as_ref().and_then(|joint| tree.joints.get(joint.as_str()).copied());
        let link = thruster.link.as_ref().and_then(|link| tree.links.get(link.as_str()).copied());
        let Some(link) = link.or(joint.map(|joint| tree.child[joint])) else {
            let unknown = thruster.link.as_ref().or(thruster.joint.as_ref()).cloned().unwrap_or_default();
            notes.push(format!("{name}: a thruster on \"{unknown}\", which the file does not have: left out"));
            continue;
        };
        let Some((_, at)) = hull.links.iter().find(|(other, _)| *other == link) else {
            notes.push(format!(
                "{name}: a thruster on {}, which is not fixed to the hull: left out",
                robot.links[link].name
            ));
            continue;
        };
        let own = Frame { position: thruster.position, rpy: Vector3::zeros() };
        let above = joint.or(tree.above[link]).map_or(Vector3::x(), |joint| robot.joints[joint].axis);
        let axis = if thruster.axis == Vector3::zeros() { above } else { thruster.axis };
        let axis = (at.rotation() * axis).map(|x| if x.abs() < 1e-12 { 0.0 } else { x });
        let position = compose(at, &own).position;
        let limits = thruster.limits.unwrap_or([-default, default]);
        if thruster.limits.is_none() {
            notes.push(format!(
                "{name}: no limits of thrust in the file: {default} N either way, its part of the weight"
            ));
            origins.push((format!("thrusters[{name}].limits"), "assumed: its part of the weight".to_owned()));
        }
        let (lag, dead_band, map) = (thruster.lag, thruster.dead_band, thruster.map.clone());
        thrusters.push(Thruster { lag, dead_band, map, ..Thruster::new(name, position, axis, limits) });
    }
    thrusters
}

/// Sets the buoyancy of a hull whose file states none: the whole robot displaces its mass, level at rest. `others` are mass and
/// displaced mass of all other bodies, kg.
pub fn trim(body: &mut Body, others: (f64, f64), density: f64, name: &str, notes: &mut Vec<String>) {
    let outline = body.volume.unwrap_or(0.0);
    let mass = body.mass + others.0 - others.1;
    let volume = mass.max(0.1 * body.mass) / density;
    let com = body.center_of_mass;
    body.volume = Some(volume);
    body.center_of_buoyancy = Vector3::new(com.x, com.y, body.center_of_buoyancy.z.max(com.z));
    notes.push(format!(
        "{name}: no buoyancy in the file: {volume:.4} m3, so that the robot neither rises nor sinks (its outline encloses {outline:.4} m3)"
    ));
}
