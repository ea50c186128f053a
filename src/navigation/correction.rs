//! Corrections of the estimate by the readings of a sensor.

use nalgebra::{Matrix3, RowVector3, SMatrix, SVector, Vector3};

use super::state::{ATTITUDE, DEPTH, FilterState, GYRO, HEADING, PING, POSITION, STATES, VELOCITY};
use crate::sensors::{Acoustic, BEAMS, Depth, Dvl, Heading, heading};

/// Bounds on the normalised innovation squared of one to four numbers: a chi-squared number exceeds them once in a
/// thousand.
pub const GATES: [f64; 4] = [10.828, 13.816, 16.266, 18.467];

/// Readings of a sensor without outliers that are refused in a row before the filter doubts itself: the standard
/// deviations of its attitude (rad) and velocity (m/s) then grow by [`WIDENED`], and the reading corrects.
const LOST: u32 = 3;
const WIDENED: [f64; 2] = [0.1, 0.2];

/// Sensors in the order of [`super::UPDATES`].
const BEAM: usize = 0;
const PRESSURE: usize = 1;
const COMPASS: usize = 2;
const FIX: usize = 3;

/// Innovation of a reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Innovation {
    /// Normalised innovation squared.
    pub nis: f64,
    /// Number of measured numbers.
    pub degrees: usize,
    /// False where it was beyond the gate and did not correct the estimate.
    pub accepted: bool,
}

/// Rows of a measurement by its derivatives to the blocks of the error.
fn rows<const M: usize>(blocks: &[(usize, SMatrix<f64, M, 3>)]) -> SMatrix<f64, M, STATES> {
    let mut all = SMatrix::<f64, M, STATES>::zeros();
    for (first, block) in blocks {
        all.fixed_columns_mut::<3>(*first).copy_from(block);
    }
    all
}

impl FilterState {
    /// Correction by M numbers: `residual = rows error + noise`. None where the innovation is not finite.
    fn update<const M: usize>(
        &mut self,
        sensor: usize,
        rows: &SMatrix<f64, M, STATES>,
        residual: &SVector<f64, M>,
        noise: &SMatrix<f64, M, M>,
        degrees: usize,
    ) -> Option<Innovation> {
        let mut across = self.covariance * rows.transpose();
        let mut factor = (rows * across + noise).cholesky()?;
        let mut weighted = factor.solve(residual);
        let nis = residual.dot(&weighted);
        if !nis.is_finite() {
            return None;
        }
        let mut accepted = nis <= GATES[degrees - 1];
        self.refused[sensor] = if accepted { 0 } else { self.refused[sensor] + 1 };
        if self.refused[sensor] == LOST && sensor != FIX {
            (self.refused[sensor], accepted) = (0, true);
            for k in 0..3 {
                self.covariance[(ATTITUDE + k, ATTITUDE + k)] += WIDENED[0] * WIDENED[0];
                self.covariance[(VELOCITY + k, VELOCITY + k)] += WIDENED[1] * WIDENED[1];
            }
            across = self.covariance * rows.transpose();
            factor = (rows * across + noise).cholesky()?;
            weighted = factor.solve(residual);
        }
        if accepted {
            let error = across * weighted;
            let gain = factor.solve(&across.transpose()).transpose();
            self.covariance -= gain * across.transpose();
            self.covariance = (self.covariance + self.covariance.transpose()) * 0.5;
            self.correct(&error);
        }
        Some(Innovation { nis, degrees, accepted })
    }

    /// Correction by the beams of a DVL; lost ones are NaN.
    pub fn by_beams(&mut self, dvl: &Dvl, imu: &Vector3<f64>, beams: &[f64; BEAMS]) -> Option<Innovation> {
        let mount = dvl.mount();
        let lever = mount.position - imu;
        let body = self.rotation.tr_mul(&self.velocity);
        let velocity = body + self.rate.cross(&lever);
        let parts: [(usize, Matrix3<f64>); 3] =
            [(VELOCITY, Matrix3::identity()), (ATTITUDE, body.cross_matrix()), (GYRO, lever.cross_matrix())];
        let (mut all, mut residual) = (SMatrix::<f64, BEAMS, STATES>::zeros(), SVector::<f64, BEAMS>::zeros());
        let mut noise = SMatrix::<f64, BEAMS, BEAMS>::identity();
        let mut degrees = 0;
        for (k, direction) in dvl.beams().iter().enumerate() {
            if !beams[k].is_finite() {
                continue;
            }
            let along = mount.rotation * direction;
            residual[k] = beams[k] - along.dot(&velocity);
            for (first, block) in &parts {
                all.fixed_view_mut::<1, 3>(k, *first).copy_from(&(along.transpose() * block));
            }
            let turned = lever.cross(&along).norm_squared() * self.rate_variance;
            noise[(k, k)] = dvl.noise * dvl.noise + turned;
            degrees += 1;
        }
        if degrees == 0 { None } else { self.update(BEAM, &all, &residual, &noise, degrees) }
    }

    /// Correction by a depth.
    pub fn by_depth(&mut self, depth: &Depth, imu: &Vector3<f64>, reading: f64) -> Option<Innovation> {
        let lever = Vector3::from(depth.position) - imu;
        let up: RowVector3<f64> = self.rotation.row(2).into();
        let place = self.position.z + (self.rotation * lever).z;
        let residual = SVector::from([reading - (depth.surface - place + self.depth_offset)]);
        let mut all = rows(&[(POSITION, -up), (ATTITUDE, up * lever.cross_matrix())]);
        all[(0, DEPTH)] = 1.0;
        self.update(PRESSURE, &all, &residual, &SMatrix::from([[depth.noise * depth.noise]]), 1)
    }

    /// Correction by a heading.
    pub fn by_heading(&mut self, compass: &Heading, reading: f64) -> Option<Innovation> {
        let predicted = heading(&self.rotation)? + self.heading_bias;
        let (sine, cosine) = (reading - predicted).sin_cos();
        let axis: Vector3<f64> = self.rotation.column(0).into();
        let slope = RowVector3::new(-axis.y, axis.x, 0.0) / (axis.x * axis.x + axis.y * axis.y);
        let mut all = rows(&[(ATTITUDE, -slope * self.rotation * Vector3::x().cross_matrix())]);
        all[(0, HEADING)] = 1.0;
        let noise = SMatrix::from([[compass.noise * compass.noise]]);
        self.update(COMPASS, &all, &SVector::from([sine.atan2(cosine)]), &noise, 1)
    }

    /// Correction by a fix of the place of the last ping; None for another ping's.
    pub fn by_fix(&mut self, acoustic: &Acoustic, time: f64, fix: &Vector3<f64>) -> Option<Innovation> {
        let ping = self.ping.filter(|ping| (ping.time - time).abs() < 1e-6)?;
        let residual = ping.rotation.tr_mul(&(fix - ping.position));
        let [across, upright] = [acoustic.noise, acoustic.vertical_noise].map(|deviation| deviation * deviation);
        let spread = Matrix3::from_diagonal(&Vector3::new(across, across, upright));
        let noise = ping.rotation.tr_mul(&(spread * ping.rotation));
        self.update(FIX, &rows(&[(PING, Matrix3::identity())]), &residual, &noise, 3)
    }
}
