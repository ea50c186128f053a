//! End-effector tracking by resolved motion, from observations alone.

use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Vector3, Vector6};

use super::ActionMap;
use super::policy::{Policy, Widths};
use crate::balance::{Balance, Loads};
use crate::description::{JointLimits, Scene};
use crate::error::ControlError;
use crate::system::{JOINTS, State};

/// Gains of [`ResolvedMotion`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ResolvedGains {
    /// Of the pose error on the end effector's commanded twist, 1/s.
    pub error: f64,
    /// Of the error of the vehicle's twist on its acceleration, 1/s.
    pub vehicle: f64,
    /// Of the error of the joints' rates on their accelerations, 1/s.
    pub joint: f64,
    /// Of the distance of the joints from home on their rates, as far as the end effector does not feel it, 1/s.
    pub home: f64,
    /// Likewise of the vehicle's tilt, 1/s.
    pub level: f64,
    /// How readily joints move against the vehicle: an arm of length 1 m takes as much of a motion at 1.
    pub arm: f64,
}

impl Default for ResolvedGains {
    fn default() -> Self {
        Self { error: 2.5, vehicle: 6.0, joint: 10.0, home: 0.5, level: 0.5, arm: 2.0 }
    }
}

/// Share of its travel within which a joint that nears a limit is spared.
const MARGIN: f64 = 0.15;
/// Damping of the pseudo-inverse, as a share of the vehicle's own weight.
const DAMPING: f64 = 1e-3;

/// A run of entries of an observation: the first, and the scales that undo the normalisation.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Entries {
    /// First entry.
    pub offset: usize,
    /// Physical value of 1, per entry.
    pub scale: Vec<f64>,
}

impl Entries {
    /// Physical values at one row of observations.
    pub fn read<'a>(&'a self, observation: &'a [f32]) -> impl Iterator<Item = f64> + 'a {
        self.scale.iter().zip(&observation[self.offset..]).map(|(scale, x)| f64::from(*x) * scale)
    }
}

/// Where [`ResolvedMotion`] finds what it reads.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackReading {
    /// Length of a row.
    pub width: usize,
    /// Both pose errors of the end effector, 6.
    pub error: Entries,
    /// Body twist of the vehicle, 6.
    pub twist: Entries,
    /// Direction against gravity, body axes, 3.
    pub up: Entries,
    /// Joint coordinates relative to home, n.
    pub q: Entries,
    /// Joint rates, n.
    pub qd: Entries,
    /// Twist of the reference, end-effector axes, 6.
    pub reference: Entries,
    /// Errors against the first point ahead, 6, and the time to it, s.
    pub ahead: Option<(Entries, f64)>,
}

/// Resolved motion and inverse dynamics. `[Whi69]`
///
/// The end effector's commanded twist is the reference's less `error` times the pose error. A damped and weighted
/// pseudo-inverse of its Jacobian shares it out among vehicle and joints; what the end effector does not feel of it pulls
/// the arm home and the vehicle level. Inverse dynamics (the closed form `[HC eq. 13]`, in still water) turns the error of
/// these velocities and the reference's acceleration into a wrench and torques, clipped to what the actuators can do.
pub struct ResolvedMotion {
    reading: TrackReading,
    gains: ResolvedGains,
    actions: ActionMap,
    balance: Balance,
    home: Vec<f64>,
    limits: Vec<Option<JointLimits>>,
    /// World axis against gravity.
    up: Vector3<f64>,
    /// 1 for the axes of the vehicle that its thrusters can move, else 0.
    actuated: [f64; 6],
}

impl ResolvedMotion {
    /// For a checked scene.
    ///
    /// # Errors
    /// `ControlError` for a gain that is not finite or is negative, or a scene that does not compose.
    pub fn new(
        scene: &Scene,
        up: Vector3<f64>,
        reading: TrackReading,
        gains: ResolvedGains,
        actions: ActionMap,
    ) -> Result<Self, ControlError> {
        let ResolvedGains { error, vehicle, joint, home, level, arm } = gains;
        let all =
            [("error", error), ("vehicle", vehicle), ("joint", joint), ("home", home), ("level", level), ("arm", arm)];
        if let Some((name, value)) = all.into_iter().find(|(_, k)| !(k.is_finite() && *k >= 0.0)) {
            return Err(ControlError::Gain { name, index: 0, value });
        }
        let balance = Balance::new(scene).map_err(|error| ControlError::Model(error.to_string()))?;
        let actuated = actions.allocation().wrench_limits().map(|limit| f64::from(u8::from(limit > 0.0)));
        let (home, limits) = scene.joints().map(|joint| (joint.home, joint.limits.clone())).unzip();
        Ok(Self { reading, gains, actions, balance, home, limits, up, actuated })
    }

    /// Gains in use.
    pub fn gains(&self) -> &ResolvedGains {
        &self.gains
    }

    /// Body wrench (N, N m) and joint torques (N m or N) at one row of observations.
    pub fn command(&self, observation: &[f32]) -> (Vector6<f64>, DVector<f64>) {
        let (reading, gains, n) = (&self.reading, &self.gains, self.home.len());
        let six = |entries: &Entries| Vector6::from_iterator(entries.read(observation));
        let up = Vector3::from_iterator(reading.up.read(observation));
        let rotation = Rotation3::rotation_between(&up, &self.up).unwrap_or_else(|| {
            // Upside down: any horizontal axis will do.
            Rotation3::from_axis_angle(&nalgebra::Unit::new_normalize(up.cross(&least_axis(&up))), std::f64::consts::PI)
        });
        let twist = six(&reading.twist);
        let (mut q, mut qd) = ([0.0; JOINTS], [0.0; JOINTS]);
        for (k, x) in reading.q.read(observation).enumerate() {
            q[k] = x + self.home[k];
        }
        for (k, x) in reading.qd.read(observation).enumerate() {
            qd[k] = x;
        }
        let state = State { rotation: rotation.into_inner(), twist, q, qd, ..State::default() };
        let form = self.balance.at(&state, Vector3::zeros());
        let jacobian = form.jacobian();

        // Mobilities: one over the weights.
        let mut mobility = DVector::from_element(6 + n, 1.0);
        for k in 0..n {
            let spared = self.limits[k].as_ref().map_or(1.0, |limits| {
                let room = (q[k] - limits.lower).min(limits.upper - q[k]);
                (room / (MARGIN * (limits.upper - limits.lower))).clamp(0.0, 1.0)
            });
            mobility[6 + k] = gains.arm * spared;
        }
        for k in 0..6 {
            mobility[k] = self.actuated[k];
        }
        let scaled = DMatrix::from_diagonal(&mobility) * jacobian.transpose();
        let damped = &jacobian * &scaled + DMatrix::identity(6, 6) * DAMPING;
        // It is symmetric and positive: there is a factor.
        let Some(factor) = damped.cholesky() else { return (Vector6::zeros(), DVector::zeros(n)) };
        let share_out = |motion: &Vector6<f64>| &scaled * factor.solve(motion);

        let (error, reference) = (six(&reading.error), six(&reading.reference));
        let mut leisure = DVector::zeros(6 + n);
        // The rotation that takes the vehicle's z axis upright.
        let tilt = Vector3::z().cross(&up) * gains.level;
        leisure.rows_mut(3, 3).copy_from(&tilt);
        for k in 0..n {
            leisure[6 + k] = gains.home * (self.home[k] - q[k]);
        }
        let felt = Vector6::from_iterator((&jacobian * &leisure).iter().copied());
        let wanted = leisure + share_out(&(reference - error * gains.error - felt));

        // The reference's velocity changes by this on the way to the first point ahead.
        let acceleration = reading.ahead.as_ref().map_or_else(Vector6::zeros, |(ahead, time)| {
            let later = six(ahead);
            let moved = error - later;
            let mut acceleration = (moved - reference * *time) * (2.0 / (time * time));
            acceleration.fixed_rows_mut::<3>(3).fill(0.0);
            acceleration
        });
        let mut acceleration = share_out(&acceleration);
        for k in 0..6 + n {
            let (now, gain) = if k < 6 { (twist[k], gains.vehicle) } else { (qd[k - 6], gains.joint) };
            acceleration[k] += gain * (wanted[k] - now);
        }
        match form.inverse_dynamics(&acceleration, &Loads::default()) {
            Ok(effort) => (effort.wrench, effort.joint_torques),
            Err(_) => (Vector6::zeros(), DVector::zeros(n)),
        }
    }
}

/// The axis that is least along a vector.
fn least_axis(v: &Vector3<f64>) -> Vector3<f64> {
    let axes = Matrix3::identity();
    axes.column(v.iamin()).into_owned()
}

impl Policy for ResolvedMotion {
    fn widths(&self) -> Widths {
        Widths { observation: self.reading.width, memory: 0, action: self.actions.len() }
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        self.widths().rows(observations, memory, actions)?;
        let rows = observations.chunks_exact(self.reading.width);
        for (observation, action) in rows.zip(actions.chunks_exact_mut(self.actions.len().max(1))) {
            let (wrench, torques) = self.command(observation);
            self.actions.normalise_all(&wrench, torques.as_slice(), action);
        }
        Ok(())
    }
}
