//! Estimates of accumulated errors, against converged motions.

use nalgebra::{Matrix3, Vector3};
use uvms_gym::batch::{
    Cause, ErrorEstimate, InaccurateStep, Inputs, Precision, Simulator, SimulatorOptions, StepQuality, StepViolation,
};
use uvms_gym::description::Scene;
use uvms_gym::dynamics::Servos;
use uvms_gym::system::State;

use crate::cases::branched;
use crate::random_scene::{Random, random_state};

/// Instances of a test.
const N: usize = 12;
const PERIOD: f64 = 0.1;

fn simulator(scene: &Scene, integrator: &str, dt: f64, options: &SimulatorOptions) -> Simulator {
    let options = SimulatorOptions { integrator: integrator.into(), dt, ..options.clone() };
    let mut simulator = Simulator::new(scene.clone(), options).unwrap();
    for i in 0..simulator.instances() {
        let mut state = random_state(i as u64, scene);
        state.twist *= 0.3;
        simulator.set_state(i, &state);
    }
    simulator
}

/// A free body with these moments of inertia.
fn body(inertia: [f64; 3]) -> Scene {
    let mut scene = Scene::shipped("free-body").unwrap();
    scene.vehicle.body.inertia = Matrix3::from_diagonal(&inertia.into());
    scene
}

/// The options with an estimate.
fn estimated(instances: usize, integrator: &str, dt: f64) -> SimulatorOptions {
    let integrator = integrator.into();
    SimulatorOptions { instances, integrator, dt, error_estimate: Some(true), ..Default::default() }
}

fn moving(twist: [f64; 6]) -> State {
    State { twist: twist.into(), ..State::default() }
}

/// Two seconds of random wrenches and servo targets that are held for a period each.
fn drive(simulator: &mut Simulator) {
    let steps = (PERIOD / simulator.options().dt).round() as usize;
    let (n, joints, mut random) = (simulator.instances(), simulator.joints(), Random::new(3));
    for _ in 0..20 {
        let row: Vec<f64> = (0..6).map(|_| random.between(-20.0, 20.0)).collect();
        let wrench: Vec<f64> = (0..n).flat_map(|_| row.clone()).collect();
        let target: Vec<f64> = (0..joints).map(|_| random.between(-0.3, 0.3)).collect();
        let target: Vec<f64> = (0..n).flat_map(|_| target.clone()).collect();
        let joint_target = (joints > 0).then_some(&target[..]);
        simulator.step(&Inputs { wrench: Some(&wrench), joint_target, ..Inputs::default() }, steps).unwrap();
    }
}

fn estimates(simulator: &Simulator) -> Vec<ErrorEstimate> {
    simulator.error_estimates().unwrap()
}

/// Errors of single quantities pass through zero: not all are met.
#[test]
fn the_estimate_is_the_error() {
    for (precision, minimum) in [(Precision::Double, 0.95), (Precision::Single, 0.9)] {
        let options = SimulatorOptions { instances: N, precision, error_estimate: Some(true), ..Default::default() };
        let mut found: Vec<(&str, Vec<f64>)> = Vec::new();
        let shipped = ["petasus-pum", "bluerov2-heavy", "rexrov"].map(|name| Scene::shipped(name).unwrap());
        for scene in shipped.into_iter().chain([branched()]) {
            let mut exact = simulator(&scene, "mk4", 0.0005, &SimulatorOptions { instances: N, ..Default::default() });
            drive(&mut exact);
            for integrator in ["mk4", "mk3", "mk2", "ros2", "ros3"] {
                for dt in [0.01, 0.02] {
                    let mut s = simulator(&scene, integrator, dt, &options);
                    drive(&mut s);
                    let mut quotients = Vec::new();
                    for (i, estimate) in estimates(&s).iter().enumerate() {
                        let (a, b) = (s.state(i), exact.state(i));
                        for (estimate, error) in [
                            (estimate.position, (a.position - b.position).norm()),
                            (estimate.attitude, (a.rotation - b.rotation).norm() / 2f64.sqrt()),
                        ] {
                            if (1e-8..0.1).contains(&error) {
                                quotients.push(estimate / error);
                            }
                        }
                    }
                    found.push((integrator, quotients));
                }
            }
        }
        let all: Vec<f64> = found.iter().flat_map(|(_, quotients)| quotients.clone()).collect();
        let within = all.iter().filter(|quotient| (1.0 / 3.0..3.0).contains(*quotient)).count();
        println!("{precision:?}: {within} of {} within a factor 3", all.len());
        for (integrator, quotients) in &mut found {
            quotients.sort_by(f64::total_cmp);
            if let Some(median) = quotients.get(quotients.len() / 2) {
                println!("{integrator}: median {median:.2}, {:.2?}", [quotients[0], quotients[quotients.len() - 1]]);
                assert!((0.5..2.0).contains(median), "{integrator}");
            }
        }
        assert!(all.len() > 300 && within as f64 > minimum * all.len() as f64, "{within} of {}", all.len());
    }
}

#[test]
fn states_do_not_depend_on_the_estimate_nor_the_estimate_on_other_instances() {
    let scenes = [Scene::shipped("petasus-pum").unwrap(), branched()];
    for (scene, precision) in scenes.iter().flat_map(|scene| [(scene, Precision::Double), (scene, Precision::Single)]) {
        for integrator in ["mk4", "ros3", "mk54", "quaternion-rk4", "lagged-added-mass"] {
            let run = |instances: usize, error_estimate: Option<bool>| {
                let options = SimulatorOptions { instances, precision, error_estimate, ..Default::default() };
                let mut s = simulator(scene, integrator, 0.01, &options);
                drive(&mut s);
                s
            };
            let [plain, one, many] = [run(1, Some(false)), run(1, Some(true)), run(N, Some(true))];
            for other in [&one, &many, &run(1, None), &run(N, None)] {
                assert_eq!(plain.state(0), other.state(0), "{integrator}");
            }
            assert_eq!(estimates(&one)[0], estimates(&many)[0], "{integrator}");
            assert_eq!(plain.error_estimates(), None);
        }
    }
}

#[test]
fn a_set_state_has_no_error_and_a_saved_one_keeps_it() {
    let scene = Scene::shipped("bluerov2-heavy").unwrap();
    let options = SimulatorOptions { instances: 3, error_estimate: Some(true), ..Default::default() };
    let mut s = simulator(&scene, "mk2", 0.05, &options);
    drive(&mut s);
    let before = estimates(&s);
    assert!(before.iter().all(|e| e.position > 1e-6 && e.relative > 0.0), "{before:?}");
    let saved = s.save();
    s.set_state(1, &State::default());
    let after = estimates(&s);
    assert_eq!((after[0], after[1].position, after[1].relative), (before[0], 0.0, 0.0));
    s.load(&saved).unwrap();
    assert_eq!(estimates(&s), before);
    drive(&mut s);
    let longer = estimates(&s);
    s.load(&saved).unwrap();
    drive(&mut s);
    assert_eq!(estimates(&s), longer);
}

/// A body that tumbles without forces, at steps that resolve it and at longer ones: one warning for all instances.
#[test]
fn accumulated_errors_are_said_once_with_their_number() {
    let scene = body([1.0, 2.0, 3.0]);
    for (dt, said) in [(0.001, false), (0.05, true)] {
        let mut s = Simulator::new(scene.clone(), estimated(20, "mk2", dt)).unwrap();
        for i in [4, 9, 17] {
            s.set_state(i, &moving([0.0, 0.0, 0.0, 0.5, 2.0, 0.1]));
        }
        let mut text = Vec::new();
        for _ in 0..40 {
            s.step(&Inputs::default(), (0.5 / dt).round() as usize).unwrap();
            while let Some(warning) = s.warn_of_motion() {
                assert_eq!(warning.estimate, s.error_estimate(4));
                text.push(warning);
            }
        }
        assert_eq!(text.len(), usize::from(said), "{text:?}");
        let Some(warning) = text.pop() else { continue };
        let far = StepQuality { accumulated: 0.5, ..warning.violation.quality };
        let far = StepViolation { quality: far, ..warning.violation };
        let estimate = warning.estimate.expect("an estimate");
        assert!(warning.to_string().contains(&format!("(estimate: {estimate}; ")), "{warning}");
        for (warning, remedy) in [
            (warning.clone(), "a step of at most"),
            (InaccurateStep { adaptive: true, ..warning.clone() }, "a smaller tolerance would do"),
            (InaccurateStep { violation: far, ..warning }, "beyond what the estimate can tell"),
        ] {
            let text = warning.to_string();
            for part in ["instance 4 and 2 more of 20", "errors have added up", remedy] {
                assert!(text.contains(part), "{part}: {text}");
            }
        }
    }
}

/// A long call is made in portions, whose length depends on the number of instances.
#[test]
fn portions_of_a_call_make_no_difference_to_the_estimate() {
    let scene = body([1.0, 2.0, 3.0]);
    let run = |instances: usize| {
        let mut s = Simulator::new(scene.clone(), estimated(instances, "mk4", 0.001)).unwrap();
        s.set_state(0, &moving([0.0, 0.0, 0.0, 0.5, 2.0, 0.1]));
        s.step(&Inputs::default(), 20_001).unwrap();
        estimates(&s)[0]
    };
    let (whole, portions) = (run(1), run(7));
    assert!(whole.attitude > 0.0);
    assert_eq!(whole, portions);
}

/// A body in straight flight that spins by nearly half a revolution within a step: lanes divide it in two. A companion with the same
/// limit would not divide its half steps, take the same sub-intervals, and see nothing.
#[test]
fn steps_that_fast_turns_divide_are_told_apart() {
    let scene = Scene::shipped("free-body").unwrap();
    for (integrator, spin) in [("mk4", 31.0), ("mk3", 31.0), ("ros3", 9.0)] {
        let mut s = Simulator::new(scene.clone(), estimated(1, integrator, 0.1)).unwrap();
        let velocity = Vector3::new(1.0, 0.5, -0.5);
        s.set_state(0, &moving([1.0, 0.5, -0.5, 0.0, 0.0, spin]));
        s.step(&Inputs::default(), 2).unwrap();
        let (error, estimate) = ((s.state(0).position - velocity * 0.2).norm(), estimates(&s)[0].position);
        println!("{integrator}: {error:.2e} m, estimate {estimate:.2e} m");
        assert!(error > 1e-6 && estimate > error / 5.0, "{integrator}: {error}, estimate {estimate}");
    }
}

/// A slow sideways motion decays at a rate that the step resolves and a longer one amplifies, beside a fast one forwards.
#[test]
fn a_companion_is_stable_where_the_step_is() {
    let mut scene = Scene::shipped("free-body").unwrap();
    scene.vehicle.body.damping.linear[(1, 1)] = 18.0;
    let mut s = Simulator::new(scene, estimated(1, "mk4", 0.1)).unwrap();
    s.set_state(0, &moving([1.0, 0.02, 0.0, 0.0, 0.0, 0.0]));
    assert!(s.warn_of_step(Servos { joints: false, vehicle: false }).is_none());
    for _ in 0..40 {
        s.step(&Inputs::default(), 5).unwrap();
    }
    let found = estimates(&s)[0];
    assert!(found.known() && s.warn_of_motion().is_none(), "{found:?}");
}

/// An arm on a fixed base, far too fast for the step: where nothing finite follows the motion, the error is not known.
#[test]
fn an_error_that_no_finite_motion_tells_is_not_known_and_is_said() {
    let mut scene = Scene::shipped("petasus-pum").unwrap();
    scene.vehicle.fixed = true;
    let mut s = Simulator::new(scene, SimulatorOptions { error_estimate: Some(true), ..Default::default() }).unwrap();
    let mut state = State { q: s.scene().home(), ..State::default() };
    for (k, rate) in [80.0, -80.0, 80.0, -80.0, 80.0].into_iter().enumerate() {
        state.qd[k] = rate;
    }
    s.set_state(0, &state);
    s.step(&Inputs::default(), 20).unwrap();
    let found = estimates(&s)[0];
    assert!(!found.known(), "{found:?}");
    let warning = s.warn_of_motion().expect("a warning");
    assert!(!warning.to_string().contains("NaN %"), "{warning}");
    // Steps of the same motion that are accurate, where the companion alone is lost.
    let quality = StepQuality { stiffness: 0.0, error: 0.0, accumulated: f64::NAN };
    let violation = StepViolation { quality, ..warning.violation };
    let lost = InaccurateStep { cause: Cause::Accumulated, violation, ..warning }.to_string();
    assert!(lost.contains("errors have added up") && !lost.contains("NaN %"), "{lost}");

    let lost = ErrorEstimate { relative: f64::NAN, ..ErrorEstimate::ZERO };
    assert!(!lost.known());
    let q = std::array::from_fn(|k| if k == 0 { f64::NAN } else { 1.0 });
    assert!(ErrorEstimate { q, ..lost }.to_string().contains("joints NaN"));
}

/// Needles that spin, `wrong` ones so fast that the step errs by 0.1 rad within seconds.
fn needles(options: &SimulatorOptions, wrong: std::ops::Range<usize>) -> Simulator {
    let mut s = Simulator::new(body([1.0, 1.0, 1e-8]), options.clone()).unwrap();
    for i in 0..s.instances() {
        let spin = if wrong.contains(&i) { 0.6 } else { 0.01 } / options.dt;
        s.set_state(i, &moving([0.0, 0.0, 0.0, 0.2, -0.3, spin]));
    }
    s
}

/// The first warning within a time, s, by calls of ten steps.
fn first_warning(s: &mut Simulator, time: f64) -> Option<InaccurateStep> {
    let calls = (time / (10.0 * s.options().dt)).round() as usize;
    (0..calls).find_map(|_| {
        s.step(&Inputs::default(), 10).unwrap();
        s.warn_of_motion()
    })
}

#[test]
fn errors_that_add_up_are_said_by_default_within_seconds() {
    for precision in [Precision::Double, Precision::Single] {
        for instances in [1, 3, 8, 64, 300] {
            for (error_estimate, wrong) in [(None, true), (None, false), (Some(false), true)] {
                let options = SimulatorOptions { instances, precision, error_estimate, ..Default::default() };
                let mut s = needles(&options, if wrong { 0..instances } else { 0..0 });
                let found = first_warning(&mut s, 10.0);
                assert_eq!(found.is_some(), error_estimate.is_none() && wrong, "{instances}: {found:?}");
                assert_eq!(s.error_estimates(), None);
                let Some(warning) = found else { continue };
                let expected = format!("instance 0{}: errors have added up", more(instances.min(8), instances));
                assert!(warning.to_string().contains(&expected) && warning.estimate.is_some(), "{warning}");
            }
        }
    }
}

fn more(count: usize, instances: usize) -> String {
    if count > 1 { format!(" and {} more of {instances}", count - 1) } else { String::new() }
}

/// Some of many instances are followed for ten seconds at a time.
#[test]
fn the_next_instances_have_their_turn() {
    let options = SimulatorOptions { instances: 128, dt: 0.1, ..Default::default() };
    let warning = first_warning(&mut needles(&options, 8..9), 400.0).expect("a warning");
    assert_eq!((warning.violation.instance, warning.violation.count), (8, 1), "{warning}");
    assert!(warning.violation.time > 100.0, "{warning}");
}

/// Errors from before its state was set do not count.
#[test]
fn a_watched_instance_begins_anew_with_its_state() {
    let options = SimulatorOptions { instances: 64, ..Default::default() };
    let mut s = needles(&options, 0..64);
    s.step(&Inputs::default(), 100).unwrap();
    for i in 0..64 {
        s.set_state(i, &State { time: 5.0, ..moving([0.0, 0.0, 0.0, 0.2, -0.3, 1.0]) });
    }
    assert!(first_warning(&mut s, 8.0).is_none());
}
