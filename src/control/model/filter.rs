//! Gains of the observer.

use nalgebra::{Matrix2, SMatrix};

/// What is estimated along one axis: pose, velocity, and the parts of the unexplained acceleration: what stays, what comes
/// and goes, and its rate.
pub(super) const STATES: usize = 5;

/// Deviation of measured velocities, m/s and rad/s, and of measured poses, m and rad.
const NOISE: [f64; 2] = [0.01, 0.005];
/// Damping ratio of what comes and goes: waves of one spectrum are in step for a few periods.
const DAMPING: f64 = 0.15;
/// Control periods in which a filter settles, at most.
const ITERATIONS: usize = 100_000;

type Square = SMatrix<f64, STATES, STATES>;

/// What is expected to disturb one axis, as accelerations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Expected {
    /// How fast what stays is followed, rad/s: natural frequency of the filter (of damping ratio `1 / sqrt 2`) that
    /// measured velocities alone would have.
    pub drift: f64,
    /// Deviation of what comes and goes, m/s2 or rad/s2.
    pub waves: f64,
    /// White noise on the acceleration, m/s2 or rad/s2 times the root of a second.
    pub jolts: f64,
}

/// How an acceleration that comes and goes, `w'' = -omega^2 w - 2 zeta omega w'`, and its rate change over a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Swell(pub [[f64; 2]; 2]);

impl Swell {
    /// With angular frequency omega (rad/s) over a time (s).
    pub fn over(omega: f64, time: f64) -> Self {
        if omega == 0.0 {
            return Self([[1.0, time], [0.0, 1.0]]);
        }
        let decay = DAMPING * omega;
        let turn = omega * (1.0 - DAMPING * DAMPING).sqrt();
        let (sin, cos) = (turn * time).sin_cos();
        let (left, per_rate) = ((-decay * time).exp(), sin / turn);
        Self([
            [left * (cos + decay * per_rate), left * per_rate],
            [-left * omega * omega * per_rate, left * (cos - decay * per_rate)],
        ])
    }
}

/// What is made of a measurement that differs from the prediction, along one axis: shares of the differences of pose and
/// velocity that go to each of what is estimated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Correction(pub [[f64; 2]; STATES]);

impl Correction {
    /// Measurements are taken as they are; momentum that is not explained is, in time, by a wrench:
    /// `d += (1 - exp(-omega T)) (h - h^-) / T`.
    pub fn momentum(omega: f64, period: f64) -> Self {
        let share = -(-omega * period).exp_m1() / period;
        Self([[1.0, 0.0], [0.0, 1.0], [0.0, share], [0.0; 2], [0.0; 2]])
    }

    /// The steady Kalman filter of a body under such accelerations, whose waves have the angular frequency omega.
    pub fn kalman(expected: &Expected, omega: f64, period: f64) -> Self {
        let t = period;
        let Swell([[a, b], [c, d]]) = Swell::over(omega, t);
        let mut step = Square::identity();
        (step[(0, 1)], step[(0, 2)], step[(0, 3)]) = (t, 0.5 * t * t, 0.5 * t * t);
        (step[(1, 2)], step[(1, 3)], step[(1, 4)]) = (t, 0.5 * (1.0 + a) * t, 0.5 * b * t);
        (step[(3, 3)], step[(3, 4)], step[(4, 3)], step[(4, 4)]) = (a, b, c, d);
        let [velocity, pose] = NOISE.map(|deviation| deviation * deviation);
        let mut wander = Square::zeros();
        wander[(1, 1)] = expected.jolts * expected.jolts * t;
        wander[(2, 2)] = expected.drift.powi(4) * velocity * t * t;
        wander[(4, 4)] = 4.0 * DAMPING * omega.powi(3) * expected.waves * expected.waves * t;
        let look = SMatrix::<f64, 2, STATES>::identity();
        let noise = Matrix2::new(pose, 0.0, 0.0, velocity);
        let mut spread = Square::zeros();
        let mut gain = SMatrix::<f64, STATES, 2>::zeros();
        for k in 0..ITERATIONS {
            let ahead = step * spread * step.transpose() + wander;
            // It is positive definite: noise is.
            let Some(inverse) = (look * ahead * look.transpose() + noise).try_inverse() else { break };
            let next = ahead * look.transpose() * inverse;
            let settled = k > STATES && (next - gain).amax() < 1e-12;
            gain = next;
            let rest = Square::identity() - gain * look;
            spread = rest * ahead * rest.transpose() + gain * noise * gain.transpose();
            if settled {
                break;
            }
        }
        Self(std::array::from_fn(|i| [gain[(i, 0)], gain[(i, 1)]]))
    }
}
