//! Meaning of an action in [-1, 1]: wrenches, thrusts and joint torques.

use nalgebra::Vector6;
use serde::{Deserialize, Serialize};

use super::allocation::{AXES, Allocation};

/// Meaning of an action's entries.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ActionKind {
    /// Body wrench over the wrench limits, through the allocation: 6 entries.
    #[default]
    Wrench,
    /// Thrust of each thruster over its limit on that side: m entries.
    Thrusters,
    /// As a wrench, added to a classical controller's action.
    Residual,
}

impl ActionKind {
    /// Name in messages and files.
    pub fn name(self) -> &'static str {
        match self {
            ActionKind::Wrench => "wrench",
            ActionKind::Thrusters => "thrusters",
            ActionKind::Residual => "residual",
        }
    }
}

/// Physical meaning of one entry of an action.
#[derive(Debug, Clone, PartialEq)]
pub struct ActionRange {
    /// Axis of the wrench, name of the thruster or of the joint.
    pub name: String,
    /// Physical values of -1 and +1; 0 is 0, and each side is linear.
    pub limits: [f64; 2],
    /// N or N m.
    pub unit: &'static str,
    /// Quantity and axes.
    pub description: &'static str,
}

/// Map between actions and the thrusts and joint torques of one vehicle, in both directions.
#[derive(Debug, Clone, PartialEq)]
pub struct ActionMap {
    kind: ActionKind,
    allocation: Allocation,
    /// Torque of 1, per actuated joint; their entries follow the vehicle's.
    torques: Vec<f64>,
}

impl ActionMap {
    /// Actions of this kind for this vehicle, and joints with these torque limits, N m or N.
    pub fn new(kind: ActionKind, allocation: Allocation, torques: Vec<f64>) -> Self {
        Self { kind, allocation, torques }
    }

    /// Meaning of an action's entries.
    pub fn kind(&self) -> ActionKind {
        self.kind
    }

    /// Entries of an action.
    pub fn len(&self) -> usize {
        self.vehicle_len() + self.torques.len()
    }

    #[inline]
    fn vehicle_len(&self) -> usize {
        match self.kind {
            ActionKind::Wrench | ActionKind::Residual => 6,
            ActionKind::Thrusters => self.allocation.count(),
        }
    }

    /// Torque of 1, per actuated joint, N m or N.
    pub fn torques(&self) -> &[f64] {
        &self.torques
    }

    /// True for an action without entries.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Thruster allocation.
    #[inline]
    pub fn allocation(&self) -> &Allocation {
        &self.allocation
    }

    /// Meaning of each entry of the vehicle; thrusters are named by `names`.
    pub fn ranges<'a>(&self, names: impl IntoIterator<Item = &'a str>) -> Vec<ActionRange> {
        match self.kind {
            ActionKind::Wrench | ActionKind::Residual => (AXES.iter().zip(self.allocation.wrench_limits()).enumerate())
                .map(|(k, (name, limit))| ActionRange {
                    name: (*name).to_owned(),
                    limits: [-limit, limit],
                    unit: if k < 3 { "N" } else { "N m" },
                    description: "wrench on the vehicle, body axes",
                })
                .collect(),
            ActionKind::Thrusters => (names.into_iter().take(self.allocation.count()).enumerate())
                .map(|(i, name)| ActionRange {
                    name: name.to_owned(),
                    limits: self.allocation.limits(i),
                    unit: "N",
                    description: "thrust",
                })
                .collect(),
        }
    }

    /// Action of a wrench and torques of the first joints, N m or N, clipped to [-1, 1]; 0 along unactuated axes and for further
    /// joints.
    #[inline(always)]
    pub fn normalise(&self, wrench: &Vector6<f64>, torques: &[f64], action: &mut [f32]) {
        let (action, joints) = action.split_at_mut(self.vehicle_len());
        joints.fill(0.0);
        for k in 0..torques.len().min(joints.len()) {
            joints[k] = over(torques[k], self.torques[k]);
        }
        match self.kind {
            ActionKind::Wrench | ActionKind::Residual => {
                let limits = self.allocation.wrench_limits();
                for k in 0..action.len().min(6) {
                    action[k] = over(wrench[k], limits[k]);
                }
            }
            ActionKind::Thrusters => {
                let thrusts = self.allocation.allocate(wrench);
                for (i, a) in action.iter_mut().enumerate() {
                    let t = thrusts[i];
                    *a = over(t, self.allocation.limits(i)[usize::from(t > 0.0)].abs());
                }
            }
        }
    }
}

/// Ratio to a limit, clipped to [-1, 1]; 0 where the limit is, and for NaN: a law that overflows asks for nothing.
#[inline(always)]
fn over(value: f64, limit: f64) -> f32 {
    if limit > 0.0 && !value.is_nan() { (value / limit).clamp(-1.0, 1.0) as f32 } else { 0.0 }
}
