//! Assessment of a scene: trim, authority of the thrusters, rates of the joints, and the integrator and step that follow it.

mod authority;
mod joint_rates;
mod recommendation;
mod trim;

pub use authority::Authority;
pub use joint_rates::JointRates;
pub use recommendation::{Recommendation, recommend};
pub use trim::Trim;

use super::options::SimulatorOptions;
use super::simulator::Simulator;
use crate::control::Allocation;
use crate::description::{Scene, SceneWarning};
use crate::error::SimulatorError;
use crate::integrate::{Gains, Integrator, Stability};

/// Tilt of the equilibrium attitude beyond which it is doubtful, rad.
const TILTED: f64 = 0.2;
/// Share of a thruster's limit, or of a joint's effort, beyond which holding still is doubtful.
const STRAINED: f64 = 0.5;
/// Force or moment of one direction over that of the other, below which thrusters push one way only.
const ONE_WAY: f64 = 1e-9;

/// Quantities of a scene by which slips in its numbers show.
#[derive(Debug, Clone, PartialEq)]
pub struct Assessment {
    /// Balance of a free vehicle; None without gravity.
    pub trim: Option<Trim>,
    /// Authority by axis; none without thrusters.
    pub authority: Vec<Authority>,
    /// Rates of the joints.
    pub joints: Vec<JointRates>,
    /// Doubtful values.
    pub doubts: Vec<SceneWarning>,
}

/// Assesses a checked scene.
///
/// # Errors
/// [`SimulatorError`] where the scene does not compose.
pub fn assess(scene: &Scene) -> Result<Assessment, SimulatorError> {
    let simulator =
        Simulator::new(scene.clone(), SimulatorOptions { error_estimate: Some(false), ..Default::default() })?;
    let mut assessment = Assessment {
        trim: trim::trim(&simulator),
        authority: authority::authority(&simulator),
        joints: joint_rates::joint_rates(&simulator),
        doubts: Vec::new(),
    };
    assessment.doubts = assessment.find_doubts(scene);
    Ok(assessment)
}

fn doubt(key: &str, text: String) -> SceneWarning {
    SceneWarning::Implausible { key: key.into(), text }
}

impl Assessment {
    fn find_doubts(&self, scene: &Scene) -> Vec<SceneWarning> {
        let mut doubts = Vec::new();
        if let Some(trim) = &self.trim {
            trim.find_doubts(scene, &mut doubts);
        }
        for Authority { axis, maximum: [ahead, back], .. } in &self.authority {
            if ahead.max(*back) > 0.0 && ahead.min(*back) <= ONE_WAY * ahead.max(*back) {
                let (some, none) = if ahead > back { ("positive", "negative") } else { ("negative", "positive") };
                let text = format!(
                    "all that act in {axis} push in the {some} direction, none in the {none}: limits or signs?"
                );
                doubts.push(doubt("vehicle.thrusters", text));
            }
        }
        let rights = Allocation::rights_itself(&scene.vehicle);
        let levelled = |axis: &str| rights && ["roll", "pitch"].contains(&axis);
        let axes = |of: &dyn Fn(&Authority) -> bool| {
            let named = self.authority.iter().filter(|each| each.alone == 0.0 && of(each)).map(|each| each.axis);
            named.collect::<Vec<_>>().join(", ")
        };
        let pushed = |of: &Authority| of.maximum != [0.0; 2];
        let absent = axes(&|of| !levelled(of.axis) && !pushed(of));
        let coupled = axes(&|of| !levelled(of.axis) && pushed(of));
        let mut missing = Vec::new();
        if !absent.is_empty() {
            missing.push(format!("no thrust in {absent}"));
        }
        if !coupled.is_empty() {
            missing.push(format!("thrust in {coupled} only together with other axes"));
        }
        if !missing.is_empty() {
            let text = format!("the vehicle cannot keep its station: {}", missing.join(", "));
            doubts.push(doubt("vehicle.thrusters", text));
        }
        let passive = axes(&|of| levelled(of.axis));
        if !passive.is_empty() {
            let text = format!("no control of {passive}: the righting moment levels the vehicle");
            doubts.push(doubt("vehicle.thrusters", text));
        }
        let integration = scene.integration();
        let explicit = match Integrator::named(&integration.integrator, &Gains::DEFAULT).map(|i| i.stability()) {
            Some(stability @ (Stability::Explicit(_) | Stability::SemiImplicitEuler)) => stability,
            _ => return doubts,
        };
        for joint in &self.joints {
            let (rate, cause) = joint.fastest();
            let step = explicit.max_step((-rate).into(), 0.0, f64::INFINITY);
            if rate > 0.0 && integration.step > step {
                let text = format!(
                    "the rate of {rate:.3e} 1/s over an inertia of {:.3e} is too fast for {} at {} s: state [integration]",
                    joint.inertia, integration.integrator, integration.step
                );
                doubts.push(doubt(&format!("{}.{cause} ({})", joint.key, joint.name), text));
            }
        }
        doubts
    }
}

impl Trim {
    fn find_doubts(&self, scene: &Scene, doubts: &mut Vec<SceneWarning>) {
        if let Some([roll, pitch]) = self.equilibrium {
            let tilt = (roll.cos() * pitch.cos()).acos();
            if tilt > TILTED {
                let text = format!(
                    "the vehicle comes to rest at a roll of {:.1} and a pitch of {:.1} degrees (righting moment {:.4} N m/rad)",
                    roll.to_degrees(),
                    pitch.to_degrees(),
                    self.righting_moment
                );
                doubts.push(doubt("vehicle.body.center_of_buoyancy", text));
            }
        }
        let names = scene.thruster_names();
        let most = self.thrusts.iter().enumerate().max_by(|a, b| a.1.1.total_cmp(&b.1.1));
        if let Some((i, (thrust, share))) = most
            && *share > STRAINED
        {
            let text = format!(
                "{} takes {thrust:.4} N to hold the level vehicle, {:.0} % of its limit",
                names[i],
                100.0 * share
            );
            doubts.push(doubt("vehicle.thrusters", text));
        }
        let keys = scene.joint_keys();
        for (k, (torque, share)) in self.joint_torques.iter().enumerate().filter(|(_, (_, share))| *share > STRAINED) {
            let text = format!("holding the arm at home takes {torque:.4}, {:.0} % of it", 100.0 * share);
            doubts.push(doubt(&format!("{}.effort", keys[k]), text));
        }
    }
}
