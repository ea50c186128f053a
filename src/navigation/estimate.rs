//! Estimate of the vehicle's motion and its covariance.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::state::{ACCELEROMETER, ATTITUDE, FilterState, GYRO, POSITION, STATES, VELOCITY};

/// Number of errors of an estimate: pose and twist.
pub const OUTPUT: usize = 12;

/// Estimate of the motion of the vehicle's frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// Origin in the world, m.
    pub position: Vector3<f64>,
    /// Rotation, body to world.
    pub rotation: Matrix3<f64>,
    /// Velocity of the origin, body axes, m/s.
    pub linear: Vector3<f64>,
    /// Angular velocity, body axes, rad/s.
    pub angular: Vector3<f64>,
    /// Covariance of the errors `[rho, theta; dv; domega]`: pose `(R^ exp(theta), p^ + R^ rho)`, twist
    /// `V^ + [dv; domega]`.
    pub covariance: SMatrix<f64, OUTPUT, OUTPUT>,
    /// Bias of the angular velocity, vehicle axes, rad/s.
    pub gyro_bias: Vector3<f64>,
    /// Bias of the specific force, vehicle axes, m/s2.
    pub accelerometer_bias: Vector3<f64>,
    /// Standard deviations of both.
    pub bias_deviations: [f64; 6],
}

impl FilterState {
    /// Estimate of the vehicle's frame from the IMU's, `lever` from it in vehicle axes.
    pub fn estimate(&self, lever: &Vector3<f64>) -> Estimate {
        let body = self.rotation.tr_mul(&self.velocity);
        let arm = lever.cross_matrix();
        let mut map = SMatrix::<f64, OUTPUT, STATES>::zeros();
        let one = Matrix3::identity();
        for (row, column, block) in [
            (0, POSITION, one),
            (0, ATTITUDE, arm),
            (3, ATTITUDE, one),
            (6, VELOCITY, one),
            (6, ATTITUDE, body.cross_matrix()),
            (6, GYRO, -arm),
            (9, GYRO, -one),
        ] {
            map.fixed_view_mut::<3, 3>(row, column).copy_from(&block);
        }
        let mut covariance = map * self.covariance * map.transpose();
        for k in 9..OUTPUT {
            covariance[(k, k)] += self.rate_variance;
        }
        Estimate {
            position: self.position - self.rotation * lever,
            rotation: self.rotation,
            linear: body - self.rate.cross(lever),
            angular: self.rate,
            covariance,
            gyro_bias: self.gyro_bias,
            accelerometer_bias: self.accelerometer_bias,
            bias_deviations: std::array::from_fn(|k| {
                let at = if k < 3 { GYRO + k } else { ACCELEROMETER + k - 3 };
                self.covariance[(at, at)].max(0.0).sqrt()
            }),
        }
    }
}
