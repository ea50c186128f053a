//! State of the filter of one instance.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use crate::lie;
use crate::sensors::{Motion, Suite, exponential};

/// Number of error states.
pub(super) const STATES: usize = 20;
/// First entries of the blocks: position and attitude (body axes), velocity (body axes), biases of gyro and
/// accelerometer (vehicle axes), bias of the heading, offset of the depth, position of the last ping.
pub(super) const POSITION: usize = 0;
pub(super) const ATTITUDE: usize = 3;
pub(super) const VELOCITY: usize = 6;
pub(super) const GYRO: usize = 9;
pub(super) const ACCELEROMETER: usize = 12;
pub(super) const HEADING: usize = 15;
pub(super) const DEPTH: usize = 16;
pub(super) const PING: usize = 17;

pub(super) type Covariance = SMatrix<f64, STATES, STATES>;
pub(super) type Error = SVector<f64, STATES>;

/// Pose and velocity from which a filter starts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// Estimated motion of the vehicle's frame.
    pub motion: Motion,
    /// Standard deviations of its errors.
    pub deviations: StartDeviations,
}

/// Standard deviations of the errors of a start, along each body axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StartDeviations {
    /// Position, m.
    pub position: f64,
    /// Attitude, rad.
    pub attitude: f64,
    /// Velocity, m/s.
    pub velocity: f64,
}

/// A tenth of a metre, three degrees, five centimetres per second.
impl Default for StartDeviations {
    fn default() -> Self {
        Self { position: 0.1, attitude: 0.05, velocity: 0.05 }
    }
}

/// Place of a ping.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ping {
    pub time: f64,
    pub position: Vector3<f64>,
    pub rotation: Matrix3<f64>,
}

/// Estimate and covariance; the navigated point is the IMU.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FilterState {
    /// Time of the last propagation, s.
    pub time: f64,
    /// Time of the last update, s.
    pub called: Option<f64>,
    pub position: Vector3<f64>,
    pub rotation: Matrix3<f64>,
    /// World axes.
    pub velocity: Vector3<f64>,
    pub gyro_bias: Vector3<f64>,
    pub accelerometer_bias: Vector3<f64>,
    pub heading_bias: f64,
    pub depth_offset: f64,
    pub gravity: Vector3<f64>,
    /// Latest angular velocity without bias.
    pub rate: Vector3<f64>,
    /// Time without readings of the IMU, s.
    pub coasted: f64,
    /// Variance of its noise, (rad/s)^2.
    pub rate_variance: f64,
    pub ping: Option<Ping>,
    /// Readings refused in a row, by sensor.
    pub refused: [u32; 4],
    pub covariance: Covariance,
}

impl FilterState {
    /// State at a start, with the biases' deviations from the settings of the sensors.
    pub fn new(start: &Start, suite: &Suite, lever: &Vector3<f64>) -> Self {
        let Start { motion, deviations } = start;
        let imu = suite.imu.clone().unwrap_or_default();
        let mut deviation = Error::zeros();
        let blocks = [
            (POSITION, deviations.position),
            (ATTITUDE, deviations.attitude),
            (VELOCITY, deviations.velocity),
            (GYRO, imu.gyro_bias),
            (ACCELEROMETER, imu.accelerometer_bias),
        ];
        for (first, value) in blocks {
            deviation.fixed_rows_mut::<3>(first).fill(value);
        }
        deviation[HEADING] = suite.heading.as_ref().map_or(0.0, |heading| heading.bias);
        deviation[DEPTH] = suite.depth.as_ref().map_or(0.0, |depth| depth.offset);
        // The deviations belong to the vehicle's origin and to its velocity in body axes.
        let velocity = motion.velocity(lever);
        let mut start = Covariance::identity();
        start.fixed_view_mut::<3, 3>(POSITION, ATTITUDE).copy_from(&-lever.cross_matrix());
        start.fixed_view_mut::<3, 3>(VELOCITY, ATTITUDE).copy_from(&-velocity.cross_matrix());
        let covariance = start * Covariance::from_diagonal(&deviation.component_mul(&deviation)) * start.transpose();
        Self {
            time: motion.time,
            called: None,
            position: motion.point(lever),
            rotation: motion.rotation,
            velocity: motion.rotation * velocity,
            gyro_bias: Vector3::zeros(),
            accelerometer_bias: Vector3::zeros(),
            heading_bias: 0.0,
            depth_offset: 0.0,
            gravity: motion.gravity,
            rate: motion.angular,
            coasted: 0.0,
            rate_variance: 0.0,
            ping: None,
            refused: [0; 4],
            covariance,
        }
    }

    /// Correction by an estimated error, and the covariance of the error that remains.
    pub fn correct(&mut self, error: &Error) {
        let part = |first: usize| -> Vector3<f64> { error.fixed_rows::<3>(first).into() };
        let (shift, turn, gain) = (part(POSITION), part(ATTITUDE), part(VELOCITY));
        self.position += self.rotation * shift;
        self.velocity += self.rotation * left_jacobian(&turn) * gain;
        self.rotation *= exponential(&turn);
        self.gyro_bias += part(GYRO);
        self.accelerometer_bias += part(ACCELEROMETER);
        self.heading_bias += error[HEADING];
        self.depth_offset += error[DEPTH];
        if let Some(ping) = &mut self.ping {
            ping.position += ping.rotation * part(PING);
        }
        // Errors in the axes after the turn. With an inexact turn the filter would assume knowledge along directions that no
        // sensor has measured: NIS of fixes 1.11, NEES of the position 5.
        let right = left_jacobian(&-turn);
        let mut reset = SMatrix::<f64, 9, 9>::identity();
        for (row, column, block) in [
            (POSITION, POSITION, exponential(&-turn)),
            (ATTITUDE, ATTITUDE, right),
            (VELOCITY, VELOCITY, right),
            (VELOCITY, ATTITUDE, gain.cross_matrix() * -0.5),
        ] {
            reset.fixed_view_mut::<3, 3>(row, column).copy_from(&block);
        }
        let top = reset * self.covariance.fixed_rows::<9>(0);
        self.covariance.fixed_rows_mut::<9>(0).copy_from(&top);
        let left = self.covariance.fixed_columns::<9>(0) * reset.transpose();
        self.covariance.fixed_columns_mut::<9>(0).copy_from(&left);
    }
}

/// Left Jacobian of SO(3): the derivative of `exp(w)` in the axes before the turn, and the mean of `exp(s w)` over s in
/// [0, 1].
fn left_jacobian(w: &Vector3<f64>) -> Matrix3<f64> {
    let angular = lie::Vector3((*w).into());
    let columns = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| {
        let moved = lie::exp_se3(lie::Vector6 { linear: lie::Vector3(axis.into()), angular });
        Vector3::from(moved.position.0)
    });
    Matrix3::from_columns(&columns)
}
