//! What a scene may be, but hardly is: slips of units, signs and keys.

use std::fmt;

use nalgebra::{DMatrix, Matrix6xX, Vector3};

use super::{Body, Scene};

/// Difference of mass and displaced mass over mass, beyond which a scene is no underwater vehicle in trim.
const OUT_OF_TRIM: f64 = 0.1;
/// Densities over that of water beyond which a body is hardly meant.
const DENSE: f64 = 30.0;
/// Added mass over displaced mass likewise.
const FLAT: f64 = 50.0;
/// Names of the axes of a body.
const AXES: [&str; 6] = ["surge", "sway", "heave", "roll", "pitch", "yaw"];

/// Something implausible.
#[derive(Debug, Clone, PartialEq)]
pub struct Doubt {
    /// Path of what is doubted.
    pub key: String,
    /// What is implausible about it.
    pub text: String,
}

impl fmt::Display for Doubt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.key, self.text)
    }
}

fn doubt(key: impl Into<String>, text: String) -> Doubt {
    Doubt { key: key.into(), text }
}

impl Scene {
    /// Mass of all bodies, and of the water that they displace, kg.
    pub fn masses(&self) -> (f64, f64) {
        self.bodies().fold((0.0, 0.0), |(mass, water), (_, body)| {
            (mass + body.mass, water + self.water.density * body.displaced_volume(&self.water))
        })
    }

    /// What is implausible about a scene that passed its checks.
    pub fn doubts(&self) -> Vec<Doubt> {
        let mut doubts = Vec::new();
        if self.water.density > 0.0 {
            self.doubt_trim(&mut doubts);
            for (key, body) in self.bodies() {
                self.doubt_body(&key, body, &mut doubts);
            }
        }
        self.doubt_thrusters(&mut doubts);
        doubts
    }

    fn doubt_trim(&self, doubts: &mut Vec<Doubt>) {
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
            doubts.push(doubt("vehicle.body.volume", text));
        }
        let body = &self.vehicle.body;
        let lever = (body.center_of_mass - body.center_of_buoyancy).dot(&self.water.gravity) / gravity;
        if body.displaced_volume(&self.water) > 0.0 && lever < -1e-9 {
            let text = format!("lies {:.4} m below the centre of mass: the vehicle turns over", -lever);
            doubts.push(doubt("vehicle.body.center_of_buoyancy", text));
        }
    }

    fn doubt_body(&self, key: &str, body: &Body, doubts: &mut Vec<Doubt>) {
        let water = self.water.density * body.displaced_volume(&self.water);
        if water > 0.0 && body.mass > DENSE * water {
            let text = format!("{:.4} kg in a volume of {water:.4} kg of water is denser than any robot", body.mass);
            doubts.push(doubt(format!("{key}.volume"), text));
        }
        if self.vehicle.fixed && key == "vehicle.body" {
            return;
        }
        let added = (0..3).map(|i| body.added_mass[(i, i)]).fold(0.0, f64::max);
        if water > 0.0 && added == 0.0 {
            let text = format!("is 0, though the body displaces {water:.4} kg of water");
            doubts.push(doubt(format!("{key}.added_mass"), text));
        } else if water > 0.0 && added > FLAT * water {
            let text = format!("{added:.4} kg is {:.0} times the displaced water", added / water);
            doubts.push(doubt(format!("{key}.added_mass"), text));
        }
        let drag = |i: usize| body.damping.linear[(i, i)] + body.damping.quadratic[(i, i)];
        if key == "vehicle.body" && water > 0.0 {
            let free: Vec<_> = (0..6).filter(|i| drag(*i) == 0.0).map(|i| AXES[i]).collect();
            if !free.is_empty() {
                doubts.push(doubt(
                    "vehicle.body.damping",
                    format!("no drag in {}: nothing slows it there", free.join(", ")),
                ));
            }
        }
    }

    fn doubt_thrusters(&self, doubts: &mut Vec<Doubt>) {
        let thrusters = &self.vehicle.thrusters;
        if thrusters.is_empty() || self.vehicle.fixed {
            return;
        }
        let at = self.vehicle.body.center_of_mass;
        let columns: Vec<_> = thrusters
            .iter()
            .map(|thruster| {
                let moment: Vector3<f64> = (thruster.position - at).cross(&thruster.axis);
                let (f, m) = (thruster.axis, moment);
                nalgebra::Vector6::new(f.x, f.y, f.z, m.x, m.y, m.z)
            })
            .collect();
        let matrix = Matrix6xX::from_columns(&columns);
        let none: Vec<_> = (0..6).filter(|i| matrix.row(*i).amax() < 1e-9).map(|i| AXES[i]).collect();
        if !none.is_empty() {
            doubts.push(doubt("vehicle.thrusters", format!("no thruster acts in {}", none.join(", "))));
            return;
        }
        let rank = DMatrix::from_iterator(6, columns.len(), matrix.iter().copied()).rank(1e-6);
        if rank < 6 {
            let text = format!("they act in {rank} independent directions, of 6");
            doubts.push(doubt("vehicle.thrusters", text));
        }
    }
}
