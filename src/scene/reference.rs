//! Seeded smooth joint references.

use std::f64::consts::TAU;

use super::random::Stream;
use crate::description::{Joint, JointKind};

/// Time over which a reference leaves rest, s.
const RAMP: f64 = 3.0;
/// Greatest slope of the ramp `10 x^3 - 15 x^4 + 6 x^5`.
const RAMP_SLOPE: f64 = 1.875;
/// Frequencies of the two sinusoids are drawn from these intervals, Hz.
const FREQUENCIES: [[f64; 2]; 2] = [[0.05, 0.1], [0.1, 0.2]];
/// Shares of the amplitude that the two sinusoids get.
const SHARES: [f64; 2] = [0.7, 0.3];
/// A swinging reference stays this share of the joint's travel away from either limit.
const MARGIN: f64 = 0.05;
/// A prismatic joint travels this many metres where a revolute one turns one radian.
pub const METRES_PER_RADIAN: f64 = 0.25;
/// Draws that one joint takes.
const DRAWS: u32 = 5;

/// A point of a reference.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ReferencePoint {
    /// rad or m.
    pub value: f64,
    /// rad/s or m/s.
    pub rate: f64,
    /// rad/s2 or m/s2.
    pub acceleration: f64,
}

/// Reference of one joint: `q_d(t) = q_0 + s(p t) (c - q_0 + sum_k a_k sin(w_k p t + phi_k))`.
///
/// The ramp s goes from 0 to 1 with zero slope and curvature at its ends, so the reference starts at rest; as s <= 1, it
/// stays between `q_0` and `c -+ (a_1 + a_2)`. The pace p <= 1 slows it down where the joint's greatest speed asks
/// for that.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointReference {
    pub(super) start: f64,
    pub(super) shift: f64,
    pub(super) amplitude: [f64; 2],
    pub(super) frequency: [f64; 2],
    pub(super) phase: [f64; 2],
    pub(super) pace: f64,
}

impl JointReference {
    /// Draws the reference of `joint` that starts at `start` and swings by at most `amplitude` (rad;
    /// [`METRES_PER_RADIAN`] of it for a prismatic joint) around home, or around the nearest place where the joint's
    /// limits leave room. `index` tells the joints of one arm apart.
    pub fn draw(joint: &Joint, start: f64, amplitude: f64, stream: &Stream, index: u32) -> Self {
        let draw = |k: u32, low, high| stream.uniform_in(DRAWS * index + k, low, high);
        let wished = amplitude
            * match joint.kind {
                JointKind::Revolute => 1.0,
                JointKind::Prismatic => METRES_PER_RADIAN,
            };
        let (swing, center) = match &joint.limits {
            Some(limits) => {
                let margin = (MARGIN * (limits.upper - limits.lower)).min(wished);
                let (lower, upper) = (limits.lower + margin, limits.upper - margin);
                let swing = wished.min(0.5 * (upper - lower));
                (swing, joint.home.min(upper - swing).max(lower + swing))
            }
            None => (wished, joint.home),
        };
        let swing = swing * draw(0, 0.5, 1.0);
        let mut this = Self {
            start,
            shift: center - start,
            amplitude: SHARES.map(|share| share * swing),
            frequency: [0, 1].map(|k| TAU * draw(1 + k as u32, FREQUENCIES[k][0], FREQUENCIES[k][1])),
            phase: [0, 1].map(|k| draw(3 + k, 0.0, TAU)),
            pace: 1.0,
        };
        if let Some(speed) = joint.speed {
            this.pace = (speed / this.greatest_rate()).min(1.0);
        }
        this
    }

    /// Value, rate and acceleration at `time` s after the start, in closed form.
    pub fn at(&self, time: f64) -> ReferencePoint {
        let t = self.pace * time;
        let x = (t / RAMP).clamp(0.0, 1.0);
        let s = x * x * x * (10.0 + x * (6.0 * x - 15.0));
        let s1 = 30.0 * x * x * (1.0 - x) * (1.0 - x) / RAMP;
        let s2 = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / (RAMP * RAMP);
        let (mut swing, mut swing1, mut swing2) = (self.shift, 0.0, 0.0);
        for k in 0..2 {
            let (a, w) = (self.amplitude[k], self.frequency[k]);
            let (sine, cosine) = (w * t + self.phase[k]).sin_cos();
            swing += a * sine;
            swing1 += a * w * cosine;
            swing2 -= a * w * w * sine;
        }
        ReferencePoint {
            value: self.start + s * swing,
            rate: self.pace * (s1 * swing + s * swing1),
            acceleration: self.pace * self.pace * (s2 * swing + 2.0 * s1 * swing1 + s * swing2),
        }
    }

    /// A bound on the rate at pace 1.
    fn greatest_rate(&self) -> f64 {
        let [a, b] = self.amplitude;
        RAMP_SLOPE / RAMP * (self.shift.abs() + a + b) + a * self.frequency[0] + b * self.frequency[1]
    }
}

/// The cubic `c0 + c1 s + c2 s^2 + c3 s^3` over `[0, period]` that meets both points in value and rate.
pub fn hermite(from: &ReferencePoint, to: &ReferencePoint, period: f64) -> [f64; 4] {
    let slope = (to.value - from.value) / period;
    [
        from.value,
        from.rate,
        (3.0 * slope - 2.0 * from.rate - to.rate) / period,
        (from.rate + to.rate - 2.0 * slope) / (period * period),
    ]
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use proptest::prelude::*;

    use super::*;
    use crate::description::{Frame, Friction, JointLimits};
    use crate::scene::random::{EpisodeKey, Purpose};

    fn joint(limits: Option<[f64; 2]>, home: f64, speed: Option<f64>) -> Joint {
        Joint {
            kind: JointKind::Revolute,
            frame: Frame::default(),
            axis: Vector3::z(),
            friction: Friction::default(),
            limits: limits.map(|[lower, upper]| JointLimits { lower, upper, stiffness: 100.0, damping: 0.0 }),
            effort: None,
            speed,
            servo: None,
            home,
        }
    }

    fn stream(seed: u64) -> Stream {
        Stream::new(EpisodeKey { seed, episode: 0 }, Purpose::Reference)
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
            let reference = JointReference::draw(&joint, home, amplitude, &stream(seed), index);
            for k in 0..400 {
                let point = reference.at(0.1 * f64::from(k));
                prop_assert!((lower..=upper).contains(&point.value));
                prop_assert!(point.rate.abs() <= speed * (1.0 + 1e-12));
            }
        }

        #[test]
        fn rate_and_acceleration_are_the_derivatives(seed: u64, time in 0.01..20.0f64, speed in 0.05..1.0f64) {
            let reference = JointReference::draw(&joint(None, 0.3, Some(speed)), 0.1, 0.5, &stream(seed), 0);
            let h = 1e-4;
            let (before, at, after) = (reference.at(time - h), reference.at(time), reference.at(time + h));
            prop_assert!(((after.value - before.value) / (2.0 * h) - at.rate).abs() < 1e-7);
            prop_assert!(((after.rate - before.rate) / (2.0 * h) - at.acceleration).abs() < 1e-7);
        }

        #[test]
        fn hermite_cubic_meets_both_ends(
            q0 in -2.0..2.0f64, v0 in -1.0..1.0f64, q1 in -2.0..2.0f64, v1 in -1.0..1.0f64, period in 0.005..0.5f64,
        ) {
            let point = |value, rate| ReferencePoint { value, rate, acceleration: 0.0 };
            let [c0, c1, c2, c3] = hermite(&point(q0, v0), &point(q1, v1), period);
            prop_assert_eq!([c0, c1], [q0, v0]);
            let value = c0 + period * (c1 + period * (c2 + period * c3));
            let rate = c1 + period * (2.0 * c2 + 3.0 * period * c3);
            prop_assert!((value - q1).abs() < 1e-13);
            prop_assert!((rate - v1).abs() < 1e-10);
        }
    }

    #[test]
    fn reference_starts_at_rest_and_then_moves() {
        let reference = JointReference::draw(&joint(None, 0.3, None), -0.2, 0.5, &stream(1), 0);
        assert_eq!(reference.at(0.0), ReferencePoint { value: -0.2, rate: 0.0, acceleration: 0.0 });
        assert!((0..200).any(|k| reference.at(0.1 * f64::from(k)).rate.abs() > 0.1));
    }

    #[test]
    fn hermite_follows_the_reference_between_control_instants() {
        let reference = JointReference::draw(&joint(None, 0.0, None), 0.0, 0.4, &stream(5), 2);
        let period = 0.05;
        for k in 0..400 {
            let start = f64::from(k) * period;
            let [c0, c1, c2, c3] = hermite(&reference.at(start), &reference.at(start + period), period);
            let s = 0.5 * period;
            let value = c0 + s * (c1 + s * (c2 + s * c3));
            // h^4 / 384 of the fourth derivative.
            assert!((value - reference.at(start + s).value).abs() < 1e-7);
        }
    }
}
