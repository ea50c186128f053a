//! Episodes with scenes of their own.

use uvms_gym::batch::{Autoreset, Inputs, Precision, SimulatorOptions, TaskBatch};
use uvms_gym::description::Scene;
use uvms_gym::system::Factors;
use uvms_gym::task::disturbance::Parameters;
use uvms_gym::task::{EpisodeKey, TaskOptions};

use crate::cases::bits;

const RANGES: &str = r#"{"vehicle.body.mass": 0.2, "vehicle.body.damping.quadratic": 0.3, "mass": [0.9, 1.1],
    "arm.links[0].joint.friction.viscous": [0.2, 0.9], "arm.links[1].body.center_of_mass": 0.2}"#;
/// More than a block, and no multiple of one.
const N: usize = 21;

fn batch(scene: &Scene, ranges: Option<&str>, instances: usize, threads: usize) -> TaskBatch {
    batch_of(scene, ranges, SimulatorOptions { instances, threads: Some(threads), ..SimulatorOptions::default() })
}

fn batch_of(scene: &Scene, ranges: Option<&str>, simulator: SimulatorOptions) -> TaskBatch {
    let mut options = TaskOptions::of("station-keep").unwrap();
    options.randomize = ranges.map(|ranges| serde_json::from_str::<Parameters>(ranges).unwrap());
    TaskBatch::new(scene.clone(), options, simulator, Autoreset::NextStep, Some(4)).unwrap()
}

/// An episode runs as one in the drawn scene does, where nothing but the physics differs.
#[test]
fn an_episode_is_one_of_the_drawn_scene() {
    let scene = Scene::shipped("petasus-pum").unwrap();
    let ranges = r#"{"arm.links[0].joint.friction.viscous": [0.2, 0.9], "arm.links[1].body.damping.linear": 0.3}"#;
    let mut drawn = batch(&scene, Some(ranges), N, 1);
    let seeds: Vec<_> = (0..N as u64).map(Some).collect();
    drawn.reset(&seeds, None, &[]).unwrap();
    let width = drawn.task().action_len();
    let actions: Vec<f32> = (0..N * width).map(|k| (k as f32).sin()).collect();
    for _ in 0..3 {
        drawn.step(&actions).unwrap();
    }
    for i in 0..N {
        let key = EpisodeKey { seed: i as u64, episode: 0 };
        let own = drawn.task().scene_draws().unwrap().draw(key).0;
        assert_ne!(own, scene);
        let mut alone = batch(&own, None, 1, 1);
        alone.reset(&[Some(i as u64)], None, &[]).unwrap();
        for _ in 0..3 {
            alone.step(&actions[i * width..][..width]).unwrap();
        }
        assert_eq!(bits(&drawn.simulator().state(i)), bits(&alone.simulator().state(0)), "instance {i}");
    }
}

/// By the seed alone: not by neighbours, threads, or a batch that was saved in between. Every episode draws anew.
#[test]
fn draws_depend_on_the_episode_alone() {
    let scene = Scene::shipped("petasus-pum").unwrap();
    let run = |seeds: std::ops::Range<u64>, threads, interrupted| {
        let n = (seeds.end - seeds.start) as usize;
        let mut all = batch(&scene, Some(RANGES), n, threads);
        all.reset(&seeds.map(Some).collect::<Vec<_>>(), None, &[]).unwrap();
        let actions = vec![0.3; n * all.task().action_len()];
        let mut seen = Vec::new();
        for step in 0..12 {
            all.step(&actions).unwrap();
            seen.push((0..n).map(|i| bits(&all.simulator().state(i))).collect::<Vec<_>>());
            if interrupted && step % 3 == 1 {
                let saved = all.save();
                all = batch(&scene, Some(RANGES), n, threads);
                all.load(&saved).unwrap();
            }
        }
        let factors: Vec<Factors<f64>> = (0..n).map(|i| all.simulator().factors(i)).collect();
        assert!(factors.iter().all(|factors| factors.mass != 1.0 && factors.payload == 0.0));
        seen
    };
    let whole = run(0..N as u64, 1, false);
    assert_eq!(whole, run(0..N as u64, 2, true));
    for i in [0, 7, 20] {
        let alone = run(i as u64..i as u64 + 1, 1, false);
        assert!(whole.iter().zip(&alone).all(|(all, one)| all[i] == one[0]));
    }
    let draws = batch(&scene, Some(RANGES), 1, 1).task().scene_draws().unwrap().clone();
    let mass = |episode| draws.draw(EpisodeKey { seed: 5, episode }).0.vehicle.body.mass;
    assert!(mass(0) != mass(1) && mass(1) != mass(2));
    let within = (0..200).map(mass).all(|m| (0.8..1.2).contains(&(m / scene.vehicle.body.mass)));
    assert!(within);
}

/// Derivatives of the drawn scenes: in single precision those in double, to the rounding of the drawn numbers.
#[test]
fn derivatives_are_those_of_the_drawn_scenes() {
    let (scene, wrench) = (Scene::shipped("petasus-pum").unwrap(), [10.0; 6 * N]);
    let [double, single] = [Precision::Double, Precision::Single].map(|precision| {
        let options = SimulatorOptions { instances: N, precision, ..SimulatorOptions::default() };
        let mut all = batch_of(&scene, Some(RANGES), options);
        all.reset(&(0..N as u64).map(Some).collect::<Vec<_>>(), None, &[]).unwrap();
        let inputs = Inputs { wrench: Some(&wrench), ..Inputs::default() };
        all.simulator().clone().step_jacobians(&inputs, 10, &[0]).unwrap()
    });
    let width = double.numbers.len() / N / double.size;
    for (i, jacobian) in double.numbers.chunks_exact(double.size * width).enumerate() {
        for k in 0..width {
            let at = |row: usize| row * width + k;
            let size = (0..double.size).fold(0.0, |most, row| f64::max(most, jacobian[at(row)].abs()));
            for row in 0..double.size {
                let error = single.numbers[i * double.size * width + at(row)] - jacobian[at(row)];
                assert!(error.abs() <= 1e-5 * size, "instance {i}, {row} by {k}: {error} of {size}");
            }
        }
    }
}
