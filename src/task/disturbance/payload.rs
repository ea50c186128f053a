//! A payload that is picked up and dropped.

use nalgebra::{DVector, Matrix6};
use serde::{Deserialize, Serialize};

use super::site::Site;
use super::span::Span;
use crate::dynamics::ClosedFormModel;
use crate::error::TaskError;
use crate::system::{Flow, State};
use crate::task::random::Stream;

/// A point mass that hangs at the end effector from one time to another (at the vehicle's origin without an arm). It is at rest when it is picked up, and
/// the grip does not give: an inelastic impact. Dropped, it takes its own momentum with it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PayloadEvent {
    /// Weight over the greatest thrust along the vehicle's weakest axis.
    pub share: Span,
    /// Mass, kg; in place of the share.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass: Option<Span>,
    /// When it is picked up, s.
    pub pick: Span,
    /// How long it is held, s.
    pub hold: Span,
}

impl Default for PayloadEvent {
    fn default() -> Self {
        Self { share: Span::of(0.03, 0.1), mass: None, pick: Span::of(2.0, 6.0), hold: Span::of(4.0, 8.0) }
    }
}

/// What is to be done with a payload at a control instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Handling {
    /// Picked up: mass, kg.
    Pick(f64),
    /// Dropped: mass, kg.
    Drop(f64),
}

impl PayloadEvent {
    /// Mass; control periods at whose start it is picked up, and dropped; what is held now.
    pub(super) const ROWS: usize = 4;

    pub(super) fn check(&self) -> Result<(), TaskError> {
        self.share.check("payload.share", 0.0, 10.0)?;
        if let Some(mass) = self.mass {
            mass.check("payload.mass", 0.0, 1e6)?;
        }
        self.pick.check("payload.pick", 0.0, 1e5)?;
        self.hold.check("payload.hold", 0.0, 1e5)
    }

    pub(super) fn draw(&self, draw: &Stream, site: &Site) -> [f64; Self::ROWS] {
        let mass = self.mass.unwrap_or_else(|| self.share.times(site.thrust / site.gravity));
        let pick = (self.pick.at(draw.uniform(1)) / site.period).round();
        let hold = (self.hold.at(draw.uniform(2)) / site.period).round().max(1.0);
        [mass.at(draw.uniform(0)), pick, pick + hold, 0.0]
    }

    /// What is to be done at the time `now` with a payload of these numbers.
    pub(super) fn handling([mass, pick, drop, held]: [f64; Self::ROWS], now: f64) -> Option<Handling> {
        if held == 0.0 && now == pick && mass > 0.0 {
            Some(Handling::Pick(mass))
        } else if held > 0.0 && now >= drop {
            Some(Handling::Drop(held))
        } else {
            None
        }
    }
}

/// Velocities `[V; q']` after the end effector has seized a point mass that was at rest:
/// `(M + J^T A_p J) nu+ = M nu-`, added mass being part of M.
pub fn seize(balance: &ClosedFormModel, state: &mut State, mass: f64) {
    let form = balance.at(state, Flow::from(nalgebra::Vector3::zeros()));
    let n = form.joints();
    let before = DVector::from_iterator(6 + n, state.twist.iter().chain(&state.qd[..n]).copied());
    let (inertia, jacobian) = (form.mass_matrix(), form.jacobian());
    let mut point = Matrix6::zeros();
    (0..3).for_each(|k| point[(k, k)] = mass);
    let together = inertia + jacobian.transpose() * point * &jacobian;
    let Some(factors) = together.cholesky() else { return };
    let after = factors.solve(&(inertia * before));
    state.twist.copy_from(&after.fixed_rows::<6>(0));
    state.qd[..n].copy_from_slice(&after.as_slice()[6..]);
}
