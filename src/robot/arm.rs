//! Arms: the moving parts of a robot as links of a scene.

use std::collections::BTreeMap;

use super::assemble::Moving;
use super::body::{Built, body};
use super::element::Result;
use super::ends::{End, ends};
use super::merge::Part;
use super::servo::{BANDWIDTH, SAG, STOP, tune};
use super::tree::Tree;
use super::{RobotJoint, RobotJointKind};
use crate::description::{
    Arm, BASE, EndEffectorFrame, Frame, Friction, Joint, JointKind, JointLimits, JointSpring, Link, Mount, VEHICLE,
};

impl Moving<'_> {
    /// The moving parts as an arm, on a mount or on the file's vehicle; `origins` receives provenance by keys below `arm`.
    pub fn arm(
        &self,
        tips: &[(String, String)],
        mount: Option<&Frame>,
        density: f64,
        origins: &mut Vec<(String, String)>,
        notes: &mut Vec<String>,
    ) -> Result<Arm> {
        let Self { tree, inertials, parts, .. } = self;
        let robot = tree.robot;
        let names = names(tree, parts);
        let mut arm = Arm {
            name: if robot.name.is_empty() { "arm".to_owned() } else { robot.name.clone() },
            mount: Mount { frame: mount.cloned().unwrap_or_default(), joint: None },
            base: None,
            meshes: Vec::new(),
            links: Vec::new(),
            end_effector: EndEffectorFrame::default(),
            end_effectors: BTreeMap::new(),
        };
        for (i, part) in parts.iter().enumerate().skip(1) {
            let Some(j) = part.joint else { continue };
            let joint = &robot.joints[j];
            let Built { body, origins: of_body, .. } = body(tree, part, inertials, (density, false), notes)?;
            let name = names[i].clone();
            if body.mass <= 0.0 {
                let problem = format!(
                    "has no mass (<inertial>), which a link on a moving joint needs: state a --density, or --lock {}",
                    joint.name
                );
                return robot.fault(joint.line, &format!("link \"{name}\""), problem);
            }
            let key = body_key(arm.links.len(), &name);
            origins.extend(of_body.into_iter().map(|(below, text)| (format!("{key}.{below}"), text)));
            // Without a name, the carrier is the link before, and the base carries the first.
            let default = part.carrier + 1 == i && (i > 1 || mount.is_some());
            let parent = (!default).then(|| names[part.carrier].clone());
            note(joint, notes);
            let (joint, meshes) = (taken_over(joint, part.frame.clone()), part.mesh_files(tree));
            arm.links.push(Link { name, parent, joint, body: Some(body), meshes });
        }
        if let Some(vehicle) = mount.is_none().then_some(VEHICLE) {
            arm.links
                .iter_mut()
                .filter(|link| link.parent.as_deref() == Some(BASE))
                .for_each(|link| link.parent = Some(vehicle.to_owned()));
        }
        let ends = ends(tree, parts, tips, notes)?;
        let on_base = if mount.is_some() { BASE } else { VEHICLE };
        for (i, End { name, part, frame }) in ends.iter().enumerate() {
            let on = if *part == 0 { on_base } else { names[*part].as_str() };
            let on = (part + 1 != parts.len()).then(|| on.to_owned());
            let end = EndEffectorFrame { on, position: frame.position, rpy: frame.rpy };
            if ends.len() > 1 || !tips.is_empty() {
                arm.end_effectors.insert(name.replace(['.', '[', ']'], "-"), end.clone());
            }
            if i == 0 {
                arm.end_effector = end;
            }
        }
        follow(tree, parts, &mut arm);
        tune(&mut arm, density);
        joints_origins(&arm, origins);
        Ok(arm)
    }
}

/// Key of a link's body below `arm`.
fn body_key(i: usize, name: &str) -> String {
    let plain = name.chars().all(|c| c.is_alphanumeric() || "_-/ ".contains(c));
    if plain { format!(".links[{name}].body") } else { format!(".links[{i}].body") }
}

/// Names of the parts in the scene: of their first links, unless a body of the scene is called so; the root is the base.
fn names(tree: &Tree, parts: &[Part]) -> Vec<String> {
    let mut names = vec![BASE.to_owned()];
    for part in &parts[1..] {
        let mut name = tree.robot.links[part.links[0].0].name.clone();
        while name == VEHICLE || names.contains(&name) {
            name.push_str("-link");
        }
        names.push(name);
    }
    names
}

/// Starts of joints that follow others, where these start.
fn follow(tree: &Tree, parts: &[Part], arm: &mut Arm) {
    for i in 1..parts.len() {
        let Some(mimic) = parts[i].joint.and_then(|j| tree.robot.joints[j].mimic.as_ref()) else { continue };
        let other = tree.joints.get(mimic.joint.as_str()).copied();
        let Some(other) = (1..parts.len()).find(|k| parts[*k].joint == other) else { continue };
        let home = mimic.multiplier * arm.links[other - 1].joint.home + mimic.offset;
        let joint = &mut arm.links[i - 1].joint;
        joint.home = joint.limits.as_ref().map_or(home, |limits| home.clamp(limits.lower, limits.upper));
    }
}

fn note(joint: &RobotJoint, notes: &mut Vec<String>) {
    let name = &joint.name;
    if let Some(mimic) = &joint.mimic {
        let (factor, other, offset) = (mimic.multiplier, &mimic.joint, mimic.offset);
        let law =
            format!("{factor} times {other}{}", if offset == 0.0 { String::new() } else { format!(" plus {offset}") });
        notes.push(format!(
            "{name}: follows {law} in the file; here it is a joint of its own: command both, or --lock {name}"
        ));
    }
    if joint.effort.is_none() {
        notes.push(format!("{name}: no effort given, so its torque is unlimited"));
    }
}

fn taken_over(joint: &RobotJoint, frame: Frame) -> Joint {
    let limits = joint.limits.map(|[lower, upper]| JointLimits { lower, upper, stiffness: 0.0, damping: 0.0 });
    let limits = limits.filter(|_| joint.kind != RobotJointKind::Continuous);
    let home = limits.as_ref().filter(|l| !(l.lower < 0.0 && 0.0 < l.upper)).map_or(0.0, |l| (l.lower + l.upper) / 2.0);
    Joint {
        kind: if joint.kind == RobotJointKind::Prismatic { JointKind::Prismatic } else { JointKind::Revolute },
        frame,
        axis: joint.axis,
        rotor_inertia: joint.armature,
        prescribed: false,
        friction: Friction { viscous: joint.damping, coulomb: joint.friction, ..Friction::default() },
        spring: (joint.stiffness > 0.0).then_some(JointSpring { stiffness: joint.stiffness, rest: joint.spring_rest }),
        detent: None,
        limits,
        effort: joint.effort,
        speed: joint.speed,
        servo: None,
        actuator: None,
        home,
    }
}

/// Provenance of the joints' numbers.
fn joints_origins(arm: &Arm, origins: &mut Vec<(String, String)>) {
    if arm.links.is_empty() {
        return;
    }
    let mut say = |key: &str, text: String| origins.push((format!(".links.joint.{key}"), text));
    let [turn, slide] = SAG;
    let servo = format!(
        "derived: damping ratio 1 on what the joint carries at home, rigid and added; natural frequency {BANDWIDTH} rad/s, or higher so that its weight in water turns the joint by at most {turn} rad, or moves it by {slide} m"
    );
    say("servo", servo);
    say("home", "assumed: 0, or the middle of the range".to_owned());
    say("friction.coulomb_speed", "assumed: default".to_owned());
    if arm.links.iter().any(|link| link.joint.limits.is_some()) {
        say("limits.stiffness", format!("derived: {STOP} times the servo's"));
        say("limits.damping", "assumed: as many N m s/rad2 as the stiffness has N m/rad".to_owned());
    }
}
