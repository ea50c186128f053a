//! Pressing a button with the end effector.

use nalgebra::{Matrix3, Vector3};

use super::bounds::{POSITION_BOUND, shorter};
use super::definition::{BaseController, ControlInstant, EpisodeStart, Frame as TaskFrame, TaskDefinition, TaskKernel};
use super::disturbance::MEASURED;
use super::episode::{EpisodeRows, RowAllocator, TaskRows};
use super::manipulation::{self, FORCE, Manipulates, ManipulationKernel, Observes, REWARD};
use super::metrics::{Metrics, OWN_METRICS, continues, padded};
use super::model::TaskModel;
use super::observation::{ObservationLayout, ObservationWriter};
use super::options::{TaskOptions, check_non_negative, check_range};
use super::reward::RewardWeights;
use super::settings::settings;
use super::tool_path::{Stroke, ToolPath};
use super::workplace::{Workplace, facing};
use crate::description::{ContactGeometry, Frame, Friction, Joint, JointKind, JointLimits, JointSpring, Scene};
use crate::error::TaskError;
use crate::lane::{Lane, Real, Rows};

settings! {
    /// Pressing a button.
    pub struct Button {
        /// Distance of the tool from the button at home, m.
        standoff: f64 = 0.12;
        /// Duration of the approach, which begins after a second, s.
        approach_time: f64 = 4.0;
        /// Depth to which the reference presses the button, m.
        press_depth: f64 = 0.012;
        /// Travel from which on the button counts as pressed, m.
        pressed_travel: f64 = 0.004;
        /// Duration for which it has to be pressed, s.
        hold_time: f64 = 0.5;
        /// Travel of the button, m.
        travel: f64 = 0.01;
        /// Stiffness of its spring, N/m.
        stiffness: f64 = 1000.0;
        /// Damping, N s/m.
        damping: f64 = 80.0;
        /// Reward per control period from success on.
        success_reward: f64 = 0.5;
        /// Coordinate and rate of the button are observed.
        observe_fixture: bool = false;
        /// The force on the tool is observed.
        observe_force: bool = false;
        /// Success ends the episode.
        terminate_on_success: bool = false;
    }
}

super::metrics::metrics! {
    /// Metrics of pressing a button.
    struct ButtonMetrics {
        /// Travel of the button, m.
        travel,
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

/// Mass that moves, kg; radius and length of the cap, m; distance of the panel behind its face, m.
const MASS: f64 = 0.5;
const CAP: [f64; 2] = [0.025, 0.03];
const PANEL: f64 = 0.02;
/// Stiffness (N/m) and damping (N s/m) of the ends of its travel.
const STOP: [f64; 2] = [2e4, 200.0];

/// Numbers of the kernel.
#[derive(Debug, Clone, PartialEq)]
pub struct ButtonKernel<T> {
    shared: ManipulationKernel<T>,
    pressed_travel: T,
    /// Hold time minus half a control period, s.
    hold_time: T,
    success_reward: T,
    terminate_on_success: bool,
}

impl Button {
    fn observes(&self) -> Observes {
        Observes { fixture: self.observe_fixture, force: self.observe_force }
    }

    /// Centre of the button's face in the world, m: in front of the first sphere of the tool.
    fn face(&self, work: &Workplace) -> Vector3<f64> {
        let (center, radius) = work.tool[0];
        center + Workplace::axis() * (radius + self.standoff)
    }
}

impl Manipulates for Button {
    #[inline(always)]
    fn shared<T: Real>(kernel: &ButtonKernel<T>) -> &ManipulationKernel<T> {
        &kernel.shared
    }
}

impl TaskDefinition for Button {
    const NAME: &'static str = "button";
    const ENVIRONMENT: &'static str = "UVMS-Button";
    const FRAME: TaskFrame = TaskFrame::EndEffector;
    const DRIVES_JOINTS: bool = true;
    const KEEPS_SERVO_DAMPING: bool = false;
    const OBSERVES_UP: bool = true;
    const BASE: BaseController = BaseController::ResolvedMotion;
    const MEASURED_INPUTS: usize = 0;
    const METRICS: &'static [&'static str] = &ButtonMetrics::NAMES;

    type Kernel<T: Real> = ButtonKernel<T>;

    fn defaults() -> TaskOptions {
        let options = TaskOptions::default();
        let reward = RewardWeights { diverged: 100.0, ..options.reward };
        TaskOptions { dt: 0.005, substeps: 10, reward, ..options }
    }

    fn check(&self, _start_distance: f64) -> Result<(), TaskError> {
        check_range("standoff", self.standoff, (0.0..=1.0).contains(&self.standoff), "in [0, 1] m")?;
        for (name, value) in [("travel", self.travel), ("stiffness", self.stiffness)] {
            check_range(name, value, value.is_finite() && value > 0.0, "finite and > 0")?;
        }
        let travel = 0.0..=self.travel;
        check_range("pressed_travel", self.pressed_travel, travel.contains(&self.pressed_travel), "in [0, travel] m")?;
        check_range("press_depth", self.press_depth, (0.0..=0.1).contains(&self.press_depth), "in [0, 0.1] m")?;
        check_non_negative(&[
            ("approach_time", self.approach_time),
            ("hold_time", self.hold_time),
            ("damping", self.damping),
            ("success_reward", self.success_reward),
        ])
    }

    fn place(&self, scene: Scene) -> Result<Scene, TaskError> {
        let mut work = Workplace::new(scene, &[Vector3::zeros()])?;
        let joint = Joint {
            kind: JointKind::Prismatic,
            axis: Vector3::z(),
            rotor_inertia: MASS,
            friction: Friction { viscous: self.damping, ..Friction::default() },
            spring: Some(JointSpring { stiffness: self.stiffness, rest: 0.0 }),
            limits: Some(JointLimits { lower: 0.0, upper: self.travel, stiffness: STOP[0], damping: STOP[1] }),
            ..Joint::fixed(facing(self.face(&work), Vector3::z()))
        };
        let [radius, length] = CAP;
        let cap = Frame::new(Vector3::z() * (length / 2.0), &Matrix3::identity());
        work.add("button", joint, vec![("cap", cap, ContactGeometry::Cylinder { radius, length })], PANEL)?;
        Ok(work.scene)
    }

    fn layout(&self, _options: &TaskOptions, model: &TaskModel, layout: &mut ObservationLayout) {
        manipulation::layout(model, self.observes(), layout);
    }

    fn rows(&self, _model: &TaskModel, rows: &mut RowAllocator) -> TaskRows {
        manipulation::rows(rows, 0)
    }

    fn kernel<T: Real>(&self, options: &TaskOptions, model: &TaskModel, rows: &EpisodeRows) -> ButtonKernel<T> {
        let number = T::from_f64;
        let work = Workplace::of(model.scene.clone());
        let path = ToolPath {
            axis: Workplace::axis(),
            origin: work.end_effector.position,
            lever: Vector3::zeros(),
            rotation: work.end_effector.rotation,
            turns: false,
            strokes: vec![Stroke {
                start: 1.0,
                duration: self.approach_time,
                advance: self.standoff + self.press_depth,
                turn: 0.0,
            }],
        };
        ButtonKernel {
            shared: manipulation::kernel(model, rows, &work, &path, self.observes()),
            pressed_travel: number(self.pressed_travel),
            hold_time: number(self.hold_time - 0.5 * options.control_period()),
            success_reward: number(self.success_reward),
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
        let travel = manipulation::fixture_coordinate(at);
        let held = manipulation::record_hold(at, L::splat(task.pressed_travel).lt(travel));
        manipulation::record_success(at, L::splat(task.hold_time).lt(held), L::splat(task.success_reward))
    }

    #[inline(always)]
    fn own_metrics<L: Lane>(at: &ControlInstant<'_, L, Self>, metrics: &mut Metrics<L>) -> [L; OWN_METRICS] {
        let shared = &at.kernel.task.shared;
        let [force, peak, impulse, _held, success, time]: [L; REWARD - FORCE] = at.memory.get_all(shared.own + FORCE);
        metrics.success = success;
        let mut values = ButtonMetrics::<L>::zero();
        values.travel = manipulation::fixture_coordinate(at);
        values.time_to_success = time;
        values.contact_force = force;
        values.peak_force = peak;
        values.impulse = impulse;
        values.reward_success = at.memory.get(shared.own + REWARD);
        padded(values.to_array())
    }

    #[inline(always)]
    fn continues<L: Lane>(kernel: &TaskKernel<L::Real, Self>, metrics: &Metrics<L>, in_bounds: L::Mask) -> L::Mask {
        continues(metrics, in_bounds, kernel.task.terminate_on_success)
    }
}
