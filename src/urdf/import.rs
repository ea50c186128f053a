//! Import of an arm from a URDF file onto the vehicle of a scene.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Matrix3, Rotation3, Vector3};
use toml::Value;

use super::chain::Chain;
use super::element::Result;
use super::file::{JointType, Robot, UrdfJoint};
use super::links::Part;
use crate::description::{
    Arm, BASE, Body, EndEffectorFrame, Frame, Friction, Joint, JointKind, JointLimits, JointServo, Link, MAX_JOINTS,
    Mount, Scene, VEHICLE, read_file,
};
use crate::estimate::{Estimate, Outline};

/// Natural frequency of the servos, rad/s.
const BANDWIDTH: f64 = 3.0;
/// Ratio of the stiffness of end stops to the stiffness of servos.
const STOP: f64 = 5.0;
/// Speed, m/s, and rate, rad/s, at which linear damping equals quadratic damping, as in the shipped scenes.
const SPEED: [f64; 2] = [0.1, 0.5];

/// Settings of an import.
#[derive(Debug, Clone)]
pub struct Import<'a> {
    /// Scene with water and vehicle; its own arm and payload are dropped.
    pub vehicle: &'a Scene,
    /// Frame of the base link in the vehicle frame.
    pub mount: Frame,
    /// First link of the chain; default: the only link without parent.
    pub base: Option<&'a str>,
    /// Last link of the chain; its frame is the frame of the end effector; default: the only end.
    pub tip: Option<&'a str>,
}

/// An imported scene, with notes for the user.
#[derive(Debug, Clone)]
pub struct Imported {
    /// Scene with vehicle and arm.
    pub scene: Scene,
    /// Notes on merged links, meshes and estimates, one sentence each.
    pub notes: Vec<String>,
}

impl Import<'_> {
    /// Reads a URDF file.
    ///
    /// # Errors
    /// A file that cannot be read, or as [`Import::from_text`].
    pub fn from_file(&self, path: impl AsRef<Path>) -> Result<Imported> {
        let (text, source) = read_file(path.as_ref())?;
        self.from_text(&text, &source)
    }

    /// Reads URDF text; `source` (a file's name) appears in errors.
    ///
    /// # Errors
    /// `DescriptionError::Syntax`, `DescriptionError::Urdf` with line and element, or `DescriptionError::Value` with the
    /// key of an invalid value of the scene.
    pub fn from_text(&self, text: &str, source: &str) -> Result<Imported> {
        let robot = Robot::read(text, source)?;
        let chain = robot.chain(self.base, self.tip)?;
        let mut notes = robot.notes.clone();
        let mut scene = self.bare(&robot);
        let cited = format!("cited: {}", file_name(source));
        let say = |scene: &mut Scene, key: String, text: String| scene.provenance.0.insert(key, text);
        say(&mut scene, "arm".into(), cited);
        say(&mut scene, "arm.mount.frame".into(), "assumed: as chosen on import".into());

        let (part, mut next, mut tip) = robot.part(&chain, chain.base)?;
        let mut arm = Arm {
            name: if robot.name.is_empty() { "arm".to_owned() } else { robot.name.clone() },
            mount: Mount { frame: self.mount.clone(), joint: None },
            base: None,
            links: Vec::new(),
            end_effector: EndEffectorFrame::default(),
            end_effectors: BTreeMap::new(),
        };
        let mut formulas = Vec::new();
        notes.extend(part.notes.iter().cloned());
        if part.mass > 0.0 {
            let (body, how) = body(&part, scene.water.density);
            arm.base = Some(body);
            formulas.push(("arm.base".to_owned(), how));
        } else if !part.shapes.is_empty() {
            notes.push(format!("{}: no mass, so its shape is ignored", robot.links[chain.base].name));
        }
        while let Some((index, frame)) = next {
            let joint = &robot.joints[index];
            let part;
            (part, next, tip) = robot.part(&chain, joint.child)?;
            notes.extend(part.notes.iter().cloned());
            let name = match robot.links[joint.child].name.as_str() {
                name @ (VEHICLE | BASE) => format!("{name}-link"),
                name => name.to_owned(),
            };
            if part.mass <= 0.0 {
                let problem = "has no mass (<inertial>), which a link on a moving joint needs";
                return robot.fault(joint.line, &format!("link \"{name}\""), problem);
            }
            if part.inertia.symmetric_eigenvalues().min() <= 0.0 {
                let problem = "has no moments of inertia, which a link on a moving joint needs";
                return robot.fault(joint.line, &format!("link \"{name}\""), problem);
            }
            let (body, how) = body(&part, scene.water.density);
            formulas.push((format!("arm.links[{name}].body"), how));
            arm.links.push(Link { name, parent: None, joint: taken_over(joint, frame), body: Some(body) });
        }
        if arm.links.len() > MAX_JOINTS {
            let problem =
                format!("{} moving joints from base to tip, but at most {MAX_JOINTS} are allowed", arm.links.len());
            return robot.fault(1, "<robot>", problem);
        }
        arm.end_effector = tip.unwrap_or_default().into();
        tune(&mut arm.links);
        for (key, how) in formulas {
            for (below, formula) in how {
                say(&mut scene, format!("{key}.{below}"), format!("derived: {formula}"));
            }
        }
        joints_provenance(&arm, &robot, &chain, &mut scene, &mut notes);
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
        let tree = Value::try_from(&scene).expect("a scene is plain data");
        Ok(Imported { scene: Scene::from_value(tree, source)?, notes })
    }

    /// The scene of the vehicle, without arm and payload.
    fn bare(&self, robot: &Robot) -> Scene {
        let mut scene = Scene { arm: None, payload: None, ..self.vehicle.clone() };
        let (vehicle, file) = (&self.vehicle.vehicle.name, file_name(&robot.source));
        scene.name = if robot.name.is_empty() { "imported".to_owned() } else { robot.name.clone() };
        scene.summary = format!(
            "{vehicle} with the arm of {file}. What water does to the arm, its servos and its end stops are ESTIMATES."
        );
        let gone =
            |key: &str| ["arm", "payload"].iter().any(|part| key == *part || key.starts_with(&format!("{part}.")));
        scene.provenance.0.retain(|key, _| !gone(key));
        scene
    }
}

fn file_name(source: &str) -> String {
    Path::new(source).file_name().map_or_else(|| source.to_owned(), |name| name.to_string_lossy().into_owned())
}

fn taken_over(joint: &UrdfJoint, frame: Frame) -> Joint {
    let limits = joint.limits.map(|[lower, upper]| JointLimits { lower, upper, stiffness: 0.0, damping: 0.0 });
    let home = limits.as_ref().filter(|l| !(l.lower < 0.0 && 0.0 < l.upper)).map_or(0.0, |l| (l.lower + l.upper) / 2.0);
    Joint {
        kind: if joint.kind == JointType::Prismatic { JointKind::Prismatic } else { JointKind::Revolute },
        frame,
        axis: joint.axis,
        rotor_inertia: joint.armature,
        prescribed: false,
        friction: Friction { viscous: joint.damping, coulomb: joint.friction, ..Friction::default() },
        limits,
        effort: joint.effort,
        speed: joint.speed,
        servo: None,
        actuator: None,
        home,
    }
}

/// Body of a part, with the formulas of its estimates.
fn body(part: &Part, density: f64) -> (Body, Vec<(&'static str, String)>) {
    let rigid = Body { center_of_mass: part.center_of_mass, inertia: part.inertia, ..Body::point(part.mass) };
    if part.shapes.is_empty() || density <= 0.0 {
        return (rigid, Vec::new());
    }
    let Estimate { body, formulas } = Outline { density, speed: SPEED, shapes: part.shapes.clone() }.estimate();
    let body = Body { mass: rigid.mass, center_of_mass: rigid.center_of_mass, inertia: rigid.inertia, ..body };
    let own = ["mass", "center_of_mass", "inertia"];
    (body, formulas.into_iter().filter(|(key, _)| !own.contains(key)).collect())
}

/// Sets servos, and the stiffness of end stops, by the inertia that each joint carries at home.
fn tune(links: &mut [Link]) {
    for i in 0..links.len() {
        let inertia = carried(&links[i..]);
        let round = |x: f64| format!("{x:.2e}").parse().expect("it was written as a number");
        let servo = JointServo { kp: round(inertia * BANDWIDTH * BANDWIDTH), kd: round(2.0 * inertia * BANDWIDTH) };
        let joint = &mut links[i].joint;
        if let Some(limits) = &mut joint.limits {
            limits.stiffness = round(STOP * servo.kp);
            limits.damping = limits.stiffness;
        }
        joint.servo = Some(servo);
    }
}

/// Rigid and added inertia of all links about the first joint at home, and the inertia of its rotor, kg m2 or kg.
fn carried(links: &[Link]) -> f64 {
    let axis = links[0].joint.axis.normalize();
    let (mut v, mut w) = if links[0].joint.slides() { (axis, Vector3::zeros()) } else { (Vector3::zeros(), axis) };
    let into = |(v, w): (Vector3<f64>, Vector3<f64>), r: Matrix3<f64>, p: Vector3<f64>| {
        (r.transpose() * (v + w.cross(&p)), r.transpose() * w)
    };
    let mut sum = links[0].joint.rotor_inertia;
    for (i, link) in links.iter().enumerate() {
        if i > 0 {
            let joint = &link.joint;
            (v, w) = into((v, w), joint.frame.rotation(), joint.frame.position);
            let axis = joint.axis.normalize();
            (v, w) = if joint.slides() {
                into((v, w), Matrix3::identity(), axis * joint.home)
            } else {
                let turn = Rotation3::from_axis_angle(&nalgebra::Unit::new_unchecked(axis), joint.home);
                into((v, w), turn.into_inner(), Vector3::zeros())
            };
        }
        let Some(body) = &link.body else { continue };
        let at_com = v + w.cross(&body.center_of_mass);
        sum += body.mass * at_com.norm_squared() + w.dot(&(body.inertia_about_com() * w));
        let (hv, hw) = into((v, w), body.hydrodynamic_frame.rotation(), body.hydrodynamic_frame.position);
        let twist = nalgebra::Vector6::new(hv.x, hv.y, hv.z, hw.x, hw.y, hw.z);
        sum += twist.dot(&(body.added_mass * twist));
    }
    sum
}

/// Provenance of the joints' numbers.
fn joints_provenance(arm: &Arm, robot: &Robot, chain: &Chain, scene: &mut Scene, notes: &mut Vec<String>) {
    if arm.links.is_empty() {
        return;
    }
    let mut say = |key: &str, text: String| scene.provenance.0.insert(format!("arm.links.joint.{key}"), text);
    let servo = format!(
        "derived: natural frequency {BANDWIDTH} rad/s and damping ratio 1 on what the joint carries at home, rigid and added"
    );
    say("servo", servo);
    say("home", "assumed: 0, or the middle of the range".to_owned());
    say("friction.coulomb_speed", "assumed: default".to_owned());
    if arm.links.iter().any(|link| link.joint.limits.is_some()) {
        say("limits.stiffness", format!("derived: {STOP} times the servo's"));
        say("limits.damping", "assumed: as many N m s/rad2 as the stiffness has N m/rad".to_owned());
    }
    for joint in chain.joints.iter().map(|i| &robot.joints[*i]).filter(|joint| joint.kind != JointType::Fixed) {
        if joint.effort.is_none() {
            notes.push(format!("{}: no effort given, so its torque is unlimited", joint.name));
        }
    }
}
