//! Laws of docking in still water; laws of the dock's motion are in `tests/python/test_dock.py`, and of contact with it in
//! `tests/python/test_dock_cradle.py`.

use nalgebra::{Rotation3, Vector3};
use proptest::prelude::*;
use uvms_gym::control::GainMap;
use uvms_gym::description::Scene;
use uvms_gym::dynamics::ClosedFormModel;
use uvms_gym::system::{Flow, State};
use uvms_gym::task::*;

fn options(dock: Dock) -> TaskOptions {
    TaskOptions { task: dock.into(), ..TaskOptions::of("dock").unwrap() }
}

fn task_with(options: TaskOptions) -> Task {
    Task::new(&Scene::shipped("bluerov2-heavy-alpha5").unwrap(), options).unwrap()
}

fn floating() -> TaskOptions {
    options(Dock { dock: DockKind::Floating, ..Dock::default() })
}

fn task() -> Task {
    task_with(floating())
}

fn key(seed: u64) -> EpisodeKey {
    EpisodeKey { seed, episode: 0 }
}

/// The task's own metrics and the shared `success`, by name.
fn metric(task: &Task, outcome: &Outcome, name: &str) -> f64 {
    let index = task.metric_names().iter().position(|known| *known == name).unwrap();
    outcome.info()[index]
}

/// An episode that starts on the dock.
fn on_the_dock(task: &Task) -> (Episode, State) {
    let given = StartOverride {
        position: Some([0.0; 3]),
        attitude: Some([1.0, 0.0, 0.0, 0.0]),
        target_position: Some([0.0; 3]),
        ..Default::default()
    };
    task.begin_with(key(1), &given).unwrap()
}

proptest! {
    #[test]
    fn starts_lie_in_the_cone_in_front_of_the_dock(seed: u64) {
        let options = TaskOptions { target_distance: 2.0, target_heading: 3.0, ..floating() };
        let (episode, state) = task_with(options).begin(key(seed));
        let target = episode.target();
        let apart = target.rotation.tr_mul(&(state.position - target.position));
        prop_assert!((2.0 - 1e-9..=5.0 + 1e-9).contains(&apart.norm()));
        prop_assert!(apart.dot(&-Vector3::x()) >= apart.norm() * (0.4f64.cos() - 1e-9));
        let turn = state.rotation * target.rotation.transpose();
        prop_assert!((turn * Vector3::z() - Vector3::z()).norm() < 1e-12);
        prop_assert!(turn[(0, 0)] >= 0.3f64.cos() - 1e-12);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    /// The dense twin has the same normal forces.
    #[test]
    fn contact_force_is_that_of_the_closed_form(
        shift in prop::array::uniform3(-0.02f64..0.02),
        turn in prop::array::uniform3(-0.05f64..0.05),
        twist in prop::array::uniform6(-0.1f64..0.1),
    ) {
        let task = task_with(options(Dock::default()));
        let (mut episode, mut state) = on_the_dock(&task);
        state.position = Vector3::from(shift);
        state.rotation = Rotation3::from_scaled_axis(Vector3::from(turn)).into_inner();
        state.twist = twist.into();
        let model = ClosedFormModel::new(task.scene()).unwrap();
        let sum: f64 = model.at(&state, Flow::from(Vector3::zeros())).contacts().iter().map(|contact| contact.normal_force).sum();
        task.act(&mut episode, &vec![0.0; task.action_len()]);
        let outcome = task.advance(&mut episode, &state);
        let [force, peak, impulse] = ["contact_force", "peak_force", "impulse"].map(|name| metric(&task, &outcome, name));
        prop_assert!((force - sum).abs() <= 1e-9 * (1.0 + sum), "{force} {sum}");
        prop_assert_eq!(peak, force);
        prop_assert!((impulse - force * task.options().control_period()).abs() <= 1e-12 * force);
    }
}

#[test]
fn docked_in_a_cradle_needs_contact_for_the_hold_time() {
    let task = task_with(options(Dock::default()));
    let (mut episode, mut state) = on_the_dock(&task);
    let mut step = |state: &State| {
        task.act(&mut episode, &vec![0.0; task.action_len()]);
        let outcome = task.advance(&mut episode, state);
        ["docked", "success", "contact_force"].map(|name| metric(&task, &outcome, name))
    };
    // At the docking pose the vehicle touches the dock without force; above it there is no contact.
    for height in [0.0, 0.02] {
        state.position.z = height;
        for _ in 0..60 {
            let [docked, success, force] = step(&state);
            assert!(docked == 0.0 && success == 0.0 && force < 1e-9);
        }
    }
    state.position.z = -0.002;
    for k in 1..=40 {
        let [docked, success, force] = step(&state);
        assert!(force > 10.0);
        assert_eq!([docked, success], [f64::from(k / 40); 2], "{k}");
    }
    // Without contact it is no longer docked.
    state.position.z = 0.02;
    let [docked, success, force] = step(&state);
    assert!(docked == 0.0 && success == 1.0 && force < 1e-9);
}

#[test]
fn the_controller_presses_the_vehicle_on_the_cradle_and_lowers_it_from_above() {
    let task = task_with(options(Dock::default()));
    let (controller, _) = task.controller(kind("dock-pd"), &GainMap::new()).unwrap();
    let wrench = |x: f64, y: f64, z: f64| {
        let (mut episode, mut state) = on_the_dock(&task);
        state.position = Vector3::new(x, y, z);
        task.advance(&mut episode, &state);
        let mut row = vec![0.0; task.observation_len()];
        task.observe(&episode, &state, &mut row);
        let mut action = vec![0.0; task.action_len()];
        controller.act(&row, &mut [], &mut action).unwrap();
        [0, 2].map(|k| f64::from(action[k]) * task.allocation().wrench_limits()[k])
    };
    let servo = task.scene().vehicle.servo.clone().unwrap();
    let [forward, up] = wrench(0.0, 0.0, 0.0);
    assert!((forward - 0.15 * servo.kp[0]).abs() < 1e-3 && (up + 0.1 * servo.kp[2]).abs() < 1e-3);
    // In front of the dock the aim is 0.15 m above the docking pose.
    assert!(wrench(-1.0, 0.0, 0.15)[1].abs() < 1e-3);
    // Aside of it the vehicle retreats, and within the clearance it does not.
    assert!(wrench(-0.1, 0.3, 0.0)[0] < 0.0 && wrench(-0.1, 0.04, 0.0)[0] > 0.0);
}

#[test]
fn docked_needs_the_hold_time_within_the_tolerances_at_low_speed() {
    let task = task();
    let (mut episode, mut state) = on_the_dock(&task);
    let action = vec![0.0; task.action_len()];
    let mut step = |state: &State| {
        task.act(&mut episode, &action);
        let outcome = task.advance(&mut episode, state);
        ["docked", "success", "time_to_dock"].map(|name| metric(&task, &outcome, name))
    };
    // 0.05 s a period: docked at the 40th, 2 s after the start.
    for k in 1..=39 {
        assert_eq!(step(&state)[..2], [0.0, 0.0], "{k}");
    }
    let [docked, success, time] = step(&state);
    assert_eq!([docked, success], [1.0, 1.0]);
    assert!((time - 2.0).abs() < 1e-12);
    // Too fast, and too far away: no longer docked; the first success stays.
    state.twist[1] = 0.11;
    assert_eq!(step(&state), [0.0, 1.0, time]);
    state.twist[1] = 0.09;
    assert_eq!(step(&state), [0.0, 1.0, time]);
    for _ in 0..38 {
        assert_eq!(step(&state), [0.0, 1.0, time]);
    }
    assert_eq!(step(&state), [1.0, 1.0, time]);
    state.position.y = 0.11;
    assert_eq!(step(&state), [0.0, 1.0, time]);
}

#[test]
fn the_approach_speed_is_that_of_the_first_crossing() {
    let task = task();
    let (mut episode, mut state) = task.begin(key(3));
    let action = vec![0.0; task.action_len()];
    let mut seen = Vec::new();
    for (x, speed) in [(-2.0, 0.5), (-0.6, 0.4), (-0.45, 0.3), (-0.2, 0.2), (-0.7, 0.1), (-0.1, 0.05)] {
        (state.position, state.twist[0]) = (Vector3::new(x, 0.0, 0.0), speed);
        task.act(&mut episode, &action);
        let outcome = task.advance(&mut episode, &state);
        seen.push(metric(&task, &outcome, "approach_speed"));
    }
    assert_eq!(seen, [0.0, 0.0, 0.3, 0.3, 0.3, 0.3]);
}

#[test]
fn the_reward_is_the_sum_of_its_terms_and_prefers_a_slow_vehicle_on_the_dock() {
    let task = task();
    let reward = |distance: f64, speed: f64| {
        let (mut episode, mut state) = on_the_dock(&task);
        (state.position.x, state.twist[0]) = (-distance, speed);
        task.act(&mut episode, &vec![0.0; task.action_len()]);
        let outcome = task.advance(&mut episode, &state);
        let terms = ["pose", "effort", "action_rate", "diverged", "docking"].map(|term| format!("reward_{term}"));
        let sum: f64 = terms.iter().map(|name| metric(&task, &outcome, name)).sum();
        assert!((outcome.reward - sum).abs() < 1e-14);
        outcome.reward
    };
    assert!(reward(0.0, 0.0) > reward(0.0, 0.2));
    assert!(reward(0.0, 0.0) > reward(0.5, 0.0) && reward(0.5, 0.0) > reward(5.0, 0.0));
    // Far away speed costs little.
    assert!(reward(5.0, 0.0) - reward(5.0, 0.5) < 0.002);
}

fn kind(name: &str) -> ControllerKind {
    ControllerKind::named(name).unwrap()
}

#[test]
fn the_controllers_approach_speed_is_limited() {
    let task = task();
    let gains = serde_json::json!({"approach_speed": 0.3, "turn_speed": 0.2});
    let given: GainMap = gains.as_object().unwrap().clone();
    let (controller, _) = task.controller(kind("dock-pd"), &given).unwrap();
    let servo = task.scene().vehicle.servo.clone().unwrap();
    let surge = |x: f64, speed: f64| {
        let (mut episode, mut state) = on_the_dock(&task);
        (state.position.x, state.twist[0]) = (x, speed);
        task.advance(&mut episode, &state);
        let mut row = vec![0.0; task.observation_len()];
        task.observe(&episode, &state, &mut row);
        let mut action = vec![0.0; task.action_len()];
        controller.act(&row, &mut [], &mut action).unwrap();
        f64::from(action[0]) * task.allocation().wrench_limits()[0]
    };
    // At the limit both terms balance, however far the dock is; near it, it is the PD.
    assert!(surge(-4.0, 0.3).abs() < 1e-3 && surge(-2.0, 0.3).abs() < 1e-3);
    assert!((surge(-3.0, 0.0) - 0.3 * servo.kd[0]).abs() < 1e-3);
    let near = 0.1 * servo.kd[0] / servo.kp[0];
    assert!((surge(-near, 0.0) - 0.1 * servo.kd[0]).abs() < 1e-3);
}
