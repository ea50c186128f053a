//! Laws of station keeping.

use nalgebra::{Vector3, Vector6};
use proptest::prelude::*;
use std::sync::Arc;
use uvms_gym::control::{ActionKind, Controller, GainMap};
use uvms_gym::description::Scene;
use uvms_gym::error::TaskError;
use uvms_gym::system::{JOINTS, State, rotation_vector};
use uvms_gym::task::*;

fn scene() -> Scene {
    Scene::shipped("bluerov2-heavy-alpha5").unwrap()
}

fn task_with(options: TaskOptions) -> Task {
    Task::new(&scene(), options).unwrap()
}

fn task() -> Task {
    task_with(TaskOptions::default())
}

fn key(seed: u64, episode: u64) -> EpisodeKey {
    EpisodeKey { seed, episode }
}

fn wrench(command: &Command<f64>) -> Vector6<f64> {
    command.actuated.wrench.to_array().into()
}

fn norm(v: uvms_gym::lie::Vector3<f64>) -> f64 {
    v.dot(v).sqrt()
}

/// Drawn references of an episode at its start.
fn references(task: &Task, episode: &Episode) -> Vec<JointReference> {
    let rows = task.episode_rows().task.joints.unwrap();
    let numbers = episode.numbers()[rows.reference..rows.now].as_chunks().0;
    numbers.iter().map(|numbers| JointReference::from_array(*numbers)).collect()
}

fn pd(task: &Task) -> Result<Arc<dyn Controller>, TaskError> {
    Ok(task.controller(ControllerKind::named("pd").unwrap(), &GainMap::new())?.0)
}

#[test]
fn an_episode_is_a_function_of_its_key() {
    let task = task();
    assert_eq!(task.begin(key(3, 4)), task.begin(key(3, 4)));
    let starts = [key(3, 4), key(3, 5), key(4, 4)].map(|k| task.begin(k));
    for (i, (episode, state)) in starts.iter().enumerate() {
        for (other, other_state) in &starts[..i] {
            assert_ne!(state.position, other_state.position);
            assert_ne!(state.rotation, other_state.rotation);
            assert_ne!(episode.current(), other.current());
            assert_ne!(references(&task, episode), references(&task, other));
        }
    }
}

proptest! {
    #[test]
    fn starts_are_near_the_target_and_currents_mostly_level(seed: u64, episode: u64) {
        let options = TaskOptions { target_distance: 2.0, target_heading: 3.0, ..Default::default() };
        let (task, options) = (task_with(options.clone()), options);
        let (episode, state) = task.begin(key(seed, episode));
        let error = PoseError::of(&StageState::from(&state).pose, &episode.target().in_lanes());
        prop_assert!(norm(error.position) <= options.start_distance + 1e-12);
        prop_assert!(norm(error.rotation) <= options.start_angle + 1e-12);
        prop_assert!(episode.target().position.norm() <= 2.0);
        prop_assert!(rotation_vector(&episode.target().rotation).xy().norm() < 1e-12);
        prop_assert_eq!(state.twist, Vector6::zeros());
        prop_assert_eq!(state.q, scene().home());
        let current = episode.current();
        prop_assert!(current.norm() <= options.max_current + 1e-12);
        prop_assert!(current.z.abs() <= 0.25 * current.norm());
    }

    #[test]
    fn observations_and_results_are_finite_and_in_bounds(
        numbers in prop::collection::vec(prop_oneof![
            4 => -30.0..30.0f64,
            1 => prop::num::f64::ANY,
            1 => prop::sample::select(vec![f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN_POSITIVE]),
        ], 18 + 2 * JOINTS),
        action in prop::collection::vec(prop::num::f32::ANY, 12),
        kind in prop::sample::select(vec![ActionKind::Wrench, ActionKind::Thrusters]),
        name in prop::sample::select(TASKS.map(|(name, _)| name).to_vec()),
    ) {
        let task = task_with(TaskOptions { action: kind, ..TaskOptions::of(name).unwrap() });
        let (mut episode, mut state) = task.begin(key(1, 1));
        let command = task.act(&mut episode, &action[..task.action_len()]);
        prop_assert!(command.actuated.torques.iter().all(|x| x.abs() <= 9.0));
        prop_assert!(wrench(&command).iter().chain(&command.actuated.thrusts).chain(command.joints.iter().flatten()).all(|x| x.is_finite()));
        let mut numbers = numbers.into_iter();
        state.position.iter_mut().for_each(|x| *x = numbers.next().unwrap());
        state.rotation.iter_mut().for_each(|x| *x = numbers.next().unwrap());
        state.twist.iter_mut().for_each(|x| *x = numbers.next().unwrap());
        state.q.iter_mut().chain(&mut state.qd).for_each(|x| *x = numbers.next().unwrap());
        let outcome = task.advance(&mut episode, &state);
        prop_assert!(outcome.reward.is_finite() && outcome.info().iter().all(|x| x.is_finite()), "{outcome:?}");
        // The arm reaches less than a metre.
        let bound = if name == EETrack::NAME { 11.0 } else { 10.0 };
        prop_assert!(outcome.diverged || state.position.norm() <= bound);
        let mut row = vec![f32::NAN; task.observation_len()];
        task.observe(&episode, &state, &mut row);
        for (x, bound) in row.iter().zip(task.layout().bound()) {
            prop_assert!(x.abs() <= *bound, "{x} beyond {bound}");
        }
    }

    #[test]
    fn saved_episodes_come_back_bit_for_bit(seed: u64, number: u64, steps in 0usize..5) {
        let task = task();
        let (mut episode, mut state) = task.begin(key(seed, number));
        for k in 0..steps {
            task.act(&mut episode, &[0.1 * k as f32; 6]);
            state.position.x += 0.1;
            task.advance(&mut episode, &state);
        }
        let mut back = Episode::from_numbers(task.episode_rows(), &episode.to_numbers()).unwrap();
        prop_assert_eq!(&back, &episode);
        let bits = |e: &Episode| e.to_numbers().into_iter().map(f64::to_bits).collect::<Vec<_>>();
        prop_assert_eq!(bits(&back), bits(&episode));
        let go_on = |e: &mut Episode| (task.act(e, &[0.7; 6]), task.advance(e, &state));
        prop_assert_eq!(go_on(&mut back), go_on(&mut episode));
    }
}

#[test]
fn observation_holds_what_the_layout_says() {
    let task = task();
    let given = StartOverride {
        position: Some([1.0, 2.0, 3.0]),
        attitude: Some([0.5f64.sqrt(), 0.0, 0.0, 0.5f64.sqrt()]),
        twist: Some([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]),
        target_position: Some([1.0, 1.0, 3.0]),
        ..Default::default()
    };
    let (mut episode, state) = task.begin_with(key(2, 0), &given).unwrap();
    let drawn = references(&task, &episode);
    let period = task.options().control_period();
    let mut row = vec![0.0; task.observation_len()];
    let read = |row: &[f32], name: &str| -> Vec<f64> {
        let block = task.layout().block(name).unwrap();
        (0..block.scale.len()).map(|k| f64::from(row[block.offset + k]) * block.scale[k]).collect()
    };
    let near = |got: Vec<f64>, expected: &[f64]| {
        assert_eq!(got.len(), expected.len());
        assert!(got.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5), "{got:?} {expected:?}");
    };
    task.observe(&episode, &state, &mut row);
    near(read(&row, "position_error"), &[1.0, 0.0, 0.0]);
    near(read(&row, "attitude_error"), &[0.0, 0.0, std::f64::consts::FRAC_PI_2]);
    near(read(&row, "linear_velocity"), &[0.1, 0.2, 0.3]);
    near(read(&row, "angular_velocity"), &[0.4, 0.5, 0.6]);
    near(read(&row, "joint_position"), &vec![0.0; task.joint_count()]);
    near(read(&row, "previous_action"), &[0.0; 6]);
    near(read(&row, "error_integral"), &[0.0; 6]);

    let action = [0.5, -2.0, 0.0, 0.25, 0.0, f32::NAN];
    for step in 1..=40 {
        task.act(&mut episode, &action);
        task.advance(&mut episode, &state);
        assert_eq!(episode.step(), step);
    }
    task.observe(&episode, &state, &mut row);
    near(read(&row, "previous_action"), &[0.5, -1.0, 0.0, 0.25, 0.0, 0.0]);
    // I' = e - I / 10 for 2 s.
    let grown = 10.0 * (1.0 - (-0.2f64).exp());
    near(read(&row, "error_integral"), &[grown, 0.0, 0.0, 0.0, 0.0, grown * std::f64::consts::FRAC_PI_2]);
    let ahead: Vec<_> = drawn.iter().map(|reference| reference.point(41.0, 1.0 / period)).collect();
    let home = scene().home();
    near(read(&row, "joint_reference"), &ahead.iter().enumerate().map(|(i, p)| p.value - home[i]).collect::<Vec<_>>());
    near(read(&row, "joint_reference_rate"), &ahead.iter().map(|p| p.rate).collect::<Vec<_>>());
}

#[test]
fn reward_is_the_documented_sum() {
    let task = task_with(TaskOptions { max_current: 0.0, ..Default::default() });
    let given =
        StartOverride { position: Some([0.06, 0.0, 0.08]), attitude: Some([1.0, 0.0, 0.0, 0.0]), ..Default::default() };
    let (mut episode, state) = task.begin_with(key(0, 0), &given).unwrap();
    let command = task.act(&mut episode, &[0.5, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let outcome = task.advance(&mut episode, &state);
    let metrics = &outcome.metrics;
    assert!((metrics.pose_error - 0.1).abs() < 1e-15);
    assert!((metrics.reward_pose + 0.1 * (26.0f64.ln() + 0.1 / 0.3)).abs() < 1e-12);
    assert!((metrics.action_rate - 0.25 / 6.0).abs() < 1e-12);
    assert!((metrics.reward_action_rate + 0.1 * metrics.action_rate).abs() < 1e-12);
    let squares: f64 = command.actuated.thrusts.iter().map(|t| (t / 51.4).powi(2)).sum();
    assert!(squares > 0.0);
    assert!((metrics.effort - squares / 8.0).abs() < 1e-12);
    assert!((metrics.reward_effort + 0.02 * metrics.effort).abs() < 1e-12);
    let terms = [metrics.reward_pose, metrics.reward_effort, metrics.reward_action_rate];
    assert!((outcome.reward - terms.iter().sum::<f64>()).abs() < 1e-15);
    let powers: f64 = command.actuated.thrusts.iter().map(|t| (t / 51.4).abs().powf(1.5)).sum();
    assert!((metrics.power - powers / 8.0).abs() < 1e-12);
    // The same action again: no change, and nothing at its limit.
    task.act(&mut episode, &[0.5, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let again = task.advance(&mut episode, &state);
    assert_eq!((again.metrics.reward_action_rate, again.metrics.saturation), (0.0, 0.0));
    assert!(
        (again.metrics.rms_position_error - 0.1).abs() < 1e-12
            && (again.metrics.mean_power - powers / 8.0).abs() < 1e-12
    );
    // Down, the four vertical thrusters stand at -40 N.
    task.act(&mut episode, &[0.0, 0.0, -1.0, 0.0, 0.0, 0.0]);
    assert!((task.advance(&mut episode, &state).metrics.saturation - 0.5).abs() < 1e-12);
}

#[test]
fn command_follows_the_reference_and_pushes_as_asked() {
    let task = task();
    let (mut episode, state) = task.begin(key(5, 0));
    let drawn = references(&task, &episode);
    let limits = task.allocation().wrench_limits();
    for step in 0..60 {
        let command = task.act(&mut episode, &[0.2, 0.0, -0.1, 0.0, 0.0, 0.0]);
        let asked = Vector6::new(0.2 * limits[0], 0.0, -0.1 * limits[2], 0.0, 0.0, 0.0);
        assert!((wrench(&command) - asked).norm() < 1e-5);
        assert!((wrench(&command) - task.allocation().wrench(&command.actuated.thrusts)).norm() < 1e-12);
        let period = task.options().control_period();
        for i in 0..JOINTS {
            let expected = drawn.get(i).map_or([0.0; 4], |reference| {
                let [from, to] = [step, step + 1].map(|step| reference.point(f64::from(step), 1.0 / period));
                hermite(&from, &to, 1.0 / period)
            });
            assert!(command.joints[i].iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{i} at {step}");
        }
        task.advance(&mut episode, &state);
    }
}

#[test]
fn only_divergence_terminates() {
    let task = task();
    let (episode, start) = task.begin(key(0, 0));
    let ends = |change: &dyn Fn(&mut State)| {
        let (mut episode, mut state) = (episode.clone(), start.clone());
        change(&mut state);
        let outcome = task.advance(&mut episode, &state);
        assert_eq!(outcome.terminated, outcome.diverged);
        outcome.terminated
    };
    assert!(!ends(&|_| ()));
    assert!(!ends(&|s| s.position.x = 9.9));
    assert!(ends(&|s| s.position.x = 10.1));
    assert!(ends(&|s| s.twist[1] = -10.1));
    assert!(ends(&|s| s.twist[4] = 20.1));
    assert!(ends(&|s| s.qd[0] = -20.1));
    assert!(ends(&|s| s.q[1] = f64::NAN));
    assert!(ends(&|s| s.rotation[(0, 1)] = f64::INFINITY));
    assert!(!ends(&|s| s.q[JOINTS - 1] = f64::NAN), "past the scene's joints");
}

#[test]
fn a_given_part_of_the_start_leaves_the_rest_as_drawn() {
    let task = task();
    let (drawn, drawn_state) = task.begin(key(8, 2));
    let n = task.joint_count();
    let given = StartOverride {
        q: Some(vec![0.5; n]),
        qd: Some(vec![0.1; n]),
        current: Some([0.0, 0.1, 0.0]),
        target_attitude: Some([2.0, 0.0, 0.0, 0.0]),
        ..Default::default()
    };
    let (episode, state) = task.begin_with(key(8, 2), &given).unwrap();
    assert_eq!((state.position, state.rotation), (drawn_state.position, drawn_state.rotation));
    assert_eq!(episode.current(), Vector3::new(0.0, 0.1, 0.0));
    // Phases and amplitudes.
    let [numbers, others] = [&episode, &drawn].map(|e| references(&task, e)[0].to_array());
    assert_eq!((&numbers[..2], &numbers[8..]), (&others[..2], &others[8..]));
    assert_eq!((state.q[n - 1], state.qd[n - 1], state.q[n]), (0.5, 0.1, 0.0));
    assert_eq!((episode.reference()[0].value, episode.reference()[0].rate), (0.5, 0.0));
}

#[test]
fn every_shipped_scene_with_six_thrusters_can_keep_station() {
    for name in Scene::shipped_names() {
        let scene = Scene::shipped(name).unwrap();
        if scene.vehicle.thrusters.len() < 6 {
            continue;
        }
        for action in [ActionKind::Wrench, ActionKind::Thrusters] {
            let task = Task::new(&scene, TaskOptions { action, ..Default::default() }).unwrap();
            assert!(pd(&task).is_ok(), "{name}");
            assert!(task.allocation().unactuated().is_empty(), "{name}: {:?}", task.allocation().unactuated());
        }
    }
}

#[test]
fn tracking_starts_on_its_path_and_counts_the_end_effectors_error() {
    let options =
        TaskOptions { task: EETrack::default().into(), start_distance: 0.0, start_angle: 0.0, ..Default::default() };
    for seed in 0..20 {
        let task = task_with(options.clone());
        let (mut episode, mut state) = task.begin(key(seed, 0));
        assert!((task.frame(&state).position - episode.target().position).norm() < 1e-12);
        let start = episode.target();
        for _ in 0..100 {
            task.act(&mut episode, &[0.0; 10]);
            state.position += Vector3::new(0.001, 0.0, 0.0);
            let outcome = task.advance(&mut episode, &state);
            let apart = (task.frame(&state).position - episode.target().position).norm();
            assert!((outcome.metrics.position_error - apart).abs() < 1e-12);
            let reached = apart < 0.05 && outcome.metrics.attitude_error < 0.1;
            assert_eq!(outcome.metrics.success, f64::from(u8::from(reached)));
        }
        assert!((episode.target().position - start.position).norm() < 1.2);
    }
}

#[test]
fn joints_are_driven_by_no_more_than_their_effort_and_enough_to_hold_the_arm() {
    for name in ["petasus-pum", "bluerov2-heavy-alpha5"] {
        let scene = Scene::shipped(name).unwrap();
        let task = Task::new(&scene, TaskOptions { task: EETrack::default().into(), ..Default::default() }).unwrap();
        let trim = uvms_gym::dynamics::ClosedFormModel::new(&scene).unwrap();
        let home = State { q: scene.home(), ..State::default() };
        let holding = trim.trim(&home, Vector3::zeros()).unwrap().joint_torques;
        let ranges = task.action_ranges();
        for ((range, joint), hold) in ranges[6..].iter().zip(scene.joints()).zip(holding.iter()) {
            let maximum = range.limits[1];
            assert!(
                maximum <= joint.effort.unwrap() && maximum > 1.5 * hold.abs() && maximum > 0.0,
                "{name}: {range:?}"
            );
        }
    }
}
