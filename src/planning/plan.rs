//! Problems of a batch, and their solutions.

use std::sync::Mutex;

use super::cost::{StateCost, reference_width, residuals};
use super::tracking::{Numbers, Tracking, Trajectory};
use crate::batch::stepping::threads::for_each;
use crate::batch::{Argument, Inputs, Precision, Simulator, SimulatorOptions};
use crate::error::{PlanningError, SimulatorError};
use crate::limits::{interrupt, memory};
use crate::optimize::{STEP_SIZES, Settings, Solution, solve};
use crate::system::{EndEffector, State};

/// Inputs that can be chosen, in their order.
const CHOICES: [Argument; 5] =
    [Argument::Thrust, Argument::Fin, Argument::Wrench, Argument::JointTorque, Argument::JointTarget];

/// Problems of all instances of a simulator, from their present states: row-major by problem, knot and entry.
pub struct Problems<'a> {
    /// Periods over which inputs are held.
    pub horizon: usize,
    /// Steps of a period.
    pub substeps: usize,
    /// Inputs to choose, in the order of [`input_argument`]; entries of all of them: w.
    pub inputs: &'a [Argument],
    /// Numbers of all problems. Limits of the scene's actuators hold besides the bounds.
    pub numbers: Numbers<'a>,
    /// (N, horizon, w): inputs at the start, within bounds or not.
    pub start: &'a [f64],
    /// Limits of the iterations.
    pub settings: Settings,
}

/// Optimal trajectory of one problem.
pub struct Plan {
    /// Inputs and states.
    pub trajectory: Trajectory,
    /// World position of the end effector at each knot, m.
    pub end_effector: Vec<[f64; 3]>,
    /// Costs, feedback gains and convergence.
    pub solution: Solution,
}

/// Entries of an input of a simulator's scene.
pub fn input_width(simulator: &Simulator, argument: Argument) -> usize {
    match argument {
        Argument::Thrust => simulator.allocation().count(),
        Argument::Fin => simulator.scene().vehicle.fins.len(),
        Argument::Wrench if !simulator.scene().vehicle.fixed => 6,
        Argument::JointTorque => simulator.joints(),
        Argument::JointTarget if simulator.scene().joints().any(|j| j.servo.is_some() || j.prescribed) => {
            simulator.joints()
        }
        _ => 0,
    }
}

/// Input of that name.
///
/// # Errors
/// [`PlanningError::UnknownInput`].
pub fn input_argument(simulator: &Simulator, name: &str) -> Result<Argument, PlanningError> {
    let known = choices(simulator);
    known.iter().copied().find(|argument| argument.name() == name).ok_or_else(|| PlanningError::UnknownInput {
        name: name.into(),
        scene: simulator.scene().name.clone(),
        known: known.iter().map(|argument| argument.name()).collect(),
    })
}

/// Inputs of a simulator's scene.
fn choices(simulator: &Simulator) -> Vec<Argument> {
    CHOICES.into_iter().filter(|argument| input_width(simulator, *argument) > 0).collect()
}

/// Range within which an actuator of instance `i` does not saturate: the derivative of a saturated one is 0, at its limit too.
fn unsaturated(simulator: &Simulator, i: usize, argument: Argument, k: usize) -> [f64; 2] {
    let scene = simulator.scene_of(i);
    let [lower, upper] = match argument {
        Argument::Thrust => simulator.allocation_of(i).limits(k),
        Argument::Fin => scene.vehicle.fins[k].range(),
        Argument::JointTorque => {
            let effort = scene.joints().nth(k).and_then(|joint| joint.effort).unwrap_or(f64::INFINITY);
            [-effort, effort]
        }
        _ => [f64::NEG_INFINITY, f64::INFINITY],
    };
    [lower.next_up().min(upper), upper.next_down().max(lower)]
}

/// Minimises the costs of all problems. The simulator stays as it is. The result of each problem depends on its own numbers
/// alone, bit for bit.
///
/// # Errors
/// [`PlanningError`] that names problem, knot and entry; [`SimulatorError`] where steps have no derivatives.
pub fn optimize(simulator: &Simulator, problems: &Problems) -> Result<Vec<Plan>, PlanningError> {
    if simulator.options().precision != Precision::Double {
        return Err(PlanningError::Precision);
    }
    let arguments: Vec<_> = (problems.inputs.iter()).map(|input| (*input, input_width(simulator, *input))).collect();
    if arguments.is_empty() {
        let known = choices(simulator).into_iter().map(Argument::name).collect();
        return Err(PlanningError::NoInputs { known });
    }
    let (lower, upper) = check(simulator, problems, &arguments)?;
    let instances = simulator.instances();
    // Of each knot, of problems that are solved at once: Jacobians, their model and policies, and the states of all trials; and of
    // the results of all problems.
    let (s, w) = (simulator.state_size(), arguments.iter().map(|(_, width)| width).sum::<usize>());
    let states = simulator.save_len() + size_of::<State>() / size_of::<f64>();
    let solving = 3 * s * (s + w) + 2 * (s + w) * (s + w) + 3 * w * s + (STEP_SIZES.len() + 4) * (states + w);
    let numbers = simulator.threads().min(instances) * solving + instances * (3 * w * s + states + w);
    memory::check("the trajectories (take a shorter horizon)", &[problems.horizon, numbers, size_of::<f64>()])
        .map_err(SimulatorError::from)?;
    let saved = simulator.save();
    let places: Vec<Mutex<Option<Result<Plan, PlanningError>>>> = (0..instances).map(|_| Mutex::new(None)).collect();
    for_each(0..instances, simulator.threads(), |i| {
        let start = saved[i * (saved.len() / instances)..][..saved.len() / instances].to_vec();
        let plan = optimize_one(simulator, problems, &arguments, (&lower, &upper), i, start);
        if let Ok(mut place) = places[i].lock() {
            *place = Some(plan);
        }
    });
    places.into_iter().map(|place| place.into_inner().ok().flatten().expect("every problem is solved")).collect()
}

fn optimize_one(
    simulator: &Simulator,
    problems: &Problems,
    arguments: &[(Argument, usize)],
    (lower, upper): (&[f64], &[f64]),
    i: usize,
    start: Vec<f64>,
) -> Result<Plan, PlanningError> {
    if interrupt::requested() {
        return Err(PlanningError::Diverged { problem: i });
    }
    let (scene, horizon) = (simulator.scene_of(i), problems.horizon);
    let w: usize = arguments.iter().map(|(_, width)| width).sum();
    let copies = |instances| {
        let options = SimulatorOptions {
            instances,
            threads: Some(1),
            error_estimate: Some(false),
            ..simulator.options().clone()
        };
        Simulator::new(scene.clone(), options)
    };
    let of_states = |all, width: usize| part(all, (horizon + 1) * width, i);
    let of_inputs = |all| part(all, horizon * w, i);
    let (joints, all) = (simulator.joints(), problems.numbers);
    let numbers = Numbers {
        references: of_states(all.references, reference_width(joints)),
        weights: of_states(all.weights, residuals(joints)),
        input_references: of_inputs(all.input_references),
        input_weights: of_inputs(all.input_weights),
        lower: of_inputs(lower),
        upper: of_inputs(upper),
    };
    let bounded = of_inputs(problems.start).iter().zip(numbers.lower.iter().zip(numbers.upper));
    let present =
        Trajectory { inputs: bounded.map(|(u, (low, high))| u.clamp(*low, *high)).collect(), ..Default::default() };
    let end_effector = EndEffector::new(scene);
    let cost = StateCost { end_effector: &end_effector, joints, thrusters: simulator.state_size() - 12 - 2 * joints };
    let mut problem = Tracking {
        numbers,
        cost,
        arguments,
        substeps: problems.substeps,
        trials: [copies(1)?, copies(STEP_SIZES.len() - 1)?],
        knots: copies(horizon)?,
        start,
        present,
        candidates: Vec::new(),
        error: None,
    };
    // The integrator may have no derivatives.
    problem.knots.step_jacobians(&Inputs::default(), 1, &[])?;
    let solution = solve(&mut problem, &problems.settings);
    if let Some(error) = problem.error {
        return Err(error.into());
    }
    let solution = solution.ok_or(PlanningError::Diverged { problem: i })?;
    let states = &problem.present.states;
    let end_effector = states.iter().map(|state| problem.cost.end_effector_position(state).into()).collect();
    Ok(Plan { end_effector, trajectory: problem.present, solution })
}

fn part(all: &[f64], width: usize, i: usize) -> &[f64] {
    &all[i * width..][..width]
}

/// Checks all numbers; bounds within the limits of actuators.
fn check(
    simulator: &Simulator,
    problems: &Problems,
    arguments: &[(Argument, usize)],
) -> Result<(Vec<f64>, Vec<f64>), PlanningError> {
    let (instances, joints) = (simulator.instances(), simulator.joints());
    let w: usize = arguments.iter().map(|(_, width)| width).sum();
    for (name, count) in [("horizon", problems.horizon), ("substeps", problems.substeps)] {
        if count == 0 {
            return Err(PlanningError::Count { name });
        }
    }
    let (states, steps) = (problems.horizon + 1, problems.horizon);
    type Allowed = (&'static str, fn(f64) -> bool);
    let finite: Allowed = ("finite", |x| x.is_finite());
    let weight: Allowed = ("finite and at least 0", |x| x.is_finite() && x >= 0.0);
    let input_weight: Allowed = ("finite and greater than 0", |x| x.is_finite() && x > 0.0);
    let bound: Allowed = ("a number", |x| !x.is_nan());
    let all = problems.numbers;
    let arrays = [
        ("references", all.references, states, reference_width(joints), finite),
        ("weights", all.weights, states, residuals(joints), weight),
        ("input references", all.input_references, steps, w, finite),
        ("input weights", all.input_weights, steps, w, input_weight),
        ("lower bounds", all.lower, steps, w, bound),
        ("upper bounds", all.upper, steps, w, bound),
        ("initial inputs", problems.start, steps, w, finite),
    ];
    for (name, values, knots, width, (allowed, holds)) in arrays {
        let (expected, got) = (instances * knots * width, values.len());
        if got != expected {
            return Err(PlanningError::Length { name, expected, got });
        }
        if let Some(at) = values.iter().position(|x| !holds(*x)) {
            let (problem, knot, entry) = (at / (knots * width), at / width % knots, at % width);
            return Err(PlanningError::Number { name, problem, knot, entry, value: values[at], allowed });
        }
    }
    let (mut lower, mut upper) = (all.lower.to_vec(), all.upper.to_vec());
    let entries: Vec<_> = arguments.iter().flat_map(|(name, width)| (0..*width).map(move |k| (*name, k))).collect();
    for at in 0..lower.len() {
        let (problem, knot, (argument, entry)) = (at / (steps * w), at / w % steps, entries[at % w]);
        let [minimum, most] = unsaturated(simulator, problem, argument, entry);
        lower[at] = lower[at].max(minimum);
        upper[at] = upper[at].min(most);
        if lower[at] > upper[at] {
            let (name, lower, upper) = (argument.name(), lower[at], upper[at]);
            return Err(PlanningError::Bounds { name, problem, knot, entry, lower, upper });
        }
    }
    Ok((lower, upper))
}
