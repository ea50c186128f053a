//! Modes of small deviations from a motion: decaying, oscillating or growing.

use nalgebra::{Complex, DMatrix, DVector, Schur};

use super::linearize::Linearization;
use crate::lane::Shared;
use crate::system::System;

/// Servos that are on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Servos {
    /// Joint servos.
    pub joints: bool,
    /// Vehicle servo.
    pub vehicle: bool,
}

impl Servos {
    /// Index of this choice, 0 to 3.
    pub fn index(self) -> usize {
        usize::from(self.joints) + 2 * usize::from(self.vehicle)
    }
}

impl Linearization {
    /// Adds servos whose targets follow the motion: `u = -kp [xi; dq] - kd [dV; dq']`.
    pub fn with_servos(mut self, system: &System<Shared<f64>>, servos: Servos) -> Self {
        let rates = self.b.ncols();
        let mut close = |k: usize, kp: f64, kd: f64| {
            for (column, gain) in [(k, kp), (rates + k, kd)] {
                self.a.column_mut(column).axpy(-gain, &self.b.column(k), 1.0);
            }
        };
        if let (true, Some(servo)) = (servos.vehicle, &system.vehicle_servo) {
            for k in 0..6 {
                close(k, servo.kp[k].0, servo.kd[k].0);
            }
        }
        for (k, joint) in system.joints.iter().enumerate() {
            if let (true, Some(servo)) = (servos.joints, &joint.servo) {
                close(6 + k, servo.kp.0, servo.kd.0);
            }
        }
        self
    }

    /// Modes of the motion with constant coefficients.
    ///
    /// Left out are states without a rate: coordinates on which nothing depends, a fixed vehicle, and the rotation of the pose
    /// error with a moving frame (`ad_V0`), which the methods on the group integrate exactly.
    pub fn modes(&self) -> Modes {
        let rates = self.b.ncols();
        let dynamics = |row: usize| rates + row;
        let moves = |m: &DMatrix<f64>, k: usize| m.row(dynamics(k)).iter().any(|&x| x != 0.0);
        let free: Vec<usize> = (0..rates).filter(|&k| moves(&self.a, k) || moves(&self.b, k)).collect();
        let acts = |&k: &usize| free.iter().any(|&row| self.a[(dynamics(row), k)] != 0.0);
        let coordinates: Vec<usize> = free.iter().copied().filter(acts).collect();

        let (c, size) = (coordinates.len(), coordinates.len() + free.len());
        let columns: Vec<usize> = coordinates.iter().copied().chain(free.iter().map(|&k| dynamics(k))).collect();
        let matrix = DMatrix::from_fn(size, size, |i, j| {
            if i < c {
                f64::from(u8::from(columns[j] == dynamics(coordinates[i])))
            } else {
                self.a[(dynamics(free[i - c]), columns[j])]
            }
        });
        let mobility = DMatrix::from_fn(free.len(), free.len(), |i, j| self.b[(dynamics(free[i]), free[j])]);
        Modes { matrix, mobility, free, width: rates }
    }
}

/// Eigenvalue problem of a motion.
#[derive(Debug, Clone)]
pub struct Modes {
    /// `[x; v]' = matrix [x; v]`.
    matrix: DMatrix<f64>,
    /// `M^-1` of the free velocities.
    mobility: DMatrix<f64>,
    /// Free velocities: their entries of `[V; q']`.
    free: Vec<usize>,
    width: usize,
}

impl Modes {
    /// Eigenvalues, 1/s: small deviations vary as `exp(rate t)`. Empty if a coefficient is not finite.
    pub fn rates(&self) -> Vec<Complex<f64>> {
        if self.matrix.is_empty() || !self.matrix.iter().all(|x| x.is_finite()) {
            return Vec::new();
        }
        // Tens of sweeps per eigenvalue are already many.
        let schur = Schur::try_new(self.matrix.clone(), f64::EPSILON, 200 * self.matrix.nrows());
        schur.map_or_else(Vec::new, |schur| schur.complex_eigenvalues().iter().copied().collect())
    }

    /// Shares of `[V; q']` in the kinetic energy of the mode of this rate; they sum to 1 in any units.
    pub fn shares(&self, rate: Complex<f64>) -> Vec<f64> {
        let n = self.matrix.nrows();
        // Inverse iteration with a shift next to the eigenvalue.
        let near = rate + Complex::new(1e-9, 1e-9) * rate.norm();
        let shifted = self.matrix.map(|x| Complex::new(x, 0.0)) - DMatrix::identity(n, n) * near;
        let factored = shifted.lu();
        let mut mode = DVector::from_fn(n, |i, _| Complex::new(1.0, 0.1 * i as f64));
        for _ in 0..3 {
            if !factored.solve_mut(&mut mode) {
                break;
            }
            let size = mode.norm();
            mode.unscale_mut(size);
        }
        let velocity = mode.rows(n - self.free.len(), self.free.len()).into_owned();
        let momentum = self.mobility.clone().map(|x| Complex::new(x, 0.0)).lu().solve(&velocity);
        let momentum = momentum.unwrap_or_else(|| velocity.clone());
        let mut shares = vec![0.0; self.width];
        for (i, &k) in self.free.iter().enumerate() {
            shares[k] = velocity[i].norm() * momentum[i].norm();
        }
        let sum: f64 = shares.iter().sum();
        shares.iter().map(|share| share / sum).collect()
    }
}
