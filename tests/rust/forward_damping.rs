//! Laws of damping by forward speed.

use nalgebra::{Matrix6, Vector3, Vector6};
use uvms_gym::batch::Inputs;
use uvms_gym::description::{ForwardDamping, Scene};
use uvms_gym::dynamics::dense::{angular, linear, stack};
use uvms_gym::system::{Factors, State};

use crate::cases::{self, drift, orders, simulator_at, wrench_of};
use crate::random_scene::Random;

/// Derivatives of the ECA A9 (uuvsimulator/eca_a9, `linear_damping_forward_speed`): X_uu, Y_uv, Y_ur, Z_uw, Z_uq, K_up, M_uw, M_uq,
/// N_uv, N_ur. They are the same in axes with z up or down.
const ECA_A9: [[f64; 6]; 6] = [
    [-8.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, -162.0, 0.0, 0.0, 0.0, 150.0],
    [0.0, 0.0, -108.0, 0.0, -100.0, 0.0],
    [0.0, 0.0, 0.0, -13.0, 0.0, 0.0],
    [0.0, 0.0, 37.0, 0.0, -20.0, 0.0],
    [0.0, -34.0, 0.0, 0.0, 0.0, -32.0],
];

pub fn eca_a9() -> ForwardDamping {
    ForwardDamping { position: Vector3::zeros(), matrix: -Matrix6::from_fn(|i, k| ECA_A9[i][k]) }
}

/// A neutral body of 10 kg and 1 kg m2 with this damping.
fn body(damping: ForwardDamping) -> Scene {
    let mut scene = cases::body(|body| body.volume = Some(0.01));
    scene.vehicle.forward_damping = Some(damping);
    scene.check().unwrap();
    scene
}

/// Wrench at a twist through still water, by kernel and by twin, from the accelerations.
fn wrenches(scene: &Scene, twist: Vector6<f64>, factor: f64) -> [Vector6<f64>; 2] {
    let mut simulator = simulator_at(scene, "mk4", 0.01, &State { twist, ..State::default() });
    simulator.set_factors(&[Factors { linear_damping: factor, ..Factors::ONE }]).unwrap();
    let kernel = simulator.forward_dynamics(&Inputs::default()).unwrap();
    let loads = simulator.applied_loads(&Inputs::default()).unwrap();
    let twin = simulator.closed_form(0, |form| form.accelerations(&loads[0].loads()).unwrap());
    [&kernel[..], twin.as_slice()].map(|rates| wrench_of(rates, &twist))
}

/// X = X_uu u u, Y = Y_uv u v + Y_ur u r, Z = Z_uw u w + Z_uq u q, K = K_up u p, M = M_uw u w + M_uq u q, N = N_uv u v + N_ur u r.
#[test]
fn val_eca_a9_has_its_published_wrench() {
    let mut random = Random::new(1);
    for _ in 0..50 {
        let twist = Vector6::from_fn(|_, _| random.between(-1.5, 1.5));
        let [u, v, w, p, q, r] = twist.into();
        let published = u * Vector6::new(
            -8.0 * u,
            -162.0 * v + 150.0 * r,
            -108.0 * w - 100.0 * q,
            -13.0 * p,
            37.0 * w - 20.0 * q,
            -34.0 * v - 32.0 * r,
        );
        for factor in [1.0, 0.7] {
            for got in wrenches(&body(eca_a9()), twist, factor) {
                let miss = (got - published * factor).norm();
                assert!(miss < 1e-11 * (1.0 + published.norm()), "factor {factor}: {got} {published}");
            }
        }
        // About another point: the velocity there, and the moment of the force there.
        let position = random.vector(0.5);
        let there = stack(&(linear(&twist) + angular(&twist).cross(&position)), &angular(&twist));
        let wrench = -(eca_a9().matrix * there) * there.x;
        let moved = stack(&linear(&wrench), &(angular(&wrench) + position.cross(&linear(&wrench))));
        for got in wrenches(&body(ForwardDamping { position, ..eca_a9() }), twist, 1.0) {
            assert!((got - moved).norm() < 1e-11 * (1.0 + moved.norm()), "{position}: {got} {moved}");
        }
    }
}

/// At a constant forward speed sway decays as `exp(-Y_uv u t / m)`; the explicit and the linearly implicit method converge to it with
/// their orders.
#[test]
fn sway_decays_exponentially_ahead_with_the_order_of_the_integrator() {
    let damping = ForwardDamping { position: Vector3::zeros(), matrix: Matrix6::from_diagonal(&Vector6::ith(1, 16.2)) };
    let scene = body(damping);
    let (u, v, t) = (1.5, 0.4, 1.0);
    let exact = v * (-16.2_f64 * u * t / 10.0).exp();
    for (integrator, order) in [("mk4", 4.0), ("ros2", 2.0)] {
        let errors = [16, 32, 64].map(|steps: usize| {
            let start = State { twist: Vector6::new(u, v, 0.0, 0.0, 0.0, 0.0), ..State::default() };
            let twist = drift(&scene, integrator, t / steps as f64, &start, steps).twist;
            assert!((twist[0] - u).abs() < 1e-14);
            (twist[1] - exact).abs()
        });
        assert!(orders(&errors).iter().all(|x| (x - order).abs() < 0.3), "{integrator}: {errors:?}");
    }
}

/// Ahead it takes energy from every motion; astern the wrench has the opposite sign, as the published form has.
#[test]
fn it_takes_power_ahead_alone() {
    let scene = body(eca_a9());
    let mut random = Random::new(2);
    for _ in 0..50 {
        let mut twist = Vector6::from_fn(|_, _| random.between(-1.0, 1.0));
        twist[0] = twist[0].abs();
        let form = |twist: Vector6<f64>| {
            let simulator = simulator_at(&scene, "mk4", 0.01, &State { twist, ..State::default() });
            let loads = simulator.applied_loads(&Inputs::default()).unwrap();
            simulator.closed_form(0, |form| {
                (form.power(&loads[0].loads()).unwrap(), form.fossen_form(None).unwrap().damping, twist)
            })
        };
        let (power, damping, nu) = form(twist);
        assert!(power.terms.forward_damping < 0.0 && power.total() == power.terms.forward_damping);
        assert!((damping.dot(&nu) + power.total()).abs() < 1e-12 * damping.norm(), "Fossen's D(nu) nu has it");
        assert!(form(-twist).0.terms.forward_damping > 0.0);
    }
}
