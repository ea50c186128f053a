//! One wet link on a fixed vehicle, whose motion is known in closed form.

use std::f64::consts::TAU;

use uvms_gym::batch::Inputs;
use uvms_gym::description::Scene;
use uvms_gym::system::State;

use crate::cases::{drift, run};

/// A link of 2 kg with added mass 1.5 kg along its way (x) and 0.2 kg m2 about its axis (y), frame at the joint.
fn link(kind: &str, axis: &str, rest: &str) -> Scene {
    let text = format!(
        r#"
        name = "one link"
        water = {{ density = 1000.0, gravity = [0.0, 0.0, -9.81] }}
        vehicle = {{ name = "held", fixed = true, body = {{ mass = 1.0, inertia = [1.0, 1.0, 1.0] }} }}
        [arm]
        name = "one link"
        [[arm.links]]
        name = "link"
        joint = {{ kind = "{kind}", axis = {axis}, friction = {{ viscous = {VISCOUS} }} }}
        [arm.links.body]
        mass = 2.0
        inertia = [0.3, 0.4, 0.5]
        added_mass = [1.5, 3.0, 4.0, 0.1, 0.2, 0.3]
        {rest}
        "#
    );
    Scene::from_toml_str(&text, "one link").unwrap()
}

/// Joint friction, N s/m or N m s/rad.
const VISCOUS: f64 = 0.5;

fn free(mut scene: Scene) -> Scene {
    scene.arm.as_mut().unwrap().links[0].joint.friction.viscous = 0.0;
    scene
}

fn at(q: f64, qd: f64) -> State {
    let mut state = State::default();
    (state.q[0], state.qd[0]) = (q, qd);
    state
}

#[test]
fn val_sliding_link_slows_as_the_inverse_of_time() {
    let drag = "damping.quadratic = [7.0, 9.0, 9.0, 1.0, 1.0, 1.0]";
    let (m, k, v0, t) = (3.5, 7.0, 0.8, 10.0);
    let end = drift(&free(link("prismatic", "[1.0, 0.0, 0.0]", drag)), "mk4", 0.01, &at(0.1, v0), 1000);
    let slowing = 1.0 + k * v0 * t / m;
    assert!((end.qd[0] - v0 / slowing).abs() < 1e-9);
    assert!((end.q[0] - 0.1 - m / k * f64::ln(slowing)).abs() < 1e-9);
}

#[test]
fn val_driven_link_turns_at_its_terminal_rate() {
    // k w^2 + c w = tau, by drag about the axis and friction.
    let (k, tau) = (1.7, 3.0);
    let scene = link("revolute", "[0.0, 1.0, 0.0]", &format!("damping.quadratic = [0.0, 0.0, 0.0, 0.0, {k}, 0.0]"));
    // Weight acts at the axis, so it turns nothing.
    let inputs = Inputs { joint_torque: Some(&[tau]), ..Inputs::default() };
    let rate = run(&scene, "mk4", 0.01, &at(0.0, 0.0), &inputs, 2000).qd[0];
    let expected = (-VISCOUS + f64::sqrt(VISCOUS * VISCOUS + 4.0 * k * tau)) / (2.0 * k);
    assert!((rate - expected).abs() < 1e-12, "{rate}");
}

#[test]
fn val_pinned_pendulum_under_water_has_its_period() {
    // (I_o + I_A) q'' = -(m l - rho vol b) g q for small q: the pin carries all forces, and added mass turns with it.
    let (m, l, displaced, b) = (2.0, 0.3, 1.2, 0.25);
    let body = format!("center_of_mass = [0.0, 0.0, -{l}]\nvolume = 0.0012\ncenter_of_buoyancy = [0.0, 0.0, -{b}]");
    let inertia = 0.4 + m * l * l + 0.2;
    let period = TAU / f64::sqrt((m * l - displaced * b) * 9.81 / inertia);
    let (swing, steps) = (1e-4, 400);
    let scene = free(link("revolute", "[0.0, 1.0, 0.0]", &body));
    let end = drift(&scene, "mk4", period / steps as f64, &at(swing, 0.0), 10 * steps);
    let late = end.qd[0] / (swing * (TAU / period).powi(2));
    assert!((end.q[0] - swing).abs() < 1e-9 && late.abs() < 1e-7 * period, "{} {late:e}", end.q[0]);
}
