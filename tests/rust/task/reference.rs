//! Seeded smooth joint references, and their rows in an episode's memory.

use nalgebra::Vector3;
use proptest::prelude::*;
use uvms_gym::description::{Frame, Friction, Joint, JointKind, JointLimits};
use uvms_gym::task::*;

fn joint(limits: Option<[f64; 2]>, home: f64, speed: Option<f64>) -> Joint {
    Joint {
        kind: JointKind::Revolute,
        frame: Frame::default(),
        axis: Vector3::z(),
        rotor_inertia: 0.0,
        prescribed: false,
        friction: Friction::default(),
        limits: limits.map(|[lower, upper]| JointLimits { lower, upper, stiffness: 100.0, damping: 0.0 }),
        effort: None,
        actuator: None,
        spring: None,
        detent: None,
        speed,
        servo: None,
        home,
    }
}

fn stream(seed: u64) -> Stream {
    Stream::new(EpisodeKey { seed, episode: 0 }, Purpose::REFERENCE)
}

/// A reference in seconds.
fn drawn(joint: &Joint, start: f64, amplitude: f64, stream: &Stream, index: u32) -> JointReference {
    JointReference::draw(joint, start, [amplitude, 1.0], 1.0, stream, index)
}

proptest! {
    #[test]
    fn reference_stays_inside_limits_and_speed(
        seed: u64, lower in -3.0..0.0f64, travel in 0.01..6.0f64, share in 0.0..=1.0f64,
        amplitude in 0.0..4.0f64, speed in 0.01..2.0f64, index in 0u32..9,
    ) {
        let upper = lower + travel;
        let home = lower + share * travel;
        let joint = joint(Some([lower, upper]), home, Some(speed));
        let reference = drawn(&joint, home, amplitude, &stream(seed), index);
        for k in 0..400 {
            let point = reference.point(0.1 * f64::from(k), 1.0);
            prop_assert!((lower..=upper).contains(&point.value));
            prop_assert!(point.rate.abs() <= speed * (1.0 + 1e-12));
        }
    }

    #[test]
    fn rate_is_the_derivative(seed: u64, time in 0.01..20.0f64, speed in 0.05..1.0f64) {
        let reference = drawn(&joint(None, 0.3, Some(speed)), 0.1, 0.5, &stream(seed), 0);
        let h = 1e-4;
        let [before, at, after] = [time - h, time, time + h].map(|t| reference.point(t, 1.0));
        prop_assert!(((after.value - before.value) / (2.0 * h) - at.rate).abs() < 1e-7);
    }

    #[test]
    fn hermite_cubic_meets_both_ends(
        q0 in -2.0..2.0f64, v0 in -1.0..1.0f64, q1 in -2.0..2.0f64, v1 in -1.0..1.0f64, period in 0.005..0.5f64,
    ) {
        let point = |value, rate| ReferencePoint { value, rate };
        let [c0, c1, c2, c3] = hermite(&point(q0, v0), &point(q1, v1), 1.0 / period);
        prop_assert_eq!([c0, c1], [q0, v0]);
        let value = c0 + period * (c1 + period * (c2 + period * c3));
        let rate = c1 + period * (2.0 * c2 + 3.0 * period * c3);
        prop_assert!((value - q1).abs() < 1e-13);
        prop_assert!((rate - v1).abs() < 1e-10);
    }
}

#[test]
fn reference_starts_at_rest_and_then_moves() {
    let reference = drawn(&joint(None, 0.3, None), -0.2, 0.5, &stream(1), 0);
    assert_eq!(reference.point(0.0, 1.0), ReferencePoint { value: -0.2, rate: 0.0 });
    assert!((0..200).any(|k| reference.point(0.1 * f64::from(k), 1.0).rate.abs() > 0.1));
}

#[test]
fn period_by_period_the_reference_is_the_same_as_from_afar() {
    let period = 0.05;
    let from_afar = JointReference::draw(&joint(None, 0.3, Some(0.3)), 0.1, [0.5, 1.0], period, &stream(3), 1);
    let mut reference = from_afar;
    for k in 0..4000 {
        let (near, far) = (reference.point(1.0, 1.0 / period), from_afar.point(f64::from(k + 1), 1.0 / period));
        assert!((near.value - far.value).abs() < 1e-12 && (near.rate - far.rate).abs() < 1e-12, "{k}");
        reference.advance();
    }
    let numbers = reference.to_array();
    assert_eq!(JointReference::from_array(numbers), reference);
    assert!(numbers[..2].iter().all(|phase| phase.abs() <= std::f64::consts::PI + 1e-12));
}

#[test]
fn hermite_follows_the_reference_between_control_instants() {
    let reference = drawn(&joint(None, 0.0, None), 0.0, 0.4, &stream(5), 2);
    let period = 0.05;
    for k in 0..400 {
        let start = f64::from(k) * period;
        let [from, half, to] = [0.0, 0.5, 1.0].map(|share| reference.point(start + share * period, 1.0));
        let [c0, c1, c2, c3] = hermite(&from, &to, 1.0 / period);
        let s = 0.5 * period;
        let value = c0 + s * (c1 + s * (c2 + s * c3));
        // h^4 / 384 of the fourth derivative.
        assert!((value - half.value).abs() < 1e-7);
    }
}
