//! Observed orders of convergence on the tumbling 11-DoF system, every pair printed.

use uvms_gym::description::{Friction, Scene};
use uvms_gym::system::State;

use crate::cases::{branched, distance, drift, sprung, tumbling, tumbling_scene};

/// Simulated time, s.
const TIME: f64 = 2.0;

/// A motion and where it ends, from a much smaller step.
struct Study {
    scene: Scene,
    start: State,
    end: State,
    /// What the reference is uncertain by: its difference from another method's.
    uncertainty: f64,
}

impl Study {
    fn new((scene, start): (Scene, State), steps: usize) -> Self {
        let end = drift(&scene, "mk4", TIME / steps as f64, &start, steps);
        let other = drift(&scene, "rk4-normalise", TIME / steps as f64, &start, steps);
        let uncertainty = distance(&end, &other);
        println!("reference: {steps} steps of mk4; rk4-normalise ends within {uncertainty:e}");
        Self { scene, start, end, uncertainty }
    }

    /// Least-squares slope of log error by log step over 2^first..=2^last steps.
    fn order(&self, integrator: &str, first: u32, last: u32) -> f64 {
        let mut points: Vec<[f64; 2]> = Vec::new();
        for exponent in first..=last {
            let steps = 1 << exponent;
            let h = TIME / f64::from(steps);
            let error = distance(&self.end, &drift(&self.scene, integrator, h, &self.start, steps as usize));
            assert!(error > 100.0 * self.uncertainty, "{integrator}, {steps} steps: {error:e} is next to rounding");
            let point = [h.log2(), error.log2()];
            let pair = points.last().map_or(f64::NAN, |before| before[1] - point[1]);
            println!("{integrator:17} h = {h:.6} error = {error:.3e} order of the pair = {pair:.3}");
            points.push(point);
        }
        assert!(points.len() >= 5, "at least four halvings");
        let n = points.len() as f64;
        let [x, y] = [0, 1].map(|k| points.iter().map(|p| p[k]).sum::<f64>() / n);
        let slope = points.iter().map(|p| (p[0] - x) * (p[1] - y)).sum::<f64>()
            / points.iter().map(|p| (p[0] - x) * (p[0] - x)).sum::<f64>();
        println!("{integrator:17} least squares: {slope:.4}");
        slope
    }
}

#[test]
fn every_integrator_converges_at_its_order() {
    let study = Study::new(tumbling(false), 4096);
    assert!(study.uncertainty < 1e-11);
    let cases = [
        ("mk4", 4.0, 0.1, 6),
        ("rk4-normalise", 4.0, 0.1, 6),
        ("euler-angles-rk4", 4.0, 0.1, 6),
        ("quaternion-rk4", 4.0, 0.1, 6),
        ("mk3", 3.0, 0.1, 6),
        ("mk2", 2.0, 0.1, 6),
        ("mk1", 1.0, 0.1, 7),
        ("semi-implicit-euler", 1.0, 0.1, 9),
        ("quaternion-euler", 1.0, 0.1, 7),
    ];
    for (integrator, order, tolerance, first) in cases {
        let observed = study.order(integrator, first, first + 4);
        assert!((observed - order).abs() < tolerance, "{integrator}: {observed}");
    }
}

#[test]
fn integrators_keep_their_order_on_a_tree() {
    let study = Study::new(tumbling_scene(branched(), false), 4096);
    assert!(study.uncertainty < 1e-11);
    for (integrator, order, first) in [("mk4", 4.0, 6), ("mk2", 2.0, 6), ("semi-implicit-euler", 1.0, 9)] {
        let observed = study.order(integrator, first, first + 4);
        assert!((observed - order).abs() < 0.1, "{integrator}: {observed}");
    }
}

#[test]
fn integrators_keep_their_order_against_springs_detents_and_static_friction() {
    let (mut scene, start) = tumbling(false);
    for (joint, sprung) in scene.joints_mut().zip(sprung().joints()) {
        (joint.spring, joint.detent) = (sprung.spring.clone(), sprung.detent.clone());
        joint.friction = Friction { coulomb_speed: 0.5, ..sprung.friction.clone() };
    }
    let study = Study::new((scene, start), 8192);
    assert!(study.uncertainty < 1e-11);
    for (integrator, order) in [("mk4", 4.0), ("mk2", 2.0)] {
        let observed = study.order(integrator, 6, 10);
        assert!((observed - order).abs() < 0.1, "{integrator}: {observed}");
    }
}

/// Quadratic drag v|v| has a kink at zero, where a step that straddles it is of order 2 to 3 only: the pairs jump.
#[test]
fn quadratic_drag_disturbs_the_order_of_every_method() {
    let study = Study::new(tumbling(true), 16384);
    let order = study.order("mk4", 7, 11);
    assert!((3.0..4.6).contains(&order), "{order}");
}
