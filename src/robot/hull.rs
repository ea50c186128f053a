//! The vehicle in a robot's file: whether there is one, and its body.

use nalgebra::Vector3;

use super::body::Built;
use super::lift::fins;
use super::merge::{Part, Rigid};
use super::motion::{Frozen, is_propeller, says};
use super::thrusters::{Propulsion, ThrusterSource, thrusters};
use super::tree::Tree;
use super::{InWater, RobotThruster};
use crate::description::{Body, Frame, Shape, ShapeKind, Vehicle};

/// Minimum mass of a hull that only its mass marks as one, kg, and its minimum ratio to the mass of all that moves on it.
const HEAVY: f64 = 5.0;
const RATIO: f64 = 2.0;

/// Words in the names of robots that are vehicles, and in the names of robots that are arms on vehicles.
const VEHICLES: [&str; 8] = ["auv", "rov", "uuv", "bluerov", "rexrov", "glider", "submarine", "submersible"];
const ARMS: [&str; 4] = ["arm", "manipulator", "gripper", "hand"];

/// Height of an assumed centre of buoyancy above the centre of mass, over the edge of a cube of the displaced volume; 0.02 m of a
/// BlueROV2.
const METACENTRIC: f64 = 0.08;

/// Reason by mass alone.
pub const OUTWEIGHS: &str = "it outweighs all that moves on it";

/// Reason for which the root is the hull of a vehicle; none if it is the base of an arm.
pub fn reason(tree: &Tree, parts: &[Part], frozen: &Frozen, rigid: &[Rigid]) -> Option<&'static str> {
    let (hull, moving) = (&parts[0], rigid[1..].iter().map(|rigid| rigid.mass).sum::<f64>());
    let carries = |thruster: &RobotThruster| {
        let link = thruster_link(tree, thruster);
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
    } else if tree.robot.thrusters.iter().any(|thruster| thruster_link(tree, thruster).is_some()) {
        Some("links on it carry thrusters")
    } else if rigid[0].mass >= HEAVY && says(&tree.robot.name, &VEHICLES) && !says(&tree.robot.name, &ARMS) {
        Some("the robot is called so")
    } else {
        None
    }
}

/// Link that a thruster is on, if the file has it.
pub fn thruster_link(tree: &Tree, thruster: &RobotThruster) -> Option<usize> {
    let joint = thruster.joint.as_ref().and_then(|joint| tree.joints.get(joint.as_str())).map(|j| tree.child[*j]);
    thruster.link.as_ref().and_then(|link| tree.links.get(link.as_str())).copied().or(joint)
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
    built: Built,
    propulsion: &Propulsion,
    notes: &mut Vec<String>,
) -> (Vehicle, Vec<(String, String)>) {
    let mut origins: Vec<(String, String)> =
        built.origins.iter().map(|(key, text)| (format!("body.{key}"), text.clone())).collect();
    let shape = shape(&built);
    let (thrusters, thruster_lag) =
        thrusters(tree, hull, propulsion, (&built.body, shape.as_ref()), notes, &mut origins);
    let fins = fins(tree, hull, notes, &mut origins);
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
        thruster_lag,
        voltage: match propulsion.source {
            ThrusterSource::Scene(scene) => scene.vehicle.voltage,
            _ => None,
        },
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

/// Sets the buoyancy of a hull whose file states none: the whole robot displaces its mass, level at rest. `others` are mass and
/// displaced mass of all other bodies, kg.
pub fn trim(body: &mut Body, others: (f64, f64), density: f64, name: &str, notes: &mut Vec<String>) {
    let outline = body.volume.unwrap_or(0.0);
    let mass = body.mass + others.0 - others.1;
    let volume = mass.max(0.1 * body.mass) / density;
    let com = body.center_of_mass;
    body.volume = Some(volume);
    let height = body.center_of_buoyancy.z.max(com.z + METACENTRIC * volume.cbrt());
    body.center_of_buoyancy = Vector3::new(com.x, com.y, height);
    let encloses =
        if outline > 0.0 { format!(" (its outline encloses {:.3} L)", 1e3 * outline) } else { String::new() };
    notes.push(format!(
        "{name}: its buoyancy is assumed: {:.3} L, so that the robot neither rises nor sinks{encloses}, and its centre {:.3} m above the centre of mass, so that it is level",
        1e3 * volume,
        height - com.z
    ));
}
