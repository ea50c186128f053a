//! Disturbances over time, for display.

use nalgebra::Vector3;

use super::column::Column;
use super::kernel::DisturbanceKernel;
use super::payload::PayloadEvent;
use crate::lane::Rows;
use crate::lie::{Pose, Vector6};
use crate::limits::interrupt;
use crate::task::EpisodeKey;

/// Forcing to come, one entry per control period.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Profile {
    /// Velocity of the water, world axes, m/s.
    pub velocity: Vec<[f64; 3]>,
    /// Its acceleration, m/s^2.
    pub acceleration: Vec<[f64; 3]>,
    /// Wrench on the vehicle, body axes, N and N m.
    pub wrench: Vec<[f64; 6]>,
    /// Remaining gain of each thruster.
    pub gains: Vec<Vec<f64>>,
    /// Payload, kg.
    pub payload: Vec<f64>,
}

impl Profile {
    /// Only a steady current.
    pub(in crate::task) fn steady(current: &Vector3<f64>, steps: u32, thrusters: usize) -> Self {
        let count = steps as usize;
        Self {
            velocity: vec![(*current).into(); count],
            acceleration: vec![[0.0; 3]; count],
            wrench: vec![[0.0; 6]; count],
            gains: vec![vec![1.0; thrusters]; count],
            payload: vec![0.0; count],
        }
    }
}

impl DisturbanceKernel<f64> {
    /// Profile of the next `steps` control periods, from number `step` on, for a vehicle at rest in `pose`.
    /// `numbers` are the episode's; they end as at the last of these periods. It ends early at an interrupt.
    pub fn profile(
        &self,
        numbers: &mut [f64],
        key: EpisodeKey,
        step: u32,
        steps: u32,
        pose: &Pose<f64>,
        thrusters: usize,
    ) -> Profile {
        let mut profile = Profile::default();
        for step in (step..).take(steps as usize).take_while(|_| !interrupt::requested()) {
            let mut column = Column::of_one(numbers);
            self.advance(&mut column, key, step);
            match self.payload_event(&column, step) {
                Some(PayloadEvent::Grasp(mass)) => self.hold(&mut column, mass),
                Some(PayloadEvent::Release(_)) => self.hold(&mut column, 0.0),
                None => {}
            }
            let mut rows = Rows::of_one(numbers);
            let forcing = self.forcing(&rows, pose, &Vector6::zero());
            self.end_period::<f64>(&mut rows);
            profile.velocity.push(forcing.velocity.0);
            profile.acceleration.push(forcing.acceleration.0);
            profile.wrench.push(forcing.wrench.to_array());
            profile.gains.push(forcing.gains[..thrusters].to_vec());
            profile.payload.push(forcing.payload);
        }
        profile
    }
}
