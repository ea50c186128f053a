//! Rates of scenes against closed forms, and stable steps against what steps do.

use nalgebra::{Complex, Matrix3, Vector3, Vector6};
use uvms_gym::batch::{Cause, Inputs, Mode};
use uvms_gym::description::{JointLimits, JointServo, Scene, Tether, VehicleServo};
use uvms_gym::dynamics::{ClosedFormModel, Servos};
use uvms_gym::integrate::{EULER, GROWTH, Gains, HEUN3, Integrator, MIDPOINT, PASSING, RK4, Stability, Tableau};
use uvms_gym::system::State;

use crate::cases::{self, PRECISIONS, batch, diagonal, drift, run, simulator, simulator_at, vacuum, with_gains};
use crate::random_scene::Random;

const OFF: Servos = Servos { joints: false, vehicle: false };
const JOINTS: Servos = Servos { joints: true, vehicle: false };
const BOTH: Servos = Servos { joints: true, vehicle: true };

/// Rates of a scene at home at rest.
fn rates(scene: &Scene, inputs: &Inputs, servos: Servos) -> Vec<Complex<f64>> {
    let simulator = simulator(scene, "mk4", 0.01);
    let linear = simulator.linearize(inputs, 0).unwrap();
    linear.with_servos(&simulator.compiled().system, servos).modes().rates()
}

/// The rate among `rates` next to `wanted`, which must be within a share of `tolerance`.
#[track_caller]
fn assert_has(rates: &[Complex<f64>], wanted: Complex<f64>, tolerance: f64) {
    let nearest = rates.iter().map(|rate| (rate - wanted).norm()).fold(f64::INFINITY, f64::min);
    assert!(nearest < tolerance * wanted.norm(), "{wanted} is not among {rates:?}");
}

fn real(x: f64) -> Complex<f64> {
    Complex::new(x, 0.0)
}

/// Roots of `a s^2 + b s + c`, the one of positive imaginary part or the faster one first.
fn roots(a: f64, b: f64, c: f64) -> [Complex<f64>; 2] {
    let root = real(b * b - 4.0 * a * c).sqrt();
    [(-real(b) - root) / (2.0 * a), (-real(b) + root) / (2.0 * a)]
}

/// A body of 2 kg with 3 kg of added mass ahead.
fn body() -> Scene {
    cases::body(|body| (body.mass, body.added_mass[(0, 0)]) = (2.0, 3.0))
}

#[test]
fn val_rate_of_a_mass_and_a_damper() {
    let mut scene = body();
    scene.vehicle.body.damping.linear[(0, 0)] = 20.0;
    assert_has(&rates(&scene, &Inputs::default(), OFF), real(-4.0), 1e-12);

    // At 1.5 m/s, quadratic drag counts twice.
    scene.vehicle.body.damping.quadratic[(0, 0)] = 10.0;
    let survey = simulator(&scene, "mk4", 0.01).modal_analysis(Some(&[1.5, 0.0, 0.0, 0.0, 0.0, 0.0])).unwrap();
    let fastest = &survey.modes(OFF)[0];
    assert!((fastest.rate + 10.0).norm() < 1e-9, "{fastest:?}");
    assert_eq!((fastest.what.as_str(), fastest.place.as_str()), ("vehicle surge", "at home, surge at 1.50 m/s"));
}

#[test]
fn val_rate_of_the_restoring_pendulum() {
    let mut scene = body();
    scene.water.gravity = Vector3::new(0.0, 0.0, -9.81);
    let (mass, across, below, turning) = (2.0, 3.0, 0.1, 0.4);
    let body = &mut scene.vehicle.body;
    (body.volume, body.center_of_mass) = (Some(mass / 1000.0), Vector3::new(0.0, 0.0, -below));
    body.inertia = Matrix3::identity();
    body.added_mass = diagonal([1.0, across, 1.0, turning, 0.2, 0.2]);
    // In roll, about the origin at the centre of buoyancy.
    let inertia = 1.0 + mass * below * below + turning - (mass * below).powi(2) / (mass + across);
    let frequency = (mass * 9.81 * below / inertia).sqrt();
    assert_has(&rates(&scene, &Inputs::default(), OFF), Complex::new(0.0, frequency), 1e-9);
}

/// PETASUS with the first `links` links of its arm in a vacuum, joints without rotors and servos.
fn dry(links: usize) -> Scene {
    let mut scene = vacuum(&Scene::shipped("petasus-pum").unwrap());
    scene.vehicle.servo = None;
    scene.arm.as_mut().unwrap().links.truncate(links);
    scene.joints_mut().for_each(|joint| (joint.servo, joint.rotor_inertia) = (None, 0.0));
    scene
}

/// Entry of the inverse mass matrix of a joint.
fn mobility(scene: &Scene, state: &State, joint: usize) -> f64 {
    let model = ClosedFormModel::new(scene).unwrap();
    let inverse = model.at(state, Vector3::zeros()).mass_matrix().clone().try_inverse().unwrap();
    inverse[(6 + joint, 6 + joint)]
}

#[test]
fn val_rates_of_a_servo_on_one_joint_of_a_floating_vehicle() {
    for (kp, kd) in [(40.0, 0.5), (3.0, 8.0)] {
        let mut scene = dry(3);
        let joint = &mut scene.arm.as_mut().unwrap().links[1].joint;
        joint.servo = Some(JointServo { kp, kd });
        joint.friction.viscous = 0.25;
        let state = State { q: scene.home(), ..State::default() };
        let found = rates(&scene, &Inputs::default(), JOINTS);
        for root in roots(1.0 / mobility(&scene, &state, 1), kd + 0.25, kp) {
            assert_has(&found, root, 1e-9);
        }
        let survey = simulator(&scene, "mk4", 0.01).modal_analysis(None).unwrap();
        assert!(survey.modes(JOINTS)[0].what.starts_with("joint 1 (upper-arm)"));
    }
}

#[test]
fn val_rates_of_the_station_servo() {
    let mut scene = body();
    scene.vehicle.servo =
        Some(VehicleServo { kp: [20.0, 8.0, 0.0, 9.0, 0.0, 0.0], kd: [5.0, 1.0, 0.0, 2.0, 0.0, 0.0] });
    let found = rates(&scene, &Inputs::default(), BOTH);
    for root in [roots(5.0, 5.0, 20.0), roots(2.0, 1.0, 8.0), roots(1.0, 2.0, 9.0)].concat() {
        assert_has(&found, root, 1e-9);
    }
    assert!(rates(&scene, &Inputs::default(), OFF).iter().all(|rate| rate.norm() < 1e-6));
}

#[test]
fn an_end_stop_is_a_rate_of_its_own() {
    let mut scene = dry(1);
    let joint = &mut scene.arm.as_mut().unwrap().links[0].joint;
    joint.limits = Some(JointLimits { lower: -1.0, upper: 1.0, stiffness: 50.0, damping: 0.0 });
    let survey = simulator(&scene, "mk4", 0.01).modal_analysis(None).unwrap();
    let modes = survey.modes(OFF);
    let mut state = State::default();
    state.q[0] = 1.0;
    let frequency = (50.0 * mobility(&scene, &state, 0)).sqrt();
    assert!(modes[0].stop && (modes[0].rate - Complex::new(0.0, frequency)).norm() < 0.02 * frequency, "{modes:?}");
    // It bounds the step only where stops are asked for.
    let explicit = Stability::Explicit(&RK4);
    assert!(survey.stable_step(explicit, OFF, false).0 * frequency > 10.0);
    let (step, mode) = survey.stable_step(explicit, OFF, true);
    assert!((step * frequency - 2.828).abs() < 0.06 && mode.unwrap().place.contains("stop"), "{step}");
}

#[test]
fn val_limits_of_stability() {
    let euler_along_i = 2.0 * GROWTH; // h w^2 / 2 = GROWTH
    let midpoint_along_i = (8.0 * GROWTH).cbrt(); // h^3 w^4 / 8 = GROWTH
    let fast: f64 = 1e3;
    for (stability, along_real, along_imaginary) in [
        (Stability::Explicit(&EULER), 2.0, euler_along_i / fast),
        (Stability::Explicit(&MIDPOINT), 2.0, midpoint_along_i / fast.cbrt()),
        (Stability::Explicit(&HEUN3), 2.51274532662, 3f64.sqrt()),
        (Stability::Explicit(&RK4), 2.78529356340, 8f64.sqrt()),
        (Stability::SemiImplicitEuler, 2.0, 2.0),
        (Stability::LinearlyImplicit { order: 2 }, f64::INFINITY, f64::INFINITY),
        (Stability::Adaptive, f64::INFINITY, f64::INFINITY),
    ] {
        for (rate, limit) in [(real(-fast), along_real), (Complex::new(0.0, fast), along_imaginary)] {
            let step = stability.max_step(rate, 0.0, f64::INFINITY);
            assert!(step == limit || (step * fast / limit - 1.0).abs() < 1e-4, "{stability:?}: {}", step * fast);
            assert_eq!(stability.max_step(rate, 0.0, 1e-12), 1e-12, "no more than asked for");
        }
        // What grows by itself bounds no step, and neither does what does not change.
        for rate in [real(3.0), Complex::new(1.0, 5.0), real(0.0)] {
            assert_eq!(stability.max_step(rate, 0.0, f64::INFINITY), f64::INFINITY);
        }
    }
    // Lenience counts for light damping, and leaves the limits where damping is strong.
    let step = |rate, lenience| Stability::Explicit(&EULER).max_step(rate, lenience, f64::INFINITY);
    assert!((step(Complex::new(0.0, 1.0), PASSING) / 0.2 - 1.0).abs() < 0.03);
    assert!((step(real(-10.0), PASSING) - 0.2).abs() < 1e-3);
}

#[test]
fn val_the_stability_function_is_the_exponential_to_the_order() {
    for tableau in [&EULER, &MIDPOINT, &HEUN3, &RK4] {
        let error = |size: f64| {
            let z = Complex::new(-0.6, 0.8) * size;
            (tableau.stability(z) - z.exp()).norm()
        };
        let order = (error(0.02) / error(0.01)).log2() - 1.0;
        assert!((order - tableau.order as f64).abs() < 0.02, "{tableau:?}: {order}");
    }
}

#[test]
fn val_the_linearly_implicit_methods_are_stable_at_any_step() {
    // Maximum amplification of an undamped oscillation by a step.
    for (order, growth) in [(2, 1e-15), (3, 0.0017)] {
        let factor = |z: Complex<f64>| Stability::LinearlyImplicit { order }.factor(z);
        for angle in 0..=90 {
            for exponent in -80..=240 {
                let turn = Complex::new(0.0, std::f64::consts::FRAC_PI_2 * (1.0 + f64::from(angle) / 90.0)).exp();
                let z = turn * 2f64.powf(0.25 * f64::from(exponent));
                let bar = if angle < 5 { growth } else { 1e-15 };
                assert!(factor(z) <= 1.0 + bar, "order {order}, {z}: {}", factor(z));
            }
        }
        assert!(factor(real(-1e12)) < 1e-10, "it is L-stable");
        let error = |x: f64| (factor(real(-x)) - (-x).exp()).abs();
        let observed = (error(0.04) / error(0.02)).log2() - 1.0;
        assert!((observed - order as f64).abs() < 0.15, "order {order}: {observed}");
    }
}

#[test]
fn a_step_of_a_damped_mass_is_the_stability_function() {
    let mut scene = body();
    scene.vehicle.body.damping.linear[(0, 0)] = 20.0;
    for (name, tableau) in
        [("mk1", &EULER), ("mk2", &MIDPOINT), ("mk3", &HEUN3), ("mk4", &RK4)] as [(&str, &Tableau); 4]
    {
        assert_eq!(Integrator::named(name, &Gains::DEFAULT).unwrap().stability(), Stability::Explicit(tableau));
        for h in [0.05, 0.3, 0.8] {
            let start = State { twist: Vector6::ith(0, 1.0), ..State::default() };
            let expected = tableau.stability(real(-4.0 * h)).re;
            assert!((drift(&scene, name, h, &start, 1).twist[0] - expected).abs() < 1e-12, "{name}, {h}");
        }
    }
}

/// A scene with its gains times a factor, whose efforts have no limits.
fn stiffened(name: &str, factor: f64) -> Scene {
    let mut scene = with_gains(name, factor);
    scene.joints_mut().for_each(|joint| joint.effort = None);
    scene
}

/// Growth of a small deviation from a balanced rest at home in 600 steps with servos on.
fn growth(scene: &Scene, integrator: &str, dt: f64, balance: Inputs) -> f64 {
    let n = scene.joints().count();
    let mut state = simulator(scene, integrator, dt).state(0);
    state.twist = Vector6::from_fn(|k, _| 1e-10 * (1.0 + k as f64));
    (0..n).for_each(|k| state.qd[k] = 1e-10 * (3.0 - k as f64));
    let station = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let target = scene.home();
    let joint_target = (n > 0).then_some(&target[..n]);
    let inputs = Inputs { joint_target, pose_target: Some(&station), ..balance };
    let end = run(scene, integrator, dt, &state, &inputs, 600);
    let size = |state: &State| state.twist.iter().chain(&state.qd).fold(0.0, |a: f64, x| a.max(x.abs()));
    let finite = end.twist.iter().chain(&end.qd).all(|x| x.is_finite());
    if finite { size(&end) / size(&state) } else { f64::INFINITY }
}

#[test]
fn steps_below_the_stable_one_decay_and_steps_above_it_grow() {
    for name in ["petasus-pum", "bluerov2-heavy-alpha5", "bluerov2-heavy", "rexrov"] {
        for factor in [1.0, 10.0, 100.0] {
            let scene = stiffened(name, factor);
            let state = State { q: scene.home(), ..State::default() };
            let trim = ClosedFormModel::new(&scene).unwrap().trim(&state, Vector3::zeros()).unwrap();
            let (wrench, torque) = (trim.wrench.as_slice(), trim.joint_torques.as_slice());
            let balance = Inputs { wrench: Some(wrench), joint_torque: Some(torque), ..Inputs::default() };
            let found = rates(&scene, &balance, BOTH);
            for integrator in ["mk4", "mk3", "mk2"] {
                let stability = Integrator::named(integrator, &Gains::DEFAULT).unwrap().stability();
                let most = |h: f64, rate: &Complex<f64>| stability.max_step(*rate, 0.0, h);
                let stable = found.iter().fold(f64::INFINITY, most);
                let [below, above] = [0.9, 1.15].map(|f| growth(&scene, integrator, f * stable, balance));
                println!("{name} x{factor} {integrator}: {stable:.3e} s, growth {below:.2e} below, {above:.2e} above");
                assert!(below < 3.0, "{name} x{factor} {integrator}: {below} at 0.9 of {stable}");
                assert!(above > 1e3, "{name} x{factor} {integrator}: {above} at 1.15 of {stable}");
            }
        }
    }
}

#[test]
fn an_unstable_step_is_said_once_and_by_its_numbers() {
    let scene = stiffened("bluerov2-heavy-alpha5", 10.0);
    let mut s = simulator(&scene, "mk4", 0.02);
    // Without the servos it is stable: no warning.
    assert_eq!(s.warn_of_step(OFF), None);
    let unstable = s.warn_of_step(JOINTS).unwrap();
    let text = unstable.to_string();
    println!("{text}");
    for part in ["'bluerov2-heavy-alpha5'", "'mk4'", "dt = 0.02 s", "joint ", "1/s"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert!(!text.contains('\n'));
    assert!(unstable.stable < 0.02 && unstable.mode.rate.re < -100.0);
    // Neither again nor by copies.
    assert_eq!((s.warn_of_step(JOINTS), s.clone().warn_of_step(BOTH)), (None, None));
    // At the stable step there is nothing to say.
    assert_eq!(simulator(&scene, "mk4", 0.99 * unstable.stable).warn_of_step(JOINTS), None);
    assert!(simulator(&scene, "mk4", 1.01 * unstable.stable).warn_of_step(JOINTS).is_some());
}

#[test]
fn simulators_of_one_scene_share_their_survey() {
    let scene = stiffened("petasus-pum", 1.5);
    let [a, b] = [0.01, 0.02].map(|dt| simulator(&scene, "mk4", dt).modal_analysis(None).unwrap());
    assert!(std::sync::Arc::ptr_eq(&a, &b));
    let other = simulator(&stiffened("petasus-pum", 1.6), "mk4", 0.01).modal_analysis(None).unwrap();
    assert!(!std::sync::Arc::ptr_eq(&a, &other));
}

#[test]
fn a_fixed_vehicle_has_no_rates_and_a_speed_must_be_one() {
    let mut scene = Scene::shipped("petasus-pum").unwrap();
    scene.vehicle.fixed = true;
    let s = simulator(&scene, "mk4", 0.01);
    assert_eq!(s.expected_speed(), [0.0; 6]);
    let modes = s.modal_analysis(Some(&[1.0; 6])).unwrap().modes(BOTH);
    assert!(modes.len() > 5 && modes.iter().all(|mode| mode.what.starts_with("joint")), "{modes:?}");
    for speed in [-1.0, f64::NAN, f64::INFINITY] {
        let error = s.modal_analysis(Some(&[speed; 6])).err().unwrap().to_string();
        assert!(error.contains("speed is"), "{error}");
    }
}

/// A sphere of 2 kg on a tether, without thrusters: at the speed v its drag `c v |v|` adds the rates `2 c v / m` along the
/// current and `c v / m` across it.
#[test]
fn val_rates_of_a_tether_in_the_current_of_a_scene() {
    let (mass, speed) = (5.0, 1.0);
    let mut scene = body();
    scene.vehicle.body.added_mass = diagonal([3.0, 3.0, 3.0, 0.0, 0.0, 0.0]);
    scene.vehicle.tether = Some(Tether {
        position: Vector3::zeros(),
        length: 40.0,
        diameter: 0.02,
        drag: 1.2,
        mass_per_length: 1000.0 * std::f64::consts::FRAC_PI_4 * 0.02 * 0.02,
    });
    let drag = 0.5 * 1000.0 * 1.2 * 0.02 * 20.0;
    let (along, across) = (2.0 * drag * speed / mass, drag * speed / mass);
    let at_rest =
        simulator(&scene, "mk4", 0.01).modal_analysis(None).unwrap().stable_step(Stability::Explicit(&RK4), OFF, true);
    for current in [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [-0.6, 0.8, 0.0]] {
        scene.water.current = current.into();
        let s = simulator(&scene, "mk4", 0.03);
        let survey = s.modal_analysis(None).unwrap();
        let modes = survey.modes(OFF);
        assert!((modes[0].rate + along).norm() < 1e-4 * along, "{current:?}: {:?}", modes[0]);
        let rates: Vec<_> = modes.iter().map(|mode| mode.rate).collect();
        assert_has(&rates, real(-if current[2] == 0.0 { along } else { across }), 1e-4);
        let (step, _) = survey.stable_step(Stability::Explicit(&RK4), OFF, true);
        assert!((step * along - 2.785).abs() < 0.01 && step < 0.1 * at_rest.0, "{step} s, {} s at rest", at_rest.0);
        // A speed that is given is the one through the water.
        assert!(
            s.modal_analysis(Some(&[0.0; 6])).unwrap().modes(OFF).iter().all(|mode| mode.rate.norm() < 0.1 * along)
        );
    }
}

/// A fixed vehicle stays in the current: its arm has the rates of the motion of an arm through water at rest.
#[test]
fn a_fixed_vehicle_has_the_rates_of_its_arm_in_the_current() {
    let mut scene = Scene::shipped("petasus-pum").unwrap();
    scene.vehicle.fixed = true;
    let modes = |scene: &Scene, speed| simulator(scene, "mk4", 0.01).modal_analysis(speed).unwrap().modes(OFF);
    let still = modes(&scene, None);
    let given = modes(&scene, Some(&[5.0, 5.0, 0.0, 0.0, 0.0, 0.0]));
    scene.water.current = Vector3::new(5.0, 0.0, 0.0);
    let own = modes(&scene, None);
    assert_eq!(own, given);
    let decaying = |modes: &[Mode]| modes.iter().find(|mode| !mode.stop).unwrap().rate.norm();
    assert!(decaying(&own) > 2.0 * decaying(&still), "{own:?} and {still:?}");
    assert!(own.iter().all(|mode| mode.what.starts_with("joint")));
}

#[test]
fn the_expected_speed_is_the_terminal_one() {
    let mut scene = Scene::shipped("bluerov2-heavy").unwrap();
    let s = simulator(&scene, "mk4", 0.01);
    let (speed, thrust) = (s.expected_speed(), s.allocation().wrench_limits());
    let body = &scene.vehicle.body.damping;
    for k in 0..6 {
        let drag = body.linear[(k, k)] * speed[k] + body.quadratic[(k, k)] * speed[k] * speed[k];
        assert!((drag / thrust[k] - 1.0).abs() < 1e-9, "axis {k}: {drag} N against {} N", thrust[k]);
    }
    scene.vehicle.body.damping = Default::default();
    assert_eq!(simulator(&scene, "mk4", 0.01).expected_speed(), [5.0; 6]);
    scene.vehicle.thrusters.clear();
    assert_eq!(simulator(&scene, "mk4", 0.01).expected_speed(), [0.0; 6]);
    scene.water.current = Vector3::new(3.0, -4.0, -0.5);
    assert_eq!(simulator(&scene, "mk4", 0.01).expected_speed(), [5.0, 5.0, 0.5, 0.0, 0.0, 0.0]);
}

#[test]
fn val_range_of_the_integrators() {
    for (tableau, range) in [(&EULER, 0.7), (&MIDPOINT, 1.2), (&HEUN3, 1.6), (&RK4, 2.0)] {
        let found = Stability::Explicit(tableau).range();
        assert!((found - range).abs() < 0.05, "order {}: {found}", tableau.order);
    }
    assert_eq!(Stability::Adaptive.range(), f64::INFINITY);
}

#[test]
fn a_state_that_is_lost_is_said_once() {
    let mut scene = body();
    scene.vehicle.body.damping.quadratic[(0, 0)] = 20.0;
    for precision in PRECISIONS {
        let mut s = batch(&scene, "mk1", 0.1, precision, 20);
        s.set_state(11, &State { twist: Vector6::ith(0, 1e3), ..State::default() });
        assert_eq!(s.warn_of_motion(), None);
        s.step(&Inputs::default(), 40).unwrap();
        let stray = s.warn_of_motion().unwrap();
        assert_eq!((stray.violation.instance, stray.violation.count, stray.cause), (11, 1, Cause::NotFinite));
        assert!(stray.to_string().contains("instance 11: state not finite"), "{stray}");
        s.step(&Inputs::default(), 1).unwrap();
        assert_eq!(s.warn_of_motion(), None);
    }
}

#[test]
fn shipped_scenes_stay_within_the_range_at_their_steps() {
    for name in Scene::shipped_names() {
        let scene = Scene::shipped(name).unwrap();
        for (integrator, dt) in [("mk4", 0.01), ("mk4", 0.02), ("mk3", 0.01), ("mk2", 0.01)] {
            for precision in PRECISIONS {
                let mut s = batch(&scene, integrator, dt, precision, 16);
                let (speed, n, mut random) = (s.expected_speed(), s.joints(), Random::new(5));
                let mut target = Vec::new();
                for i in 0..16 {
                    let mut state = s.state(i);
                    for k in 0..6 {
                        state.twist[k] = random.between(-0.7, 0.7) * speed[k];
                    }
                    for (k, joint) in scene.joints().enumerate() {
                        let limits = joint.limits.as_ref().unwrap();
                        state.q[k] = random.between(limits.lower, limits.upper);
                        state.qd[k] = random.between(-0.5, 0.5);
                        target.push(state.q[k] + random.between(-0.3, 0.3));
                    }
                    s.set_state(i, &state);
                }
                let inputs = Inputs { joint_target: (n > 0).then_some(&target), ..Inputs::default() };
                let mut maximum: f64 = 0.0;
                for _ in 0..20 {
                    s.step(&inputs, 5).unwrap();
                    maximum = (0..16).fold(maximum, |maximum, i| maximum.max(s.stiffness(i)));
                }
                println!("{name}, {integrator} at {dt} s, {precision:?}: h |rate| up to {maximum:.3}");
                // Coarser steps and lower orders get such starts wrong by percents, and say so.
                if (integrator, dt) == ("mk4", 0.01) {
                    assert_eq!(s.warn_of_motion(), None);
                }
                assert!(maximum < 2.0, "{maximum}");
            }
        }
    }
}

/// A steady spin shows no rate at all, whatever keeps a quaternion's length.
#[test]
fn a_kept_quaternion_is_no_reason_to_warn() {
    let scene = Scene::shipped("free-body").unwrap();
    for entry in Integrator::NAMES {
        let spin = State { twist: Vector6::ith(5, 1.0), ..State::default() };
        let mut s = simulator_at(&scene, entry.name, 0.1, &spin);
        s.step(&Inputs::default(), 1).unwrap();
        assert_eq!(s.warn_of_motion(), None);
    }
}
