//! Laws of resolved motion, on a plant that is its own model.

use std::rc::Rc;

use nalgebra::{Rotation3, Vector3, Vector6};

use super::{JOINT_TORQUES, actions, actuated, tracking_indices};
use uvms_gym::control::{
    ActionMap, ChainState, Controller, NominalModel, Plant, ResolvedMotion, ResolvedMotionGains, Velocities,
};
use uvms_gym::description::Scene;
use uvms_gym::dynamics::{ClosedFormModel, Loads};
use uvms_gym::system::{JOINTS, Joints, State};

const PERIOD: f64 = 0.1;
const SUBSTEPS: u32 = 50;
const N: usize = 5;

fn scene() -> Scene {
    Scene::shipped("petasus-pum").unwrap()
}

fn policy(gains: ResolvedMotionGains) -> ResolvedMotion {
    let plant = Plant { scene: &scene(), actions: actions(&scene(), &JOINT_TORQUES), period: PERIOD };
    ResolvedMotion::new(gains, tracking_indices(), plant).unwrap()
}

fn gains() -> ResolvedMotionGains {
    ResolvedMotionGains { pose_gain: 1.5, twist_gain: 4.0, joint_gain: 6.0, ..ResolvedMotionGains::default() }
}

/// Vehicle and arm in still water, and the pose error for small motions.
#[derive(Clone)]
struct Simulation {
    model: Rc<NominalModel>,
    map: Rc<ActionMap>,
    home: Joints,
    rotation: Rotation3<f64>,
    now: Motion,
}

/// State of vehicle and arm.
#[derive(Clone)]
struct Motion {
    error: Vector6<f64>,
    velocities: Velocities,
    up: Vector3<f64>,
    q: Joints,
}

impl Simulation {
    fn at_home() -> Self {
        let q = scene().home();
        let now = Motion { error: Vector6::zeros(), velocities: Velocities::zeros(), up: Vector3::z(), q };
        let (model, map) = (NominalModel::new(&scene()), actions(&scene(), &JOINT_TORQUES));
        Self { model: Rc::new(model), map: Rc::new(map), home: q, rotation: Rotation3::identity(), now }
    }

    fn observation(&self) -> Vec<f32> {
        let now = &self.now;
        let q = now.q.iter().zip(&self.home).map(|(q, home)| q - home);
        let (twist, rates) = now.velocities.as_slice()[..6 + N].split_at(6);
        let row = now.error.iter().chain(twist).chain(&now.up).copied().chain(q.take(N));
        row.chain(rates.iter().copied()).chain([0.0; 6]).map(|x| x as f32).collect()
    }

    /// Wrench and torques of an action within the actuators' limits.
    fn reached(&self, action: &[f32]) -> Velocities {
        let actuated = actuated(&self.map, action);
        let mut reached = Velocities::zeros();
        reached.fixed_rows_mut::<6>(0).copy_from_slice(&actuated.wrench.to_array());
        reached.fixed_rows_mut::<JOINTS>(6).copy_from_slice(&actuated.torques);
        reached
    }

    /// A control period under an effort and a load.
    fn pass(&mut self, effort: &Velocities, load: &Velocities) {
        let (now, dt) = (&mut self.now, PERIOD / f64::from(SUBSTEPS));
        for _ in 0..SUBSTEPS {
            let at = ChainState { up: &now.up, q: &now.q, velocities: &now.velocities };
            let equations = self.model.equations(at, 0.0);
            now.velocities += equations.solve(&(effort + load - equations.bias)) * dt;
            now.error += equations.jacobian * now.velocities * dt;
            (0..N).for_each(|k| now.q[k] += now.velocities[6 + k] * dt);
            let turn = now.velocities.fixed_rows::<3>(3) * dt;
            self.rotation *= Rotation3::from_scaled_axis(turn);
            now.up = self.rotation.inverse() * Vector3::z();
        }
    }
}

/// A closed loop with measurements `late` periods old. Gives the root mean square of the pose error over the second
/// half, the error at the end, and the memory.
fn closed_loop(
    policy: &ResolvedMotion,
    start: Simulation,
    load: &Velocities,
    late: usize,
    periods: usize,
) -> (f64, f64, Vec<f64>) {
    let widths = policy.widths();
    let (mut plant, mut memory, mut action) = (start, vec![0.0; widths.memory], vec![0.0; widths.action]);
    let mut seen = vec![plant.observation()];
    let mut sum = 0.0;
    for k in 0..periods {
        policy.act(&seen[seen.len().saturating_sub(1 + late)], &mut memory, &mut action).unwrap();
        plant.pass(&plant.reached(&action), load);
        seen.push(plant.observation());
        if k >= periods / 2 {
            sum += plant.now.error.norm_squared();
        }
    }
    ((sum / (periods - periods / 2) as f64).sqrt(), plant.now.error.norm(), memory)
}

fn load() -> Velocities {
    let mut load = Velocities::zeros();
    load.as_mut_slice()[..11].copy_from_slice(&[20.0, -10.0, 8.0, 2.0, -3.0, 1.5, 1.0, -1.0, 0.3, 0.1, 0.005]);
    load
}

/// Numbers in [-1, 1) that look random.
fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

#[test]
fn without_errors_all_velocities_die_out_at_their_gains() {
    let gains = ResolvedMotionGains { posture_gain: 0.0, levelling_gain: 0.0, ..ResolvedMotionGains::default() };
    let (policy, balance, mut draw) = (policy(gains), ClosedFormModel::new(&scene()).unwrap(), noise(3));
    for _ in 0..10 {
        let mut plant = Simulation::at_home();
        plant.rotation = Rotation3::from_euler_angles(0.05 * draw(), 0.05 * draw(), 0.0);
        plant.now.up = plant.rotation.inverse() * Vector3::z();
        for k in 0..6 + N {
            plant.now.velocities[k] = 0.02 * draw();
        }
        // The observation is rounded to single precision.
        let mut action = vec![0.0; 11];
        policy.act(&plant.observation(), &mut [], &mut action).unwrap();
        let effort = plant.reached(&action);
        let mut state = State { rotation: plant.rotation.into_inner(), q: plant.now.q, ..State::default() };
        state.twist = plant.now.velocities.fixed_rows::<6>(0).into_owned();
        state.qd[..N].copy_from_slice(&plant.now.velocities.as_slice()[6..6 + N]);
        let mut external = vec![Vector6::zeros(); 1 + N];
        external[0] = effort.fixed_rows::<6>(0).into_owned();
        let loads = Loads { external: &external, joint_command: &effort.as_slice()[6..6 + N], ..Loads::default() };
        let accelerations = balance.at(&state, Vector3::zeros()).accelerations(&loads).unwrap();
        for k in 0..6 + N {
            let gain = if k < 6 { 6.0 } else { 10.0 };
            assert!((accelerations[k] + gain * plant.now.velocities[k]).abs() < 2e-4, "{k}");
        }
    }
}

#[test]
fn the_observer_finds_a_constant_force_and_the_error_vanishes() {
    let with = |observer_bandwidth, delay| ResolvedMotionGains { observer_bandwidth, delay, ..gains() };
    let (_, plain, _) = closed_loop(&policy(gains()), Simulation::at_home(), &load(), 0, 150);
    assert!(plain > 0.02, "{plain}");
    for delay in [0, 1, 2] {
        let policy = policy(with([3.0, 3.0, 3.0], delay));
        let (_, error, memory) = closed_loop(&policy, Simulation::at_home(), &load(), delay, 150);
        let found = &memory[1 + 6 + N..][..6 + N];
        for k in 0..6 + N {
            let scale = if k < 6 { 1.0 } else { JOINT_TORQUES[k - 6] };
            assert!((found[k] - load()[k]).abs() < 1e-2 * scale, "delay {delay}, {k}: {} of {}", found[k], load()[k]);
        }
        assert!(error < 0.05 * plain, "delay {delay}: {error}");
    }
}

#[test]
fn the_integral_takes_out_what_a_constant_force_leaves_and_does_not_wind_up() {
    let policy = policy(ResolvedMotionGains { integral_gain: 0.5, ..gains() });
    let (_, error, _) = closed_loop(&policy, Simulation::at_home(), &load(), 0, 300);
    assert!(error < 2e-3, "{error}");
    // More than the thrusters reach.
    let mut plant = Simulation::at_home();
    plant.now.error[0] = 20.0;
    let (mut memory, mut action) = (vec![0.0; 6], vec![0.0; 11]);
    for _ in 0..1000 {
        policy.act(&plant.observation(), &mut memory, &mut action).unwrap();
    }
    assert!(memory[0] <= PERIOD * 20.0 * (1.0 + 1e-6), "{memory:?}");
    // It turns at once.
    let before = memory[0];
    plant.now.error[0] = -20.0;
    policy.act(&plant.observation(), &mut memory, &mut action).unwrap();
    assert!(memory[0] < before);
}

#[test]
fn a_prediction_makes_up_for_the_delay() {
    let fast = ResolvedMotionGains { pose_gain: 2.5, twist_gain: 5.0, joint_gain: 6.0, ..gains() };
    let mut start = Simulation::at_home();
    start.now.error[1] = 0.1;
    start.now.velocities[0] = 0.2;
    let run = |delay, late| {
        let policy = policy(ResolvedMotionGains { delay, ..fast.clone() });
        closed_loop(&policy, start.clone(), &Velocities::zeros(), late, 60).0
    };
    let (prompt, blind, predicted) = (run(0, 0), run(0, 3), run(3, 3));
    assert!(predicted < 3.0 * prompt.max(1e-4), "{predicted} {prompt}");
    assert!(blind > 10.0 * predicted, "{blind} {predicted}");
}
