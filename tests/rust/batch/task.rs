//! Laws of the batch driver of station keeping.

use std::sync::Arc;

use crate::random_scene::{Options, random_scene, random_state};
use nalgebra::Matrix3;
use uvms_gym::batch::{Autoreset, Precision, Rollout, RolloutStats, SimulatorOptions, TaskBatch, Transition};
use uvms_gym::control::{ActionKind, Controller, GainMap};
use uvms_gym::description::Scene;
use uvms_gym::dynamics::ClosedFormModel;
use uvms_gym::error::{ControlError, TaskError};
use uvms_gym::lane::Isa;
use uvms_gym::system::EndEffector;
use uvms_gym::task::{ControllerKind, StartOverride, TaskOptions};

const SEEDS: [u64; 5] = [11, 3, 400, 7, u64::MAX];

struct Made {
    instances: usize,
    threads: usize,
    autoreset: Autoreset,
    max_steps: Option<u32>,
    precision: Precision,
}

impl Default for Made {
    fn default() -> Self {
        let precision = Precision::Double;
        Self { instances: 3, threads: 1, autoreset: Autoreset::NextStep, max_steps: Some(4), precision }
    }
}

impl Made {
    fn batch(&self) -> TaskBatch {
        let simulator = SimulatorOptions {
            instances: self.instances,
            threads: Some(self.threads),
            precision: self.precision,
            ..Default::default()
        };
        let options = TaskOptions { substeps: 2, ..Default::default() };
        TaskBatch::new(scene(), options, simulator, self.autoreset, self.max_steps).unwrap()
    }
}

fn scene() -> Scene {
    Scene::shipped("bluerov2-heavy-alpha5").unwrap()
}

fn seeds(n: usize) -> Vec<Option<u64>> {
    (0..n).map(|i| Some(SEEDS[i % 5].wrapping_add(i as u64 / 5))).collect()
}

/// Actions that depend on instance and step alone.
fn actions(batch: &TaskBatch, step: usize) -> Vec<f32> {
    let width = batch.task().action_len();
    (0..batch.instances() * width).map(|k| (1.3 * (k + 7 * step) as f32).sin()).collect()
}

fn idle(batch: &TaskBatch) -> Vec<f32> {
    vec![0.0; batch.instances() * batch.task().action_len()]
}

/// Rows of instance `i`, as bits.
fn row(batch: &TaskBatch, step: &Transition, i: usize) -> (Vec<u32>, Vec<u64>, bool, bool) {
    let d = batch.task().observation_len();
    let verdict = step.result(i);
    let numbers = verdict.info.iter().chain([&verdict.reward]).map(|x| x.to_bits()).collect();
    let observation = step.observations[i * d..(i + 1) * d].iter().map(|x| x.to_bits()).collect();
    (observation, numbers, verdict.terminated, verdict.truncated)
}

#[test]
fn the_end_effector_is_where_the_closed_form_has_it() {
    for seed in 0..60 {
        let scene = random_scene(seed, Options::default());
        let state = random_state(seed, &scene);
        let (rotation, position) = EndEffector::new(&scene).pose(&state.q);
        let expected = ClosedFormModel::new(&scene).unwrap().at(&state, scene.water.current).end_effector_pose();
        let reached = state.position + state.rotation * position;
        assert!((reached - expected.position).norm() < 1e-12, "seed {seed}");
        assert!((state.rotation * rotation - expected.rotation).norm() < 1e-12, "seed {seed}");
    }
    let bare = EndEffector::new(&Scene::shipped("bluerov2-heavy").unwrap()).pose(&[0.0; 9]);
    assert_eq!(bare, (Matrix3::identity(), nalgebra::Vector3::zeros()));
}

#[test]
fn an_instance_does_not_know_how_many_there_are_nor_on_which_thread_it_is() {
    for autoreset in [Autoreset::NextStep, Autoreset::SameStep] {
        for precision in [Precision::Double, Precision::Single] {
            let made =
                |instances, threads| Made { instances, threads, autoreset, precision, ..Made::default() }.batch();
            let (mut many, mut shared, mut few) = (made(530, 1), made(530, 3), made(2, 1));
            let starts = many.reset(&seeds(530), None, &[]).unwrap();
            assert_eq!(starts, shared.reset(&seeds(530), None, &[]).unwrap());
            few.reset(&seeds(2), None, &[]).unwrap();
            for step in 0..11 {
                let all = actions(&many, step);
                let (a, b) = (many.step(&all).unwrap(), shared.step(&all).unwrap());
                let c = few.step(&all[..2 * few.task().action_len()]).unwrap();
                for i in 0..530 {
                    assert_eq!(row(&many, &a, i), row(&shared, &b, i), "step {step}, instance {i}");
                }
                assert_eq!(a.finals, b.finals);
                assert_eq!(c.finals.len(), a.finals.iter().filter(|end| end.instance < 2).count());
                assert!((0..2).all(|i| row(&many, &a, i) == row(&few, &c, i)), "step {step}");
            }
        }
    }
}

/// Starts from which episodes end at different times: one by one, the instances leave.
fn leaving(n: usize) -> Vec<StartOverride> {
    let start = |i: usize| StartOverride {
        position: Some([9.95 - 0.07 * (i % 7) as f64, 0.0, 0.0]),
        attitude: Some([1.0, 0.0, 0.0, 0.0]),
        twist: Some([5.0, 0.0, 0.0, 0.0, 0.0, 0.1 * i as f64]),
        ..Default::default()
    };
    (0..n).map(start).collect()
}

#[test]
fn each_of_many_is_as_it_would_be_alone() {
    for autoreset in [Autoreset::NextStep, Autoreset::SameStep] {
        for precision in [Precision::Double, Precision::Single] {
            let made =
                |instances| Made { instances, autoreset, precision, max_steps: Some(9), ..Made::default() }.batch();
            let n = 19;
            let mut many = made(n);
            many.reset(&seeds(n), None, &leaving(n)).unwrap();
            let all: Vec<_> =
                (0..14).map(|step| (actions(&many, step), many.step(&actions(&many, step)).unwrap())).collect();
            let ended = |i: usize| all.iter().position(|(_, result)| result.terminated[i]);
            assert!(ended(0) < ended(6) && ended(6).is_some(), "they should leave one after the other");
            for i in [0, 3, 7, 8, 18] {
                let mut alone = made(1);
                alone.reset(&seeds(n)[i..=i], None, &leaving(n)[i..=i]).unwrap();
                for (step, (actions, expected)) in all.iter().enumerate() {
                    let width = alone.task().action_len();
                    let got = alone.step(&actions[i * width..(i + 1) * width]).unwrap();
                    assert_eq!(row(&alone, &got, 0), row(&many, expected, i), "step {step}, instance {i}");
                    let end = expected.finals.iter().find(|end| end.instance == i);
                    assert_eq!(got.finals.first().map(|end| &end.observation), end.map(|end| &end.observation));
                }
            }
        }
    }
}

#[test]
fn lanes_do_what_the_task_does_to_one_instance() {
    // Where lanes fuse multiply and add, as the scalar functions do.
    if Isa::best().unwrap() == Isa::Plain {
        return;
    }
    for kind in [ActionKind::Wrench, ActionKind::Thrusters] {
        let options =
            TaskOptions { substeps: 2, action: kind, target_distance: 1.0, target_heading: 2.0, ..Default::default() };
        let simulator = SimulatorOptions { instances: 11, ..Default::default() };
        let mut batch = TaskBatch::new(scene(), options, simulator, Autoreset::Disabled, None).unwrap();
        batch.reset(&seeds(11), None, &[]).unwrap();
        let (d, a) = (batch.task().observation_len(), batch.task().action_len());
        let mut twins: Vec<_> = (0..11).map(|i| batch.episode(i).unwrap()).collect();
        for step in 0..5 {
            let actions: Vec<f32> = actions(&batch, step).iter().map(|x| 1.2 * x).collect();
            let result = batch.step(&actions).unwrap();
            for (i, twin) in twins.iter_mut().enumerate() {
                let (task, state) = (batch.task(), batch.simulator().state(i));
                task.act(twin, &actions[i * a..(i + 1) * a]);
                let outcome = task.advance(twin, &state);
                let verdict = result.result(i);
                assert_eq!(
                    (outcome.reward, outcome.info()),
                    (verdict.reward, verdict.info),
                    "step {step}, instance {i}"
                );
                assert_eq!(batch.episode(i).as_ref(), Some(&*twin));
                let mut seen = vec![0.0; d];
                task.observe(twin, &state, &mut seen);
                assert_eq!(seen, result.observations[i * d..(i + 1) * d]);
            }
        }
    }
}

#[test]
fn an_instance_takes_less_than_three_kilobytes() {
    for name in ["petasus-pum", "bluerov2-heavy-alpha5", "bluerov2-heavy", "rexrov"] {
        for (precision, most) in [(Precision::Double, 3000), (Precision::Single, 1500)] {
            let simulator = SimulatorOptions { instances: 64, precision, ..Default::default() };
            let scene = Scene::shipped(name).unwrap();
            let options = TaskOptions::default();
            let batch = TaskBatch::new(scene, options, simulator, Autoreset::NextStep, None).unwrap();
            let bytes = batch.bytes_per_instance();
            assert!(bytes < most && bytes > batch.simulator().bytes_per_instance(), "{name}: {bytes}");
        }
    }
}

#[test]
fn next_step_autoreset_spends_a_step_on_the_reset() {
    let mut batch = Made::default().batch();
    batch.reset(&seeds(3), None, &[]).unwrap();
    for step in 1..=10 {
        let result = batch.step(&actions(&batch, step)).unwrap();
        for (i, verdict) in result.results().enumerate() {
            assert_eq!(verdict.truncated, step % 5 == 4);
            assert_eq!(verdict.reward == 0.0, step % 5 == 0);
            let episode = batch.episode(i).unwrap();
            assert_eq!((episode.key().episode, episode.step()), (step as u64 / 5, (step % 5) as u32));
        }
        assert!(result.finals.is_empty());
    }
}

#[test]
fn same_step_autoreset_hands_over_the_last_observation() {
    let made = |autoreset| Made { autoreset, ..Made::default() }.batch();
    let (mut batch, mut plain) = (made(Autoreset::SameStep), made(Autoreset::Disabled));
    batch.reset(&seeds(3), None, &[]).unwrap();
    plain.reset(&seeds(3), None, &[]).unwrap();
    for step in 1..=8 {
        let actions = actions(&batch, step);
        let (got, expected) = (batch.step(&actions).unwrap(), plain.step(&actions).unwrap());
        let ends = step % 4 == 0;
        assert_eq!(got.finals.len(), if ends { 3 } else { 0 });
        for (i, end) in got.finals.iter().enumerate() {
            let d = batch.task().observation_len();
            assert_eq!(end.observation, expected.observations[i * d..(i + 1) * d]);
            assert_eq!((end.instance, &end.info), (i, &expected.result(i).info));
            assert_eq!(got.rewards[i], expected.rewards[i]);
            assert!(got.truncated[i]);
        }
        if ends {
            let next = plain.reset(&[None; 3], None, &[]).unwrap();
            assert_eq!(got.observations, next.observations);
            assert_eq!(got.info, next.info);
        }
    }
}

#[test]
fn without_autoreset_an_episode_that_is_over_must_be_reset() {
    let mut batch = Made { autoreset: Autoreset::Disabled, max_steps: Some(2), ..Made::default() }.batch();
    let idle = idle(&batch);
    assert_eq!(batch.step(&idle).unwrap_err(), TaskError::NotBegun { instance: 0 });
    let refused = batch.reset(&[None; 3], Some(&[true, false, true]), &[]).unwrap_err();
    assert_eq!(refused, TaskError::NotBegun { instance: 1 });
    batch.reset(&[None; 3], None, &[]).unwrap();
    batch.step(&idle).unwrap();
    let before = batch.step(&idle).unwrap();
    assert_eq!(batch.step(&idle).unwrap_err(), TaskError::Over { instance: 0 });
    let after = batch.reset(&[None; 3], Some(&[true, false, true]), &[]).unwrap();
    let d = batch.task().observation_len();
    assert_eq!(before.observations[d..2 * d], after.observations[d..2 * d]);
    assert_ne!(before.observations[..d], after.observations[..d]);
    assert_eq!(batch.step(&idle).unwrap_err(), TaskError::Over { instance: 1 });
    batch.reset(&[None; 3], Some(&[false, true, false]), &[]).unwrap();
    assert!(batch.step(&idle).is_ok());
}

#[test]
fn an_instance_that_diverges_leaves_its_neighbours_alone() {
    let made = Made { max_steps: None, ..Made::default() };
    let (mut one, mut other) = (made.batch(), made.batch());
    // At the edge of the bounds, on the way out.
    let leaving = StartOverride {
        position: Some([9.99, 0.0, 0.0]),
        attitude: Some([1.0, 0.0, 0.0, 0.0]),
        twist: Some([9.0, 0.0, 0.0, 0.0, 0.0, 15.0]),
        ..Default::default()
    };
    let given = [StartOverride::default(), leaving, StartOverride::default()];
    one.reset(&seeds(3), None, &given).unwrap();
    other.reset(&seeds(3), None, &[]).unwrap();
    let mut ended = false;
    for step in 0..6 {
        let actions = actions(&one, step);
        let (a, b) = (one.step(&actions).unwrap(), other.step(&actions).unwrap());
        ended |= a.terminated[1];
        assert!(!a.truncated[1]);
        assert!([0, 2].into_iter().all(|i| row(&one, &a, i) == row(&other, &b, i) && !a.terminated[i]));
        assert!(a.observations.iter().all(|x| x.is_finite()));
    }
    assert!(ended);
    assert_eq!(one.episode(1).unwrap().key().episode, 1);
}

#[test]
fn refused_calls_change_nothing() {
    let mut batch = Made::default().batch();
    batch.reset(&seeds(3), None, &[]).unwrap();
    batch.step(&actions(&batch, 0)).unwrap();
    let before = batch.save();
    let mut wrong = actions(&batch, 1);
    wrong[8] = f32::NAN;
    assert!(matches!(batch.step(&wrong).unwrap_err(), TaskError::Action { instance: 1, index: 2, .. }));
    assert!(batch.step(&wrong[1..]).is_err());
    let far = StartOverride { position: Some([0.0, 50.0, 0.0]), ..Default::default() };
    let given = [StartOverride::default(), StartOverride::default(), far];
    assert!(matches!(batch.reset(&[None; 3], None, &given).unwrap_err(), TaskError::Start { .. }));
    assert!(batch.reset(&[None; 2], None, &[]).is_err());
    assert!(batch.reset(&[None; 3], Some(&[true]), &[]).is_err());
    let mut cut = before.clone();
    cut.physics.pop();
    assert!(batch.load(&cut).is_err());
    cut = before.clone();
    cut.episodes[0] = 0.5;
    assert!(batch.load(&cut).is_err());
    assert_eq!(batch.save(), before);
    let (a, b) = (batch.step(&actions(&batch, 1)), Made::default().batch().step(&[2.0; 18]));
    assert!(a.is_ok() && b.is_err());
}

#[test]
fn beyond_the_range_actions_are_clipped() {
    let (mut a, mut b) = (Made::default().batch(), Made::default().batch());
    a.reset(&seeds(3), None, &[]).unwrap();
    b.reset(&seeds(3), None, &[]).unwrap();
    let wild: Vec<f32> = actions(&a, 0).iter().map(|x| 50.0 * x).collect();
    let tame: Vec<f32> = wild.iter().map(|x| x.clamp(-1.0, 1.0)).collect();
    assert_eq!(a.step(&wild).unwrap(), b.step(&tame).unwrap());
}

#[test]
fn a_saved_batch_goes_on_as_if_nothing_had_happened() {
    for precision in [Precision::Double, Precision::Single] {
        for autoreset in [Autoreset::NextStep, Autoreset::SameStep] {
            let made = Made { precision, autoreset, ..Made::default() };
            let (mut batch, mut other) = (made.batch(), made.batch());
            batch.reset(&seeds(3), None, &[]).unwrap();
            for step in 0..6 {
                batch.step(&actions(&batch, step)).unwrap();
            }
            other.load(&batch.save()).unwrap();
            assert_eq!(other.save(), batch.save());
            for step in 6..12 {
                let actions = actions(&batch, step);
                assert_eq!(batch.step(&actions).unwrap(), other.step(&actions).unwrap());
            }
        }
    }
    let fresh = Made::default().batch();
    let mut other = Made::default().batch();
    other.load(&fresh.save()).unwrap();
    assert!(other.episode(0).is_none());
}

#[test]
fn a_seed_starts_a_stream_of_episodes() {
    let mut batch = Made::default().batch();
    let first = batch.reset(&seeds(3), None, &[]).unwrap();
    let second = batch.reset(&[None; 3], None, &[]).unwrap();
    assert_ne!(first, second);
    assert_eq!(batch.reset(&seeds(3), None, &[]).unwrap(), first);
    assert_eq!(batch.reset(&[None; 3], None, &[]).unwrap(), second);
    // A given start is an episode of the stream too.
    let still = StartOverride { current: Some([0.0; 3]), ..Default::default() };
    batch.reset(&[None; 3], None, &[still.clone(), still.clone(), still]).unwrap();
    assert_eq!(batch.episode(2).unwrap().key().episode, 2);
    assert_eq!(batch.episode(2).unwrap().current().norm(), 0.0);
}

#[test]
fn the_pd_holds_station_and_no_action_does_not() {
    for action in [ActionKind::Wrench, ActionKind::Thrusters] {
        let run = |controlled: bool| {
            let options = TaskOptions { action, ..Default::default() };
            let simulator = SimulatorOptions { instances: 4, ..Default::default() };
            let mut batch = TaskBatch::new(scene(), options, simulator, Autoreset::Disabled, None).unwrap();
            let pd = classical(&batch, "pd");
            let mut observations = batch.reset(&seeds(4), None, &[]).unwrap().observations;
            let mut actions = idle(&batch);
            let mut last = Vec::new();
            for _ in 0..200 {
                if controlled {
                    pd.act(&observations, &mut [], &mut actions).unwrap();
                }
                let result = batch.step(&actions).unwrap();
                last = result.results().collect();
                observations = result.observations;
            }
            last
        };
        let task = uvms_gym::task::Task::new(&scene(), TaskOptions::default()).unwrap();
        let [error, rms] = ["position_error", "rms_position_error"]
            .map(|name| task.metric_names().iter().position(|known| *known == name).unwrap());
        for (held, adrift) in run(true).iter().zip(run(false)) {
            assert!(held.info[error] < 0.5 && held.info[rms] < 0.5, "{held:?}");
            assert!(held.info[rms] < 0.5 * adrift.info[rms], "{held:?} {adrift:?}");
        }
    }
}

fn classical(batch: &TaskBatch, name: &str) -> Arc<dyn Controller> {
    batch.task().controller(ControllerKind::named(name).unwrap(), &GainMap::new()).unwrap()
}

/// What stepping with a policy's actions brings in so many periods.
fn stepped(batch: &mut TaskBatch, policy: &dyn Controller, steps: u32) -> Vec<RolloutStats> {
    let (n, widths) = (batch.instances(), policy.widths());
    let mut observations = batch.reset(&seeds(n), None, &[]).unwrap().observations;
    let mut memory = vec![0.0; n * widths.memory];
    let mut actions = vec![0.0; n * widths.action];
    let mut stats = vec![RolloutStats::default(); n];
    for _ in 0..steps {
        policy.act(&observations, &mut memory, &mut actions).unwrap();
        let done = batch.step(&actions).unwrap();
        for (i, (stats, verdict)) in stats.iter_mut().zip(done.results()).enumerate() {
            if stats.terminated || stats.truncated {
                continue;
            }
            // Where the next episode has begun already, what the last step came to is among the ends.
            let end = done.finals.iter().find(|end| end.instance == i);
            let info = end.map_or(verdict.info, |end| end.info.clone());
            stats.last[..info.len()].copy_from_slice(&info);
            stats.steps += 1;
            stats.reward += verdict.reward;
            (stats.terminated, stats.truncated) = (verdict.terminated, verdict.truncated);
            for (k, x) in info.into_iter().enumerate() {
                stats.sums[k] += x;
                stats.squares[k] += x * x;
            }
        }
        observations = done.observations;
    }
    stats
}

#[test]
fn a_rollout_gives_what_stepping_gives_bit_for_bit() {
    for precision in [Precision::Double, Precision::Single] {
        for autoreset in [Autoreset::NextStep, Autoreset::SameStep] {
            let made = Made { instances: 131, max_steps: Some(9), autoreset, precision, ..Made::default() };
            let mut batch = made.batch();
            let pid = classical(&batch, "pid");
            let expected = stepped(&mut batch, &*pid, 11);
            for (threads, parts) in [(1, &[11][..]), (2, &[4, 0, 7])] {
                let mut batch = Made { threads, ..made }.batch();
                let mut rollout = Rollout::new(&*pid, 131, &[130]).unwrap();
                batch.reset(&seeds(131), None, &[]).unwrap();
                for steps in parts {
                    batch.run(&*pid, &mut rollout, *steps).unwrap();
                }
                assert_eq!(rollout.stats(), expected);
                assert_eq!(rollout.traces()[0].rewards.iter().sum::<f64>(), expected[130].reward);
            }
            assert!(expected.iter().all(|stats| stats.steps == 9 && stats.truncated));
        }
    }
}

#[test]
fn rollouts_that_do_not_fit_are_refused() {
    let mut batch = Made::default().batch();
    let pid = classical(&batch, "pid");
    let mut rollout = Rollout::new(&*pid, 3, &[]).unwrap();
    assert_eq!(batch.run(&*pid, &mut rollout, 1), Err(TaskError::NotBegun { instance: 0 }));
    batch.reset(&seeds(3), None, &[]).unwrap();
    let mut other = Rollout::new(&*pid, 4, &[]).unwrap();
    assert!(matches!(batch.run(&*pid, &mut other, 1), Err(TaskError::Control(ControlError::Shape { .. }))));
    let mut rest = Rollout::new(&*classical(&batch, "none"), 3, &[]).unwrap();
    let refused = batch.run(&*pid, &mut rest, 1);
    assert!(matches!(refused, Err(TaskError::Control(ControlError::Shape { what: "memory", got: 0, expected: 18 }))));
    let small = TaskBatch::new(
        Scene::shipped("bluerov2-heavy").unwrap(),
        TaskOptions::default(),
        SimulatorOptions::default(),
        Autoreset::Disabled,
        None,
    );
    let narrow = classical(&small.unwrap(), "pid");
    let refused = batch.run(&*narrow, &mut rollout, 1);
    assert!(matches!(refused, Err(TaskError::Control(ControlError::Widths { got: 24, .. }))));
    assert_eq!(rollout.stats(), [RolloutStats::default(); 3]);
    assert!(matches!(Rollout::new(&*pid, 3, &[3]), Err(ControlError::Instance { instance: 3, instances: 3 })));
}
