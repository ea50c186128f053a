//! A system whose numbers differ between the instances of a lane, and the order of its numbers.

use super::Compiled;
use super::factors::UnscaledBodyTerms;
use super::model::System;
use crate::lane::{Lane, Shared, numbers};
use crate::spatial::BodyPoint;

numbers! {
    /// A system, the parts of its bodies' terms, from which [`System::apply_factors`] makes these terms, and the payload's attachment.
    /// Systems of the same structure have the same runs of numbers.
    #[derive(Debug, Clone, PartialEq)]
    pub struct InstanceSystem<P> {
        /// The system.
        pub system: System<P>,
        /// Parts of the terms of each moving body, vehicle first.
        pub unscaled: Vec<UnscaledBodyTerms<P>>,
        /// Attachment of payloads, in the frame of their body, m.
        pub payload_attachment: [P; 3],
    }
}

impl From<&Compiled> for InstanceSystem<f64> {
    fn from(compiled: &Compiled) -> Self {
        Self {
            system: compiled.system.map(|Shared(x)| x),
            unscaled: compiled.unscaled.iter().map(|parts| parts.map(|Shared(x)| x)).collect(),
            payload_attachment: compiled.payload_attachment,
        }
    }
}

impl<L: Lane> InstanceSystem<L> {
    /// Memory for the numbers of a lane, set to the shared numbers of `system` ([`System::allocate_scaled`]) and `parts` of the bodies.
    pub fn allocate(
        system: System<L>,
        parts: &[UnscaledBodyTerms<Shared<L::Real>>],
        payload_attachment: Option<[Shared<L::Real>; 3]>,
    ) -> Self {
        let unscaled = parts.iter().map(|parts| parts.map(|Shared(x)| L::splat(x))).collect();
        let payload_attachment = payload_attachment.map_or([L::zero(); 3], |at| at.map(|Shared(x)| L::splat(x)));
        Self { system, unscaled, payload_attachment }
    }

    /// Puts the payload, if there is one, at its attachment.
    #[inline(always)]
    pub fn attach_payload(&mut self) {
        let [x, y, z] = self.payload_attachment;
        if let Some(payload) = &mut self.system.payload_body_mut().payload {
            match &mut payload.position {
                BodyPoint::X(to) => *to = x,
                BodyPoint::Y(to) => *to = y,
                BodyPoint::Z(to) => *to = z,
                BodyPoint::General(to) => *to = [x, y, z],
            }
        }
    }
}
