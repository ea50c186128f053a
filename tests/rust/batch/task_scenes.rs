//! Episodes with scenes of their own.

use uvms_gym::batch::{Autoreset, Inputs, Precision, SimulatorOptions, TaskBatch};
use uvms_gym::description::Scene;
use uvms_gym::system::Factors;
use uvms_gym::task::disturbance::Parameters;
use uvms_gym::task::{EpisodeKey, TaskOptions};

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

fn bits(batch: &TaskBatch, i: usize) -> Vec<u64> {
    let state = batch.simulator().state(i);
    state.position.iter().chain(&state.rotation).chain(&state.twist).chain(&state.q).map(|x| x.to_bits()).collect()
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
        assert_eq!(bits(&drawn, i), bits(&alone, 0), "instance {i}");
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
            seen.push((0..n).map(|i| bits(&all, i)).collect::<Vec<_>>());
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

#[test]
fn ranges_that_cannot_be_are_refused_by_key() {
    let scene = Scene::shipped("petasus-pum").unwrap();
    let refused = |ranges: &str| {
        let mut options = TaskOptions::of("station-keep").unwrap();
        options.randomize = Some(serde_json::from_str::<Parameters>(ranges).unwrap());
        let simulator = SimulatorOptions::default();
        TaskBatch::new(scene.clone(), options, simulator, Autoreset::Disabled, None).err().unwrap().to_string()
    };
    for (ranges, words) in [
        (r#"{"vehicle.body.mas": [1.0, 2.0]}"#, ["vehicle.body.mas", "vehicle.body.mass"]),
        (r#"{"vehicle.body.mass": [2.0, 1.0]}"#, ["vehicle.body.mass", "[2, 1]"]),
        (r#"{"vehicle.body.mass": [[2.0], [1.0]]}"#, ["vehicle.body.mass", "is a number"]),
        (r#"{"vehicle.body.center_of_mass": [0.0, 1.0]}"#, ["vehicle.body.center_of_mass", "two lists of 3"]),
        (r#"{"vehicle.body.mass": [-2.0, -1.0]}"#, ["vehicle.body.mass", "must be > 0"]),
        (r#"{"vehicle.thrusters[0].position": 0.1}"#, ["vehicle.thrusters[0].position", "no effect"]),
        (r#"{"arm.links[0].joint.home": [0.1, 0.2]}"#, ["arm.links[0].joint.home", "no effect"]),
        (r#"{"vehicle.body.mass": 1.5}"#, ["vehicle.body.mass", "1.5"]),
    ] {
        let message = refused(ranges);
        assert!(words.iter().all(|word| message.contains(word)), "{ranges}: {message}");
    }
}
