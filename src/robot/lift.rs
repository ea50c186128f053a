//! Fins of a robot on its vehicle.

use nalgebra::Vector3;

use super::merge::{Part, compose};
use super::tree::Tree;
use crate::description::{Fin, Frame};

/// Maximum number of fins of a vehicle.
const FINS: usize = 8;

/// Fins of the hull, in its frame; `origins` receives provenance by keys below `vehicle`.
pub fn fins(tree: &Tree, hull: &Part, notes: &mut Vec<String>, origins: &mut Vec<(String, String)>) -> Vec<Fin> {
    let mut fins: Vec<Fin> = Vec::new();
    for own in &tree.robot.fins {
        let place =
            tree.links.get(own.link.as_str()).and_then(|link| hull.links.iter().find(|(other, _)| other == link));
        let Some((_, at)) = place.filter(|_| fins.len() < FINS) else {
            let why = if fins.len() < FINS { "is not fixed to the hull" } else { "is one too many" };
            notes.push(format!("{}: a fin that {why}: left out", own.link));
            continue;
        };
        let turn = |axis: Vector3<f64>| (at.rotation() * axis).map(|x| if x.abs() < 1e-12 { 0.0 } else { x });
        let own_frame = Frame { position: own.fin.position, rpy: Vector3::zeros() };
        let joint = own.joint.as_ref().and_then(|joint| tree.joints.get(joint.as_str()));
        let limits = joint.and_then(|joint| tree.robot.joints[*joint].limits);
        let mut name = own.fin.name.clone();
        while fins.iter().any(|fin| fin.name == name) {
            name.push('\'');
        }
        if joint.is_some() && limits.is_none() {
            notes.push(format!("{name}: no limits of deflection in the file: 0.4 rad either way"));
            origins.push((format!("fins[{name}].limits"), "assumed: below the stall of most fins".to_owned()));
        }
        for (key, text) in [
            ("plate", "assumed: flat plate"),
            ("area", "derived: with the lift slope, the lift of the file"),
            ("induced_drag", "derived: the drag of the file, at the stall angle if it has one"),
        ] {
            origins.push((format!("fins[{name}].{key}"), text.to_owned()));
        }
        fins.push(Fin {
            position: compose(at, &own_frame).position,
            chord: turn(own.fin.chord),
            axis: turn(own.fin.axis),
            name,
            limits: joint.map(|_| limits.unwrap_or([-0.4, 0.4])),
            ..own.fin.clone()
        });
    }
    fins
}
