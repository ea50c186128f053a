//! Observations of tracking: the measured state and the reference.

use nalgebra::{Vector3, Vector6};

use crate::control::equations::{ChainState, Velocities};
use crate::control::indices::BlockIndices;
use crate::system::{JOINTS, Joints};

/// State of vehicle, arm and reference.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackingState {
    /// Pose error of the end effector, m and rad.
    pub error: Vector6<f64>,
    /// Velocities of vehicle and joints.
    pub velocities: Velocities,
    /// Direction against gravity, vehicle axes, as measured: of length 1 but for noise.
    pub up: Vector3<f64>,
    /// Joint coordinates, rad or m.
    pub q: Joints,
    /// Twist of the reference, end-effector axes.
    pub reference: Vector6<f64>,
    /// Its acceleration, m/s^2; the angular part is not observed.
    pub acceleration: Vector6<f64>,
}

impl TrackingState {
    /// State of vehicle and arm.
    pub fn chain(&self) -> ChainState<'_> {
        ChainState { up: &self.up, q: &self.q, velocities: &self.velocities }
    }
}

/// Indices of the observation's blocks that controllers of tracking read.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackingIndices {
    /// Length of a row.
    pub width: usize,
    /// Both pose errors of the end effector, 6.
    pub error: BlockIndices,
    /// Body twist of the vehicle, 6.
    pub twist: BlockIndices,
    /// Direction against gravity, body axes, 3.
    pub up: BlockIndices,
    /// Joint coordinates relative to home, n.
    pub q: BlockIndices,
    /// Joint rates, n.
    pub qd: BlockIndices,
    /// Twist of the reference, end-effector axes, 6.
    pub reference: BlockIndices,
    /// Errors against each point ahead, 6 each, and the time between them and to the first, s.
    pub ahead: Option<(BlockIndices, f64)>,
}

impl TrackingIndices {
    /// State of a row, for joints with this home position.
    pub(in crate::control) fn read(&self, home: &[f64], observation: &[f32]) -> TrackingState {
        let six = |entries: &BlockIndices| Vector6::from_iterator(entries.read(observation));
        let mut velocities = Velocities::zeros();
        let rates = self.twist.read(observation).chain(self.qd.read(observation));
        rates.zip(velocities.iter_mut()).for_each(|(x, velocity)| *velocity = x);
        let mut q = [0.0; JOINTS];
        for (k, x) in self.q.read(observation).enumerate() {
            q[k] = x + home[k];
        }
        let up = Vector3::from_iterator(self.up.read(observation));
        let (error, reference) = (six(&self.error), six(&self.reference));
        // Constant acceleration of the reference to the first point ahead.
        let acceleration = self.ahead.as_ref().map_or_else(Vector6::zeros, |(ahead, time)| {
            let motion = error - six(ahead);
            let mut acceleration = (motion - reference * *time) * (2.0 / (time * time));
            acceleration.fixed_rows_mut::<3>(3).fill(0.0);
            acceleration
        });
        TrackingState { error, velocities, up, q, reference, acceleration }
    }

    /// Motion of the reference from now to each point ahead of a row, present end-effector axes, and the time between
    /// points, s.
    pub(in crate::control) fn points(&self, error: &Vector6<f64>, observation: &[f32]) -> (Vec<Vector6<f64>>, f64) {
        let Some((ahead, time)) = &self.ahead else { return (Vec::new(), 0.0) };
        let ahead: Vec<f64> = ahead.read(observation).collect();
        (ahead.chunks_exact(6).map(|point| error - Vector6::from_column_slice(point)).collect(), *time)
    }
}
