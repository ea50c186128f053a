//! Gains of the disturbance observer: exponential, or a steady Kalman filter.

use nalgebra::{Matrix2, SMatrix};

/// States per axis: pose, velocity, and the parts of the disturbing acceleration: slow part, wave part and its rate.
pub(super) const STATES: usize = 5;

/// Standard deviation of measured velocities, m/s and rad/s, and of measured poses, m and rad.
const NOISE: [f64; 2] = [0.01, 0.005];
/// Damping ratio of the wave part: waves of one spectrum stay in phase for a few periods.
const DAMPING: f64 = 0.15;
/// Maximum number of control periods in which a filter settles.
const ITERATIONS: usize = 100_000;

type Square = SMatrix<f64, STATES, STATES>;

/// Model of the disturbing acceleration along one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DisturbanceModel {
    /// Bandwidth of the slow part, rad/s: natural frequency (at damping ratio `1 / sqrt 2`) of the filter that measures
    /// only velocities.
    pub bandwidth: f64,
    /// Standard deviation of the wave part, m/s2 or rad/s2.
    pub wave: f64,
    /// White noise on the acceleration, m/s2 or rad/s2 times the root of a second.
    pub noise: f64,
}

/// Transition of a wave `w'' = -omega^2 w - 2 zeta omega w'` and its rate over a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct WaveTransition(pub [[f64; 2]; 2]);

impl WaveTransition {
    /// With angular frequency omega (rad/s) over a time (s).
    pub fn over(omega: f64, time: f64) -> Self {
        if omega == 0.0 {
            return Self([[1.0, time], [0.0, 1.0]]);
        }
        let decay = DAMPING * omega;
        let damped = omega * (1.0 - DAMPING * DAMPING).sqrt();
        let (sin, cos) = (damped * time).sin_cos();
        let (remaining, per_rate) = ((-decay * time).exp(), sin / damped);
        Self([
            [remaining * (cos + decay * per_rate), remaining * per_rate],
            [-remaining * omega * omega * per_rate, remaining * (cos - decay * per_rate)],
        ])
    }
}

/// Observer gain along one axis: corrections of the states per innovation of pose and of velocity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ObserverGain(pub [[f64; 2]; STATES]);

impl ObserverGain {
    /// Measurements taken as exact; the momentum's innovation drives the slow disturbance,
    /// `d += (1 - exp(-omega T)) (h - h^-) / T`.
    pub fn momentum(omega: f64, period: f64) -> Self {
        let share = -(-omega * period).exp_m1() / period;
        Self([[1.0, 0.0], [0.0, 1.0], [0.0, share], [0.0; 2], [0.0; 2]])
    }

    /// Steady Kalman gain of a body under these accelerations, with waves of angular frequency omega.
    pub fn kalman(model: &DisturbanceModel, omega: f64, period: f64) -> Self {
        let t = period;
        let WaveTransition([[a, b], [c, d]]) = WaveTransition::over(omega, t);
        let mut step = Square::identity();
        (step[(0, 1)], step[(0, 2)], step[(0, 3)]) = (t, 0.5 * t * t, 0.5 * t * t);
        (step[(1, 2)], step[(1, 3)], step[(1, 4)]) = (t, 0.5 * (1.0 + a) * t, 0.5 * b * t);
        (step[(3, 3)], step[(3, 4)], step[(4, 3)], step[(4, 4)]) = (a, b, c, d);
        let [velocity, pose] = NOISE.map(|deviation| deviation * deviation);
        let mut process = Square::zeros();
        process[(1, 1)] = model.noise * model.noise * t;
        process[(2, 2)] = model.bandwidth.powi(4) * velocity * t * t;
        process[(4, 4)] = 4.0 * DAMPING * omega.powi(3) * model.wave * model.wave * t;
        let measured = SMatrix::<f64, 2, STATES>::identity();
        let noise = Matrix2::new(pose, 0.0, 0.0, velocity);
        let mut covariance = Square::zeros();
        let mut gain = SMatrix::<f64, STATES, 2>::zeros();
        for k in 0..ITERATIONS {
            let predicted = step * covariance * step.transpose() + process;
            // Positive definite, because the noise is.
            let Some(inverse) = (measured * predicted * measured.transpose() + noise).try_inverse() else { break };
            let next = predicted * measured.transpose() * inverse;
            let settled = k > STATES && (next - gain).amax() < 1e-12;
            gain = next;
            let rest = Square::identity() - gain * measured;
            covariance = rest * predicted * rest.transpose() + gain * noise * gain.transpose();
            if settled {
                break;
            }
        }
        Self(std::array::from_fn(|i| [gain[(i, 0)], gain[(i, 1)]]))
    }
}
