//! Thrusters of the vehicle in a robot's file: stated, called so, or assumed.

use nalgebra::Vector3;

use super::RobotThruster;
use super::hull::thruster_link;
use super::merge::{Part, compose};
use super::motion::is_propeller;
use super::tree::Tree;
use crate::description::{Body, Frame, Scene, Shape, Thruster};

/// Places of assumed thrusters on the hull's box, in halves of its edges, and their axes.
const LAYOUT: [(&str, [f64; 2], [f64; 3]); 8] = [
    ("front-right", [1.0, -1.0], [1.0, 1.0, 0.0]),
    ("front-left", [1.0, 1.0], [1.0, -1.0, 0.0]),
    ("rear-right", [-1.0, -1.0], [1.0, -1.0, 0.0]),
    ("rear-left", [-1.0, 1.0], [1.0, 1.0, 0.0]),
    ("vertical-front-right", [1.0, -1.0], [0.0, 0.0, 1.0]),
    ("vertical-front-left", [1.0, 1.0], [0.0, 0.0, 1.0]),
    ("vertical-rear-right", [-1.0, -1.0], [0.0, 0.0, 1.0]),
    ("vertical-rear-left", [-1.0, 1.0], [0.0, 0.0, 1.0]),
];

/// Thrust of all four vertical assumed thrusters over the net weight that they have to hold.
const SPARE: f64 = 2.0;

/// Minimum half of an edge of the box that carries assumed thrusters, over the maximum one.
const THIN: f64 = 0.1;

/// Thrusters that the vehicle of a file gets.
#[derive(Debug, Clone, Copy, Default)]
pub enum ThrusterSource<'a> {
    /// Thrusters of the file; where it states none, assumed ones.
    #[default]
    FileOrAssumed,
    /// Thrusters of the file, or none.
    File,
    /// Assumed ones, in the place of the file's.
    Assumed,
    /// Thrusters of another scene's vehicle.
    Scene(&'a Scene),
}

/// All on which thrusters depend besides the hull.
pub struct Propulsion<'a> {
    pub source: ThrusterSource<'a>,
    /// Joints of propellers without a stated thruster.
    pub propellers: &'a [usize],
    /// Weight of the robot, and weight less buoyancy, N.
    pub weight: f64,
    pub net_weight: f64,
}

fn rounded(thrust: f64) -> f64 {
    format!("{:.1e}", thrust.max(1.0)).parse().expect("it was written as a number")
}

/// Thrusters of the hull, and their common lag; `body` is the hull's, with the box around it. `origins` receives provenance by
/// keys below `vehicle`.
pub fn thrusters(
    tree: &Tree,
    hull: &Part,
    propulsion: &Propulsion,
    body: (&Body, Option<&Shape>),
    notes: &mut Vec<String>,
    origins: &mut Vec<(String, String)>,
) -> (Vec<Thruster>, Option<f64>) {
    let name = &tree.robot.links[hull.links[0].0].name;
    let source = propulsion.source;
    if let ThrusterSource::Scene(scene) = source {
        notes.push(format!("{name}: the thrusters of {}, in its vehicle's frame, as chosen", scene.name));
        origins.push(("thrusters".to_owned(), format!("assumed: the thrusters of {}", scene.name)));
        return (scene.vehicle.thrusters.clone(), scene.vehicle.thruster_lag);
    }
    if !matches!(source, ThrusterSource::Assumed) {
        let own = stated(tree, hull, propulsion, notes, origins);
        if !own.is_empty() {
            return (own, None);
        }
    }
    if matches!(source, ThrusterSource::File) {
        notes.push(format!("{name}: no thrusters in the file: write [[vehicle.thrusters]] into the scene"));
        return (Vec::new(), None);
    }
    let vertical = LAYOUT.iter().filter(|(.., axis)| axis[2] != 0.0).count() as f64;
    let limit = (propulsion.weight / LAYOUT.len() as f64).max(SPARE * propulsion.net_weight.abs() / vertical);
    let limit = rounded(limit);
    let why =
        if matches!(source, ThrusterSource::Assumed) { "as chosen" } else { "as the file states none on the hull" };
    notes.push(format!(
        "{name}: eight thrusters are ASSUMED, {why}: ideal, at the edges of the hull's box, {limit} N each either way (--thrusters SCENE chooses others, --thrusters file leaves them out)"
    ));
    let text = format!("assumed: eight ideal ones at the edges of the hull's box, {why}");
    origins.push(("thrusters".to_owned(), text));
    (assumed(body, limit), None)
}

/// Four vectored and four vertical thrusters around the centre of mass.
fn assumed((body, shape): (&Body, Option<&Shape>), limit: f64) -> Vec<Thruster> {
    let radius = 0.5 * body.volume.unwrap_or(body.mass / 1000.0).max(1e-6).cbrt();
    let half = shape.map_or(Vector3::repeat(radius), |shape| shape.size / 2.0);
    let half = half.map(|edge| edge.max(THIN * half.amax()));
    let of = |(name, [x, y], axis): &(&str, [f64; 2], [f64; 3])| {
        let position = body.center_of_mass + Vector3::new(x * half.x, y * half.y, 0.0);
        Thruster::new((*name).to_owned(), position, Vector3::from(*axis).normalize(), [-limit, limit])
    };
    LAYOUT.iter().map(of).collect()
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

fn stated(
    tree: &Tree,
    hull: &Part,
    propulsion: &Propulsion,
    notes: &mut Vec<String>,
    origins: &mut Vec<(String, String)>,
) -> Vec<Thruster> {
    let (robot, mut thrusters) = (tree.robot, Vec::new());
    let named = propulsion.propellers.iter().map(|j| {
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
    let default = rounded(propulsion.weight / all.len().max(1) as f64);
    for thruster in &all {
        let mut name = thruster.name.clone();
        while thrusters.iter().any(|other: &Thruster| other.name == name) || name.is_empty() {
            name.push_str(if name.is_empty() { "thruster" } else { "-2" });
        }
        let joint = thruster.joint.as_ref().and_then(|joint| tree.joints.get(joint.as_str()).copied());
        let Some(link) = thruster_link(tree, thruster) else {
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
