//! Warnings about a scene that can exist but is probably not intended: slips of units, signs and keys.

use std::fmt;

use super::{Body, JointKind, JointLimits, Parent, Scene, Thruster, path};

/// Difference of mass and displaced mass over mass, beyond which a vehicle counts as out of trim.
const OUT_OF_TRIM: f64 = 0.1;
/// Mass over displaced volume outside of which a body is implausible, kg/m3.
const DENSITIES: [f64; 2] = [100.0, 20_000.0];
/// Displaced mass over mass beyond which an arm is implausible.
const BUOYANT: f64 = 2.0;
/// Angle beyond which one is probably in degrees: of a frame and of a joint's limit, rad.
const ANGLES: [f64; 2] = [std::f64::consts::TAU, 3.0 * std::f64::consts::TAU];
/// Distance below which two thrusters are at the same place, m, and deviation of parallel axes.
const SAME: f64 = 1e-3;
/// Relative deviation of a thruster's limits from its bench table, beyond which they are doubted.
const LIMITS: f64 = 0.05;
/// Added mass over displaced mass, beyond which it is implausible.
const FLAT: f64 = 50.0;
/// Distance of a link's centre of mass behind its joint over the distance to the next joint, beyond which it is implausible.
const BEHIND: f64 = 0.3;
/// Ratio of a slender link's minimum moment of inertia to the next one.
const SLENDER: f64 = 0.3;
/// Angle between a slender link and the way to the next joint, beyond which it is implausible, rad.
const OFF_AXIS: f64 = 0.8;
/// Names of the axes of a body.
const AXES: [&str; 6] = ["surge", "sway", "heave", "roll", "pitch", "yaw"];

/// Warning about a valid scene.
#[derive(Debug, Clone, PartialEq)]
pub enum SceneWarning {
    /// Quadratic damping that adds energy to the body at some twist. `[HC eq. 22]`
    DampingAddsEnergy {
        /// Path of the matrix.
        key: String,
        /// Relative twist `[v; omega]` in the hydrodynamic frame, m/s and rad/s.
        twist: [f64; 6],
        /// Power put into the body there, W.
        power: f64,
    },
    /// Implausible value.
    Implausible {
        /// Path of the value.
        key: String,
        /// Reason.
        text: String,
    },
}

impl fmt::Display for SceneWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::DampingAddsEnergy { key, twist, power } => {
                write!(f, "{key}: quadratic damping puts {power:.3e} W into the body at the relative twist {twist:?}")
            }
            Self::Implausible { key, text } => write!(f, "{key}: {text}"),
        }
    }
}

pub fn implausible(key: impl Into<String>, text: String) -> SceneWarning {
    SceneWarning::Implausible { key: key.into(), text }
}

impl Scene {
    /// Mass of all bodies of the robot and mass of the displaced water, kg.
    pub fn masses(&self) -> (f64, f64) {
        let robot = self.bodies().filter(|(key, _)| !key.starts_with("fixtures"));
        robot.fold((0.0, 0.0), |(mass, water), (_, body)| {
            (mass + body.mass, water + self.water.density * body.displaced_volume(&self.water))
        })
    }

    /// Plausibility warnings of a scene that passed [`Scene::check`].
    pub fn lint(&self) -> Vec<SceneWarning> {
        let mut warnings = Vec::new();
        if self.water.density > 0.0 {
            self.lint_trim(&mut warnings);
            for (key, body) in self.bodies() {
                self.lint_body(&key, body, &mut warnings);
            }
            self.lint_arm_volume(&mut warnings);
        }
        self.lint_arm(&mut warnings);
        self.lint_angles(&mut warnings);
        self.lint_thrusters(&mut warnings);
        self.vehicle.lint_terms(&mut warnings);
        self.lint_contact(&mut warnings);
        warnings
    }

    /// Angles that are probably in degrees.
    fn lint_angles(&self, warnings: &mut Vec<SceneWarning>) {
        let [frame, limit] = ANGLES;
        let mut doubt = |key: String, angle: f64, maximum: f64| {
            if angle.abs() > maximum * (1.0 + 1e-6) {
                warnings
                    .push(implausible(key, format!("{angle} rad are {:.1} turns: in degrees?", angle.abs() / frame)));
            }
        };
        let tree = self.to_tree();
        for (key, angle) in path::numbers(&tree).into_iter().filter(|(key, _)| key.contains(".rpy[")) {
            doubt(key, angle, frame);
        }
        for (joint, key) in
            self.coordinates().zip(self.coordinate_keys()).filter(|(joint, _)| joint.kind == JointKind::Revolute)
        {
            doubt(format!("{key}.home"), joint.home, limit);
            if let Some(JointLimits { lower, upper, .. }) = &joint.limits {
                doubt(format!("{key}.limits.lower"), *lower, limit);
                doubt(format!("{key}.limits.upper"), *upper, limit);
            }
        }
    }

    /// An arm that floats like a balloon: volumes of shapes in wrong units, or of dummy moments of inertia.
    fn lint_arm_volume(&self, warnings: &mut Vec<SceneWarning>) {
        let Some(arm) = &self.arm else { return };
        let bodies = || arm.base.iter().chain(arm.links.iter().flat_map(|link| &link.body));
        let mass: f64 = bodies().map(|body| body.mass).sum();
        let water: f64 = bodies().map(|body| self.water.density * body.displaced_volume(&self.water)).sum();
        if mass > 0.0 && water > BUOYANT * mass {
            let text = format!("all bodies of the arm weigh {mass:.4} kg but displace {water:.4} kg of water");
            warnings.push(implausible("arm", text));
        }
    }

    /// Links whose mass does not lie on the way to the next joint: mostly given in other axes than the joint's.
    fn lint_arm(&self, warnings: &mut Vec<SceneWarning>) {
        let Some(arm) = &self.arm else { return };
        let end_effectors: Vec<_> = std::iter::once(&arm.end_effector).chain(arm.end_effectors.values()).collect();
        for (i, link) in arm.links.iter().enumerate() {
            let this = Some(Parent::Link(i));
            let on_it = (i + 1..arm.links.len()).find(|&k| arm.parent(k) == this);
            let next = match on_it {
                Some(k) => arm.links[k].joint.frame.position,
                None => match end_effectors.iter().find(|of| arm.carrier(of) == this) {
                    Some(end_effector) => end_effector.position,
                    None => continue,
                },
            };
            let Some(body) = &link.body else { continue };
            let length = next.norm();
            if length == 0.0 || body.mass == 0.0 {
                continue;
            }
            let way = next / length;
            let key = |field: &str| format!("arm.links[{i}].body.{field} ({})", link.name);
            let along = body.center_of_mass.dot(&way);
            if along < -BEHIND * length {
                let text =
                    format!("lies {:.4} m behind the joint, as seen from the next one: given in other axes?", -along);
                warnings.push(implausible(key("center_of_mass"), text));
            }
            let eigen = body.inertia_about_com().symmetric_eigen();
            let (minimum, smallest) = eigen.eigenvalues.argmin();
            let middle = eigen.eigenvalues.sum() - smallest - eigen.eigenvalues.max();
            // Length of a uniform rod with this moment of inertia.
            let rod = (12.0 * middle / body.mass).sqrt();
            let angle = eigen.eigenvectors.column(minimum).dot(&way).abs().min(1.0).acos();
            if smallest < SLENDER * middle && length > 0.5 * rod && angle > OFF_AXIS {
                let degrees = angle.to_degrees();
                let text =
                    format!("has its long axis {degrees:.0} degrees off the way to the next joint: in other axes?");
                warnings.push(implausible(key("inertia"), text));
            }
        }
    }

    fn lint_trim(&self, warnings: &mut Vec<SceneWarning>) {
        let gravity = self.water.gravity.norm();
        if self.vehicle.fixed || gravity == 0.0 {
            return;
        }
        let (mass, water) = self.masses();
        if (mass - water).abs() > OUT_OF_TRIM * mass {
            let force = (mass - water).abs() * gravity;
            let way = if mass > water { "sinks" } else { "rises" };
            let text = format!(
                "all bodies weigh {mass:.4} kg but displace {water:.4} kg of water: the scene {way} with {force:.4} N"
            );
            warnings.push(implausible("vehicle.body.volume", text));
        }
        let body = &self.vehicle.body;
        let lever = (body.center_of_mass - body.center_of_buoyancy).dot(&self.water.gravity) / gravity;
        if body.displaced_volume(&self.water) > 0.0 && lever < -1e-9 {
            let text = format!("is {:.4} m below the centre of mass: the vehicle capsizes", -lever);
            warnings.push(implausible("vehicle.body.center_of_buoyancy", text));
        }
    }

    fn lint_body(&self, key: &str, body: &Body, warnings: &mut Vec<SceneWarning>) {
        let water = self.water.density * body.displaced_volume(&self.water);
        let volume = body.displaced_volume(&self.water);
        let [minimum, maximum] = DENSITIES;
        // A massless body is a mere float or a frame.
        if volume > 0.0 && body.mass > 0.0 && !(minimum * volume..=maximum * volume).contains(&body.mass) {
            let density = body.mass / volume;
            let text = format!(
                "{:.4} kg in {volume:.3e} m3 are {density:.4} kg/m3, implausible outside of {minimum} to {maximum}",
                body.mass
            );
            warnings.push(implausible(format!("{key}.volume"), text));
        }
        if self.vehicle.fixed && key == "vehicle.body" {
            return;
        }
        let added = (0..3).map(|i| body.added_mass[(i, i)]).fold(0.0, f64::max);
        if water > 0.0 && added == 0.0 {
            let text = format!("is 0, but the body displaces {water:.4} kg of water");
            warnings.push(implausible(format!("{key}.added_mass"), text));
        } else if water > 0.0 && added > FLAT * water {
            let text = format!("{added:.4} kg is {:.0} times the displaced water", added / water);
            warnings.push(implausible(format!("{key}.added_mass"), text));
        }
        let damping = |i: usize| body.damping.linear[(i, i)] + body.damping.quadratic[(i, i)];
        if key == "vehicle.body" && water > 0.0 {
            let free: Vec<_> = (0..6).filter(|i| damping(*i) == 0.0).map(|i| AXES[i]).collect();
            if !free.is_empty() {
                warnings.push(implausible("vehicle.body.damping", format!("no damping in {}", free.join(", "))));
            }
        }
    }

    fn lint_thrusters(&self, warnings: &mut Vec<SceneWarning>) {
        let thrusters = &self.vehicle.thrusters;
        if thrusters.is_empty() || self.vehicle.fixed {
            return;
        }
        for (k, other) in thrusters.iter().enumerate() {
            let same = |one: &&Thruster| {
                (one.position - other.position).norm() < SAME && one.axis.cross(&other.axis).norm() < SAME
            };
            if let Some(one) = thrusters[..k].iter().find(same) {
                let way = if one.axis.dot(&other.axis) > 0.0 { "same" } else { "opposite" };
                let text = format!("has the place of '{}' and the {way} direction: stated twice?", one.name);
                warnings.push(implausible(format!("vehicle.thrusters[{k}] ({})", other.name), text));
            }
        }
        self.lint_limits(warnings);
    }

    /// Limits that the bench table of a thruster does not have at the supply voltage.
    fn lint_limits(&self, warnings: &mut Vec<SceneWarning>) {
        let voltage = self.vehicle.supply_voltage();
        for (k, thruster) in self.vehicle.thrusters.iter().enumerate() {
            let Some(table) = thruster.map.as_ref().and_then(|map| map.table()) else { continue };
            let full = table.pulses().map(|pulse| table.thrust(pulse, voltage));
            let differs = |(limit, full): (f64, f64)| (limit - full).abs() > LIMITS * full.abs();
            if thruster.limits.into_iter().zip(full).any(differs) {
                let ([lower, upper], [first, last]) = (full, table.pulses());
                let text = format!(
                    "{first} and {last} us give {lower:.1} and {upper:.1} N at {voltage} V: state these limits"
                );
                warnings.push(implausible(format!("vehicle.thrusters[{k}].limits ({})", thruster.name), text));
            }
        }
    }
}
