//! Laws of disturbances.

use nalgebra as na;
use proptest::prelude::*;
use serde_json::{Value, json};
use uvms_gym::control::Allocation;
use uvms_gym::description::Scene;
use uvms_gym::dynamics::ClosedFormModel;
use uvms_gym::lane::Rows;
use uvms_gym::lie::{Matrix3, Pose, Vector3, Vector6};
use uvms_gym::system::State;
use uvms_gym::task::EpisodeKey;
use uvms_gym::task::disturbance::*;

const PERIOD: f64 = 0.05;

fn scene() -> Scene {
    Scene::shipped("bluerov2-heavy-alpha5").unwrap()
}

fn context_of(scene: &Scene) -> DisturbanceContext {
    let allocation = Allocation::new(&scene.vehicle).unwrap();
    let level = [na::Vector3::x(), na::Vector3::y(), na::Vector3::z()];
    DisturbanceContext::new(scene, &allocation, level, PERIOD)
}

fn context() -> DisturbanceContext {
    context_of(&scene())
}

fn key(seed: u64) -> EpisodeKey {
    EpisodeKey { seed, episode: 0 }
}

fn read(value: Value) -> Disturbance {
    Disturbance::from_json(&value.to_string()).unwrap()
}

fn refusal(value: Value) -> String {
    let read = Disturbance::from_json(&value.to_string());
    read.and_then(|disturbance| disturbance.check(&context())).unwrap_err().to_string()
}

/// An episode of one instance.
struct Run {
    kernel: DisturbanceKernel<f64>,
    numbers: Vec<f64>,
    key: EpisodeKey,
    step: u32,
}

impl Run {
    fn new(disturbance: &Disturbance, seed: u64) -> Self {
        let context = context();
        disturbance.check(&context).unwrap();
        let rows = DisturbanceRows::new(disturbance, &context, 0).unwrap();
        let kernel = DisturbanceKernel::new(rows, &context);
        let mut numbers = vec![0.0; rows.end];
        let steady = na::Vector3::zeros();
        kernel.begin(&mut Column::of_one(&mut numbers), key(seed), &steady, disturbance);
        Self { kernel, numbers, key: key(seed), step: 0 }
    }

    fn advance(&mut self) {
        self.kernel.advance(&mut Column::of_one(&mut self.numbers), self.key, self.step);
    }

    fn force_on(&mut self, pose: &Pose<f64>, twist: &Vector6<f64>) -> Forcing<f64> {
        self.kernel.forcing(&Rows::of_one(&mut self.numbers), pose, twist)
    }

    fn forcing(&mut self) -> Forcing<f64> {
        self.force_on(&Pose::identity(), &Vector6::zero())
    }

    fn end_period(&mut self) {
        self.kernel.end_period::<f64>(&mut Rows::of_one(&mut self.numbers));
        self.step += 1;
    }

    /// What a period brings.
    fn next(&mut self) -> Forcing<f64> {
        self.advance();
        let forcing = self.forcing();
        self.end_period();
        forcing
    }

    /// What is seen after the truth was measured.
    fn see(&mut self, truth: &[f64; MEASURED]) -> [f64; MEASURED] {
        let mut rows = Rows::of_one(&mut self.numbers);
        self.kernel.measure(&mut rows, truth);
        self.kernel.sensors().unwrap().reading(&rows)
    }
}

fn norm(v: Vector3<f64>) -> f64 {
    v.dot(v).sqrt()
}

fn at(x: f64, y: f64, z: f64) -> Pose<f64> {
    Pose { position: Vector3([x, y, z]), ..Pose::identity() }
}

#[test]
fn val_wandering_current_has_the_moments_of_its_process() {
    let (deviation, time) = (0.08, 0.5);
    let disturbance = read(json!({ "drift": { "deviation": deviation, "time": time, "vertical": 0.5 } }));
    let mut run = Run::new(&disturbance, 3);
    let steps = 20_000;
    let lag = 10;
    let series: Vec<[f64; 3]> = (0..steps).map(|_| run.next().velocity.0).collect();
    let keep = (-PERIOD * lag as f64 / time).exp();
    for axis in 0..3 {
        let expected = deviation * if axis == 2 { 0.5 } else { 1.0 };
        let x: Vec<f64> = series.iter().map(|v| v[axis] / expected).collect();
        let mean = |of: &dyn Fn(usize) -> f64, n: usize| (0..n).map(of).sum::<f64>() / n as f64;
        // A tenth of the samples or so are independent: five deviations of each estimate.
        assert!(mean(&|k| x[k], steps).abs() < 0.16, "{axis}");
        assert!((mean(&|k| x[k] * x[k], steps) - 1.0).abs() < 0.16, "{axis}");
        assert!((mean(&|k| x[k] * x[k + lag], steps - lag) - keep).abs() < 0.16, "{axis}");
    }
    // Over episodes, the first sample is as any other.
    let first = |seed| Run::new(&disturbance, seed).forcing().velocity.0[0] / deviation;
    let square = (0..2000).map(|seed| first(seed) * first(seed)).sum::<f64>() / 2000.0;
    assert!((square - 1.0).abs() < 0.16, "{square}");
}

#[test]
fn gusts_are_smooth_bounded_and_come_again() {
    for turns in [false, true] {
        let rise = 1.0;
        let gust =
            json!({ "speed": [0.2, 0.3], "rise": rise, "duration": [2.5, 3], "pause": [0.5, 1], "turns": turns });
        let mut run = Run::new(&read(json!({ "gust": gust })), 5);
        let (mut last, mut rises) = (Vector3::zero(), 0);
        let mut lowest = f64::INFINITY;
        for _ in 0..4000 {
            let velocity = run.next().velocity;
            let speed = norm(velocity);
            assert!(speed <= 0.3 + 1e-12);
            // The steepest slope of a smooth step is 3/2 over its rise; a turn is twice as high.
            let steepest = 1.5 * 0.3 / rise * if turns { 2.0 } else { 1.0 };
            assert!(norm(velocity - last) <= steepest * PERIOD + 1e-12);
            rises += u32::from(norm(last) < 0.1 && speed >= 0.1);
            lowest = lowest.min(velocity.dot(last));
            last = velocity;
        }
        assert!((20..100).contains(&rises), "{rises}");
    }
    // C1: the slope does not jump, however finely one looks.
    let slope = |x: f64| {
        (uvms_gym::task::disturbance::current::smooth_step(x + 1e-7)
            - uvms_gym::task::disturbance::current::smooth_step(x - 1e-7))
            / 2e-7
    };
    for x in [0.0, 1.0] {
        assert!(slope(x).abs() < 1e-6 && (slope(x - 1e-4) - slope(x + 1e-4)).abs() < 1e-3);
    }
}

#[test]
fn the_acceleration_of_waves_is_the_rate_of_their_velocity() {
    let disturbance = read(json!({ "waves": { "height": [0.3, 0.6], "period": [3, 8], "trains": 3 } }));
    let mut run = Run::new(&disturbance, 8);
    let here = at(0.4, -0.3, 0.7);
    for _ in 0..200 {
        let before = run.force_on(&here, &Vector6::zero());
        run.end_period();
        let after = run.force_on(&here, &Vector6::zero());
        let rate = (after.velocity - before.velocity).scale(1.0 / PERIOD);
        // Central difference: omega^2 h^2 / 24 of it.
        assert!(norm(rate - before.acceleration) < 1e-3 * norm(before.acceleration).max(0.1));
    }
}

#[test]
fn val_waves_decay_with_depth_and_travel() {
    let disturbance = read(json!({ "waves": { "height": 0.5, "period": 5, "depth": 4 } }));
    let mut run = Run::new(&disturbance, 1);
    let frequency = std::f64::consts::TAU / 5.0;
    let k = frequency * frequency / 9.81;
    let speed = |run: &mut Run, z| norm(run.force_on(&at(0.0, 0.0, z), &Vector6::zero()).velocity);
    // Round orbits: the speed does not change in time.
    let expected = 0.25 * frequency * f64::exp(-4.0 * k);
    for _ in 0..50 {
        assert!((speed(&mut run, 0.0) - expected).abs() < 1e-6 * expected, "{}", speed(&mut run, 0.0) / expected);
        run.end_period();
    }
    assert!((speed(&mut run, -3.0) / expected - f64::exp(-3.0 * k)).abs() < 1e-9);
    // Above the surface as at it.
    assert_eq!(speed(&mut run, 4.0), speed(&mut run, 6.0));
    // After a time t the wave stands where it stood omega/k t before, along one horizontal direction.
    let first = run.forcing().velocity;
    (0..20).for_each(|_| run.end_period());
    let way = frequency / k * 20.0 * PERIOD;
    let found = (0..3600).map(|i| {
        let angle = std::f64::consts::TAU * f64::from(i) / 3600.0;
        norm(run.force_on(&at(way * angle.cos(), way * angle.sin(), 0.0), &Vector6::zero()).velocity - first)
    });
    assert!(found.fold(f64::INFINITY, f64::min) < 1e-3 * expected);
}

#[test]
fn a_push_gives_its_momentum_whatever_the_period() {
    let mut run = Run::new(&read(json!({ "impulse": { "force": 100, "duration": 0.13, "pause": 1.02 } })), 2);
    let mut given = 0.0;
    let mut most: f64 = 0.0;
    for _ in 0..46 {
        let force = norm(run.next().wrench.linear);
        given += force * PERIOD;
        most = most.max(force);
    }
    // Two pushes at 1.02 s and at the first instant after that is 1.02 s past its end.
    assert!((given - 2.0 * 100.0 * 0.13).abs() < 1e-9, "{given}");
    assert!((most - 100.0).abs() < 1e-9);
}

#[test]
fn pushes_come_from_outside_at_a_point() {
    let mut run = Run::new(&read(json!({ "impulse": { "force": 50, "duration": 1e4, "pause": 0, "reach": 1 } })), 4);
    run.next();
    let turn = na::Rotation3::from_euler_angles(0.3, -0.5, 1.1).into_inner();
    let rows = [0, 1, 2].map(|i| [0, 1, 2].map(|k| turn[(i, k)]));
    let turned = Pose { rotation: Matrix3(rows), position: Vector3::zero() };
    let (level, tilted) = (run.forcing().wrench, run.force_on(&turned, &Vector6::zero()).wrench);
    // The same force in the world, a moment across it.
    assert!(norm(turned.rotation.apply(tilted.linear) - level.linear) < 1e-12);
    assert!(level.linear.dot(level.angular).abs() < 1e-9 && norm(level.angular) <= 50.0 * context().lever);
}

#[test]
fn a_cable_pulls_towards_its_fixed_point_and_its_drag_with_the_current() {
    let taut = json!({ "height": 10, "distance": 0, "slack": 0, "weight": 0, "stiffness": 0.5, "diameter": 0 });
    let mut run = Run::new(&read(json!({ "tether": taut })), 1);
    assert!(norm(run.forcing().wrench.linear) < 1e-9, "no load, and no longer than it is");
    let down = run.force_on(&at(0.0, 0.0, -0.4), &Vector6::zero()).wrench;
    assert!((down.linear.0[2] - 0.4 * 0.5 * context().thrust).abs() < 1e-9 && norm(down.angular) < 1e-9);

    let loose = json!({ "height": 10, "distance": 0, "slack": 0.1, "weight": 0.2, "diameter": 0.02, "attachment": [0, 0, 0.2] });
    let mut run = Run::new(&read(json!({ "tether": loose })), 1);
    // Hanging straight down, it bears itself but for half of its weight.
    let still = run.forcing().wrench.linear.0;
    assert!((still[2] + 0.5 * 0.2 * 11.0).abs() < 1e-9 && still[0].abs() < 1e-9, "{still:?}");
    // Moving sideways it drags back.
    let moving = Vector6 { linear: Vector3([0.5, 0.0, 0.0]), angular: Vector3::zero() };
    let dragged = run.force_on(&Pose::identity(), &moving).wrench;
    let expected = 0.5 * scene().water.density * 1.2 * 0.02 * 0.25 * 0.25 * 0.5 * 11.0;
    assert!((dragged.linear.0[0] + expected).abs() < 1e-9, "{:?} {expected}", dragged.linear);
    assert!((dragged.angular.0[1] - 0.2 * dragged.linear.0[0]).abs() < 1e-9);
}

#[test]
fn a_payload_is_grasped_without_a_loss_of_momentum() {
    let model = ClosedFormModel::new(&scene()).unwrap();
    let mass = 1.5;
    let mut state = State { q: scene().home(), ..State::default() };
    state.twist = na::Vector6::new(0.2, -0.1, 0.15, 0.1, -0.2, 0.3);
    state.qd[..4].copy_from_slice(&[0.1, -0.2, 0.3, 0.2]);
    let before = state.clone();
    uvms_gym::task::disturbance::grasp_impulse(&model, &mut state, mass);
    let form = model.at(&before, na::Vector3::zeros());
    let n = form.joints();
    let all = |s: &State| na::DVector::from_iterator(6 + n, s.twist.iter().chain(&s.qd[..n]).copied());
    let (old, new) = (all(&before), all(&state));
    let inertia = form.mass_matrix();
    // What the bodies lose, the mass gains: p = m v of the end effector, through its Jacobian.
    let jacobian = form.jacobian();
    let gained = (&jacobian * &new).fixed_rows::<3>(0) * mass;
    let lost = inertia * (&old - &new);
    let given = jacobian.rows(0, 3).transpose() * gained;
    assert!((lost - given).norm() < 1e-12);
    // An inelastic impact takes energy.
    let energy = |v: &na::DVector<f64>| 0.5 * v.dot(&(inertia * v));
    let held = (&jacobian * &new).fixed_rows::<3>(0).norm_squared() * 0.5 * mass;
    assert!(energy(&new) + held < energy(&old));
    assert!((new - old).norm() > 1e-3);
}

#[test]
fn thrusters_lose_what_they_should_when_they_should() {
    let loss = json!({ "count": 3, "gain": [0.2, 0.4], "time": 1.0 });
    let mut run = Run::new(&read(json!({ "thrusters": loss })), 1);
    for step in 0..60 {
        let gains = run.next().gains;
        let weak = gains.iter().filter(|gain| (0.2..=0.4).contains(*gain)).count();
        let whole = gains.iter().filter(|gain| **gain == 1.0).count();
        assert_eq!((weak, whole), if step < 20 { (0, 16) } else { (3, 13) });
    }
    let given = [1.0, 0.5, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0];
    let mut run = Run::new(&read(json!({ "thrusters": { "gains": given, "time": 0, "fade": 1 } })), 1);
    let series: Vec<f64> = (0..30).map(|_| run.next().gains[4]).collect();
    assert!(series.is_sorted_by(|a, b| a >= b) && series[0] > 0.9 && series[10] < 0.6 && series[20] == 0.0);
    assert_eq!(run.forcing().gains[..8], given);
    assert_eq!(run.forcing().summary()[2], 0.0);
    let wrong = refusal(json!({ "thrusters": { "gains": [1.0] } }));
    assert!(wrong.contains("1 gains") && wrong.contains('8'), "{wrong}");
}

#[test]
fn a_battery_weakens_all_thrusters_with_time_and_load() {
    let battery = json!({ "charge": 0.9, "drain": 36.0, "sag": 0.2 });
    let weak = json!({ "gains": vec![0.5; 8], "time": 0 });
    let mut run = Run::new(&read(json!({ "battery": battery, "thrusters": weak })), 1);
    let at = run.kernel.places().battery.unwrap();
    for (step, power) in [0.0, 0.0, 0.5, 1.0].into_iter().enumerate() {
        Battery::load(&mut Rows::of_one(&mut run.numbers), at, power);
        // 36 an hour are 0.0005 per period of 0.05 s.
        let voltage = 0.9 - 0.0005 * step as f64 - 0.2 * power;
        let gains = run.next().gains;
        assert!(gains[..8].iter().all(|gain| (gain - 0.5 * voltage.powf(1.25)).abs() < 1e-12), "{step}: {gains:?}");
    }
    // As the bench table: from 16 to 12 V within 4 % of full thrust.
    let table = uvms_gym::description::ThrustTable::t200();
    for pulse in [1100.0, 1200.0, 1300.0, 1400.0, 1600.0, 1700.0, 1800.0, 1900.0] {
        let (from, to) = (table.thrust(pulse, 16.0), table.thrust(pulse, 12.0));
        assert!((to - from * 0.75f64.powf(1.25)).abs() < 0.04 * 28.48, "{pulse} us");
    }
    let mut empty = Run::new(&read(json!({ "battery": { "charge": 0.0 } })), 1);
    assert_eq!(empty.next().gains[0], 0.0);
    let drawn: Vec<_> = (0..50).map(|seed| Run::new(&read(json!({ "battery": true })), seed).next().gains[3]).collect();
    assert!(drawn.iter().all(|gain| (0.85f64.powf(1.25)..1.05f64.powf(1.25)).contains(gain)));
    for (wrong, expected) in [
        (json!({ "charge": 2.0 }), "battery.charge"),
        (json!({ "sag": [0.3, 0.1] }), "battery.sag"),
        (json!({ "drain": -1.0 }), "battery.drain"),
    ] {
        let error = refusal(json!({ "battery": wrong }));
        assert!(error.contains(expected) && !error.contains('\n'), "{error}");
    }
}

#[test]
fn noise_has_its_deviation_and_a_bias_stays() {
    let noise = json!({ "position": 0.01, "attitude": 0.02, "joint_rate": 0.5, "bias": 2.0 });
    let mut run = Run::new(&read(json!({ "noise": noise })), 1);
    let measured = run.kernel.sensors().unwrap().measured;
    let n = 10_000;
    let (mut sum, mut squares, mut product) = ([0.0; MEASURED], [0.0; MEASURED], 0.0);
    for _ in 0..n {
        run.advance();
        let seen = run.see(&[1.0; MEASURED]);
        run.end_period();
        for k in 0..measured {
            sum[k] += (seen[k] - 1.0) / n as f64;
            squares[k] += (seen[k] - 1.0) * (seen[k] - 1.0) / n as f64;
        }
        product += (seen[0] - 1.0) * (seen[1] - 1.0) / n as f64;
    }
    for (k, deviation) in [(0, 0.01), (1, 0.01), (2, 0.01), (3, 0.02), (measured - 1, 0.5)] {
        let spread = (squares[k] - sum[k] * sum[k]).sqrt();
        assert!((spread / deviation - 1.0).abs() < 0.04, "{k}: {spread}");
        assert!(sum[k] != 0.0 && sum[k].abs() < 10.0 * deviation);
    }
    // Independent of each other.
    assert!((product - sum[0] * sum[1]).abs() < 5.0 * 0.01 * 0.01 / (n as f64).sqrt());
    // Biases differ from episode to episode, with twice the deviation.
    let bias = |seed| {
        let mut run = Run::new(&read(json!({ "noise": { "position": 0.0, "attitude": 0.1, "bias": 10 } })), seed);
        run.see(&[0.0; MEASURED])[3]
    };
    let square = (0..1000).map(|seed| bias(seed) * bias(seed)).sum::<f64>() / 1000.0;
    assert!((square - 1.0).abs() < 0.25, "{square}");
}

#[test]
fn val_losses_have_their_share_and_gaps_their_mean() {
    for (losses, share, gap) in [
        (json!({ "probability": 0.3 }), 0.3, 1.0 / 0.7),
        (json!({ "probability": 0.3, "gap": 0.5 }), 0.3, 10.0),
        (json!({ "probability": 0.6, "gap": 0.075 }), 0.6, 1.5),
    ] {
        let mut run = Run::new(&read(json!({ "dropout": losses, "delay": { "periods": 2 } })), 1);
        let age = run.kernel.rows().age.unwrap();
        // Times of the last arrival, from two periods before the start on.
        let (steps, mut lost, mut gaps, mut arrived) = (40_000_usize, 0, 0, vec![0.0; 3]);
        for step in 0..steps {
            let mut truth = [step as f64; MEASURED];
            truth[MEASURED - 1] = 0.0;
            let seen = run.see(&truth);
            assert_eq!(seen[..12], [arrived[step]; 12], "{step}");
            assert!(step < 2 || step as f64 - seen[0] == run.numbers[age], "{step}");
            run.advance();
            run.end_period();
            let (loses, last) = (run.numbers[run.kernel.places().dropout.unwrap().row + 2] > 0.5, arrived[step + 2]);
            lost += u32::from(loses);
            gaps += u32::from(loses && last == step as f64);
            arrived.push(if loses { last } else { (step + 1) as f64 });
        }
        // Deviations of a Markov chain's share and mean: five of each.
        let found = f64::from(lost) / steps as f64;
        assert!((found - share).abs() < 5.0 * (share * (1.0 - share) * 2.0 * gap / steps as f64).sqrt(), "{found}");
        let mean = f64::from(lost) / f64::from(gaps);
        assert!((mean / gap - 1.0).abs() < 5.0 / f64::from(gaps).sqrt(), "{mean} {gap}");
    }
    let wrong = refusal(json!({ "dropout": { "probability": 0.8, "gap": 0.1 } }));
    assert!(wrong.contains("dropout.gap: 0.1 s, but at least 0.200 s"), "{wrong}");
}

#[test]
fn val_outliers_have_their_share_and_sizes() {
    let (share, steps) = (0.2, 20_000);
    let outliers = json!({ "probability": share, "position": [0.2, 0.4], "attitude": 0.1 });
    let mut run = Run::new(&read(json!({ "outliers": outliers })), 1);
    let (mut found, mut size, mut sum) = (0.0, 0.0, Vector3::zero());
    for step in 0..steps {
        let seen = run.see(&[1.0; MEASURED]);
        assert!(seen[6..12].iter().all(|x| *x == 1.0));
        let part = |k: usize| Vector3([seen[k] - 1.0, seen[k + 1] - 1.0, seen[k + 2] - 1.0]);
        let [position, attitude] = [part(0), part(3)];
        if norm(position) > 0.0 {
            assert!((0.2 - 1e-12..=0.4).contains(&norm(position)) && (norm(attitude) - 0.1).abs() < 1e-12);
            assert!(step > 0);
            (found, size, sum) = (found + 1.0, size + norm(position), sum + position);
        }
        run.advance();
        run.end_period();
    }
    assert!((found / f64::from(steps) - share).abs() < 5.0 * (share * (1.0 - share) / f64::from(steps)).sqrt());
    assert!((size / found - 0.3).abs() < 5.0 * 0.2 / (12.0 * found).sqrt());
    assert!(norm(sum) / found < 5.0 * 0.31 / found.sqrt());
}

#[test]
fn parameters_keep_what_floats_afloat() {
    let randomised =
        read(json!({ "parameters": { "mass": 0.3, "volume": [0.99, 1.01], "payload": 2.0, "thrust": [0.5, 0.6] } }));
    let mut seen = Vec::new();
    for seed in 0..200 {
        let factors = randomised.factors(key(seed));
        assert!((0.7..=1.3).contains(&factors.mass) && (0.0..=2.0).contains(&factors.payload));
        assert!((factors.volume / factors.mass - 1.0).abs() <= 0.01 + 1e-12);
        assert!((0.5..=0.6).contains(&factors.thrust) && factors.added_mass == 1.0);
        seen.push(factors.mass);
    }
    seen.sort_by(f64::total_cmp);
    assert!(seen[0] < 0.72 && seen[199] > 1.28 && (seen[100] - 1.0).abs() < 0.1);
    let all = read(json!({ "parameters": true })).factors(key(1)).to_array();
    assert!(all.iter().filter(|x| **x != 1.0 && **x != 0.0).count() == 7, "{all:?}");
    let none: Parameters = serde_json::from_value(json!(false)).unwrap();
    assert_eq!(none.any(), None);
    let wrong = refusal(json!({ "parameters": { "mas": 0.1 } }));
    assert!(wrong.contains("mas") && wrong.contains("added_mass"), "{wrong}");
}

#[test]
fn levels_can_be_read_written_and_held_at_every_scene() {
    for level in LEVELS {
        let disturbance = Disturbance::named(level.name).unwrap();
        assert_eq!(Disturbance::from_json(&disturbance.to_json()).unwrap(), disturbance, "{}", level.name);
        for name in Scene::shipped_names() {
            let scene = Scene::shipped(name).unwrap();
            if !scene.vehicle.thrusters.is_empty() {
                disturbance.check(&context_of(&scene)).unwrap();
            }
        }
    }
    assert!(DisturbanceRows::new(&Disturbance::named("calm").unwrap(), &context(), 0).is_none());
    assert!(DisturbanceRows::new(&Disturbance::steady(0.3), &context(), 0).is_none());
}

#[test]
fn a_dict_changes_its_base() {
    let storm = Disturbance::named("storm").unwrap();
    let changed =
        read(json!({ "base": "storm", "gust": { "rise": 2 }, "waves": null, "tether": true, "impulse": false }));
    let gust = changed.gust.as_ref().unwrap();
    assert_eq!((gust.rise, gust.speed), (2.0, storm.gust.unwrap().speed));
    assert!(changed.waves.is_none() && changed.impulse.is_none());
    assert_eq!(changed.tether, Some(Tether::default()));
    assert_eq!(changed.noise, storm.noise);
    assert_eq!(read(json!({})), Disturbance::default());
}

#[test]
fn what_there_is_no_room_for_is_refused() {
    let room = read(json!({ "base": "gusts", "waves": {}, "delay": 0.1 }));
    for (asked, named) in [
        (json!({ "drift": {}, "delay": 0.1 }), "drift"),
        (json!({ "waves": { "trains": 2 }, "delay": 0.1 }), "waves.trains"),
        (json!("calm"), "delay"),
    ] {
        let message = room.check_room(&read(asked), PERIOD).unwrap_err().to_string();
        assert!(message.contains(named), "{message}");
    }
    assert_eq!(room.check_room(&read(json!({ "gust": {}, "delay": 0.1 })), PERIOD), Ok(()));
}

#[test]
fn a_profile_tells_what_comes() {
    let disturbance = read(json!({ "base": "storm", "waves": null }));
    let mut run = Run::new(&disturbance, 6);
    for _ in 0..7 {
        run.next();
    }
    let (kernel, mut numbers) = (run.kernel.clone(), run.numbers.clone());
    let profile = kernel.profile(&mut numbers, run.key, run.step, 300, &Pose::identity(), 8);
    for k in 0..300 {
        let forcing = run.next();
        assert_eq!((profile.velocity[k], profile.wrench[k]), (forcing.velocity.0, forcing.wrench.to_array()));
        assert_eq!(profile.gains[k], forcing.gains[..8]);
    }
    let held: Vec<f64> = profile.payload.iter().copied().filter(|mass| *mass > 0.0).collect();
    assert!(held.len() >= 79 && held.iter().all(|mass| *mass == held[0]));
}

proptest! {
    #[test]
    fn levels_are_finite_at_any_place(seed: u64, level in 0..LEVELS.len(), x in -10.0..10.0f64, z in -10.0..10.0f64) {
        let disturbance = LEVELS[level].disturbance();
        if DisturbanceRows::new(&disturbance, &context(), 0).is_none() {
            return Ok(());
        }
        let mut run = Run::new(&disturbance, seed);
        for _ in 0..50 {
            run.advance();
            let forcing = run.force_on(&at(x, 0.0, z), &Vector6::zero());
            run.end_period();
            prop_assert!(forcing.wrench.to_array().iter().all(|x| x.abs() < 1e5));
            prop_assert!(norm(forcing.velocity) < 3.0 && norm(forcing.acceleration) < 10.0);
        }
    }
}
