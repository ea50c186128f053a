//! Integrator and step that follow a scene's motion at the speeds that its actuators reach.

use crate::batch::monitoring::modal_analysis::{Mode, configurations, joint_speed};
use crate::batch::monitoring::step_monitor::digits;
use crate::batch::monitoring::step_quality::{ACCUMULATED_LIMIT, maximum};
use crate::batch::options::SimulatorOptions;
use crate::batch::simulator::Simulator;
use crate::batch::simulator::states::States;
use crate::batch::storage::inputs::Inputs;
use crate::description::{Integration, Joint, Scene};
use crate::dynamics::Servos;
use crate::error::SimulatorError;
use crate::integrate::Integrator;

/// Integrators and steps, s, in the order of preference: explicit where it follows the motion, then linearly implicit, then
/// shorter steps.
const CANDIDATES: [(&str, f64); 10] = [
    ("mk4", 0.01),
    ("ros2", 0.01),
    ("ros3", 0.01),
    ("mk4", 0.005),
    ("ros3", 0.005),
    ("mk4", 0.002),
    ("ros3", 0.002),
    ("mk4", 0.001),
    ("ros3", 0.001),
    ("ros3", 0.0005),
];
/// Minimum ratio of the maximum stable step to the recommended one of an explicit method.
const MARGIN: f64 = 1.5;
/// Directions of motion: along each axis of the vehicle, either way.
const MOTIONS: usize = 12;
/// Duration of the motions, and the interval between changes of their inputs, s.
const DURATION: f64 = 2.0;
const PERIOD: f64 = 0.05;
/// Frequency of the joints' targets, rad/s, and half the period at which torques change sign, in intervals.
const FREQUENCY: f64 = 4.0;
const REVERSAL: usize = 10;

/// Integrator and step for a scene's motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Recommendation {
    /// Integrator and step.
    pub integration: Integration,
    /// Reason, in one line.
    pub reason: String,
    /// Maximum estimated error of driven motions of 2 s, relative to the motion.
    pub error: f64,
    /// False where the error exceeds the limit of 2 %: nothing better is known.
    pub accurate: bool,
}

/// Integrator and step for the motion of a scene at these speeds of the vehicle (m/s, rad/s), by default the speeds that full
/// thrust reaches, and the speeds of its joints.
///
/// mk4 at 0.01 s where it is stable with a margin, else a linearly implicit method, else a shorter step. Each is judged by its
/// estimated error over motions of 2 s: the vehicle at speed under full thrust along each axis, joints at configurations within
/// their limits at speed, under servos and under torques that reverse.
///
/// # Errors
/// [`SimulatorError`] where the scene does not compose, or for a speed that is not finite or is negative.
pub fn recommend(scene: &Scene, speed: Option<&[f64; 6]>) -> Result<Recommendation, SimulatorError> {
    let simulator =
        Simulator::new(scene.clone(), SimulatorOptions { error_estimate: Some(false), ..Default::default() })?;
    let (stable, mode) = stable_step(&simulator, speed)?;
    let motion = DrivenMotion::new(&simulator, speed);
    let mut best: Option<Recommendation> = None;
    let mut failed = Vec::new();
    for (name, step) in CANDIDATES {
        let known = Integrator::named(name, &crate::integrate::Gains::DEFAULT);
        let Some(integrator) = known else { continue };
        if !integrator.implicit() && MARGIN * step > stable {
            continue;
        }
        let integration = Integration { integrator: name.into(), step };
        let found = motion.error(&integration)?;
        let error = if found.is_nan() { f64::INFINITY } else { found };
        let accurate = error <= ACCUMULATED_LIMIT;
        let reason = reason(&integration, error, (stable, mode.as_ref()), &failed);
        if step == Integration::default().step {
            failed.push(format!("{name} at {step} s ({})", percent(error)));
        }
        if accurate || best.as_ref().is_none_or(|best| error < best.error) {
            best = Some(Recommendation { integration, reason, error, accurate });
        }
        if accurate {
            break;
        }
    }
    Ok(best.expect("linearly implicit candidates are always tried"))
}

/// Maximum stable step of mk4 with any servos on or off, and the mode that limits it.
pub(super) fn stable_step(
    simulator: &Simulator,
    speed: Option<&[f64; 6]>,
) -> Result<(f64, Option<Mode>), SimulatorError> {
    let analysis = simulator.modal_analysis(speed)?;
    let explicit = simulator.integrator().stability();
    let choices = [(false, false), (false, true), (true, false), (true, true)];
    let steps = choices.map(|(joints, vehicle)| analysis.stable_step(explicit, Servos { joints, vehicle }, true));
    Ok(steps.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::INFINITY, None)))
}

fn percent(error: f64) -> String {
    if error.is_finite() { format!("{} %", digits(100.0 * error)) } else { "diverges".into() }
}

/// One line: the error, and the reasons for which mk4 and others at the default step are not enough.
fn reason(integration: &Integration, error: f64, (stable, mode): (f64, Option<&Mode>), failed: &[String]) -> String {
    let judged = if error.is_finite() {
        format!("estimated error {} of the motion after {DURATION} s at full thrust and joint speed", percent(error))
    } else {
        format!("the motion diverges within {DURATION} s at full thrust and joint speed")
    };
    let Integration { integrator, step } = Integration::default();
    if *integration == (Integration { integrator, step }) {
        return if stable.is_finite() { format!("stable up to {} s; {judged}", digits(stable)) } else { judged };
    }
    let mut causes: Vec<String> = mode
        .filter(|_| MARGIN * step > stable)
        .map(|mode| {
            let rate = digits(mode.rate.norm());
            format!("mk4 is unstable beyond {} s ({}: rate {rate} 1/s)", digits(stable), mode.what)
        })
        .into_iter()
        .collect();
    if !failed.is_empty() {
        causes.push(format!("the error is too large with {}", failed.join(", ")));
    }
    format!("{}; {judged}", causes.join(", "))
}

/// Starts and inputs of motions at the speeds that actuators reach, one instance each.
struct DrivenMotion<'a> {
    scene: &'a Scene,
    twist: Vec<f64>,
    q: Vec<f64>,
    qd: Vec<f64>,
    thrust: Vec<f64>,
    /// Torques that keep the joints at speed against their friction.
    torque: Vec<f64>,
    servos: bool,
}

impl<'a> DrivenMotion<'a> {
    fn new(simulator: &'a Simulator, given: Option<&[f64; 6]>) -> Self {
        let scene = simulator.scene();
        let reached = simulator.expected_speed();
        let speed = given.copied().unwrap_or(reached);
        // Drag grows with the square of the speed.
        let power = |axis: usize| if speed[axis] < reached[axis] { (speed[axis] / reached[axis]).powi(2) } else { 1.0 };
        let joints: Vec<&Joint> = scene.joints().collect();
        let configurations = configurations(scene, &joints);
        let allocation = simulator.allocation();
        let mut motion = Self {
            scene,
            twist: Vec::new(),
            q: Vec::new(),
            qd: Vec::new(),
            thrust: Vec::new(),
            torque: Vec::new(),
            servos: joints.iter().any(|joint| joint.servo.is_some() || joint.prescribed),
        };
        for i in 0..MOTIONS {
            let (axis, sign) = (i % 6, if i < 6 { 1.0 } else { -1.0 });
            motion.twist.extend((0..6).map(|k| if k == axis { sign * speed[axis] } else { 0.0 }));
            motion.thrust.extend((0..allocation.count()).map(|k| {
                let along = sign * allocation.column(k)[axis];
                let [lower, upper] = allocation.limits(k);
                let full = if along > 0.0 { upper } else { lower };
                if along.abs() < 1e-9 { 0.0 } else { power(axis) * full }
            }));
            let (q, _) = &configurations[i % configurations.len()];
            for (k, joint) in joints.iter().enumerate() {
                let rate = if (i + k) % 2 == 0 { joint_speed(joint) } else { -joint_speed(joint) };
                motion.q.push(q[k]);
                motion.qd.push(rate);
                motion.torque.push(joint.friction.viscous * rate + joint.friction.coulomb * rate.signum());
            }
        }
        motion
    }

    /// Maximum estimated error of all motions, without servos and with them; NaN or infinite where one diverges.
    fn error(&self, integration: &Integration) -> Result<f64, SimulatorError> {
        let without = self.run(integration, false)?;
        Ok(if self.servos && without <= ACCUMULATED_LIMIT {
            maximum(without, self.run(integration, true)?)
        } else {
            without
        })
    }

    fn run(&self, Integration { integrator, step }: &Integration, servos: bool) -> Result<f64, SimulatorError> {
        let options = SimulatorOptions {
            instances: MOTIONS,
            dt: *step,
            integrator: integrator.clone(),
            error_estimate: Some(true),
            ..SimulatorOptions::default()
        };
        let mut simulator = Simulator::new(self.scene.clone(), options)?;
        let twist = (!self.scene.vehicle.fixed).then_some(&self.twist[..]);
        simulator.set_states(&States { twist, q: Some(&self.q), qd: Some(&self.qd), ..States::default() })?;
        let substeps = (PERIOD / step).round().max(1.0) as usize;
        for period in 0..(DURATION / PERIOD).round() as usize {
            let phase = FREQUENCY * PERIOD * period as f64;
            let targets: Vec<f64> = self
                .q
                .iter()
                .zip(&self.qd)
                .flat_map(|(q, qd)| [q + qd / FREQUENCY * phase.sin(), qd * phase.cos()])
                .collect();
            let back = (period + REVERSAL / 2) / REVERSAL % 2 == 1;
            let torque: Vec<f64> = self.torque.iter().map(|torque| if back { -torque } else { *torque }).collect();
            let inputs = Inputs {
                thrust: Some(&self.thrust),
                joint_torque: (!servos).then_some(&torque[..]),
                joint_target: servos.then_some(&targets[..]),
                ..Inputs::default()
            };
            simulator.step(&inputs, substeps)?;
        }
        Ok((0..MOTIONS).fold(0.0, |worst, i| maximum(worst, simulator.estimate_of(i).map_or(0.0, |e| e.relative))))
    }
}
