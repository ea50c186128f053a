//! Scenes of robots.

use std::collections::HashMap;

use toml::Value;

use super::body::{Built, body};
use super::element::Result;
use super::hull;
use super::merge::{Part, Rigid, parts, rigid};
use super::motion::{Choices, Frozen};
use super::outline::{Densities, inertials};
use super::parts::listed;
use super::servo::{STATION, station};
use super::thrusters::{Propulsion, ThrusterSource};
use super::tree::Tree;
use super::{Inertial, Robot};
use crate::description::{Frame, Provenance, Scene, Vehicle, Water};

/// Vehicle under an arm without one, and water of a vehicle whose file states none.
const DEFAULT: &str = "bluerov2-heavy";
/// Vehicle under an arm too heavy for that.
const LARGE: &str = "rexrov";
/// Maximum mass of an arm over the mass of the default vehicle.
const LOAD: f64 = 0.25;

/// Settings that a robot's file cannot state.
#[derive(Debug, Clone, Default)]
pub struct Assembly<'a> {
    /// Scene whose water and vehicle take the place of the file's hull; its own arm and payload are dropped.
    pub vehicle: Option<&'a Scene>,
    /// Thrusters of the vehicle in the file.
    pub thrusters: ThrusterSource<'a>,
    /// Frame of the robot's first link in the frame of that vehicle.
    pub mount: Frame,
    /// First link; default: the only link without parent, or on a floating joint.
    pub base: Option<&'a str>,
    /// End effectors, the default one first: name and link whose frame it has; default: the ends of the tree that are no fingers.
    pub tips: &'a [(String, String)],
    /// Joints to freeze.
    pub lock: &'a [String],
    /// The only joints that move; all if empty.
    pub keep: &'a [String],
    /// Densities of links, kg/m3, by name; no name for all links without mass.
    pub density: &'a Densities,
}

/// An imported scene, with notes for the user.
#[derive(Debug, Clone)]
pub struct Imported {
    /// Scene with vehicle and arms.
    pub scene: Scene,
    /// Notes on parts that were guessed, merged, frozen or left out, one sentence each.
    pub notes: Vec<String>,
}

/// The robot's tree with what moves.
pub struct Moving<'a> {
    pub tree: Tree<'a>,
    pub inertials: Vec<Option<Inertial>>,
    pub parts: Vec<Part>,
    frozen: Frozen,
    /// True if a vehicle takes the place of the file's hull.
    replaced: bool,
    /// Vehicle under an arm without one.
    default: &'static str,
}

impl Assembly<'_> {
    /// Makes the scene of a robot.
    ///
    /// # Errors
    /// `DescriptionError::Robot` with line and part, or `DescriptionError::Value` with the key of an invalid value of the scene.
    pub fn of(&self, robot: &Robot) -> Result<Imported> {
        robot.check()?;
        let mut notes = robot.notes.clone();
        notes.extend(robot.doubts());
        let tree = Tree::new(robot)?;
        let root = tree.root(self.base)?;
        let inertials = inertials(&tree, &tree.order(root), self.density, &mut notes)?;
        let choices = Choices { lock: self.lock, keep: self.keep };
        let frozen = tree.frozen(root, &choices, &inertials, &mut notes)?;
        let parts = parts(&tree, root, &frozen.at);
        let mut moving = Moving { tree, inertials, frozen, parts, replaced: false, default: DEFAULT };
        let scene = match self.hull(&mut moving, root, &mut notes)? {
            true => self.whole(&moving, &mut notes)?,
            false => self.mounted(&moving, &mut notes)?,
        };
        let value = Value::try_from(&scene).expect("a scene is plain data");
        Ok(Imported { scene: Scene::from_value(value, &robot.source)?, notes: by_subject(&notes) })
    }

    /// True if the file's root becomes the vehicle.
    fn hull(&self, moving: &mut Moving, root: usize, notes: &mut Vec<String>) -> Result<bool> {
        let Moving { tree, inertials, frozen, parts, .. } = &mut *moving;
        let masses = |part: &Part| rigid(tree, part, inertials, &mut Vec::new()).unwrap_or_default();
        let masses: Vec<Rigid> = parts.iter().map(masses).collect();
        let name = &tree.robot.links[root].name;
        // Mass alone does not make a hull of the link that the user names as the first one on a vehicle.
        let named = self.vehicle.is_some() && self.base.is_some();
        let reason = hull::reason(tree, parts, frozen, &masses).filter(|reason| !(named && *reason == hull::OUTWEIGHS));
        match (self.vehicle, reason) {
            (Some(_), Some("nothing moves on it")) => {
                notes.push(format!("{name}: nothing moves on it, so it is a body fixed to the vehicle"));
                Ok(false)
            }
            (Some(vehicle), Some(reason)) => {
                let (vehicle, mass) = (&vehicle.vehicle.name, masses[0].mass);
                let heavy = parts[0].links.iter().filter(|(link, _)| inertials[*link].is_some());
                let gone = listed(heavy.map(|(link, _)| tree.robot.links[*link].name.as_str()));
                notes.push(format!(
                    "{name}: the hull of a vehicle, as {reason}; {vehicle} takes its place, and of {gone}: {mass:.4} kg"
                ));
                // The hull goes, with everything fixed to it.
                for (link, _) in &parts[0].links {
                    inertials[*link] = None;
                }
                moving.replaced = true;
                Ok(false)
            }
            (Some(_), None) => Ok(false),
            (None, Some(reason)) => {
                notes.push(format!("{name}: the hull of a vehicle, as {reason}: --vehicle replaces it"));
                if self.mount != Frame::default() {
                    return tree
                        .robot
                        .refuse("has a vehicle of its own, so --mount needs a --vehicle that takes its place");
                }
                let masses = tree.masses_below(&tree.order(root), inertials);
                let first = if self.base.is_none() { hull::first_body(tree, root, &masses) } else { root };
                *parts = super::merge::parts(tree, first, &frozen.at);
                Ok(true)
            }
            (None, None) => {
                let mass: f64 = masses.iter().map(|rigid| rigid.mass).sum();
                let heavy = mass > LOAD * Scene::shipped(DEFAULT)?.vehicle.body.mass;
                moving.default = if heavy { LARGE } else { DEFAULT };
                notes.push(format!(
                    "{name}: the base of an arm of {mass:.4} kg, as the file states no vehicle; mounted on {}: choose another with --vehicle",
                    moving.default
                ));
                Ok(false)
            }
        }
    }

    /// The scene of a robot with a vehicle of its own.
    fn whole(&self, moving: &Moving, notes: &mut Vec<String>) -> Result<Scene> {
        let (tree, robot) = (&moving.tree, moving.tree.robot);
        let default = Scene::shipped(DEFAULT)?.water;
        let stated = robot.fluid_density;
        let density = stated.filter(|density| *density > 0.0).unwrap_or(default.density);
        let water = Water { density, ..default };
        let mut origins = vec![(String::new(), format!("cited: {}", robot.file_name()))];
        let arm =
            (moving.parts.len() > 1).then(|| moving.arm(self.tips, None, density, &mut origins, notes)).transpose()?;
        let built = body(tree, &moving.parts[0], &moving.inertials, (density, true), notes)?;
        let others = arm
            .iter()
            .flat_map(|arm| &arm.links)
            .flat_map(|link| &link.body)
            .fold((0.0, 0.0), |sum, body| (sum.0 + body.mass, sum.1 + body.displaced_volume(&water) * density));
        let displaces = built.displaces;
        let mass = built.body.mass + others.0;
        let displaced = if displaces { others.1 + built.body.displaced_volume(&water) * density } else { mass };
        let gravity = water.gravity.norm();
        let propulsion = Propulsion {
            source: self.thrusters,
            propellers: &moving.frozen.propellers,
            weight: mass * gravity,
            net_weight: (mass - displaced) * gravity,
        };
        let (mut vehicle, of_vehicle) = hull::vehicle(tree, &moving.parts[0], built, &propulsion, notes);
        let mut provenance = Provenance::default();
        provenance.0.insert("water".into(), format!("assumed: the water of {DEFAULT}"));
        if stated.is_some() {
            provenance.0.insert("water.density".into(), format!("cited: {}", robot.file_name()));
        }
        provenance.0.insert("vehicle".into(), format!("cited: {}", robot.file_name()));
        provenance.0.extend(of_vehicle.into_iter().map(|(key, text)| (format!("vehicle.{key}"), text)));
        if !displaces {
            hull::trim(&mut vehicle.body, others, density, &vehicle.name, notes);
            for key in ["volume", "center_of_buoyancy"] {
                let text = "assumed: the robot neither rises nor sinks, and is level at rest";
                provenance.0.insert(format!("vehicle.body.{key}"), text.to_owned());
            }
        }
        vehicle.servo = Some(station(&vehicle, arm.as_ref()));
        let [translation, rotation] = STATION;
        let servo = format!(
            "derived: natural frequency {translation} rad/s (turning {rotation} rad/s) and damping ratio 1 on rigid and added mass"
        );
        provenance.0.insert("vehicle.servo".into(), servo);
        if arm.is_some() {
            provenance.0.extend(origins.into_iter().map(|(key, text)| (format!("arm{key}"), text)));
        }
        let name = if robot.name.is_empty() { "imported".to_owned() } else { robot.name.clone() };
        let assumed = provenance.0.get("vehicle.thrusters").map_or("", |_| " Its thrusters are ASSUMED.");
        let summary = format!(
            "The robot of {}. Numbers that the file does not state are ESTIMATES: see the provenance.{assumed}",
            robot.file_name()
        );
        Ok(Scene {
            name,
            summary,
            water,
            vehicle,
            arm,
            payload: None,
            contact: None,
            fixtures: Vec::new(),
            integration: None,
            provenance,
        })
    }

    /// The scene of an arm on the vehicle of another scene.
    fn mounted(&self, moving: &Moving, notes: &mut Vec<String>) -> Result<Scene> {
        let robot = moving.tree.robot;
        if !matches!(self.thrusters, ThrusterSource::FileOrAssumed) {
            return robot.refuse("is mounted on a vehicle with thrusters of its own, so --thrusters has no use");
        }
        let shipped = Scene::shipped(moving.default)?;
        let mut scene = self.vehicle.unwrap_or(&shipped).bare_vehicle();
        let (Vehicle { name: vehicle, .. }, file) = (&scene.vehicle, robot.file_name());
        scene.summary = format!(
            "{vehicle} with the arm of {file}. What water does to the arm, its servos and its end stops are ESTIMATES."
        );
        scene.name = if robot.name.is_empty() { "imported".to_owned() } else { robot.name.clone() };
        let mut origins = vec![
            (String::new(), format!("cited: {file}")),
            (".mount.frame".to_owned(), "assumed: as chosen on import".to_owned()),
        ];
        let density = scene.water.density;
        let mut arm = moving.arm(self.tips, Some(&self.mount), density, &mut origins, notes)?;
        let base = &moving.parts[0];
        let Built { body, origins: of_base, .. } =
            body(&moving.tree, base, &moving.inertials, (density, false), notes)?;
        if !moving.replaced {
            arm.meshes = base.mesh_files(&moving.tree);
        }
        if body.mass > 0.0 {
            arm.base = Some(body);
            origins.extend(of_base.into_iter().map(|(key, text)| (format!(".base.{key}"), text)));
        }
        let (mass, volume) = arm
            .base
            .iter()
            .chain(arm.links.iter().flat_map(|link| &link.body))
            .fold((0.0, 0.0), |sum, body| (sum.0 + body.mass, sum.1 + body.displaced_volume(&scene.water)));
        notes.push(format!(
            "the arm weighs {mass:.4} kg and displaces {:.4} kg of water: the vehicle may need foam or ballast for the difference",
            volume * scene.water.density
        ));
        scene.arm = Some(arm);
        scene.provenance.0.extend(origins.into_iter().map(|(key, text)| (format!("arm{key}"), text)));
        Ok(scene)
    }
}

/// Notes, joined where they begin with the same link or joint: `arm: merged into foot; no geometry`.
fn by_subject(notes: &[String]) -> Vec<String> {
    let (mut joined, mut places): (Vec<String>, HashMap<&str, usize>) = (Vec::new(), HashMap::new());
    for note in notes {
        match note.split_once(": ") {
            Some((subject, text)) => match places.get(subject) {
                Some(place) => joined[*place] += &format!("; {text}"),
                None => {
                    places.insert(subject, joined.len());
                    joined.push(note.clone());
                }
            },
            None => joined.push(note.clone()),
        }
    }
    joined
}
