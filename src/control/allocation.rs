//! Thruster allocation: body wrench to thrusts, and thrusts to body wrench.

use nalgebra::{Matrix6xX, Vector6};

use crate::description::{Thruster, Vehicle};
use crate::error::ControlError;
pub use crate::system::{THRUSTERS, Thrusts};

/// Names of the six axes of a body wrench.
pub const AXES: [&str; 6] = ["surge", "sway", "heave", "roll", "pitch", "yaw"];

/// Share of the maximum below which singular values and forces along other axes count as 0: files round angles, as 1.5708
/// and 3.14, and along an axis of such a singular value a force takes 500 times the thrust.
const RANK_TOLERANCE: f64 = 2e-3;

/// Wrench that saturates any thrusters, N and N m.
const HUGE: f64 = 1e100;

/// Relative thrusts below this share of the maximum count as rounding: they are dropped, or saturate nothing.
pub(super) const ROUNDING: f64 = 1e-12;

/// Minimum height of the centre of buoyancy above the centre of mass by which roll and pitch level themselves, m.
const RIGHTING: f64 = 1e-3;

/// Share of the maximum force below which an axis is reached too weakly to be of use: the thrusters push against each other.
const WEAK: f64 = 0.2;

/// Axes that may be left to the righting moment, pitch and roll, in the order in which that is tried.
const RIGHTED: [&[usize]; 3] = [&[4], &[3], &[3, 4]];

/// Weighted least-squares allocation of a body wrench to the thrusters of one vehicle.
///
/// Minimises `sum (T_i / range_i)^2` over the thrusts that come closest to the wrench, where `range_i` is the
/// maximum magnitude thruster i reaches. Moments count against forces through the thrusters' RMS distance from
/// the origin, which matters only where a wrench cannot be reached.
///
/// An axis that thrusters reach only, or with more than a fifth of their force only, with a moment in roll or pitch, as the
/// surge of four vectored and two vertical thrusters beside the centre of mass, is allocated as if that moment were none, if
/// the vehicle rights itself (its centre of buoyancy is above its centre of mass) and cannot be rolled or pitched alone with
/// a fifth of the maximum moment.
#[derive(Debug, Clone, PartialEq)]
pub struct Allocation {
    count: usize,
    /// Columns of T_tcm.
    configuration: [Vector6<f64>; THRUSTERS],
    /// Rows of its weighted pseudo-inverse, N per N or N m.
    pseudo_inverse: [Vector6<f64>; THRUSTERS],
    limits: [[f64; 2]; THRUSTERS],
    wrench_limits: [f64; 6],
    /// True for axes left to the righting moment.
    righted: [bool; 6],
}

impl Allocation {
    /// Allocation to a vehicle's thrusters.
    ///
    /// # Errors
    /// `ControlError` names the thruster whose limits exclude 0 or whose geometry is not a direction at a place, or
    /// the number of thrusters if there are more than [`THRUSTERS`]. No thrusters at all is not an error.
    pub fn new(vehicle: &Vehicle) -> Result<Self, ControlError> {
        let thrusters = &vehicle.thrusters;
        let count = thrusters.len();
        if count > THRUSTERS {
            return Err(ControlError::TooManyThrusters { count, maximum: THRUSTERS });
        }
        let mut configuration = [Vector6::zeros(); THRUSTERS];
        let mut limits = [[0.0; 2]; THRUSTERS];
        for (i, thruster) in thrusters.iter().enumerate() {
            let name = || thruster.name.clone();
            let [lower, upper] = thruster.limits;
            if !(lower.is_finite() && upper.is_finite() && lower <= 0.0 && upper >= 0.0) {
                return Err(ControlError::ThrusterLimits { name: name(), lower, upper });
            }
            let (position, axis) = (thruster.position, thruster.axis.normalize());
            if !(position.iter().chain(&axis).all(|x| x.is_finite())) {
                let (position, axis) = (position.into(), thruster.axis.into());
                return Err(ControlError::ThrusterGeometry { name: name(), position, axis });
            }
            configuration[i] = Thruster { axis, ..thruster.clone() }.wrench();
            limits[i] = thruster.limits;
        }

        let squares: f64 = thrusters.iter().map(|t| t.position.norm_squared()).sum();
        let rms = (squares / count.max(1) as f64).sqrt();
        let lever = if rms > 1e-9 { rms } else { 1.0 };
        let row = Vector6::new(1.0, 1.0, 1.0, 1.0 / lever, 1.0 / lever, 1.0 / lever);

        let mut this = Self {
            count,
            configuration,
            pseudo_inverse: [Vector6::zeros(); THRUSTERS],
            limits,
            wrench_limits: [0.0; 6],
            righted: [false; 6],
        };
        if count > 0 {
            this.pseudo_inverse = this.inverse(&row);
            if Self::rights_itself(vehicle) {
                this.leave_to_righting(&row);
            }
            let row = Vector6::from_fn(|axis, _| if this.righted[axis] { 0.0 } else { row[axis] });
            this.wrench_limits = std::array::from_fn(|axis| this.pure_limit(axis, &this.pseudo_inverse, &row));
        }
        Ok(this)
    }

    /// True if gravity and buoyancy level the vehicle, without its arm.
    pub fn rights_itself(vehicle: &Vehicle) -> bool {
        vehicle.body.center_of_buoyancy.z - vehicle.body.center_of_mass.z > RIGHTING
    }

    /// Rows of the weighted pseudo-inverse, with a weight on each axis of the wrench.
    fn inverse(&self, row: &Vector6<f64>) -> [Vector6<f64>; THRUSTERS] {
        let scaled = Matrix6xX::from_fn(self.count, |r, i| row[r] * self.configuration[i][r] * self.range(i));
        let svd = scaled.svd(true, true);
        let minimum = RANK_TOLERANCE * svd.singular_values.max();
        let inverse = svd.pseudo_inverse(minimum).expect("both factors were asked for, and the tolerance is >= 0");
        let noise = ROUNDING * inverse.amax();
        let inverse = inverse.map(|x| if x.abs() > noise { x } else { 0.0 });
        let thrusts = |i: usize| Vector6::from_fn(|r, _| self.range(i) * inverse[(i, r)] * row[r]);
        std::array::from_fn(|i| if i < self.count { thrusts(i) } else { Vector6::zeros() })
    }

    /// Allocates axes that are not reached alone, or weakly, as if moments in roll and pitch were none, where this makes them
    /// reachable or stronger.
    fn leave_to_righting(&mut self, row: &Vector6<f64>) {
        let mut limits: [f64; 6] = std::array::from_fn(|axis| self.pure_limit(axis, &self.pseudo_inverse, row));
        for left in RIGHTED {
            let strong = |axis: usize| limits[axis] > WEAK * self.maximum(axis).into_iter().fold(0.0, f64::max);
            if left.iter().any(|axis| strong(*axis)) {
                continue;
            }
            let row = Vector6::from_fn(|axis, _| if left.contains(&axis) { 0.0 } else { row[axis] });
            let inverse = self.inverse(&row);
            for axis in 0..6 {
                let limit = self.pure_limit(axis, &inverse, &row);
                if limits[axis] < WEAK * limit {
                    limits[axis] = limit;
                    (0..self.count).for_each(|i| self.pseudo_inverse[i][axis] = inverse[i][axis]);
                    left.iter().for_each(|axis| self.righted[*axis] = true);
                }
            }
        }
        for axis in (0..6).filter(|axis| self.righted[*axis]) {
            (0..self.count).for_each(|i| self.pseudo_inverse[i][axis] = 0.0);
        }
    }

    /// True if the thrusts of an axis give its wrench and none along the other axes that `row` weighs.
    fn reaches(&self, axis: usize, inverse: &[Vector6<f64>; THRUSTERS], row: &Vector6<f64>) -> bool {
        let unit = Vector6::ith(axis, 1.0);
        let thrusts = std::array::from_fn(|i| inverse[i].dot(&unit));
        let missed = row.component_mul(&(self.wrench(&thrusts) - unit)).norm();
        row[axis] > 0.0 && missed <= RANK_TOLERANCE * row[axis]
    }

    /// Number of thrusters m.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Thruster configuration matrix T_tcm, 6 x m: thrusts to the body wrench at the vehicle origin. `[HC eq. 25]`
    pub fn configuration(&self) -> Matrix6xX<f64> {
        Matrix6xX::from_fn(self.count, |r, i| self.configuration[i][r])
    }

    /// Wrench per thrust of thruster i: its column of T_tcm.
    pub fn column(&self, i: usize) -> Vector6<f64> {
        self.configuration[i]
    }

    /// Unsaturated thrust of thruster i per wrench, N per N or N m.
    pub(super) fn pseudo_inverse(&self, i: usize) -> Vector6<f64> {
        self.pseudo_inverse[i]
    }

    /// Minimum and maximum thrust of thruster i, N.
    pub fn limits(&self, i: usize) -> [f64; 2] {
        self.limits[i]
    }

    /// Maximum thrust of thruster i in either direction, N.
    pub fn range(&self, i: usize) -> f64 {
        self.limits[i][1].max(-self.limits[i][0])
    }

    /// Thrusts over their ranges, m numbers in [-1, 1]; 0 for a thruster that has no range.
    pub fn relative<'a>(&'a self, thrusts: &'a Thrusts) -> impl Iterator<Item = f64> + 'a {
        (0..self.count).map(|i| if self.range(i) > 0.0 { thrusts[i] / self.range(i) } else { 0.0 })
    }

    /// Body wrench `T_tcm T` of thrusts. `[HC eq. 25]`
    pub fn wrench(&self, thrusts: &Thrusts) -> Vector6<f64> {
        (0..self.count).map(|i| self.configuration[i] * thrusts[i]).sum()
    }

    /// Maximum force (N) or moment (N m) along a body axis, forward and backward, whatever the thrusters do along the others.
    pub fn maximum(&self, axis: usize) -> [f64; 2] {
        (0..self.count).fold([0.0; 2], |[forward, backward], i| {
            let [a, b] = self.limits[i].map(|limit| self.configuration[i][axis] * limit);
            [forward + a.max(b), backward - a.min(b)]
        })
    }

    /// Thrusts of minimum weighted effort that come closest to `wrench`, without limits.
    pub fn unsaturated(&self, wrench: &Vector6<f64>) -> Thrusts {
        std::array::from_fn(|i| self.pseudo_inverse[i].dot(wrench))
    }

    /// Thrusts for `wrench` within the limits: scaled down together where one would exceed its own, so that the
    /// wrench keeps its direction.
    pub fn allocate(&self, wrench: &Vector6<f64>) -> Thrusts {
        // Far beyond all limits only the direction counts, and a shorter wrench cannot overflow.
        let shrink = (HUGE / wrench.amax()).min(1.0);
        let thrusts = self.unsaturated(&(wrench * shrink));
        let factor = self.scale_to_limits(&thrusts).min(1.0);
        // The clamp removes rounding beyond a limit.
        std::array::from_fn(|i| (factor * thrusts[i]).clamp(self.limits[i][0], self.limits[i][1]))
    }

    /// Maximum force (N) and moment (N m) along each body axis alone, in both directions, that [`Self::allocate`]
    /// reaches. 0 where the thrusters cannot push along that axis without pushing along another that does not right itself.
    #[inline]
    pub fn wrench_limits(&self) -> [f64; 6] {
        self.wrench_limits
    }

    /// Names of the axes whose limit is 0.
    pub fn unactuated(&self) -> Vec<&'static str> {
        AXES.into_iter().zip(self.wrench_limits).filter(|(_, limit)| *limit == 0.0).map(|(axis, _)| axis).collect()
    }

    /// Maximum factor that keeps the thrusts within their limits.
    fn scale_to_limits(&self, thrusts: &Thrusts) -> f64 {
        let noise = ROUNDING * self.relative(thrusts).fold(0.0, |a: f64, u| a.max(u.abs()));
        (0..self.count)
            .filter(|&i| thrusts[i].abs() > noise * self.range(i))
            .map(|i| self.limits[i][usize::from(thrusts[i] > 0.0)] / thrusts[i])
            .fold(f64::INFINITY, f64::min)
    }

    fn pure_limit(&self, axis: usize, inverse: &[Vector6<f64>; THRUSTERS], row: &Vector6<f64>) -> f64 {
        if !self.reaches(axis, inverse, row) {
            return 0.0;
        }
        let thrusts = std::array::from_fn(|i| inverse[i][axis]);
        self.scale_to_limits(&thrusts).min(self.scale_to_limits(&thrusts.map(|t| -t)))
    }
}
