//! Turning a valve with the end effector.

use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use serde::{Deserialize, Serialize};

use super::bounds::{POSITION_BOUND, shorter};
use super::definition::{BaseController, ControlInstant, EpisodeStart, Frame as TaskFrame, TaskDefinition, TaskKernel};
use super::disturbance::MEASURED;
use super::episode::{EpisodeRows, RowAllocator, TaskRows};
use super::manipulation::{self, FORCE, Manipulates, ManipulationKernel, Observes, REWARD, SHARED_ROWS, ToolReading};
use super::metrics::{Metrics, OWN_METRICS, continues, padded};
use super::model::TaskModel;
use super::observation::{ObservationLayout, ObservationWriter};
use super::options::{TaskOptions, check_non_negative, check_range};
use super::reward::RewardWeights;
use super::settings::settings;
use super::tool_path::{Stroke, ToolPath};
use super::workplace::{Workplace, facing};
use crate::description::{ContactGeometry, Frame, Friction, Joint, JointKind, JointLimits, Scene};
use crate::error::TaskError;
use crate::lane::{Lane, Real, Rows};
use crate::lie::Vector3 as LaneVector;

/// Tool and condition of success.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ValveContract {
    /// One finger pushes the handle round; success is a turn by 170 degrees.
    #[default]
    Push,
    /// Two fingers turn the handle between them, stop it within 170 to 175 degrees, and leave it.
    Grasp,
}

settings! {
    /// Turning a valve.
    pub struct Valve {
        /// Tool and condition of success.
        contract: ValveContract = ValveContract::Push;
        /// Coulomb friction of the valve, N m.
        torque: f64 = 0.012;
        /// Viscous friction, N m s/rad.
        damping: f64 = 0.08;
        /// Turn from stop to stop, rad.
        range: f64 = 3.22;
        /// Distance of the fingers from the valve's axis, m.
        radius: f64 = 0.059;
        /// Distance of the fingers from the middle of the handle at home, along the valve's axis, m.
        standoff: f64 = 0.12;
        /// Duration of the approach, which begins after a second, s.
        approach_time: f64 = 4.0;
        /// Duration of the turn, s.
        turn_time: f64 = 20.0;
        /// Reward per control period from success on.
        success_reward: f64 = 0.5;
        /// Angle and rate of the valve are observed.
        observe_fixture: bool = false;
        /// The force on the tool is observed.
        observe_force: bool = false;
        /// Success ends the episode.
        terminate_on_success: bool = false;
    }
}

super::metrics::metrics! {
    /// Metrics of turning a valve.
    struct ValveMetrics {
        /// Angle of the valve, rad.
        angle,
        /// Turn while no two opposed fingers touched the handle, rad.
        slip,
        /// Time from the start to success, s; the time so far before it.
        time_to_success,
        /// Sum of the normal forces of all contacts, N.
        contact_force,
        /// Its maximum over the control instants so far, N.
        peak_force,
        /// Its integral, N s.
        impulse,
        /// Reward term of success.
        reward_success,
    }
}

/// Lengths of the handle along the bar, across it and along the valve's axis, m.
const HANDLE: [f64; 3] = [0.15, 0.012, 0.02];
/// Distance of the panel behind the middle of the handle, m.
const PANEL: f64 = 0.07;
/// Inertia of the handle and its stem, kg m2.
const INERTIA: f64 = 0.02;
/// Speed over which Coulomb friction is smoothed, rad/s.
const FRICTION_SPEED: f64 = 0.1;
/// Stiffness (N m/rad) and damping (N m s/rad) of the stops.
const STOP: [f64; 2] = [100.0, 2.0];
/// Angle between a finger and the handle at the start, beyond that at which they touch, rad.
const CLEARANCE: f64 = 0.1;

/// Angle that counts as turned, and the middle and half width of the range in which a grasped valve has to stop, rad.
const TURNED: f64 = 170.0 * DEGREE;
const STOP_ANGLE: [f64; 2] = [172.5 * DEGREE, 2.5 * DEGREE];
/// Minimum turn by two opposed fingers, and maximum turn otherwise, rad.
const GRASPED: f64 = 165.0 * DEGREE;
const SLIPPED: f64 = 5.0 * DEGREE;
/// Minimum normal force of a finger, N, and maximum cosine of the angle between two opposed ones.
const FINGER_FORCE: f64 = 0.1;
const OPPOSED: f64 = -0.25;
/// Maximum rate of the valve, rad/s, and maximum speed of the tool, m/s, for a valve at rest, and for how long, s.
const REST: [f64; 3] = [0.05, 0.025, 1.0];
/// Clearance of the released tool, m, and for how long, s.
const RELEASE: [f64; 2] = [0.08, 0.5];
const DEGREE: f64 = std::f64::consts::PI / 180.0;
/// Angle of the valve to which the reference pushes and turns it, rad.
const PUSH_ANGLE: f64 = 175.0 * DEGREE;

/// Offsets of the task's own rows: angle at the last control instant, turn by two opposed fingers and otherwise (rad), brought to rest so
/// far, duration of the release (s).
const LAST: usize = SHARED_ROWS;
const OWN_ROWS: usize = 5;

/// Numbers of the kernel.
#[derive(Debug, Clone, PartialEq)]
pub struct ValveKernel<T> {
    shared: ManipulationKernel<T>,
    contract: ValveContract,
    /// Number of spheres of the tool.
    fingers: usize,
    success_reward: T,
    /// Half a control period, s.
    half_period: T,
    terminate_on_success: bool,
}

/// The valve in front of a robot.
struct Layout {
    /// Middle of the handle, m, and direction of the bar.
    center: Vector3<f64>,
    bar: Vector3<f64>,
    path: ToolPath,
}

impl Valve {
    fn observes(&self) -> Observes {
        Observes { fixture: self.observe_fixture, force: self.observe_force }
    }

    /// Places of the fingers relative to the end effector at home, m.
    fn fingers(&self) -> Vec<Vector3<f64>> {
        match self.contract {
            ValveContract::Push => vec![Vector3::zeros()],
            ValveContract::Grasp => vec![Vector3::y() * self.radius, Vector3::y() * -self.radius],
        }
    }

    /// Where the valve is, and how the end effector turns it.
    fn layout_of(&self, work: &Workplace) -> Result<Layout, TaskError> {
        let axis = Workplace::axis();
        let (first, tip) = work.tool[0];
        // Middle of the tool at home, and its first finger from there, across the axis.
        let middle = match self.contract {
            ValveContract::Push => first - Vector3::y() * self.radius,
            ValveContract::Grasp if work.tool.len() == 2 => (first + work.tool[1].0) * 0.5,
            ValveContract::Grasp => {
                return work
                    .refuse(format!("to grasp the valve takes 2 fingers, but its tool has {}", work.tool.len()));
            }
        };
        let finger = first - middle;
        let across = finger - axis * axis.dot(&finger);
        let reach = across.norm();
        let touching = (HANDLE[1] / 2.0 + tip) / reach;
        if touching.is_nan() || touching >= 1.0 {
            return work
                .refuse(format!("its fingers are {reach} m from the valve's axis, too near to turn the handle"));
        }
        let lead = CLEARANCE + touching.asin();
        let bar = Rotation3::from_axis_angle(&Unit::new_unchecked(axis), lead) * (across / reach);
        let turn_start = 1.0 + self.approach_time;
        let stroke = |start, duration, advance, turn| Stroke { start, duration, advance, turn };
        let mut strokes = vec![stroke(1.0, self.approach_time, self.standoff, 0.0)];
        let origin = work.end_effector.position;
        let (turns, lever) = match self.contract {
            ValveContract::Push => (false, across),
            ValveContract::Grasp => (true, origin - middle),
        };
        let angle = if turns { STOP_ANGLE[0] } else { PUSH_ANGLE };
        strokes.push(stroke(turn_start, self.turn_time, 0.0, CLEARANCE + angle));
        if turns {
            strokes.push(stroke(turn_start + self.turn_time + 2.0, self.approach_time, -self.standoff, 0.0));
        }
        let rotation = work.end_effector.rotation;
        let path = ToolPath { axis, origin: origin - lever, lever, rotation, turns, strokes };
        Ok(Layout { center: middle + axis * self.standoff, bar, path })
    }
}

impl Manipulates for Valve {
    #[inline(always)]
    fn shared<T: Real>(kernel: &ValveKernel<T>) -> &ManipulationKernel<T> {
        &kernel.shared
    }
}

impl TaskDefinition for Valve {
    const NAME: &'static str = "valve";
    const ENVIRONMENT: &'static str = "UVMS-Valve";
    const FRAME: TaskFrame = TaskFrame::EndEffector;
    const DRIVES_JOINTS: bool = true;
    const KEEPS_SERVO_DAMPING: bool = false;
    const OBSERVES_UP: bool = true;
    const BASE: BaseController = BaseController::ResolvedMotion;
    const MEASURED_INPUTS: usize = 0;
    const METRICS: &'static [&'static str] = &ValveMetrics::NAMES;

    type Kernel<T: Real> = ValveKernel<T>;

    fn defaults() -> TaskOptions {
        let options = TaskOptions::default();
        let reward = RewardWeights { diverged: 100.0, ..options.reward };
        TaskOptions { dt: 0.005, substeps: 10, reward, ..options }
    }

    fn check(&self, _start_distance: f64) -> Result<(), TaskError> {
        check_range("standoff", self.standoff, (0.1..=1.0).contains(&self.standoff), "in [0.1, 1] m")?;
        let longest = HANDLE[0] / 2.0;
        check_range("radius", self.radius, (0.02..=longest).contains(&self.radius), "in [0.02, 0.075] m")?;
        check_range("range", self.range, (0.0..=10.0).contains(&self.range), "in [0, 10] rad")?;
        check_range("torque", self.torque, (0.0..=100.0).contains(&self.torque), "in [0, 100] N m")?;
        check_non_negative(&[
            ("approach_time", self.approach_time),
            ("turn_time", self.turn_time),
            ("damping", self.damping),
            ("success_reward", self.success_reward),
        ])
    }

    fn place(&self, scene: Scene) -> Result<Scene, TaskError> {
        let mut work = Workplace::new(scene, &self.fingers())?;
        let Layout { center, bar, .. } = self.layout_of(&work)?;
        let joint = Joint {
            kind: JointKind::Revolute,
            axis: Vector3::z(),
            rotor_inertia: INERTIA,
            friction: Friction {
                viscous: self.damping,
                coulomb: self.torque,
                coulomb_speed: FRICTION_SPEED,
                ..Friction::default()
            },
            limits: Some(JointLimits { lower: 0.0, upper: self.range, stiffness: STOP[0], damping: STOP[1] }),
            ..Joint::fixed(facing(center, bar))
        };
        let handle = ContactGeometry::Box { size: Vector3::from(HANDLE) };
        work.add("valve", joint, vec![("handle", Frame::new(Vector3::zeros(), &Matrix3::identity()), handle)], PANEL)?;
        Ok(work.scene)
    }

    fn layout(&self, _options: &TaskOptions, model: &TaskModel, layout: &mut ObservationLayout) {
        manipulation::layout(model, self.observes(), layout);
    }

    fn rows(&self, _model: &TaskModel, rows: &mut RowAllocator) -> TaskRows {
        manipulation::rows(rows, OWN_ROWS)
    }

    fn kernel<T: Real>(&self, options: &TaskOptions, model: &TaskModel, rows: &EpisodeRows) -> ValveKernel<T> {
        let work = Workplace::of(model.scene.clone());
        let path = self.layout_of(&work).expect("the scene has been placed").path;
        ValveKernel {
            fingers: work.tool.len(),
            shared: manipulation::kernel(model, rows, &work, &path, self.observes()),
            contract: self.contract,
            success_reward: T::from_f64(self.success_reward),
            half_period: T::from_f64(0.5 * options.control_period()),
            terminate_on_success: self.terminate_on_success,
        }
    }

    fn sample(&self, _kernel: &TaskKernel<f64, Self>, _start: &EpisodeStart<'_>, _memory: &mut Rows<'_, f64>) {}

    #[inline(always)]
    fn begin<L: Lane>(kernel: &TaskKernel<L::Real, Self>, memory: &mut Rows<'_, L::Real>) {
        manipulation::begin::<L, Self>(kernel, memory);
    }

    #[inline(always)]
    fn advance<L: Lane>(kernel: &TaskKernel<L::Real, Self>, memory: &mut Rows<'_, L::Real>) {
        manipulation::advance::<L, Self>(kernel, memory);
    }

    #[inline(always)]
    fn observe<L: Lane>(
        at: &ControlInstant<'_, L, Self>,
        _measured: &[L; MEASURED],
        writer: &mut ObservationWriter<'_, L::Real>,
    ) {
        manipulation::observe(at, writer);
    }

    #[inline(always)]
    fn in_bounds<L: Lane>(at: &ControlInstant<'_, L, Self>) -> L::Mask {
        manipulation::in_bounds(at, shorter(at.error.position, POSITION_BOUND))
    }

    #[inline(always)]
    fn update<L: Lane>(at: &mut ControlInstant<'_, L, Self>, _metrics: &Metrics<L>) -> L {
        let reading = manipulation::read(at);
        manipulation::record_force(at, &reading);
        let task = &at.kernel.task;
        let (zero, one, half) = (L::zero(), L::c(1.0), L::c(0.5));
        let (own, half_period) = (task.shared.own, L::splat(task.half_period));
        let (angle, rate) = (manipulation::fixture_coordinate(at), at.state.qd[task.shared.fixture]);

        let [last, grasped, slip, rested, released]: [L; OWN_ROWS] = at.memory.get_all(own + LAST);
        let by = angle - last;
        let held = half.lt(opposed(&reading, task.fingers));
        let counts = half.lt(rested);
        let grasped = L::select(held, grasped + by, grasped);
        let slip = L::select(held, slip, L::select(counts, slip, slip + by.abs()));

        let within = (angle - L::c(STOP_ANGLE[0])).abs().lt(L::c(STOP_ANGLE[1]));
        let slow = L::and(rate.abs().lt(L::c(REST[0])), tool_speed(&reading, task.fingers).lt(L::c(REST[1])));
        let turned = L::and(L::c(GRASPED).lt(grasped), slip.lt(L::c(SLIPPED)));
        let held_for = manipulation::record_hold(at, L::and(L::and(within, slow), turned));
        let rested = L::select((L::c(REST[2]) - half_period).lt(held_for), one, rested);

        let clear = L::and(L::c(RELEASE[0]).lt(clearance(&reading, task.fingers)), L::and(within, half.lt(rested)));
        let released = L::select(clear, released + half_period + half_period, zero);
        at.memory.set_all(own + LAST, &[angle, grasped, slip, rested, released]);

        let succeeds = match task.contract {
            ValveContract::Push => L::c(TURNED).lt(angle),
            ValveContract::Grasp => (L::c(RELEASE[1]) - half_period).lt(released),
        };
        manipulation::record_success(at, succeeds, L::splat(task.success_reward))
    }

    #[inline(always)]
    fn own_metrics<L: Lane>(at: &ControlInstant<'_, L, Self>, metrics: &mut Metrics<L>) -> [L; OWN_METRICS] {
        let own = at.kernel.task.shared.own;
        let [force, peak, impulse, _held, success, time]: [L; REWARD - FORCE] = at.memory.get_all(own + FORCE);
        metrics.success = success;
        let mut values = ValveMetrics::<L>::zero();
        values.angle = manipulation::fixture_coordinate(at);
        values.slip = at.memory.get(own + LAST + 2);
        values.time_to_success = time;
        values.contact_force = force;
        values.peak_force = peak;
        values.impulse = impulse;
        values.reward_success = at.memory.get(own + REWARD);
        padded(values.to_array())
    }

    #[inline(always)]
    fn continues<L: Lane>(kernel: &TaskKernel<L::Real, Self>, metrics: &Metrics<L>, in_bounds: L::Mask) -> L::Mask {
        continues(metrics, in_bounds, kernel.task.terminate_on_success)
    }
}

/// 1 where two fingers press on the handle from opposite sides, else 0.
#[inline(always)]
fn opposed<L: Lane>(reading: &ToolReading<L>, fingers: usize) -> L {
    let (mut found, one) = (L::zero(), L::c(1.0));
    for i in 1..fingers {
        for k in 0..i {
            let (a, b) = (reading.contacts[i].normal_force, reading.contacts[k].normal_force);
            let (long, short) = (a.dot(a).sqrt(), b.dot(b).sqrt());
            let presses = L::and(L::c(FINGER_FORCE).lt(long), L::c(FINGER_FORCE).lt(short));
            let opposite = a.dot(b).lt(long * short * L::c(OPPOSED));
            found = L::select(L::and(presses, opposite), one, found);
        }
    }
    found
}

/// Speed of the middle of the fingers, m/s.
#[inline(always)]
fn tool_speed<L: Lane>(reading: &ToolReading<L>, fingers: usize) -> L {
    let mut sum = LaneVector::zero();
    for k in 0..fingers {
        sum = sum + reading.contacts[k].velocity;
    }
    sum.dot(sum).sqrt() * L::c(1.0 / fingers as f64)
}

/// Minimum clearance of the fingers, m.
#[inline(always)]
fn clearance<L: Lane>(reading: &ToolReading<L>, fingers: usize) -> L {
    let mut minimum = reading.contacts[0].clearance;
    for k in 1..fingers {
        minimum = minimum.min(reading.contacts[k].clearance);
    }
    minimum
}
