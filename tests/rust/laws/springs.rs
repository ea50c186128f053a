//! Springs, detents and static friction of a joint on a fixed vehicle, against their closed forms.

use std::f64::consts::TAU;

use uvms_gym::batch::{Inputs, Simulator};
use uvms_gym::description::{Detent, Friction, JointKind, JointSpring, Scene};
use uvms_gym::dynamics::Loads;
use uvms_gym::system::State;

use crate::cases::{drift, run, simulator_at};

/// Inertia of the link about its axis, kg m2, added and rotor's included; and its mass along its way, kg.
const INERTIA: f64 = 0.4 + 0.2 + 0.05;
const MASS: f64 = 2.0 + 1.5 + 0.05;

/// A link on one joint, which weight does not turn.
fn scene(kind: &str, joint: &str) -> Scene {
    let axis = if kind == "revolute" { "[0.0, 1.0, 0.0]" } else { "[1.0, 0.0, 0.0]" };
    let text = format!(
        r#"
        name = "one joint"
        water = {{ density = 1000.0, gravity = [0.0, 0.0, -9.81] }}
        vehicle = {{ name = "held", fixed = true, body = {{ mass = 1.0, inertia = [1.0, 1.0, 1.0] }} }}
        [arm]
        name = "one joint"
        [[arm.links]]
        name = "link"
        joint = {{ kind = "{kind}", axis = {axis}, rotor_inertia = 0.05, {joint} }}
        body = {{ mass = 2.0, inertia = [0.3, 0.4, 0.5], added_mass = [1.5, 3.0, 4.0, 0.1, 0.2, 0.3] }}
        "#
    );
    Scene::from_toml_str(&text, "one joint").unwrap()
}

fn at(q: f64, qd: f64) -> State {
    let mut state = State::default();
    (state.q[0], state.qd[0]) = (q, qd);
    state
}

fn acceleration(simulator: &mut Simulator, state: &State) -> f64 {
    simulator.set_state(0, state);
    simulator.forward_dynamics(&Inputs::default()).unwrap()[6]
}

#[test]
fn val_a_spring_swings_a_joint_at_its_frequency_about_its_rest() {
    for (kind, inertia) in [("revolute", INERTIA), ("prismatic", MASS)] {
        let (stiffness, rest, swing) = (7.0, 0.25, 0.4);
        let scene = scene(kind, &format!("spring = {{ stiffness = {stiffness}, rest = {rest} }}"));
        let period = TAU / (stiffness / inertia).sqrt();
        let steps = 400;
        let end = drift(&scene, "mk4", period / steps as f64, &at(rest + swing, 0.0), 10 * steps);
        let late = end.qd[0] / (swing * (TAU / period).powi(2));
        println!("{kind}: period {period:.6} s, off by {:.1e} of it after ten", late / (10.0 * period));
        assert!((end.q[0] - rest - swing).abs() < 1e-8 && late.abs() < 1e-7 * period, "{} {late:e}", end.q[0]);
        // A quarter of a period from the rest at speed: the speed becomes the swing.
        let end = drift(&scene, "mk4", period / steps as f64, &at(rest, 1.0), steps / 4);
        assert!((end.q[0] - rest - (inertia / stiffness).sqrt()).abs() < 1e-9, "{}", end.q[0]);
    }
}

/// A detent is the pendulum of the angle `2 pi (q - offset) / period`, whose periods are elliptic integrals.
#[test]
fn val_a_detent_swings_a_joint_as_a_pendulum() {
    let (torque, pitch, offset) = (0.6, 0.5, 0.1);
    let scene = scene("revolute", &format!("detent = {{ torque = {torque}, period = {pitch}, offset = {offset} }}"));
    let rate = TAU / pitch;
    for amplitude in [0.1, 1.2, 2.5] {
        // 4 K(sin(amplitude / 2)) by the arithmetic-geometric mean.
        let (mut a, mut b) = (1.0, f64::cos(amplitude / 2.0));
        while a - b > 1e-15 {
            (a, b) = ((a + b) / 2.0, (a * b).sqrt());
        }
        let period = TAU / (torque * rate / INERTIA).sqrt() / a;
        let start = offset + 3.0 * pitch + amplitude / rate;
        let end = drift(&scene, "mk4", period / 1000.0, &at(start, 0.0), 5000);
        println!("amplitude {amplitude}: {:.1e} rad, {:.1e} rad/s after five periods", end.q[0] - start, end.qd[0]);
        assert!((end.q[0] - start).abs() < 1e-9 && end.qd[0].abs() < 1e-7, "{amplitude}: {} {}", end.q[0], end.qd[0]);
    }
    // Across its tops: at every place the speed that its energy leaves.
    let energy = |q: f64| torque / rate * (1.0 - f64::cos(rate * (q - offset)));
    let fast = f64::sqrt(2.2 * 2.0 * torque / rate / INERTIA);
    let mut simulator = simulator_at(&scene, "mk4", 0.002, &at(offset, fast));
    for _ in 0..20 {
        simulator.step(&Inputs::default(), 150).unwrap();
        let state = simulator.state(0);
        let speed = f64::sqrt(fast * fast - 2.0 * energy(state.q[0]) / INERTIA);
        assert!((state.qd[0] - speed).abs() < 1e-7, "{} {speed}", state.qd[0]);
    }
    assert!(simulator.state(0).q[0] > offset + 2.0 * pitch);
}

/// Over one period a detent takes as much as it gives; over half of it `torque period / pi`.
#[test]
fn val_the_work_against_a_detent_over_its_period_is_zero() {
    let (torque, pitch, offset) = (0.6, 0.5, 0.1);
    let scene = scene("prismatic", &format!("detent = {{ torque = {torque}, period = {pitch}, offset = {offset} }}"));
    let mut simulator = simulator_at(&scene, "mk4", 0.01, &State::default());
    // The midpoint rule is exact for a sine over its period; half of it ends where the force is 0: Euler and Maclaurin.
    let n = 2000;
    let mut work = |share: f64| {
        let force = |k: i32| {
            let q = offset + share * pitch * (f64::from(k) + 0.5) / f64::from(n);
            -MASS * acceleration(&mut simulator, &at(q, 0.0)) * share * pitch / f64::from(n)
        };
        (0..n).map(force).sum::<f64>()
    };
    assert!(work(1.0).abs() < 1e-13, "{}", work(1.0));
    let half = work(0.5);
    assert!((half - torque * pitch / std::f64::consts::PI).abs() < 1e-6, "{half}");
    let energy = simulator.closed_form(0, |form| form.energy().elastic);
    assert!(energy >= 0.0);
}

/// Dry friction at a speed.
fn dry(coulomb: f64, [still, decay, speed]: [f64; 3], v: f64) -> f64 {
    (coulomb + (still - coulomb) / (1.0 + (v / decay).powi(2))) * v / v.hypot(speed)
}

#[test]
fn val_static_friction_creeps_below_break_away_and_slides_beyond() {
    let (coulomb, viscous) = (0.4, 0.05);
    let [still, decay, speed] = [1.0, 0.1, 0.001];
    let friction = format!(
        "friction = {{ viscous = {viscous}, coulomb = {coulomb}, coulomb_speed = {speed}, static = {still}, \
         stribeck_speed = {decay} }}"
    );
    let scene = scene("revolute", &friction);
    let under = |load: f64, start: f64, integrator: &str, h: f64, time: f64| {
        let inputs = Inputs { joint_torque: Some(&[load]), ..Inputs::default() };
        run(&scene, integrator, h, &at(0.0, start), &inputs, (time / h).round() as usize)
    };
    let law = |v: f64| viscous * v + dry(coulomb, [still, decay, speed], v);
    for load in [0.3, 0.8, 0.95] {
        let creep = speed * load / f64::sqrt(still * still - load * load);
        for (integrator, h) in [("mk4", 5e-4), ("ros2", 0.01), ("ros3", 0.01)] {
            let rate = under(load, 0.0, integrator, h, 6.0).qd[0];
            println!("{integrator}: creep under {load} N m {rate:.6e} rad/s, closed form {creep:.6e}");
            assert!((law(rate) - load).abs() < 1e-9, "{integrator}: {rate}");
            assert!((rate / creep - 1.0).abs() < 1e-2, "{integrator}: {rate} {creep}");
        }
    }
    // Beyond break-away it slides, at the speed where friction has dropped: the root beyond the minimum.
    let (mut slow, mut fast) = (0.5, 100.0);
    for _ in 0..200 {
        let middle = 0.5 * (slow + fast);
        (slow, fast) = if law(middle) < 1.05 { (middle, fast) } else { (slow, middle) };
    }
    for (integrator, h) in [("mk4", 1e-3), ("ros2", 0.002)] {
        let rate = under(1.05, 0.0, integrator, h, 250.0).qd[0];
        assert!((rate - slow).abs() < 1e-6 * slow, "{integrator}: {rate} {slow}");
    }
    // Between Coulomb and static friction it stays at rest, or goes on sliding: friction drops with speed.
    let [rest, sliding] = [0.0, 3.0].map(|start| under(0.6, start, "mk4", 5e-4, 20.0).qd[0]);
    assert!(rest < 2e-3 && sliding > 1.0, "{rest} {sliding}");
}

/// Powers: springs and detents are in the energy, static friction among the losses.
#[test]
fn energy_has_springs_and_detents_and_power_static_friction() {
    let mut scene = scene("revolute", "home = 0.0");
    let joint = &mut scene.arm.as_mut().unwrap().links[0].joint;
    joint.spring = Some(JointSpring { stiffness: 3.0, rest: 0.5 });
    joint.detent = Some(Detent { torque: 0.2, period: 0.8, offset: -0.1 });
    joint.friction = Friction {
        coulomb: 0.1,
        coulomb_speed: 0.3,
        break_away: Some(0.4),
        stribeck_speed: Some(0.2),
        ..Friction::default()
    };
    assert_eq!(joint.kind, JointKind::Revolute);
    let simulator = simulator_at(&scene, "mk4", 0.01, &at(0.6, -0.6));
    let (energy, power, torques) = simulator.closed_form(0, |form| {
        let loads = Loads::default();
        (form.energy(), form.power(&loads).unwrap(), form.joint_torques(&loads).unwrap())
    });
    let close = |got: f64, expected: f64| assert!((got - expected).abs() < 1e-13, "{got} {expected}");
    let rate = TAU / 0.8;
    close(energy.elastic, 0.5 * 3.0 * 0.01 + 0.2 / rate * (1.0 - f64::cos(rate * 0.7)));
    close(torques.spring[0], -3.0 * 0.1 - 0.2 * f64::sin(rate * 0.7));
    close(torques.friction[0], dry(0.1, [0.4, 0.2, 0.3], 0.6));
    close(power.friction, -0.6 * torques.friction[0]);
    close(power.total(), power.friction);
}
