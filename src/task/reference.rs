//! Seeded smooth joint references, and their rows in an episode's memory.

use std::f64::consts::TAU;

use super::random::Stream;
use crate::description::Joint;
use crate::lane::{Lane, Rows, sin_cos};
use crate::system::JOINTS;

/// Duration of the ramp from rest, s.
const RAMP: f64 = 3.0;
/// Maximum slope of the ramp `10 x^3 - 15 x^4 + 6 x^5`.
const RAMP_SLOPE: f64 = 1.875;
/// Ranges of the frequencies of the two sinusoids, Hz.
const FREQUENCIES: [[f64; 2]; 2] = [[0.05, 0.1], [0.1, 0.2]];
/// Shares of the two sinusoids in the amplitude.
const SHARES: [f64; 2] = [0.7, 0.3];
/// Distance of a reference from either limit, relative to the joint's travel.
const MARGIN: f64 = 0.05;
/// Travel of a prismatic joint where a revolute one turns one radian, m.
pub const PRISMATIC_PER_RADIAN: f64 = 0.25;
/// Number of draws of one joint.
const DRAWS: u32 = 5;

/// A point of a reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferencePoint<L = f64> {
    /// rad or m.
    pub value: L,
    /// rad/s or m/s.
    pub rate: L,
}

/// Reference of one joint from the current control instant on:
/// `q_d = q_0 + s(x) (c - q_0 + sum_k a_k sin(phi_k))`, where x and the phases grow steadily from period to period.
///
/// The ramp s goes from 0 to 1 with zero slope and curvature at its ends, so the reference starts at rest; as s <= 1, it
/// stays between `q_0` and `c -+ (a_1 + a_2)`. It is slowed down where it would exceed the joint's maximum speed.
/// Phases are kept within a turn, so that they stay exact in episodes of any length, even in single precision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointReference<L = f64> {
    /// phi_k, rad.
    phase: [L; 2],
    /// x, at most 1.
    progress: L,
    /// Growth of the phases per period, rad.
    pace: [L; 2],
    /// Growth of x per period.
    ramp: L,
    /// q_0.
    start: L,
    /// c - q_0.
    shift: L,
    /// a_k.
    amplitude: [L; 2],
}

impl JointReference {
    /// Draws the reference of `joint` from `start` on, with at most `amplitude` (rad; [`PRISMATIC_PER_RADIAN`] of it for a
    /// prismatic joint) about home, or about the nearest centre within the joint's limits; `pace` is a factor on its
    /// speed. `index` is the number of the joint, `period` the control period, s.
    pub fn draw(
        joint: &Joint,
        start: f64,
        [amplitude, pace]: [f64; 2],
        period: f64,
        stream: &Stream,
        index: u32,
    ) -> Self {
        let draw = |k: u32, low, high| stream.uniform_in(DRAWS * index + k, low, high);
        let wished = amplitude * if joint.slides() { PRISMATIC_PER_RADIAN } else { 1.0 };
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
        let frequency = [0, 1].map(|k| TAU * draw(1 + k as u32, FREQUENCIES[k][0], FREQUENCIES[k][1]));
        let (shift, amplitude) = (center - start, SHARES.map(|share| share * swing));
        // Upper bound of the rate.
        let maximum = RAMP_SLOPE / RAMP * (shift.abs() + amplitude[0] + amplitude[1])
            + amplitude[0] * frequency[0]
            + amplitude[1] * frequency[1];
        let slowed = joint.speed.map_or(pace, |speed| (speed / maximum).min(pace)) * period;
        Self {
            phase: [0, 1].map(|k| draw(3 + k, 0.0, TAU)),
            progress: 0.0,
            pace: frequency.map(|w| w * slowed),
            ramp: slowed / RAMP,
            start,
            shift,
            amplitude,
        }
    }
}

impl<L: Lane> JointReference<L> {
    /// Count of numbers of a reference.
    pub const LEN: usize = 10;

    /// Reference of these numbers.
    #[inline(always)]
    pub fn from_array(x: [L; JointReference::<f64>::LEN]) -> Self {
        Self {
            phase: [x[0], x[1]],
            progress: x[2],
            pace: [x[3], x[4]],
            ramp: x[5],
            start: x[6],
            shift: x[7],
            amplitude: [x[8], x[9]],
        }
    }

    /// Numbers of the reference.
    #[inline(always)]
    pub fn to_array(&self) -> [L; JointReference::<f64>::LEN] {
        let ([p, r, x], [v, w], [a, b]) = (self.moving(), self.pace, self.amplitude);
        [p, r, x, v, w, self.ramp, self.start, self.shift, a, b]
    }

    /// The leading numbers, which change from period to period.
    #[inline(always)]
    pub fn moving(&self) -> [L; 3] {
        [self.phase[0], self.phase[1], self.progress]
    }

    /// Point `ahead` periods from now; `frequency` is the number of periods per second.
    #[inline(always)]
    pub fn point(&self, ahead: L, frequency: L) -> ReferencePoint<L> {
        let one = L::c(1.0);
        let x = ahead.mul_add(self.ramp, self.progress).min(one);
        // s = 10 x^3 - 15 x^4 + 6 x^5
        let (square, rest) = (x * x, one - x);
        let s = square * x * x.mul_add(x.mul_add(L::c(6.0), L::c(-15.0)), L::c(10.0));
        let slope = square * (rest * rest) * (self.ramp * L::c(30.0));
        let (mut swing, mut swinging) = (self.shift, L::zero());
        for k in 0..2 {
            let (sine, cosine) = sin_cos(ahead.mul_add(self.pace[k], self.phase[k]));
            swing = self.amplitude[k].mul_add(sine, swing);
            swinging = (self.amplitude[k] * self.pace[k]).mul_add(cosine, swinging);
        }
        let rate = slope.mul_add(swing, s * swinging);
        ReferencePoint { value: s.mul_add(swing, self.start), rate: rate * frequency }
    }

    /// Advances by one period.
    #[inline(always)]
    pub fn advance(&mut self) {
        self.progress = (self.progress + self.ramp).min(L::c(1.0));
        for k in 0..2 {
            let phase = self.phase[k] + self.pace[k];
            self.phase[k] = (phase * L::c(1.0 / TAU)).round().neg_mul_add(L::c(TAU), phase);
        }
    }
}

/// Rows of the references of joints that follow one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct JointReferenceRows {
    /// Number of joints.
    pub joints: usize,
    /// References, [`JointReference::LEN`] per joint.
    pub reference: usize,
    /// Value and rate of each at the current control instant.
    pub now: usize,
    /// Value and rate of each at the next control instant.
    pub next: usize,
}

impl JointReferenceRows {
    /// Allocates rows for `joints` joints by `take`, which gives the first of so many rows.
    pub fn new(joints: usize, mut take: impl FnMut(usize) -> usize) -> Self {
        Self {
            joints,
            reference: take(JointReference::<f64>::LEN * joints),
            now: take(2 * joints),
            next: take(2 * joints),
        }
    }

    /// Sets the points of the first control instants from the references; `frequency` is one over the control period.
    #[inline(always)]
    pub fn begin<L: Lane>(&self, memory: &mut Rows<'_, L::Real>, frequency: L) {
        for i in 0..self.joints {
            let reference: JointReference<L> = self.reference(memory, i);
            for (row, ahead) in [(self.now, 0.0), (self.next, 1.0)] {
                let point = reference.point(L::c(ahead), frequency);
                set_point(memory, row, i, &point);
            }
        }
    }

    /// Moves the references to the next control instant.
    #[inline(always)]
    pub fn advance<L: Lane>(&self, memory: &mut Rows<'_, L::Real>, frequency: L) {
        for i in 0..self.joints {
            let mut reference: JointReference<L> = self.reference(memory, i);
            reference.advance();
            let now = point::<L>(memory, self.next, i);
            set_point(memory, self.now, i, &now);
            set_point(memory, self.next, i, &reference.point(L::c(1.0), frequency));
            memory.set_all(self.reference + JointReference::<L>::LEN * i, &reference.moving());
        }
    }

    /// Servo targets over the coming control period, per joint: see [`hermite`].
    #[inline(always)]
    pub fn targets<L: Lane>(&self, memory: &Rows<'_, L::Real>, frequency: L, targets: &mut [[L; 4]; JOINTS]) {
        for i in 0..self.joints {
            let (now, next) = (point(memory, self.now, i), point(memory, self.next, i));
            targets[i] = hermite(&now, &next, frequency);
        }
    }

    #[inline(always)]
    fn reference<L: Lane>(&self, memory: &Rows<'_, L::Real>, joint: usize) -> JointReference<L> {
        JointReference::from_array(memory.get_all(self.reference + JointReference::<L>::LEN * joint))
    }
}

#[inline(always)]
fn point<L: Lane>(memory: &Rows<'_, L::Real>, row: usize, joint: usize) -> ReferencePoint<L> {
    let [value, rate] = memory.get_all(row + 2 * joint);
    ReferencePoint { value, rate }
}

#[inline(always)]
fn set_point<L: Lane>(memory: &mut Rows<'_, L::Real>, row: usize, joint: usize, point: &ReferencePoint<L>) {
    memory.set_all(row + 2 * joint, &[point.value, point.rate]);
}

/// The cubic `c0 + c1 t + c2 t^2 + c3 t^3` in the time t that meets both points, a period apart, in value and rate;
/// `frequency` is 1 over the period.
#[inline(always)]
pub fn hermite<L: Lane>(from: &ReferencePoint<L>, to: &ReferencePoint<L>, frequency: L) -> [L; 4] {
    let slope = (to.value - from.value) * frequency;
    let (off, over) = (slope - from.rate, to.rate - slope);
    [from.value, from.rate, (off + off - over) * frequency, (over - off) * (frequency * frequency)]
}
