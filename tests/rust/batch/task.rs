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
use uvms_gym::system::{EndEffector, JOINTS};
use uvms_gym::task::{ControllerKind, TaskOptions};

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

/// Metrics of instance `i`.
fn metrics(transition: &Transition, i: usize) -> Vec<f64> {
    transition.info.iter().skip(i).step_by(transition.rewards.len()).copied().collect()
}

fn seeds(n: usize) -> Vec<Option<u64>> {
    (0..n).map(|i| Some(SEEDS[i % 5].wrapping_add(i as u64 / 5))).collect()
}

/// Actions that depend on instance and step alone.
fn actions(batch: &TaskBatch, step: usize) -> Vec<f32> {
    let width = batch.task().action_len();
    (0..batch.instances() * width).map(|k| (1.3 * (k + 7 * step) as f32).sin()).collect()
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
    let bare = EndEffector::new(&Scene::shipped("bluerov2-heavy").unwrap()).pose(&[0.0; JOINTS]);
    assert_eq!(bare, (Matrix3::identity(), nalgebra::Vector3::zeros()));
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
                let seen = (result.rewards[i], metrics(&result, i));
                assert_eq!((outcome.reward, outcome.info()), seen, "step {step}, instance {i}");
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

fn classical(batch: &TaskBatch, name: &str) -> Arc<dyn Controller> {
    batch.task().controller(ControllerKind::named(name).unwrap(), &GainMap::new()).unwrap().0
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
        for (i, stats) in stats.iter_mut().enumerate() {
            if stats.terminated || stats.truncated {
                continue;
            }
            // Where the next episode has begun already, what the last step came to is among the ends.
            let end = done.finals.iter().find(|end| end.instance == i);
            let info = end.map_or_else(|| metrics(&done, i), |end| end.info.clone());
            stats.last[..info.len()].copy_from_slice(&info);
            stats.steps += 1;
            stats.reward += done.rewards[i];
            (stats.terminated, stats.truncated) = (done.terminated[i], done.truncated[i]);
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
