//! Docking: the vehicle approaches a dock, and rests in it: a cradle that it touches, or a pose that sways with the waves.

use std::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::Vector3 as Vector;
use serde::{Deserialize, Serialize};

use super::arm_reference;
use super::bounds::{SPEED_BOUND, bounded_length};
use super::contact_force::{FORCE_ROWS, contact_force, record_force};
use super::cradle::{self, Hull};
use super::definition::{BaseController, ControlInstant, EpisodeStart, TaskDefinition, TaskKernel};
use super::disturbance::WaveOrbit;
use super::episode::{EpisodeRows, RowAllocator, TaskRows};
use super::metrics::{Metrics, OWN_METRICS, continues, padded};
use super::model::TaskModel;
use super::options::{TaskOptions, Tolerance, check_non_negative, check_range};
use super::pose::Pose;
use super::random::Stream;
use super::reward::RewardWeights;
use super::settings::settings;
use crate::description::Scene;
use crate::error::TaskError;
use crate::lane::{Lane, Real, Rows, Shared};
use crate::lie::{self, Matrix3, Vector3, Vector6, exp_se3};
use crate::system::{System, compile};

/// Kind of dock.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DockKind {
    /// A rigid cradle at the world's origin, which the vehicle touches.
    #[default]
    Cradle,
    /// A pose that moves with the waves, without contact.
    Floating,
}

/// Motion of the arm while docking.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DockArm {
    /// The joints stay at home.
    #[default]
    Stowed,
    /// The joints follow references, as in station keeping.
    Moving,
}

settings! {
    /// Docking.
    pub struct Dock {
        /// Kind of dock.
        dock: DockKind = DockKind::Cradle;
        /// Minimum initial distance from the dock, m; `start_distance` is the maximum.
        start_clearance: f64 = 2.0;
        /// Half angle of the cone in front of the dock that starts are drawn from, rad.
        approach_cone: f64 = 0.4;
        /// Motion of the arm.
        arm: DockArm = DockArm::Stowed;
        /// Maximum amplitude of a moving arm's reference about home, rad (a quarter of it in metres for prismatic joints).
        arm_amplitude: f64 = 0.4;
        /// Horizontal motion of the dock relative to the water's motion at its place.
        dock_sway: f64 = 0.5;
        /// Vertical motion of the dock relative to the water's motion at its place.
        dock_heave: f64 = 0.5;
        /// Tilt of the dock relative to the wave slope at its place.
        dock_tilt: f64 = 0.5;
        /// Speed relative to the dock below which the vehicle counts as holding, m/s.
        hold_speed: f64 = 0.1;
        /// Duration within the tolerances at low relative speed until the vehicle counts as docked, s.
        hold_time: f64 = 2.0;
        /// Distance from the dock at whose first crossing the approach speed is taken, m.
        capture_distance: f64 = 0.5;
        /// Reward per control period while docked.
        docked_reward: f64 = 0.5;
        /// Weight of the relative speed near the dock in the reward.
        speed_weight: f64 = 0.1;
        /// The first docking ends the episode.
        terminate_on_success: bool = false;
    }
}

super::metrics::metrics! {
    /// Metrics of docking.
    struct DockMetrics {
        /// 1 while the vehicle has been within the tolerances at low relative speed for the hold time, else 0.
        docked,
        /// Time from the start to the first docking, s; the time so far before it.
        time_to_dock,
        /// Relative speed at the first crossing of the capture distance, m/s; 0 before it.
        approach_speed,
        /// Sum of the normal forces of all contacts, N.
        contact_force,
        /// Its maximum over the control instants so far, N.
        peak_force,
        /// Its integral, N s.
        impulse,
        /// Reward term of the relative speed near the dock and of being docked.
        reward_docking,
    }
}

/// Offsets of the task's own rows: pose of the dock in still water (12) and its twist in world axes (6), duration of the
/// hold (s), docked, any docking so far, time to the first one (s), capture so far, approach speed (m/s), reward term, record of the
/// force.
const REST: usize = 0;
const MOTION: usize = 12;
const HOLD: usize = 18;
const DOCKED: usize = 19;
const SUCCESS: usize = 20;
const TIME: usize = 21;
const APPROACH_SPEED: usize = 23;
const REWARD: usize = 24;
const FORCE: usize = 25;
const ROWS: usize = FORCE + FORCE_ROWS;

/// Sum of the normal forces above which a vehicle in a cradle counts as holding, N.
const HOLD_FORCE: f64 = 1.0;
/// Maximum force that counts, N.
const FORCE_BOUND: f64 = 1e6;

/// Numbers of the kernel.
#[derive(Debug, Clone, PartialEq)]
pub struct DockKernel<T> {
    own: usize,
    /// System of a scene with contact.
    system: Option<System<Shared<T>>>,
    sway: T,
    heave: T,
    tilt: T,
    hold_speed: T,
    hold_force: T,
    /// Hold time minus half a control period, s.
    hold_time: T,
    capture_distance: T,
    docked_reward: T,
    speed_weight: T,
    terminate_on_success: bool,
}

impl Dock {
    /// True for a dock that the vehicle touches.
    pub fn touches(&self) -> bool {
        self.dock == DockKind::Cradle
    }
}

impl TaskDefinition for Dock {
    const NAME: &'static str = "dock";
    const ENVIRONMENT: &'static str = "UVMS-Dock";
    const OBSERVES_UP: bool = true;
    const BASE: BaseController = BaseController::DockPd;
    const TWIST: [(&'static str, &'static str); 2] = [
        ("relative_velocity", "velocity of the vehicle origin less that of the dock, body axes"),
        ("relative_angular_velocity", "angular velocity less that of the dock, body axes"),
    ];
    const MEASURED_INPUTS: usize = 0;
    const REWARD_SCALE: f64 = 2.0;
    const METRICS: &'static [&'static str] = &DockMetrics::NAMES;

    type Kernel<T: Real> = DockKernel<T>;

    /// Divergence costs as much as 370 steps at 5 m from the dock, so ending the episode early seldom pays.
    fn defaults() -> TaskOptions {
        let options = TaskOptions::default();
        TaskOptions {
            start_distance: 5.0,
            start_angle: 0.3,
            reward: RewardWeights { diverged: 500.0, ..options.reward },
            tolerance: Tolerance { position: 0.1, attitude: 0.15 },
            ..options
        }
    }

    fn check(&self, start_distance: f64) -> Result<(), TaskError> {
        let (clearance, cone) = (self.start_clearance, self.approach_cone);
        check_range(
            "start_clearance",
            clearance,
            (0.0..=start_distance).contains(&clearance),
            "in [0, start_distance] m",
        )?;
        check_range("approach_cone", cone, (0.0..=FRAC_PI_2).contains(&cone), "in [0, pi/2] rad")?;
        for (name, value) in
            [("dock_sway", self.dock_sway), ("dock_heave", self.dock_heave), ("dock_tilt", self.dock_tilt)]
        {
            check_range(name, value, (0.0..=1.0).contains(&value), "in [0, 1]")?;
        }
        check_non_negative(&[
            ("arm_amplitude", self.arm_amplitude),
            ("hold_speed", self.hold_speed),
            ("hold_time", self.hold_time),
            ("capture_distance", self.capture_distance),
            ("docked_reward", self.docked_reward),
            ("speed_weight", self.speed_weight),
        ])
    }

    fn place(&self, scene: Scene) -> Result<Scene, TaskError> {
        if self.touches() { cradle::place(scene) } else { Ok(scene) }
    }

    fn rows(&self, model: &TaskModel, rows: &mut RowAllocator) -> TaskRows {
        let own = rows.take(ROWS);
        TaskRows { own, updated: [own + HOLD, ROWS - HOLD], ..arm_reference::rows(model, rows) }
    }

    fn kernel<T: Real>(&self, options: &TaskOptions, model: &TaskModel, rows: &EpisodeRows) -> DockKernel<T> {
        let number = T::from_f64;
        let system = compile(&model.scene).system.map(|Shared(x)| Shared(number(x)));
        // A cradle does not move.
        let follows = |share: f64| number(if self.touches() { 0.0 } else { share });
        DockKernel {
            own: rows.task.own,
            system: system.contact.is_some().then_some(system),
            sway: follows(self.dock_sway),
            heave: follows(self.dock_heave),
            tilt: follows(self.dock_tilt),
            hold_speed: number(self.hold_speed),
            hold_force: number(if self.touches() { HOLD_FORCE } else { -1.0 }),
            hold_time: number(self.hold_time - 0.5 * options.control_period()),
            capture_distance: number(self.capture_distance),
            docked_reward: number(self.docked_reward),
            speed_weight: number(self.speed_weight),
            terminate_on_success: self.terminate_on_success,
        }
    }

    /// Uniform distance within a cone in front of the dock (its -x side), facing the dock up to a heading error; always in front of the
    /// entrance of a cradle.
    fn start_pose(&self, options: &TaskOptions, model: &TaskModel, target: &Pose, draw: &Stream) -> Pose {
        let distance = draw.uniform_in(0, self.start_clearance, options.start_distance);
        let (angle, around) = (self.approach_cone * draw.uniform(1).sqrt(), TAU * draw.uniform(2));
        let (across, up) = (angle.sin() * around.cos(), angle.sin() * around.sin());
        let heading = draw.uniform_in(3, -options.start_angle, options.start_angle);
        let mut position = target.position - target.rotation * Vector::new(angle.cos(), across, up) * distance;
        if self.touches() {
            position.x = position.x.min(Hull::start(&model.scene));
        }
        Pose { position, rotation: Pose::turn(model.level[2] * heading).rotation * target.rotation }
    }

    fn sample(&self, kernel: &TaskKernel<f64, Self>, start: &EpisodeStart<'_>, memory: &mut Rows<'_, f64>) {
        let amplitude = if self.arm == DockArm::Moving { self.arm_amplitude } else { 0.0 };
        arm_reference::sample(kernel, start, amplitude, memory);
        if self.touches() {
            kernel.rows.set_target::<f64>(memory, &lie::Pose::identity());
        }
        let target: [f64; 12] = memory.get_all(kernel.rows.target);
        memory.set_all(kernel.task.own + REST, &target);
    }

    #[inline(always)]
    fn begin<L: Lane>(kernel: &TaskKernel<L::Real, Self>, memory: &mut Rows<'_, L::Real>) {
        arm_reference::begin::<L, Self>(kernel, memory);
        set_target::<L>(kernel, memory);
    }

    #[inline(always)]
    fn advance<L: Lane>(kernel: &TaskKernel<L::Real, Self>, memory: &mut Rows<'_, L::Real>) {
        arm_reference::advance::<L, Self>(kernel, memory);
        set_target::<L>(kernel, memory);
    }

    #[inline(always)]
    fn twist<L: Lane>(at: &ControlInstant<'_, L, Self>) -> Vector6<L> {
        let [vx, vy, vz, wx, wy, wz]: [L; 6] = at.memory.get_all(at.kernel.task.own + MOTION);
        let rotation = &at.state.pose.rotation;
        Vector6 {
            linear: at.state.twist.linear - rotation.apply_transposed(Vector3([vx, vy, vz])),
            angular: at.state.twist.angular - rotation.apply_transposed(Vector3([wx, wy, wz])),
        }
    }

    #[inline(always)]
    fn update<L: Lane>(at: &mut ControlInstant<'_, L, Self>, metrics: &Metrics<L>) -> L {
        let (task, zero, one, half) = (&at.kernel.task, L::zero(), L::c(1.0), L::c(0.5));
        let mut force = zero;
        if let Some(system) = &task.system {
            force = contact_force(at, system);
            force = record_force(at, task.own + FORCE, force, FORCE_BOUND);
        }
        let (period, own) = (L::splat(at.kernel.period), task.own);
        let speed = bounded_length(Self::twist(at).linear, SPEED_BOUND);
        let [hold, _, success, time, captured, approach]: [L; 6] = at.memory.get_all(own + HOLD);

        let slow = L::and(half.lt(metrics.success), speed.lt(L::splat(task.hold_speed)));
        let holds = L::and(slow, L::splat(task.hold_force).lt(force));
        let hold = L::select(holds, hold + period, zero);
        let docked = L::select(L::and(holds, L::splat(task.hold_time).lt(hold)), one, zero);
        let time = L::select(half.lt(success), time, time + period);
        let success = success.max(docked);

        let near = metrics.position_error.lt(L::splat(task.capture_distance));
        let approach = L::select(half.lt(captured), approach, L::select(near, speed, zero));
        let captured = L::select(near, one, captured);

        // Relative speed near the dock: smooth in both, and at most the weight.
        let distance = metrics.pose_error * L::c(1.0 / NEAR);
        let closeness = one / distance.mul_add(distance, one);
        let fast = speed / (speed + L::splat(task.hold_speed) + L::c(MIN_SPEED));
        let reward = docked * L::splat(task.docked_reward) - closeness * fast * L::splat(task.speed_weight);
        at.memory.set_all(own + HOLD, &[hold, docked, success, time, captured, approach, reward]);
        reward
    }

    #[inline(always)]
    fn own_metrics<L: Lane>(at: &ControlInstant<'_, L, Self>, metrics: &mut Metrics<L>) -> [L; OWN_METRICS] {
        let (memory, own) = (&at.memory, at.kernel.task.own);
        metrics.success = memory.get(own + SUCCESS);
        let mut dock = DockMetrics::<L>::zero();
        dock.docked = memory.get(own + DOCKED);
        dock.time_to_dock = memory.get(own + TIME);
        dock.approach_speed = memory.get(own + APPROACH_SPEED);
        [dock.contact_force, dock.peak_force, dock.impulse] = memory.get_all(own + FORCE);
        dock.reward_docking = memory.get(own + REWARD);
        padded(dock.to_array())
    }

    #[inline(always)]
    fn continues<L: Lane>(kernel: &TaskKernel<L::Real, Self>, metrics: &Metrics<L>, in_bounds: L::Mask) -> L::Mask {
        continues(metrics, in_bounds, kernel.task.terminate_on_success)
    }
}

/// Pose error at which the reward's weight of the relative speed has fallen to a half, m.
const NEAR: f64 = 0.5;
/// Keeps the reward's speed term finite without a hold speed, m/s.
const MIN_SPEED: f64 = 1e-3;

/// Sets the target and its twist to the dock's: its pose in still water, displaced and tilted by the waves.
#[inline(always)]
fn set_target<L: Lane>(kernel: &TaskKernel<L::Real, Dock>, memory: &mut Rows<'_, L::Real>) {
    let task = &kernel.task;
    let [xx, xy, xz, yx, yy, yz, zx, zy, zz, x, y, z]: [L; 12] = memory.get_all(task.own + REST);
    let (rest, place) = (Matrix3([[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]]), Vector3([x, y, z]));
    let orbit = match kernel.disturbance() {
        Some(disturbance) => disturbance.wave_orbit(memory, place),
        None => WaveOrbit::zero(),
    };
    let up = Vector3([L::splat(kernel.up[0]), L::splat(kernel.up[1]), L::splat(kernel.up[2])]);
    let velocity = followed_motion(task, orbit.velocity, up);
    let tilt = L::splat(task.tilt);
    // The left Jacobian of the rotation vector turns its rate into an angular velocity, as it does in the exponential.
    let turn = exp_se3(Vector6 { linear: orbit.slope_rate.scale(tilt), angular: orbit.slope.scale(tilt) });
    let target = lie::Pose {
        rotation: turn.rotation.times(&rest),
        position: place + followed_motion(task, orbit.displacement, up),
    };
    kernel.rows.set_target(memory, &target);
    memory.set_all(task.own + MOTION, &velocity.0);
    memory.set_all(task.own + MOTION + 3, &turn.position.0);
}

/// Motion of the dock for one of the water: its horizontal and vertical parts by their factors.
#[inline(always)]
fn followed_motion<L: Lane>(task: &DockKernel<L::Real>, water: Vector3<L>, up: Vector3<L>) -> Vector3<L> {
    let vertical = up.scale(water.dot(up));
    (water - vertical).scale(L::splat(task.sway)) + vertical.scale(L::splat(task.heave))
}
