//! DVL: velocity over the bottom by four beams.

use nalgebra::{Matrix3, Vector3};

use super::motion::{Motion, Mount};
use super::sensor::{BIASES, Draws, Field, Sensor, Timing, VALUES, each};
use crate::task::settings::settings;

/// Number of beams.
pub const BEAMS: usize = 4;

settings! {
    /// Doppler velocity log in Janus arrangement: beams at 45, 135, 225 and 315 degrees about its z axis from its x axis,
    /// inclined to -z. A beam is lost where the flat bottom is out of its range or it does not point down.
    pub struct Dvl {
        /// Samples per second: of the Water Linked A50 at altitudes of 1.5 to 14 m (its documentation).
        rate: f64 = 5.0;
        /// Delay, s.
        delay: f64 = 0.0;
        /// Probability that a sample is lost.
        dropout: f64 = 0.0;
        /// Time of failure, s.
        failure: Option<f64> = None;
        /// Position on the vehicle, m.
        position: [f64; 3] = [0.0; 3];
        /// Roll, pitch and yaw of the DVL's axes about the vehicle's, rad.
        rpy: [f64; 3] = [0.0; 3];
        /// Angle of the beams to the -z axis, rad: 25 degrees, typical (20 to 30), estimated.
        beam_angle: f64 = 0.4363;
        /// Standard deviation of a beam's velocity, m/s: typical, estimated.
        noise: f64 = 0.005;
        /// Probability that a beam is lost: typical, estimated.
        beam_dropout: f64 = 0.02;
        /// Height of the flat bottom in the world, m.
        bottom: f64 = -10.0;
        /// Minimum range along a beam, m: Water Linked A50 (its documentation).
        minimum_range: f64 = 0.05;
        /// Maximum range along a beam, m: Water Linked A50 (its documentation).
        maximum_range: f64 = 50.0;
    }
}

impl Dvl {
    /// Mounting pose.
    pub fn mount(&self) -> Mount {
        Mount::new(self.position, self.rpy)
    }

    /// Directions of the beams in the DVL's axes.
    pub fn beams(&self) -> [Vector3<f64>; BEAMS] {
        let (sine, cosine) = self.beam_angle.sin_cos();
        let half = std::f64::consts::FRAC_1_SQRT_2;
        [(half, half), (-half, half), (-half, -half), (half, -half)]
            .map(|(x, y)| Vector3::new(sine * x, sine * y, -cosine))
    }

    /// Velocity in the DVL's axes from beams that are not NaN, by least squares; None from fewer than three.
    pub fn velocity(&self, along: &[f64; BEAMS]) -> Option<Vector3<f64>> {
        let (mut normal, mut sum, mut count) = (Matrix3::zeros(), Vector3::zeros(), 0);
        for (beam, speed) in self.beams().iter().zip(along) {
            if speed.is_finite() {
                normal += beam * beam.transpose();
                sum += beam * *speed;
                count += 1;
            }
        }
        if count < 3 {
            return None;
        }
        normal.try_inverse().map(|inverse| inverse * sum)
    }
}

impl Sensor for Dvl {
    fn name(&self) -> &'static str {
        "dvl"
    }

    fn fields(&self) -> &'static [Field] {
        &[("velocity", 3), ("beams", BEAMS), ("range", BEAMS)]
    }

    fn timing(&self) -> Timing {
        Timing { rate: self.rate, delay: self.delay, dropout: self.dropout, failure: self.failure }
    }

    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        let mut ranges = vec![
            ("beam_angle", self.beam_angle, 0.01, 1.5),
            ("noise", self.noise, 0.0, 10.0),
            ("beam_dropout", self.beam_dropout, 0.0, 1.0),
            ("bottom", self.bottom, -12e3, 12e3),
            ("minimum_range", self.minimum_range, 0.0, 12e3),
            ("maximum_range", self.maximum_range, 0.0, 12e3),
        ];
        ranges.extend(each("position", self.position, 100.0));
        ranges.extend(each("rpy", self.rpy, std::f64::consts::PI));
        ranges
    }

    fn begin(&self, _draws: &Draws) -> [f64; BIASES] {
        [0.0; BIASES]
    }

    fn read(
        &self,
        _before: Option<&Motion>,
        now: &Motion,
        _biases: &mut [f64; BIASES],
        draws: &Draws,
        values: &mut [f64; VALUES],
    ) -> bool {
        let mount = self.mount();
        let velocity = mount.rotation.tr_mul(&now.velocity(&mount.position));
        let altitude = now.point(&mount.position).z - self.bottom;
        let mut along = [f64::NAN; BEAMS];
        values.fill(f64::NAN);
        for (k, beam) in self.beams().iter().enumerate() {
            let down = -(now.rotation * (mount.rotation * beam)).z;
            let range = altitude / down;
            let seen = down > 0.0 && (self.minimum_range..=self.maximum_range).contains(&range);
            if seen && draws.uniform(1 + k) >= self.beam_dropout {
                along[k] = beam.dot(&velocity) + self.noise * draws.normal(k);
                values[3 + k] = along[k];
                values[3 + BEAMS + k] = range;
            }
        }
        if let Some(solved) = self.velocity(&along) {
            values[..3].copy_from_slice(solved.as_slice());
        }
        along.iter().any(|speed| speed.is_finite())
    }
}
