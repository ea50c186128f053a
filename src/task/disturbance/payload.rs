//! A payload, grasped and released.

use serde::{Deserialize, Serialize};

use super::context::DisturbanceContext;
use super::span::Span;
use crate::error::TaskError;
use crate::task::random::Stream;

/// A point mass at the end effector (at the vehicle's origin without an arm) between two times. It is at rest when grasped,
/// by a rigid grip: an inelastic impact. Released, it keeps its own momentum.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Payload {
    /// Weight relative to the maximum thrust along the vehicle's weakest axis.
    pub share: Span,
    /// Mass, kg; in place of the share.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass: Option<Span>,
    /// Time of the grasp, s.
    pub pick: Span,
    /// Duration of the hold, s.
    pub hold: Span,
}

impl Default for Payload {
    fn default() -> Self {
        Self { share: Span::of(0.03, 0.1), mass: None, pick: Span::of(2.0, 6.0), hold: Span::of(4.0, 8.0) }
    }
}

/// Event of a payload at a control instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PayloadEvent {
    /// Grasp of a mass, kg.
    Grasp(f64),
    /// Release of a mass, kg.
    Release(f64),
}

impl Payload {
    /// Mass; control periods at whose start it is grasped, and released; mass held now.
    pub(super) const ROWS: usize = 4;

    pub(super) fn check(&self) -> Result<(), TaskError> {
        self.share.check("payload.share", 0.0, 10.0)?;
        if let Some(mass) = self.mass {
            mass.check("payload.mass", 0.0, 1e6)?;
        }
        self.pick.check("payload.pick", 0.0, 1e5)?;
        self.hold.check("payload.hold", 0.0, 1e5)
    }

    pub(super) fn draw(&self, draw: &Stream, context: &DisturbanceContext) -> [f64; Self::ROWS] {
        let mass = self.mass.unwrap_or_else(|| self.share.times(context.thrust / context.gravity));
        let pick = (self.pick.at(draw.uniform(1)) / context.period).round();
        let hold = (self.hold.at(draw.uniform(2)) / context.period).round().max(1.0);
        [mass.at(draw.uniform(0)), pick, pick + hold, 0.0]
    }

    /// Event at the time `now` of a payload of these numbers.
    pub(super) fn event([mass, pick, drop, held]: [f64; Self::ROWS], now: f64) -> Option<PayloadEvent> {
        if held == 0.0 && now == pick && mass > 0.0 {
            Some(PayloadEvent::Grasp(mass))
        } else if held > 0.0 && now >= drop {
            Some(PayloadEvent::Release(held))
        } else {
            None
        }
    }
}
