//! Joints that move, and joints that are frozen, each with its reason.

use super::element::Result;
use super::ends::{children, is_finger};
use super::merge::parts;
use super::parts::listed;
use super::tree::Tree;
use super::{Inertial, RobotJoint, RobotJointKind};
use crate::description::MAX_JOINTS;

/// Mass of a propeller over the mass of the body that carries it, beyond which a wheel is no propeller.
const ROTOR: f64 = 0.05;
/// Number of light ends that turn freely on the hull from which they are the propellers of a vehicle whose file states no thrusters.
const SEVERAL: usize = 4;
/// Parts of the names of propellers, further words in these names, and words in the names of fins.
const PROPELLERS: [&str; 2] = ["thruster", "propeller"];
const ROTORS: [&str; 3] = ["prop", "rotor", "screw"];
const FINS: [&str; 4] = ["fin", "fins", "rudder", "elevator"];

/// Coordinates of the joints that do not move; none where a joint does.
pub struct Frozen {
    /// Per joint of the robot.
    pub at: Vec<Option<f64>>,
    /// True if propellers turn on the root.
    pub rotors: bool,
    /// Joints of propellers that the file calls so without stating a thruster.
    pub propellers: Vec<usize>,
}

/// Choices of the user, by names of joints.
pub struct Choices<'a> {
    pub lock: &'a [String],
    pub keep: &'a [String],
}

impl Choices<'_> {
    fn keeps(&self, name: &str) -> bool {
        self.keep.iter().any(|kept| kept == name)
    }
}

/// True if the name has one of these words, as in `fin_3_joint`, whatever its case.
pub fn says(name: &str, words: &[&str]) -> bool {
    let name = name.to_lowercase();
    let mut parts = name.split(|c: char| !c.is_alphabetic());
    parts.any(|part| words.contains(&part) || part.strip_suffix('s').is_some_and(|part| words.contains(&part)))
}

/// True if the name says thruster or propeller.
pub fn is_propeller(name: &str) -> bool {
    let name = name.to_lowercase();
    PROPELLERS.iter().any(|word| name.contains(word))
}

impl<'a> Tree<'a> {
    /// Freezes joints: fixed, locked by limits or by the user, propellers, fins, joints without mass, and fingers where too many
    /// joints move.
    ///
    /// # Errors
    /// Unknown joints, or too many that move.
    pub fn frozen(
        &self,
        root: usize,
        choices: &Choices,
        inertials: &[Option<Inertial>],
        notes: &mut Vec<String>,
    ) -> Result<Frozen> {
        let joints = &self.robot.joints;
        for name in choices.lock.iter().chain(choices.keep) {
            if !self.joints.contains_key(name.as_str()) {
                let moving: Vec<_> = joints.iter().filter(|joint| joint.moves()).map(|j| j.name.as_str()).collect();
                let known = listed(moving);
                return self
                    .robot
                    .refuse(format!("has no joint \"{name}\" to lock or keep; its moving joints are {known}"));
            }
        }
        let order = self.order(root);
        let mut frozen = Frozen { at: vec![None; joints.len()], rotors: false, propellers: Vec::new() };
        let below: Vec<usize> = order.iter().flat_map(|link| self.below[*link].iter().copied()).collect();
        for &j in &below {
            self.freeze_stated(j, choices, &mut frozen, notes);
        }
        self.follow_frozen(&below, &mut frozen, notes);
        let masses = self.masses_below(&order, inertials);
        self.freeze_rotors(root, &masses, choices, &mut frozen, notes);
        self.freeze_massless(&below, &masses, choices, &mut frozen, notes)?;
        self.freeze_fingers(root, choices, &mut frozen, notes);
        let moving: Vec<_> =
            below.iter().filter(|j| frozen.at[**j].is_none()).map(|j| joints[*j].name.as_str()).collect();
        if moving.len() > MAX_JOINTS {
            let problem = format!(
                "has {} moving joints, but at most {MAX_JOINTS} are allowed: --lock some of them, or name the ones to --keep: {}",
                moving.len(),
                listed(moving.iter().copied())
            );
            return self.robot.refuse(problem);
        }
        Ok(frozen)
    }

    /// Coordinate of a joint that does not move: 0, or the nearest within its limits.
    fn rest(&self, joint: usize) -> f64 {
        self.robot.joints[joint].limits.map_or(0.0, |[lower, upper]| 0.0f64.clamp(lower, upper))
    }

    fn freeze_stated(&self, j: usize, choices: &Choices, frozen: &mut Frozen, notes: &mut Vec<String>) {
        let (joint, rest) = (&self.robot.joints[j], self.rest(j));
        let name = &joint.name;
        if !joint.moves() {
            frozen.at[j] = Some(0.0);
        } else if joint.limits.is_some_and(|[lower, upper]| lower == upper) {
            frozen.at[j] = Some(rest);
            notes.push(format!("{name}: its limits are equal: locked at {rest}"));
        } else if choices.lock.contains(name) {
            frozen.at[j] = Some(rest);
            notes.push(format!("{name}: locked at {rest}, as chosen"));
        } else if !choices.keep.is_empty() && !choices.keeps(name) {
            frozen.at[j] = Some(rest);
            notes.push(format!("{name}: not among the joints to keep: locked at {rest}"));
        } else if self.carries_thruster(j) && !choices.keeps(name) {
            (frozen.at[j], frozen.rotors) = (Some(rest), true);
            notes.push(format!("{name}: turns the propeller of a thruster, so it is no joint of an arm"));
        } else if self.robot.fins.iter().any(|fin| fin.joint.as_ref() == Some(name)) && !choices.keeps(name) {
            frozen.at[j] = Some(rest);
            notes.push(format!("{name}: deflects a fin, so it is no joint of an arm"));
        }
    }

    fn carries_thruster(&self, j: usize) -> bool {
        let joint = &self.robot.joints[j];
        self.robot.thrusters.iter().any(|thruster| {
            thruster.joint.as_ref() == Some(&joint.name)
                || (thruster.link.as_ref() == Some(&joint.child) && joint.kind == RobotJointKind::Continuous)
        })
    }

    /// Freezes joints that follow a frozen one.
    fn follow_frozen(&self, below: &[usize], frozen: &mut Frozen, notes: &mut Vec<String>) {
        for &j in below.iter().filter(|j| self.robot.joints[**j].moves()) {
            let joint = &self.robot.joints[j];
            let Some(mimic) = joint.mimic.as_ref().filter(|_| frozen.at[j].is_none()) else { continue };
            let Some(&other) = self.joints.get(mimic.joint.as_str()) else {
                notes.push(format!(
                    "{}: follows the unknown joint {}, so it is a joint of its own",
                    joint.name, mimic.joint
                ));
                continue;
            };
            if let Some(q) = frozen.at[other] {
                let at = mimic.multiplier * q + mimic.offset;
                frozen.at[j] = Some(at);
                notes.push(format!("{}: follows {}, which does not move: locked at {at}", joint.name, mimic.joint));
            }
        }
    }

    /// Mass of each link and all below it, kg.
    pub fn masses_below(&self, order: &[usize], inertials: &[Option<Inertial>]) -> Vec<f64> {
        let mut masses: Vec<f64> = inertials.iter().map(|own| own.as_ref().map_or(0.0, |own| own.mass)).collect();
        for &link in order[1..].iter().rev() {
            if let Some(joint) = self.above[link] {
                masses[self.parent[joint]] += masses[link];
            }
        }
        masses
    }

    fn freeze_massless(
        &self,
        below: &[usize],
        masses: &[f64],
        choices: &Choices,
        frozen: &mut Frozen,
        notes: &mut Vec<String>,
    ) -> Result<()> {
        let moving: Vec<usize> = below.iter().copied().filter(|j| frozen.at[*j].is_none()).collect();
        let (with, without): (Vec<usize>, Vec<usize>) = moving.iter().partition(|j| masses[self.child[**j]] > 0.0);
        let kept = without.iter().find(|j| choices.keeps(&self.robot.joints[**j].name));
        if let Some(&j) = kept.or(without.first().filter(|_| with.is_empty())) {
            let joint = &self.robot.joints[j];
            let problem = format!(
                "has no mass (<inertial>), which a link on a moving joint needs: state a --density, or --lock {}",
                joint.name
            );
            return self.robot.fault(joint.line, &format!("link \"{}\"", joint.child), problem);
        }
        for j in without {
            frozen.at[j] = Some(self.rest(j));
            notes.push(format!("{}: nothing on it has mass: locked at {}", self.robot.joints[j].name, self.rest(j)));
        }
        Ok(())
    }

    /// Freezes propellers and fins: ends of the tree that turn on the root and are light, or are called so.
    fn freeze_rotors(
        &self,
        root: usize,
        masses: &[f64],
        choices: &Choices,
        frozen: &mut Frozen,
        notes: &mut Vec<String>,
    ) {
        let parts = parts(self, root, &frozen.at);
        let carried = children(&parts);
        let hull = masses[root] - carried[0].iter().map(|i| masses[parts[*i].links[0].0]).sum::<f64>();
        let ends = carried[0].iter().filter(|i| carried[**i].is_empty()).filter_map(|i| {
            let j = parts[*i].joint?;
            let (joint, mass) = (&self.robot.joints[j], masses[parts[*i].links[0].0]);
            let free = !choices.keeps(&joint.name) && joint.mimic.is_none();
            free.then(|| (j, joint, joint.kind == RobotJointKind::Continuous, mass > 0.0 && mass <= ROTOR * hull))
        });
        let ends: Vec<_> = ends.collect();
        // Where the file states thrusters, it states all of them.
        let unstated = self.robot.thrusters.is_empty();
        let called = |joint: &RobotJoint| {
            [&joint.name, &joint.child].into_iter().any(|name| is_propeller(name) || says(name, &ROTORS))
        };
        let alike = ends.iter().filter(|(.., turns, light)| *turns && *light).count();
        let several = unstated && alike >= SEVERAL && !ends.iter().any(|(_, joint, turns, _)| *turns && called(joint));
        for (j, joint, turns, light) in ends {
            let either = |is: &dyn Fn(&str) -> bool| is(&joint.name) || is(&joint.child);
            let what = if turns && unstated && called(joint) {
                frozen.rotors = true;
                frozen.propellers.push(j);
                "a propeller, by its name: a thruster along its axis"
            } else if turns && light && several {
                frozen.rotors = true;
                frozen.propellers.push(j);
                "a propeller, as several light ends of the hull turn freely: a thruster along its axis"
            } else if turns && (light || either(&is_propeller)) {
                frozen.rotors = true;
                "a propeller, as it turns freely: locked at 0, without a thruster, as the file states none for it"
            } else if light && either(&|name| says(name, &FINS)) {
                "a fin: locked at 0, and its lift is not read"
            } else {
                continue;
            };
            frozen.at[j] = Some(self.rest(j));
            notes.push(format!("{}: taken for {what} (--keep makes it a joint)", joint.name));
        }
    }

    /// Freezes fingers where more joints move than there can be, first the ones that follow others.
    fn freeze_fingers(&self, root: usize, choices: &Choices, frozen: &mut Frozen, notes: &mut Vec<String>) {
        for followers in [true, false] {
            let parts = parts(self, root, &frozen.at);
            if parts.len() - 1 <= MAX_JOINTS {
                return;
            }
            let fingers = is_finger(self, &parts);
            for (part, _) in parts.iter().zip(fingers).filter(|(_, finger)| *finger) {
                let Some(j) = part.joint else { continue };
                let joint = &self.robot.joints[j];
                if choices.keeps(&joint.name) || (followers && joint.mimic.is_none()) {
                    continue;
                }
                frozen.at[j] = Some(self.rest(j));
                let at = self.rest(j);
                notes.push(format!(
                    "{}: a finger's joint, locked at {at}, as at most {MAX_JOINTS} joints move",
                    joint.name
                ));
            }
        }
    }
}
