//! Single bodies whose motion is known in closed form.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Rotation3, Vector3, Vector6};
use uvms_gym::batch::{Inputs, Simulator};
use uvms_gym::description::Scene;
use uvms_gym::system::{State, rotation_vector};

use crate::cases::{body, diagonal, distance, drift, lossless, run, simulator_at};

fn moving(twist: [f64; 6]) -> State {
    State { twist: twist.into(), ..State::default() }
}

#[test]
fn val_quadratic_drag_slows_as_the_inverse_of_time() {
    // Motion along x: v = v0 / (1 + k v0 t / m), x = (m / k) ln(1 + k v0 t / m), m with added mass.
    let scene = body(|body| {
        body.added_mass = diagonal([5.0, 8.0, 8.0, 1.0, 1.0, 1.0]);
        body.damping.quadratic = diagonal([6.0, 9.0, 9.0, 1.0, 1.0, 1.0]);
    });
    let (m, k, v0, t) = (15.0, 6.0, 2.0, 10.0);
    let end = drift(&scene, "mk4", 0.01, &moving([v0, 0.0, 0.0, 0.0, 0.0, 0.0]), 1000);
    let slowing = 1.0 + k * v0 * t / m;
    assert!((end.twist[0] - v0 / slowing).abs() < 1e-9);
    assert!((end.position.x - m / k * f64::ln(slowing)).abs() < 1e-9, "{}", end.position.x);
    // And so does turning.
    let (inertia, k, w0) = (2.0, 1.0, 1.5);
    let end = drift(&scene, "mk4", 0.01, &moving([0.0, 0.0, 0.0, w0, 0.0, 0.0]), 1000);
    let slowing = 1.0 + k * w0 * t / inertia;
    assert!((end.twist[3] - w0 / slowing).abs() < 1e-9);
    let angle = rotation_vector(&end.rotation).x.rem_euclid(TAU);
    assert!((angle - (inertia / k * slowing.ln()).rem_euclid(TAU)).abs() < 1e-9);
}

#[test]
fn val_linear_drag_slows_exponentially() {
    let scene = body(|body| body.damping.linear = diagonal([4.0; 6]));
    let end = drift(&scene, "mk4", 0.01, &moving([0.0, 2.0, 0.0, 0.0, 0.0, 0.0]), 1000);
    let decay = f64::exp(-4.0 * 10.0 / 10.0);
    assert!((end.twist[1] - 2.0 * decay).abs() < 1e-10);
    assert!((end.position.y - 2.0 * 10.0 / 4.0 * (1.0 - decay)).abs() < 1e-10);
}

#[test]
fn val_terminal_speed_is_the_root_of_force_by_drag() {
    let scene = body(|body| body.damping.quadratic = diagonal([6.0, 9.0, 12.0, 1.0, 1.0, 1.0]));
    for axis in 0..3 {
        let mut wrench = [0.0; 6];
        wrench[axis] = -24.0;
        let inputs = Inputs { wrench: Some(&wrench), ..Inputs::default() };
        let end = run(&scene, "mk4", 0.02, &State::default(), &inputs, 2000);
        let expected = -f64::sqrt(24.0 / [6.0, 9.0, 12.0][axis]);
        assert!((end.twist[axis] - expected).abs() < 1e-12);
    }
    // A heavy body sinks at its own.
    let mut heavy = scene;
    heavy.water.gravity = Vector3::new(0.0, 0.0, -9.81);
    heavy.vehicle.body.volume = Some(0.009);
    let end = drift(&heavy, "mk4", 0.02, &State::default(), 2000);
    assert!((end.twist[2] + f64::sqrt(9.81 / 12.0)).abs() < 1e-12, "{}", end.twist);
}

/// sn, cn, dn by descending Landen transformations. [Abramowitz & Stegun 16.4]
fn jacobi(u: f64, m: f64) -> [f64; 3] {
    let mut a = vec![1.0];
    let mut c = vec![m.sqrt()];
    let mut b = (1.0 - m).sqrt();
    while c.last().unwrap().abs() > 1e-17 {
        let last = a[a.len() - 1];
        a.push((last + b) / 2.0);
        c.push((last - b) / 2.0);
        b = (last * b).sqrt();
    }
    let n = a.len() - 1;
    let mut phi = f64::exp2(n as f64) * a[n] * u;
    for k in (1..=n).rev() {
        phi = (phi + (c[k] / a[k] * phi.sin()).asin()) / 2.0;
    }
    let (sin, cos) = phi.sin_cos();
    [sin, cos, (1.0 - m * sin * sin).sqrt()]
}

/// Spins of a free top with moments I1 < I2 < I3, from omega_2 = 0. [Landau & Lifshitz, Mechanics, section 37]
struct Top {
    inertia: [f64; 3],
    start: Vector3<f64>,
    rate: f64,
    modulus: f64,
    amplitude: [f64; 3],
}

impl Top {
    fn new(inertia: [f64; 3], start: Vector3<f64>) -> Self {
        let [i1, i2, i3] = inertia;
        let energy = i1 * start.x * start.x + i3 * start.z * start.z;
        let momentum = (i1 * start.x).powi(2) + (i3 * start.z).powi(2);
        assert!(start.y == 0.0 && start.x > 0.0 && start.z > 0.0 && momentum > energy * i2);
        let (low, high) = (energy * i3 - momentum, momentum - energy * i1);
        Self {
            inertia,
            start,
            rate: ((i3 - i2) * high / (i1 * i2 * i3)).sqrt(),
            modulus: (i2 - i1) * low / ((i3 - i2) * high),
            amplitude: [
                (low / (i1 * (i3 - i1))).sqrt(),
                (low / (i2 * (i3 - i2))).sqrt(),
                (high / (i3 * (i3 - i1))).sqrt(),
            ],
        }
    }

    fn omega(&self, t: f64) -> Vector3<f64> {
        let [sn, cn, dn] = jacobi(self.rate * t, self.modulus);
        let [a, b, c] = self.amplitude;
        Vector3::new(a * cn, b * sn, c * dn)
    }

    /// Attitude: the axis of momentum as polar axis, precession by quadrature of the spins.
    fn rotation(&self, t: f64) -> Matrix3<f64> {
        let momentum = |w: Vector3<f64>| Vector3::from(self.inertia).component_mul(&w);
        let size = momentum(self.start).norm();
        let n = 20_000;
        let h = t / f64::from(n);
        let precession: f64 = (0..=n)
            .map(|k| {
                let l = momentum(self.omega(h * f64::from(k)));
                let weight = if k == 0 || k == n { 1.0 } else { f64::from(2 + 2 * (k % 2)) };
                weight * (l.x * l.x / self.inertia[0] + l.y * l.y / self.inertia[1]) / (l.x * l.x + l.y * l.y)
            })
            .sum::<f64>()
            * size
            * h
            / 3.0;
        let attitude = |angle: f64, w: Vector3<f64>| {
            let l = momentum(w) / size;
            let (nutation, spin) = (l.z.acos(), l.x.atan2(l.y));
            (Rotation3::new(Vector3::z() * angle)
                * Rotation3::new(Vector3::x() * nutation)
                * Rotation3::new(Vector3::z() * spin))
            .into_inner()
        };
        attitude(0.0, self.start).transpose() * attitude(precession, self.omega(t))
    }
}

#[test]
fn val_free_asymmetric_top_spins_as_jacobis_functions() {
    let inertia = [1.0, 2.0, 2.6];
    let scene = body(|body| body.inertia = Matrix3::from_diagonal(&inertia.into()));
    let start = Vector3::new(0.6, 0.0, 1.1);
    let top = Top::new(inertia, start);
    let time = 40.0;
    let error = |integrator: &str, steps: usize| {
        let state = moving([0.0, 0.0, 0.0, start.x, start.y, start.z]);
        let end = drift(&scene, integrator, time / steps as f64, &state, steps);
        let spin = (end.twist.fixed_rows::<3>(3) - top.omega(time)).norm();
        // The start's attitude is the identity: both are relative to it.
        let attitude = rotation_vector(&(top.rotation(time).transpose() * end.rotation)).norm();
        [spin, attitude]
    };
    for integrator in ["mk4", "rk4-normalise"] {
        let [coarse, fine] = [1000, 2000].map(|steps| error(integrator, steps));
        println!(
            "top, {integrator}, h = 0.04 and 0.02: spin {:.2e} {:.2e}, attitude {:.2e} {:.2e}",
            coarse[0], fine[0], coarse[1], fine[1]
        );
        assert!(fine[0] < 1e-6 && fine[1] < 1e-6);
        for part in 0..2 {
            let order = (coarse[part] / fine[part]).log2();
            assert!((3.7..5.3).contains(&order), "{integrator}, part {part}: order {order}");
        }
    }
    assert!(error("mk4", 16_000).into_iter().all(|e| e < 2e-11), "{:?}", error("mk4", 16_000));
}

/// Dzhanibekov: about the middle axis a body flips over, again and again, at intervals of half the period of sn.
#[test]
fn val_spin_about_the_middle_axis_flips_over() {
    let inertia = [1.0, 2.0, 2.6];
    let scene = body(|body| body.inertia = Matrix3::from_diagonal(&inertia.into()));
    let top = Top::new(inertia, Vector3::new(1.2, 0.0, 1.02));
    // Quarter period K by the arithmetic-geometric mean.
    let (mut a, mut b) = (1.0, (1.0 - top.modulus).sqrt());
    while a - b > 1e-15 {
        (a, b) = ((a + b) / 2.0, (a * b).sqrt());
    }
    let quarter = std::f64::consts::FRAC_PI_2 / a / top.rate;
    let mut simulator = simulator_at(&scene, "mk4", quarter / 400.0, &moving([0.0, 0.0, 0.0, 1.2, 0.0, 1.02]));
    for flip in 0..6 {
        simulator.step(&Inputs::default(), 400).unwrap();
        let middle = simulator.state(0).twist[4];
        let expected = if flip % 2 == 0 { top.amplitude[1] } else { -top.amplitude[1] };
        assert!((middle - expected).abs() < 1e-8, "{middle} {expected}");
        simulator.step(&Inputs::default(), 400).unwrap();
        assert!(simulator.state(0).twist[4].abs() < 1e-7);
    }
}

#[test]
fn val_restoring_pendulum_has_its_period() {
    // Neutral, origin at the centre of buoyancy, centre of mass d below; added mass m_A across the plane of motion.
    let (m, d, inertia, m_a, i_a, g) = (10.0, 0.05, 0.4, 6.0, 0.3, 9.81);
    let mut scene = body(|body| {
        body.center_of_mass = Vector3::new(0.0, 0.0, -d);
        body.inertia = Matrix3::from_diagonal_element(inertia);
        body.added_mass = diagonal([m_a, 9.0, 11.0, 0.2, i_a, 0.5]);
        body.volume = Some(m / 1000.0);
    });
    scene.water.gravity = Vector3::new(0.0, 0.0, -g);
    // I_o + I_A - (m d)^2 / (m + m_A), where I_o = I_c + m d^2.
    let effective = inertia + m * d * d + i_a - (m * d).powi(2) / (m + m_a);
    let period = TAU / (m * g * d / effective).sqrt();
    let swing = 1e-4;
    let start = State { rotation: Rotation3::new(Vector3::y() * swing).into_inner(), ..State::default() };
    let steps = 1000;
    let end = drift(&scene, "mk4", period / steps as f64, &start, 10 * steps);
    let pitch = rotation_vector(&end.rotation).y;
    // At the turning point the angle tells little; the rate, which crosses zero, tells the time.
    let late = end.twist[4] / (swing * (TAU / period).powi(2));
    println!("pendulum: period {period:.6} s, off by {:.1e} of it after ten", late / (10.0 * period));
    assert!((pitch - swing).abs() < 1e-9 * swing.max(1.0) && late.abs() < 1e-7 * period, "{pitch} {late}");
}

#[test]
fn val_munk_moment_turns_a_slender_body_at_its_growth_rate() {
    // Neutral, no drag, frame at the centre of mass: U sqrt((m_y - m_x) (m + m_x) / ((m + m_y) (I + I_A))).
    let (m, m_x, m_y, inertia, i_a, speed) = (10.0, 1.5, 9.0, 0.7, 0.5, 0.8);
    let scene = body(|body| {
        body.inertia = Matrix3::from_diagonal_element(inertia);
        body.added_mass = diagonal([m_x, m_y, m_y, 0.1, i_a, i_a]);
    });
    let growth = speed * ((m_y - m_x) * (m + m_x) / ((m + m_y) * (inertia + i_a))).sqrt();
    let at = |simulator: &Simulator| simulator.state(0).twist[5];
    let mut simulator = simulator_at(&scene, "mk4", 0.005, &moving([speed, 0.0, 0.0, 0.0, 0.0, 1e-12]));
    // Past the decaying mode; then by the ratio of yaw rates.
    simulator.step(&Inputs::default(), (12.0 / growth / 0.005) as usize).unwrap();
    let before = at(&simulator);
    simulator.step(&Inputs::default(), 400).unwrap();
    let observed = (at(&simulator) / before).ln() / 2.0;
    println!("Munk: growth rate {observed:.8} 1/s, expected {growth:.8}");
    assert!((observed - growth).abs() < 1e-8 * growth, "{observed} {growth}");
    // In the current's frame the same: at rest in water that comes from ahead.
    let mut held = simulator_at(&scene, "mk4", 0.005, &moving([0.0, 0.0, 0.0, 0.0, 0.0, 1e-12]));
    held.set_flow(0, Vector3::new(-speed, 0.0, 0.0));
    held.step(&Inputs::default(), (12.0 / growth / 0.005) as usize).unwrap();
    assert!((at(&held) / before - 1.0).abs() < 1e-9);
    // Broadside first is stable.
    let stable = drift(&scene, "mk4", 0.005, &moving([0.0, speed, 0.0, 0.0, 0.0, 1e-9]), 4000);
    assert!(stable.twist[5].abs() < 1e-8);
}

/// Without losses the motion runs backward as it ran forward.
#[test]
fn motion_without_losses_reverses() {
    let mut scene = lossless(&Scene::shipped("petasus-pum").unwrap());
    scene.water.gravity = Vector3::new(0.0, 0.0, -9.81);
    scene.vehicle.body.center_of_buoyancy = Vector3::new(0.0, 0.0, 0.03);
    let mut start = State { q: scene.home(), ..State::default() };
    start.twist = Vector6::new(0.3, -0.2, 0.1, 0.4, -0.3, 0.5);
    start.qd[..5].copy_from_slice(&[0.4, -0.3, 0.2, -0.4, 0.5]);
    let reversed = |state: State| State { twist: -state.twist, qd: state.qd.map(|x| -x), ..state };
    let miss = |h: f64| {
        let steps = (2.0 / h) as usize;
        let there = drift(&scene, "mk4", h, &start, steps);
        assert!(distance(&there, &start) > 0.1);
        let back = reversed(drift(&scene, "mk4", h, &reversed(there), steps));
        distance(&back, &start)
    };
    let misses = [0.01, 0.005, 0.0025].map(miss);
    println!("reversal misses the start by {misses:?}");
    assert!(misses[2] < 1e-8 && misses[2] < misses[1] / 12.0 && misses[1] < misses[0] / 12.0, "{misses:?}");
}
