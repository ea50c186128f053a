//! Laws of the tasks whose tool works on a fixture: the reference, the forces, and success.

use nalgebra::{Rotation3, Vector3};
use proptest::prelude::*;
use uvms_gym::control::GainMap;
use uvms_gym::description::Scene;
use uvms_gym::dynamics::ClosedFormModel;
use uvms_gym::system::{EndEffector, Flow, State};
use uvms_gym::task::*;

const SCENE: &str = "bluerov2-heavy-alpha5-tool";

fn options(name: &str) -> TaskOptions {
    TaskOptions { max_current: 0.0, start_distance: 0.0, start_angle: 0.0, ..TaskOptions::of(name).unwrap() }
}

fn task_of(kind: impl Into<TaskKind>) -> Task {
    let task = kind.into();
    let options = TaskOptions { task: task.clone(), ..options(task.name()) };
    Task::new(&Scene::shipped(SCENE).unwrap(), options).unwrap()
}

fn grasp() -> Valve {
    Valve { contract: ValveContract::Grasp, ..Valve::default() }
}

fn key() -> EpisodeKey {
    EpisodeKey { seed: 1, episode: 0 }
}

/// An episode with metrics by name.
struct Run<'a> {
    task: &'a Task,
    episode: Episode,
    state: State,
}

impl<'a> Run<'a> {
    fn new(task: &'a Task) -> Self {
        let (episode, state) = task.begin(key());
        Self { task, episode, state }
    }

    /// Index of the fixture's coordinate.
    fn fixture(&self) -> usize {
        self.task.joint_count()
    }

    /// Metrics of a control period that ends in the run's state.
    fn step<const K: usize>(&mut self, names: [&str; K]) -> [f64; K] {
        self.task.act(&mut self.episode, &vec![0.0; self.task.action_len()]);
        let info = self.task.advance(&mut self.episode, &self.state).info();
        names.map(|name| info[self.task.metric_names().iter().position(|known| *known == name).unwrap()])
    }

    /// Places the vehicle so that the end effector has advanced along the axis of the work, m, and turned about it, rad.
    fn place(&mut self, advance: f64, turn: f64) {
        let (_, tip) = EndEffector::new(self.task.scene()).pose(&self.task.scene().home());
        let rotation = Rotation3::from_axis_angle(&Vector3::x_axis(), turn);
        self.state.rotation = rotation.into_inner();
        self.state.position = tip + Vector3::x() * advance - rotation * tip;
    }
}

#[test]
fn the_reference_begins_at_home_and_moves_with_its_twist() {
    for kind in [TaskKind::from(Button::default()), Valve::default().into(), grasp().into()] {
        let task = task_of(kind);
        let mut run = Run::new(&task);
        let home = task.frame(&run.state);
        let start = run.episode.target();
        assert!((home.position - start.position).norm() < 1e-12, "{:?}", home.position - start.position);
        assert!((home.rotation - start.rotation).norm() < 1e-12);
        let block = task.layout().block("reference_twist").unwrap().clone();
        let period = task.options().control_period();
        let (mut poses, mut twists) = (vec![], vec![]);
        for _ in 0..700 {
            poses.push(run.episode.target());
            // An end effector at the target: its axes are the reference's.
            let mut row = vec![0.0; task.observation_len()];
            task.observe(&run.episode, &run.state, &mut row);
            let rotation = task.frame(&run.state).rotation;
            let entry = |k: usize| f64::from(row[block.offset + k]) * block.scale[k];
            let [linear, angular] = [0, 3].map(|from| rotation * Vector3::from_fn(|k, _| entry(from + k)));
            twists.push([linear, angular]);
            run.step([]);
        }
        let mut fastest = 0.0f64;
        for k in 1..699 {
            let velocity = (poses[k + 1].position - poses[k - 1].position) / (2.0 * period);
            let turn = Rotation3::from_matrix(&(poses[k + 1].rotation * poses[k - 1].rotation.transpose()));
            let spin = turn.scaled_axis() / (2.0 * period);
            assert!((velocity - twists[k][0]).norm() < 2e-4, "{k}: {velocity} {}", twists[k][0]);
            assert!((spin - twists[k][1]).norm() < 2e-4, "{k}: {spin} {}", twists[k][1]);
            fastest = fastest.max(velocity.norm());
        }
        assert!(fastest > 0.03 && twists[0][0].norm() < 1e-6 && twists[699][0].norm() < 1e-6);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    /// The dense twin has the same normal forces.
    #[test]
    fn contact_force_is_that_of_the_closed_form(
        which in 0usize..3,
        shift in prop::array::uniform3(-0.01f64..0.01),
        twist in prop::array::uniform6(-0.1f64..0.1),
        turn in -0.05f64..0.05,
        fixture in prop::array::uniform2(-0.05f64..0.05),
    ) {
        let kinds = [TaskKind::from(Button::default()), Valve::default().into(), grasp().into()];
        let task = task_of(kinds[which].clone());
        let mut run = Run::new(&task);
        run.place(if which == 0 { 0.125 } else { 0.12 }, turn);
        run.state.position += Vector3::from(shift);
        run.state.twist = twist.into();
        let k = run.fixture();
        // The button by millimetres, the handle to where the tool reaches it.
        run.state.q[k] = if which == 0 { 0.1 * fixture[0] } else { -0.12 + fixture[0] };
        run.state.qd[k] = fixture[1];
        let model = ClosedFormModel::new(task.scene()).unwrap();
        let sum: f64 = model.at(&run.state, Flow::from(Vector3::zeros())).contacts().iter().map(|contact| contact.normal_force).sum();
        let [force, peak, impulse] = run.step(["contact_force", "peak_force", "impulse"]);
        prop_assert!((force - sum).abs() <= 1e-9 * (1.0 + sum), "{force} {sum}");
        prop_assert_eq!(peak, force);
        prop_assert!((impulse - force * task.options().control_period()).abs() <= 1e-12 * force);
    }
}

#[test]
fn a_button_has_to_be_pressed_for_the_hold_time() {
    let task = task_of(Button::default());
    let mut run = Run::new(&task);
    let k = run.fixture();
    let names = ["success", "time_to_success", "travel"];
    run.state.q[k] = 0.0041;
    for at in 1..=9 {
        assert_eq!(run.step(names), [0.0, f64::from(at) * 0.05, 0.0041].map(|x| x), "{at}");
        // Each release starts anew.
        if at == 5 {
            run.state.q[k] = 0.0039;
            run.step(names);
            run.state.q[k] = 0.0041;
            break;
        }
    }
    for _ in 0..9 {
        assert_eq!(run.step(names)[0], 0.0);
    }
    let [success, time, _] = run.step(names);
    assert_eq!(success, 1.0);
    assert!((time - 16.0 * 0.05).abs() < 1e-12);
    // Success stays, and the time with it.
    run.state.q[k] = 0.0;
    assert_eq!(run.step(names), [1.0, time, 0.0]);
}

#[test]
fn a_pushed_valve_has_to_turn_by_170_degrees() {
    let task = task_of(Valve::default());
    let mut run = Run::new(&task);
    let k = run.fixture();
    for (degrees, success) in [(0.0, 0.0), (169.9, 0.0), (170.1, 1.0), (90.0, 1.0)] {
        run.state.q[k] = f64::to_radians(degrees);
        assert_eq!(run.step(["success"])[0], success, "{degrees}");
    }
}

/// A whole turn by the fork in steps of a degree, then a second at rest and the retreat. `spoil` changes the state of a phase: the angle of
/// the turn in degrees, or None afterwards.
fn turn_by_fork(spoil: impl Fn(&mut Run<'_>, Option<f64>), retreat: f64) -> [f64; 2] {
    let task = task_of(grasp());
    let mut run = Run::new(&task);
    let k = run.fixture();
    // Angle of the handle behind the fork at which both fingers press, rad.
    let behind = 0.11;
    let mut last = [0.0; 2];
    let steps = (0..=172).map(|degrees| (Some(f64::from(degrees)), 0.12)).chain((0..22).map(|_| (None, 0.12)));
    for (degrees, advance) in steps.chain((0..12).map(|_| (None, 0.12 - retreat))) {
        let angle = f64::to_radians(degrees.unwrap_or(172.0));
        run.place(advance, angle + behind);
        run.state.q[k] = angle;
        spoil(&mut run, degrees);
        last = run.step(["success", "slip"]);
    }
    last
}

#[test]
fn a_grasped_valve_has_to_be_turned_by_both_fingers_stopped_and_left() {
    let [success, slip] = turn_by_fork(|_, _| {}, 0.12);
    assert_eq!(success, 1.0);
    assert!(slip < f64::to_radians(2.0), "{slip}");
    // Not left: the tool is 80 mm clear of the handle from 98 mm on (half the bar and the radius of a finger).
    assert_eq!(turn_by_fork(|_, _| {}, 0.09)[0], 0.0);
    // Turned by the current for more than 5 degrees: the fork is away.
    let away = |run: &mut Run<'_>, degrees: Option<f64>| {
        if degrees.is_some_and(|degrees| (40.0..47.0).contains(&degrees)) {
            run.place(0.0, 0.0);
        }
    };
    let [success, slip] = turn_by_fork(away, 0.12);
    assert_eq!(success, 0.0);
    assert!(slip > f64::to_radians(5.0), "{slip}");
    // Too far, too fast, and a tool that moves.
    let k = task_of(grasp()).joint_count();
    let at_end = |change: fn(&mut State, usize)| {
        move |run: &mut Run<'_>, degrees: Option<f64>| {
            if degrees.is_none() {
                change(&mut run.state, k);
            }
        }
    };
    assert_eq!(turn_by_fork(at_end(|state, k| state.q[k] += f64::to_radians(4.0)), 0.12)[0], 0.0);
    assert_eq!(turn_by_fork(at_end(|state, k| state.qd[k] = 0.06), 0.12)[0], 0.0);
    assert_eq!(turn_by_fork(at_end(|state, _| state.twist[1] = 0.03), 0.12)[0], 0.0);
    assert_eq!(turn_by_fork(at_end(|state, _| state.twist[1] = 0.02), 0.12)[0], 1.0);
}

#[test]
fn scenes_that_do_not_fit_are_refused() {
    let scene = Scene::shipped("bluerov2-heavy-alpha5-tool").unwrap();
    let again = task_of(Button::default()).scene().clone();
    let refused = |scene: &Scene, name: &str| Task::new(scene, TaskOptions::of(name).unwrap()).unwrap_err().to_string();
    let message = refused(&again, "button");
    assert!(message.contains("fixture \"button\" already"), "{message}");
    // The tool of the button is one finger.
    let options = TaskOptions { task: grasp().into(), ..options("valve") };
    let message = Task::new(&Scene { fixtures: Vec::new(), ..again }, options).unwrap_err().to_string();
    assert!(message.contains("contact.shapes") || message.contains("2 fingers"), "{message}");
    assert!(Task::new(&scene, TaskOptions::of("valve").unwrap()).is_ok());
}

#[test]
fn resolved_motion_and_residuals_fit() {
    for kind in [TaskKind::from(Button::default()), grasp().into()] {
        let task = task_of(kind);
        for name in ["resolved-motion", "resolved-adaptive"] {
            assert!(task.controller(ControllerKind::named(name).unwrap(), &GainMap::new()).is_ok(), "{name}");
        }
        assert!(task.controller(ControllerKind::named("pd").unwrap(), &GainMap::new()).is_err());
    }
}
