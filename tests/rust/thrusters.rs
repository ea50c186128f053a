//! Laws of thrusters with dynamics: map, dead band, saturation, lag, inflow, hull.

use nalgebra::{Vector3, Vector6};
use uvms_gym::batch::{Autoreset, Inputs, SimulatorOptions, States, TaskBatch};
use uvms_gym::description::{Scene, ThrustMap};
use uvms_gym::error::SimulatorError;
use uvms_gym::integrate::Integrator;
use uvms_gym::system::{State, compile};
use uvms_gym::task::TaskOptions;

use crate::cases::{self, orders, run, simulator, simulator_at};

/// One body without water, one thruster forward through its centre of mass.
pub fn puck(change: &str) -> Scene {
    let text = format!(
        "name = 'puck'\nwater = {{ density = 0.0, gravity = [0.0, 0.0, 0.0] }}\n[vehicle]\nname = 'puck'\n\
         body = {{ mass = 10.0, inertia = [1.0, 1.0, 1.0] }}\n[[vehicle.thrusters]]\nname = 'main'\n\
         position = [0.0, 0.0, 0.0]\naxis = [1.0, 0.0, 0.0]\nlimits = [-40.0, 60.0]\n{change}\n"
    );
    Scene::from_toml_str(&text, "puck").unwrap()
}

fn thrust(thrust: &[f64]) -> Inputs<'_> {
    Inputs { thrust: Some(thrust), ..Inputs::default() }
}

/// What a command settles at.
pub fn settled(scene: &Scene, command: f64) -> f64 {
    run(scene, "mk4", 0.01, &State::default(), &thrust(&[command]), 1).thrust[0]
}

#[test]
fn a_step_response_is_an_exponential() {
    let scene = puck("lag = 0.15");
    for dt in [1e-4, 0.01, 0.3] {
        let mut simulator = simulator(&scene, "mk4", dt);
        for k in 1..=200 {
            simulator.step(&thrust(&[30.0]), 1).unwrap();
            let t = dt * f64::from(k);
            let expected = -30.0 * (-t / 0.15).exp_m1();
            let got = simulator.state(0).thrust[0];
            assert!((got - expected).abs() <= 1e-12 * 30.0, "dt {dt}, t {t}: {got} {expected}");
        }
    }
}

/// m v = F (t - tau (1 - exp(-t / tau))), exactly, because the course of the thrust over a step has its mean.
#[test]
fn impulse_is_exact_at_any_step() {
    let (tau, mass) = (0.2, 10.0);
    for (dt, steps) in [(0.001, 700), (0.05, 14), (0.35, 2)] {
        let t = dt * steps as f64;
        let expected = 50.0 * (t + tau * (-t / tau).exp_m1()) / mass;
        let got = run(&puck("lag = 0.2"), "mk4", dt, &State::default(), &thrust(&[50.0]), steps).twist[0];
        assert!((got - expected).abs() < 1e-13, "{dt}: {got} {expected}");
    }
}

/// The course of the thrust within a step leaves methods their order.
#[test]
fn way_under_a_lag_converges_with_the_order_of_the_method() {
    let (tau, mass, t) = (0.2, 10.0, 0.64_f64);
    // x = F / m (t^2 / 2 - tau (t - tau (1 - exp(-t / tau))))
    let expected = 50.0 / mass * (0.5 * t * t - tau * (t + tau * (-t / tau).exp_m1()));
    for (integrator, order) in [("mk4", 4.0), ("mk3", 3.0), ("mk2", 2.0), ("ros2", 2.0), ("ros3", 3.0)] {
        let error = |steps: usize| {
            let dt = t / steps as f64;
            let end = run(&puck("lag = 0.2"), integrator, dt, &State::default(), &thrust(&[50.0]), steps);
            (end.position[0] - expected).abs()
        };
        let errors = [16, 32, 64].map(error);
        assert!(orders(&errors).iter().all(|x| *x > order - 0.2), "{integrator}: {errors:?}");
    }
}

#[test]
fn commands_in_the_dead_band_give_exactly_nothing() {
    let scene = puck("dead_band = 3.0");
    for command in [0.0, 1.0, 3.0, -3.0, -2.9] {
        let end = run(&scene, "mk4", 0.01, &State::default(), &thrust(&[command]), 20);
        assert_eq!((end.thrust[0], end.twist), (0.0, Vector6::zeros()));
    }
    assert_eq!([3.5, -3.5].map(|command| settled(&scene, command)), [3.5, -3.5]);
    // A thruster that runs down stops for good, and the zero command is within any dead band.
    let mut lagging = simulator(&puck("lag = 0.1"), "mk4", 0.01);
    lagging.step(&thrust(&[20.0]), 5).unwrap();
    lagging.step(&thrust(&[0.0]), 600).unwrap();
    assert_eq!(lagging.state(0).thrust[0], 0.0);
}

#[test]
fn thrust_saturates_at_the_limits() {
    for change in ["dead_band = 1.0", "map = [[-1e3, -1e3], [0, 0], [1e3, 1e3]]", "lag = 1e-9"] {
        assert!((settled(&puck(change), 1e6) - 60.0).abs() < 0.1, "{change}");
        assert!((settled(&puck(change), -1e6) + 40.0).abs() < 1.5, "{change}");
    }
    let table = [1e6, -1e6].map(|command| settled(&puck("map = 't200'"), command));
    assert!((table[0] - 51.44).abs() < 1e-9 && (table[1] + 39.91).abs() < 1e-9, "{table:?}");
    assert_eq!(settled(&puck("map = [[-1, -99], [0, 0], [1, 99]]"), 1.0), 60.0);
}

#[test]
fn a_map_goes_straight_through_its_points() {
    let scene = puck("map = [[-40, -20], [-10, 0], [0, 0], [10, 2], [20, 10], [60, 50]]");
    let commands = [0.0, 5.0, 10.0, 15.0, 40.0, 60.0, -5.0, -25.0, -40.0];
    let expected = [0.0, 1.0, 2.0, 6.0, 30.0, 50.0, 0.0, -10.0, -20.0];
    for (command, expected) in commands.into_iter().zip(expected) {
        assert!((settled(&scene, command) - expected).abs() < 1e-12, "{command}: {}", settled(&scene, command));
    }
}

/// Thrust that acts at a speed.
fn acting(scene: &Scene, command: f64, speed: f64) -> f64 {
    let simulator = simulator_at(scene, "mk4", 0.01, &State { twist: Vector6::ith(0, speed), ..State::default() });
    simulator.applied_loads(&thrust(&[command])).unwrap()[0].thrust[0]
}

/// KC06: thrust falls as water flows in along it.
#[test]
fn inflow_takes_thrust_away() {
    let scene = puck("ambient_flow = 1.8");
    for sign in [1.0, -1.0] {
        let at: Vec<f64> = (0..60).map(|k| sign * acting(&scene, sign * 30.0, sign * 0.1 * f64::from(k))).collect();
        assert!(at.windows(2).all(|pair| pair[1] <= pair[0]), "{at:?}");
        assert!((at[10] - (30.0 - 1.8 * 30f64.sqrt())).abs() < 1e-12);
        // Beyond sqrt(T) / k = 3.04 m/s nothing is left, and never less than that.
        assert!(at[30] > 0.0 && at[31] == 0.0 && at[59] == 0.0);
        // Against the thrust as in still water.
        assert_eq!(acting(&scene, sign * 30.0, -sign), sign * 30.0);
    }
    assert_eq!(acting(&scene, 0.0, 1.0), 0.0);
}

/// Inflow is the velocity of the thruster through the water, not of the origin over ground.
#[test]
fn inflow_is_relative_and_at_the_thruster() {
    let mut scene = puck("ambient_flow = 1.0");
    let moving = |twist| State { twist, ..State::default() };
    let mut drifting = simulator_at(&scene, "mk4", 0.01, &moving(Vector6::ith(0, 0.7)));
    drifting.set_flow(0, Vector3::new(0.7, 0.0, 0.0));
    assert_eq!(drifting.applied_loads(&thrust(&[30.0])).unwrap()[0].thrust[0], 30.0);

    scene.vehicle.thrusters[0].position = Vector3::new(0.0, 0.5, 0.0);
    // A turn to the left moves a thruster on the left backward: no inflow; a turn to the right 0.5 m/s.
    for (rate, speed) in [(1.0, 0.0), (-1.0, 0.5)] {
        let turning = simulator_at(&scene, "mk4", 0.01, &moving(Vector6::ith(5, rate)));
        let got = turning.applied_loads(&thrust(&[30.0])).unwrap()[0].thrust[0];
        assert!((got - (30.0 - 30f64.sqrt() * speed)).abs() < 1e-12, "{rate}: {got}");
    }
}

/// A vehicle ends at the speed where drag takes what inflow leaves.
#[test]
fn inflow_limits_the_speed() {
    let mut scene = puck("ambient_flow = 1.5\nlag = 0.1");
    scene.vehicle.body.damping.linear[(0, 0)] = 10.0;
    let end = run(&scene, "mk4", 0.01, &State::default(), &thrust(&[36.0]), 4000);
    // 36 - 1.5 * 6 v = 10 v
    assert!((end.twist[0] - 36.0 / 19.0).abs() < 1e-12);
}

/// The inflow of each stage leaves methods their order, while a thrust rises and the vehicle turns: against a fine step.
#[test]
fn inflow_leaves_every_method_its_order() {
    let mut scene = puck("ambient_flow = 1.5\nlag = 0.3");
    let mut side = scene.vehicle.thrusters[0].clone();
    (side.name, side.position) = ("side".into(), Vector3::new(0.0, 0.05, 0.1));
    (side.lag, side.ambient_flow) = (Some(0.0), Some(0.3));
    scene.vehicle.thrusters.push(side);
    let end = |integrator: &str, steps: usize| {
        // At full inflow throughout, and without thrusts of 0: the loss has kinks there.
        let mut state = State { twist: Vector6::new(0.5, 0.1, 0.0, 0.1, 0.2, -0.2), ..State::default() };
        state.thrust[..2].copy_from_slice(&[20.0, 6.0]);
        run(&scene, integrator, 1.28 / steps as f64, &state, &thrust(&[50.0, 6.0]), steps)
    };
    let exact = end("mk4", 4096);
    for (integrator, order) in [("mk4", 4.0), ("mk3", 3.0), ("mk2", 2.0), ("ros2", 2.0), ("ros3", 3.0)] {
        let errors = [16, 32, 64].map(|steps| {
            let state = end(integrator, steps);
            (state.position - exact.position).norm() + (state.twist - exact.twist).norm()
        });
        assert!(orders(&errors).iter().all(|x| *x > order - 0.1), "{integrator}: {errors:?}");
    }
}

#[test]
fn the_hull_deducts_and_is_pushed() {
    let plain = compile(&puck("")).system;
    assert!(plain.thrusters.is_empty());
    let scene = puck("deduction = 0.2\ninduced = [0, 0, 0, 0.03, 0, 0]");
    assert!(compile(&scene).system == plain, "a matter of the thruster configuration alone");
    let mut simulator = simulator(&scene, "mk4", 0.01);
    let configuration = simulator.allocation().configuration();
    assert_eq!(configuration.column(0).as_slice(), [0.8, 0.0, 0.0, 0.03, 0.0, 0.0]);
    let rates = simulator.forward_dynamics(&thrust(&[10.0])).unwrap();
    assert!((rates[0] - 0.8).abs() < 1e-15 && (rates[3] - 0.3).abs() < 1e-15);
    // With dynamics too.
    let mut lagging = cases::simulator(&puck("deduction = 0.2\nlag = 0.0\ndead_band = 1.0"), "mk4", 0.01);
    assert!((lagging.forward_dynamics(&thrust(&[10.0])).unwrap()[0] - 0.8).abs() < 1e-15);
}

/// Every thruster of a shipped vehicle with everything.
pub fn complete(name: &str) -> Scene {
    let mut scene = Scene::shipped(name).unwrap();
    scene.vehicle.thruster_lag = Some(0.1);
    for (i, thruster) in scene.vehicle.thrusters.iter_mut().enumerate() {
        thruster.ambient_flow = Some(1.8);
        match i % 3 {
            0 => thruster.map = Some(ThrustMap::T200),
            1 => thruster.dead_band = Some(2.0),
            _ => thruster.lag = Some(0.05 * i as f64),
        }
    }
    scene.check().unwrap();
    scene
}

/// Terms that are stated as nothing are not there, bit for bit.
#[test]
fn thrusters_without_dynamics_are_not_there() {
    let plain = Scene::shipped("bluerov2-heavy").unwrap();
    let mut stated = plain.clone();
    stated.vehicle.thruster_lag = Some(0.0);
    for thruster in &mut stated.vehicle.thrusters {
        (thruster.lag, thruster.dead_band, thruster.ambient_flow) = (Some(0.0), Some(0.0), Some(0.0));
        (thruster.deduction, thruster.induced) = (Some(0.0), Some([0.0; 6]));
    }
    assert!(compile(&plain).system == compile(&stated).system);
    let [mut plain, stated] = [plain, stated].map(|scene| simulator(&scene, "mk4", 0.01));
    assert_eq!(plain.allocation().configuration(), stated.allocation().configuration());
    let states = States { thrust: Some(&[0.0; 8]), ..Default::default() };
    assert!(matches!(plain.set_states(&states), Err(SimulatorError::NoThrusterState { .. })));
}

/// Where nothing holds thrust back, dynamics change what steps only by rounding.
#[test]
fn dynamics_that_do_nothing_change_nothing() {
    let plain = Scene::shipped("bluerov2-heavy-alpha5").unwrap();
    let mut quick = plain.clone();
    quick.vehicle.thruster_lag = Some(1e-12);
    for integrator in Integrator::NAMES.map(|entry| entry.name) {
        let end = |scene: &Scene| {
            let mut simulator = simulator(scene, integrator, 0.005);
            simulator.step(&thrust(&[10.0, -5.0, 3.0, 8.0, -2.0, 1.0, 4.0, -9.0]), 20).unwrap();
            simulator.state(0)
        };
        let (a, b) = (end(&plain), end(&quick));
        if a.twist.iter().all(|x| x.is_finite() && x.abs() < 1e3) {
            assert!((a.twist - b.twist).amax() < 1e-11, "{integrator}");
        }
    }
}

#[test]
fn what_no_thruster_has_is_refused_by_key() {
    let scene = |change: &str| {
        let plain = puck("").to_toml_string();
        let text = plain.replace("limits = [-40.0, 60.0]", &format!("limits = [-40.0, 60.0]\n{change}"));
        Scene::from_toml_str(&text, "puck.toml").map(drop).map_err(|error| error.to_string())
    };
    assert_eq!(scene("lag = 0.1"), Ok(()));
    for (change, expected) in [
        ("lag = -0.1", "puck.toml: vehicle.thrusters[0].lag (main): is -0.1, but must be >= 0"),
        ("dead_band = -1.0", "vehicle.thrusters[0].dead_band (main): is -1.0, but must be >= 0"),
        ("ambient_flow = nan", "vehicle.thrusters[0].ambient_flow (main): NaN is not a finite number"),
        ("deduction = 1.0", "vehicle.thrusters[0].deduction (main): is 1.0, but must be at least 0 and below 1"),
        ("induced = [1.0]", "vehicle.thrusters[0].induced (main): expected 6 numbers, found 1"),
        ("map = 3", "vehicle.thrusters[0].map (main): "),
        ("map = [[0, 0], [1, 2, 3]]", "vehicle.thrusters[0].map (main): expected pairs, found 3 numbers"),
        ("map = [[1, 1]]", "vehicle.thrusters[0].map (main): must contain the pair [0, 0]"),
        ("map = [[0, 0], [0, 1]]", "commands must ascend"),
        ("map = [[0, 0], [1, -1]]", "thrusts must not descend"),
        ("lags = 1", "vehicle.thrusters[0].lags (main): unknown key"),
    ] {
        let error = scene(change).unwrap_err();
        assert!(error.contains(expected), "{change}: {error}");
    }
    let error =
        Scene::from_toml_str(&puck("").to_toml_string().replace("[vehicle]\n", "[vehicle]\nthruster_lag = -1\n"), "x");
    assert!(error.unwrap_err().to_string().contains("vehicle.thruster_lag: is -1.0"));
}

#[test]
fn scenes_with_thruster_dynamics_round_trip() {
    for scene in [complete("petasus-pum"), puck("map = [[-1, -2], [0, 0], [3, 4]]\ninduced = [0, 1, 2, 3, 4, 5]")] {
        assert_eq!(Scene::from_toml_str(&scene.to_toml_string(), "again").unwrap(), scene);
    }
}

/// Tasks command thrusters that lag; episodes begin with all at rest; neighbours make no difference.
#[test]
fn tasks_command_lagging_thrusters() {
    let scene = complete("bluerov2-heavy-alpha5");
    let batch = |instances: usize| {
        let options = TaskOptions { substeps: 2, ..TaskOptions::default() };
        let simulator = SimulatorOptions { instances, ..SimulatorOptions::default() };
        let mut batch = TaskBatch::new(scene.clone(), options, simulator, Autoreset::NextStep, Some(4)).unwrap();
        batch.reset(&(0..instances as u64).map(Some).collect::<Vec<_>>(), None, &[]).unwrap();
        batch
    };
    let (mut one, mut many) = (batch(1), batch(11));
    for step in 0..6 {
        let at_rest = one.simulator().state(0).thrust == [0.0; 16];
        assert_eq!(at_rest, step == 0 || step == 5, "at rest where episodes begin");
        let action: Vec<f32> = (0..one.task().action_len()).map(|k| (1.3 * (k + 7 * step) as f32).sin()).collect();
        let (a, b) = (one.step(&action).unwrap(), many.step(&action.repeat(11)).unwrap());
        assert_eq!(a.observations, b.observations[..a.observations.len()]);
        assert_eq!(one.simulator().state(0), many.simulator().state(0));
    }
    assert_ne!(one.simulator().state(0).thrust, [0.0; 16]);
}
