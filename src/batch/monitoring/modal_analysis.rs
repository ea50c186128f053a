//! Modal analysis of a scene: its modes at a spread of states, and the stable steps.

use std::collections::{BTreeMap, VecDeque};
use std::fmt;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use nalgebra::{Complex, Vector3, Vector6};

use super::step_monitor::{InaccurateStep, OtherIntegrators, digits};
use super::step_quality::ACCUMULATED_LIMIT;
use crate::batch::options::SimulatorOptions;
use crate::batch::simulator::Simulator;
use crate::control::AXES;
use crate::description::{Joint, Scene};
use crate::dynamics::aba::ArmLoads;
use crate::dynamics::{Linearization, Loads, Modes, Servos, linearize};
use crate::error::SimulatorError;
use crate::integrate::{Integrator, PASSING, Stability};
use crate::system::{Compiled, JOINTS, Joints, State, System};

/// Number of configurations of the arm in addition to home.
const SPREAD: usize = 8;
/// Maximum expected speed of a vehicle, m/s and rad/s.
const FASTEST: f64 = 5.0;
/// Expected speed of a joint without a speed limit: revolute rad/s, prismatic m/s.
const JOINT_SPEED: [f64; 2] = [1.0, 0.25];
/// Range of a joint without limits, to either side: revolute rad, prismatic m.
const JOINT_RANGE: [f64; 2] = [std::f64::consts::PI, 0.5];
/// Minimum share in a mode's energy of a further coordinate that its description names.
const NAMED: f64 = 0.3;
/// Rates below this are rounding, 1/s.
const SLOW: f64 = 1e-4;
/// Number of scenes whose analyses are cached.
const CACHED: usize = 16;

/// Mode of small deviations: decaying, oscillating or growing.
#[derive(Debug, Clone, PartialEq)]
pub struct Mode {
    /// Eigenvalue, 1/s: deviations go as `exp(rate t)`.
    pub rate: Complex<f64>,
    /// Moving coordinates: "joint 3 (wrist)", "vehicle yaw"; most of the kinetic energy first.
    pub what: String,
    /// State of the linearization: "at home, at rest".
    pub place: String,
    /// True where a joint stands against an end stop there.
    pub stop: bool,
}

/// Warning of an unstable step; displays as one line.
#[derive(Debug, Clone, PartialEq)]
pub struct UnstableStep {
    /// Name of the scene.
    pub scene: String,
    /// Name of the integrator.
    pub integrator: String,
    /// Step, s.
    pub dt: f64,
    /// The mode with the smallest stable step.
    pub mode: Mode,
    /// Maximum stable step, s.
    pub stable: f64,
}

impl fmt::Display for UnstableStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scene, integrator, dt, mode, stable } = self;
        write!(
            f,
            "scene '{scene}': integrator '{integrator}' unstable at dt = {dt} s (mode of {}: rate {} 1/s, {}); \
             a step of at most {} s{} would do",
            mode.what,
            text(mode.rate),
            mode.place,
            digits(*stable),
            OtherIntegrators { failed: integrator, stiff: true },
        )
    }
}

fn text(rate: Complex<f64>) -> String {
    if rate.im == 0.0 { digits(rate.re) } else { format!("{} +- {} i", digits(rate.re), digits(rate.im)) }
}

/// Modal analysis of a scene, linearized at a spread of states.
///
/// Configurations of the arm: home, and a fixed low-discrepancy sequence within the limits. Motions: at rest; the vehicle
/// at its expected speed through the water along each axis in turn, or the water past a fixed one; all joints at their expected
/// speeds. At home also each joint against each end stop, as deep as its expected speed carries it. All of them level, without
/// loads, servos at their targets.
#[derive(Debug)]
pub struct ModalAnalysis {
    joint_names: Vec<String>,
    samples: Vec<Sample>,
    /// Modes without servos, with servos of the joints, of the vehicle, and of both: computed on first use.
    modes: [OnceLock<Vec<SampleModes>>; 4],
    system: Arc<crate::system::System<crate::lane::Shared<f64>>>,
}

#[derive(Debug)]
struct Sample {
    place: String,
    /// Joint against a stop.
    stop: Option<usize>,
    /// True where nothing moves but the water past a fixed vehicle.
    rest: bool,
    linear: Linearization,
}

/// Fastest mode of a kind: sample, energy shares and rate.
type Fastest = (usize, Vec<f64>, Complex<f64>);

/// Modes at a sample.
#[derive(Debug)]
struct SampleModes {
    modes: Modes,
    rates: Vec<Complex<f64>>,
}

impl ModalAnalysis {
    fn new(scene: &Scene, compiled: &Compiled, speeds: &[f64; 6]) -> Self {
        let joints: Vec<&Joint> = scene.coordinates().collect();
        let joint_names = scene.coordinate_names();
        // Contacts have sub-intervals of their own.
        let system = &System { contact: None, ..compiled.system.clone() };
        let fixed = scene.vehicle.fixed;
        // `twist` through the water.
        let at = |q: &Joints, twist: [f64; 6], qd: Joints| {
            let twist = Vector6::from(twist);
            let (own, water) = if fixed { (Vector6::zeros(), -twist) } else { (twist, Vector6::zeros()) };
            let state = State { q: *q, qd, twist: own, ..State::default() };
            let water: Vector3<f64> = water.fixed_rows::<3>(0).into();
            linearize(system, &state, &water.into(), &[0.0; 6], &system.terms.deflections(), &ArmLoads::none())
        };
        let still = [0.0; JOINTS];
        let mut joint_speeds = still;
        for (speed, joint) in joint_speeds.iter_mut().zip(&joints) {
            *speed = joint_speed(joint);
        }

        let mut samples = Vec::new();
        for (q, place) in configurations(scene, &joints) {
            let mut add = |motion: &str, rest, linear| {
                samples.push(Sample { place: format!("{place}, {motion}"), stop: None, rest, linear });
            };
            add("at rest", true, at(&q, [0.0; 6], still));
            // The water turns past nothing.
            let axes = if fixed { 3 } else { 6 };
            for (axis, &speed) in speeds.iter().enumerate().take(axes).filter(|(_, speed)| **speed > 0.0) {
                let mut twist = [0.0; 6];
                twist[axis] = speed;
                let unit = if axis < 3 { "m/s" } else { "rad/s" };
                add(&format!("{} at {} {unit}", AXES[axis], digits(speed)), fixed, at(&q, twist, still));
            }
            if joint_speeds != still {
                add("joints at speed", false, at(&q, [0.0; 6], joint_speeds));
            }
        }
        for (k, joint) in joints.iter().enumerate() {
            let Some(limits) = &joint.limits else { continue };
            for (limit, side) in [(limits.lower, -1.0), (limits.upper, 1.0)] {
                let mut q = scene.home();
                q[k] = limit;
                // Depth to which the stiffness stops the joint from its speed, without damping; 1/B is its apparent inertia.
                let rates = 6 + joints.len();
                let free = at(&q, [0.0; 6], still).b[(rates + 6 + k, 6 + k)];
                let depth = joint_speeds[k] / (limits.stiffness * free).sqrt();
                if limits.stiffness > 0.0 && depth.is_finite() {
                    q[k] += side * depth;
                    let end = if side < 0.0 { "lower" } else { "upper" };
                    let place = format!("joint {k} ({}) at its {end} stop", joint_names[k]);
                    samples.push(Sample { place, stop: Some(k), rest: true, linear: at(&q, [0.0; 6], still) });
                }
            }
        }
        let system = Arc::new(system.clone());
        Self { joint_names, samples, modes: Default::default(), system }
    }

    /// Modes at each sample.
    fn sample_modes(&self, servos: Servos) -> &[SampleModes] {
        self.modes[servos.index()].get_or_init(|| {
            let find = |sample: &Sample| {
                let modes = sample.linear.clone().with_servos(&self.system, servos).modes();
                SampleModes { rates: modes.rates(), modes }
            };
            self.samples.iter().map(find).collect()
        })
    }

    fn mode(&self, sample: usize, shares: &[f64], rate: Complex<f64>) -> Mode {
        let Sample { place, stop, .. } = &self.samples[sample];
        let mut order: Vec<usize> = (0..shares.len()).collect();
        order.sort_by(|&i, &k| shares[k].total_cmp(&shares[i]));
        let named = order.iter().enumerate().filter(|(i, k)| *i == 0 || shares[**k] >= NAMED);
        let what = named.map(|(_, &k)| self.coordinate(k)).collect::<Vec<_>>().join(" and ");
        Mode { rate, what, place: place.clone(), stop: stop.is_some() }
    }

    /// Name of an entry of `[V; q']`.
    fn coordinate(&self, k: usize) -> String {
        match k.checked_sub(6) {
            None => format!("vehicle {}", AXES[k]),
            Some(joint) => format!("joint {joint} ({})", self.joint_names[joint]),
        }
    }

    /// The fastest modes, fastest first. For each coordinate, of the modes in which it has most of the energy: the fastest
    /// decaying one, the fastest growing one, and for joints the fastest one against an end stop.
    pub fn modes(&self, servos: Servos) -> Vec<Mode> {
        // By (maximum coordinate, growing, at a stop).
        let mut fastest: BTreeMap<(usize, bool, bool), Fastest> = BTreeMap::new();
        for (sample, found) in self.sample_modes(servos).iter().enumerate() {
            // One of each conjugate pair.
            for &rate in found.rates.iter().filter(|rate| rate.im >= 0.0 && rate.norm() > SLOW) {
                let shares = found.modes.shares(rate);
                let most = (0..shares.len()).fold(0, |best, k| if shares[k] > shares[best] { k } else { best });
                let stop = self.samples[sample].stop;
                if stop.is_some_and(|joint| most != 6 + joint) {
                    continue;
                }
                let kind = (most, rate.re > SLOW, stop.is_some());
                if fastest.get(&kind).is_none_or(|(_, _, other)| other.norm() < rate.norm()) {
                    fastest.insert(kind, (sample, shares, rate));
                }
            }
        }
        let mut modes: Vec<Mode> =
            fastest.into_values().map(|(sample, shares, rate)| self.mode(sample, &shares, rate)).collect();
        modes.sort_by(|a, b| b.rate.norm().total_cmp(&a.rate.norm()));
        modes
    }

    /// Maximum stable step, s, infinite where any step is stable; and the mode that limits it.
    pub fn stable_step(&self, stability: Stability, servos: Servos, stops: bool) -> (f64, Option<Mode>) {
        let (mut minimum, mut bound) = (f64::INFINITY, None);
        for (sample, found) in self.sample_modes(servos).iter().enumerate() {
            let Sample { stop, rest, .. } = self.samples[sample];
            if stop.is_some() && !stops {
                continue;
            }
            // An arm without servos does not stay at rest.
            let lasts = rest && (servos.joints || self.joint_names.is_empty());
            let lenience = if lasts { 0.0 } else { PASSING };
            for &rate in found.rates.iter().filter(|rate| rate.im >= 0.0) {
                let step = stability.max_step(rate, lenience, minimum);
                if step < minimum {
                    (minimum, bound) = (step, Some((sample, rate)));
                }
            }
        }
        let mode = bound.map(|(sample, rate)| {
            let shares = self.sample_modes(servos)[sample].modes.shares(rate);
            self.mode(sample, &shares, rate)
        });
        (minimum, mode)
    }
}

/// Home, and [`SPREAD`] configurations within the limits, by the additive recurrence of the generalised golden ratio.
pub fn configurations(scene: &Scene, joints: &[&Joint]) -> Vec<(Joints, String)> {
    let home = (scene.home(), "at home".to_owned());
    let n = joints.len();
    if n == 0 {
        return vec![home];
    }
    // The root of x^(n + 1) = x + 1.
    let ratio = (0..64).fold(1.0_f64, |x, _| (1.0 + x).powf(1.0 / (n as f64 + 1.0)));
    let spread = (1..=SPREAD).map(|i| {
        let mut q = [0.0; JOINTS];
        for (k, joint) in joints.iter().enumerate() {
            let share = (0.5 + i as f64 * ratio.powi(-(k as i32) - 1)).fract();
            let range = of_kind(joint, JOINT_RANGE);
            let [lower, upper] = joint.limits.as_ref().map_or([-range, range], |l| [l.lower, l.upper]);
            q[k] = lower + share * (upper - lower);
        }
        let text: Vec<String> = q[..n].iter().map(|q| format!("{q:.2}")).collect();
        (q, format!("at q = [{}]", text.join(", ")))
    });
    std::iter::once(home).chain(spread).collect()
}

/// Expected speed of a joint: its maximum, or the usual one of its kind, rad/s or m/s.
pub fn joint_speed(joint: &Joint) -> f64 {
    joint.speed.unwrap_or(of_kind(joint, JOINT_SPEED))
}

/// The entry for a revolute or a prismatic joint.
fn of_kind(joint: &Joint, [revolute, prismatic]: [f64; 2]) -> f64 {
    if joint.slides() { prismatic } else { revolute }
}

/// Analyses at the default speeds, latest first, shared by the simulators of a scene.
static ANALYSES: Mutex<VecDeque<(Scene, Arc<ModalAnalysis>)>> = Mutex::new(VecDeque::new());

impl Simulator {
    /// Expected speed through the water along each axis: the maximum of the speed of the scene's current, which may come from any
    /// heading, and the speed at which damping balances full thrust, arm at home, at most 5 m/s and 5 rad/s. A fixed vehicle has
    /// the speed of the current.
    pub fn expected_speed(&self) -> [f64; 6] {
        let thrust = self.allocation().wrench_limits();
        let [x, y, z] = self.scene().water.current.into();
        let current = [x.hypot(y), x.hypot(y), z.abs(), 0.0, 0.0, 0.0];
        std::array::from_fn(|axis| {
            if self.scene().vehicle.fixed || thrust[axis] == 0.0 {
                return current[axis];
            }
            let drag = |speed: f64| {
                let twist = Vector6::ith(axis, speed);
                let state = State { q: self.scene().home(), twist, ..State::default() };
                let power = self.closed_form_model.at(&state, Vector3::zeros()).power(&Loads::default());
                power.map_or(0.0, |power| -power.damping / speed)
            };
            // drag = linear v + quadratic v^2
            let [at_one, at_two] = [1.0, 2.0].map(drag);
            let quadratic = 0.5 * at_two - at_one;
            let linear = at_one - quadratic;
            let speed = 2.0 * thrust[axis] / (linear + (linear * linear + 4.0 * quadratic * thrust[axis]).sqrt());
            current[axis].max(if speed < FASTEST { speed } else { FASTEST })
        })
    }

    /// Modal analysis of the scene at these vehicle speeds (m/s, rad/s), by default [`Self::expected_speed`], without the
    /// factors of instances.
    ///
    /// # Errors
    /// [`SimulatorError::Speed`] for a speed that is not finite or is negative.
    pub fn modal_analysis(&self, speed: Option<&[f64; 6]>) -> Result<Arc<ModalAnalysis>, SimulatorError> {
        if let Some(speed) = speed {
            if let Some(&value) = speed.iter().find(|v| !(v.is_finite() && **v >= 0.0)) {
                return Err(SimulatorError::Speed { value });
            }
            return Ok(Arc::new(ModalAnalysis::new(self.scene(), self.compiled(), speed)));
        }
        let cached = || ANALYSES.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, analysis)) = cached().iter().find(|(scene, _)| scene == self.scene()) {
            return Ok(Arc::clone(analysis));
        }
        let analysis = Arc::new(ModalAnalysis::new(self.scene(), self.compiled(), &self.expected_speed()));
        let mut analyses = cached();
        analyses.push_front((self.scene().clone(), Arc::clone(&analysis)));
        analyses.truncate(CACHED);
        Ok(analysis)
    }

    /// Warning before a step with these `servos` on, once: the step is unstable for a mode of the scene, end stops left out.
    pub fn warn_of_step(&mut self, servos: Servos) -> Option<UnstableStep> {
        if !self.monitor.needs_modal_analysis(servos) {
            return None;
        }
        let analysis = self.modal_analysis(None).ok()?;
        let (stable, mode) = analysis.stable_step(self.integrator().stability(), servos, false);
        let mode = mode.filter(|_| self.options().dt > stable)?;
        self.monitor.set_unstable_step_warned();
        let SimulatorOptions { dt, integrator, .. } = self.options().clone();
        Some(UnstableStep { scene: self.scene().name.clone(), integrator, dt, mode, stable })
    }

    /// Warning after steps, once for each cause: instances whose state is not finite, whose motion excites rates beyond
    /// [`crate::integrate::Integrator::range`], whose steps have a velocity error beyond [`super::step_quality::ERROR_LIMIT`], or
    /// whose accumulated error is beyond [`super::step_quality::ACCUMULATED_LIMIT`].
    pub fn warn_of_motion(&mut self) -> Option<InaccurateStep> {
        let (cause, violation) = self.monitor.take_violation()?;
        // None of an episode that has begun anew since.
        let estimate = self
            .estimate_of(violation.instance)
            .filter(|estimate| estimate.relative > ACCUMULATED_LIMIT || estimate.relative.is_nan());
        Some(InaccurateStep {
            scene: self.scene().name.clone(),
            options: self.options().clone(),
            order: self.integrator().order(),
            adaptive: self.integrator().adaptive(),
            range: self.range,
            cause,
            violation,
            estimate,
        })
    }
}

/// Stability of each integrator, with its name.
pub fn stabilities() -> impl Iterator<Item = (&'static str, Stability)> {
    Integrator::NAMES.into_iter().map(|entry| (entry.name, entry.integrator.stability()))
}
