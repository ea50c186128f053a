//! Contact of spheres with planes, boxes, cylinders and tori: distances, and a smooth law of normal force and friction.

mod force;
mod geometry;
mod law;

pub use force::{ContactForce, RelativeMotion, contact_force, contact_force_adjoint};
pub use geometry::{Distance, Geometry};
pub use law::Law;

use crate::lane::numbers;

numbers! {
    /// Compiled contact of a scene: every sphere meets every shape.
    #[derive(Debug, Clone, PartialEq)]
    pub struct ContactTerms<P> {
        /// Spheres on the robot.
        pub spheres: Vec<SphereTerms<P>>,
        /// Shapes in the world and on fixtures.
        pub shapes: Vec<ShapeTerms<P>>,
    }
}

numbers! {
    /// A sphere on a body.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct SphereTerms<P> {
        /// Its body: 0 for the vehicle, k + 1 for the link of joint k.
        pub body: usize,
        /// Centre in the frame of the body, m.
        pub position: [P; 3],
        /// Radius, m.
        pub radius: P,
        /// Maximum acceleration of the centre per force on it, 1/kg, with the body free.
        pub mobility: P,
        /// The same where equal forces act on all spheres of the body, each along its own acceleration: at most the sum of their
        /// mobilities.
        pub together: P,
    }
}

numbers! {
    /// A shape on a body.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct ShapeTerms<P> {
        /// Its body: 0 for the world, k + 1 for the link of joint k.
        pub body: usize,
        /// Rotation to the frame of the body, by rows.
        pub rotation: [[P; 3]; 3],
        /// Origin in the frame of the body, m.
        pub position: [P; 3],
        /// Form and size.
        pub geometry: Geometry<P>,
        /// Law of the force.
        pub law: Law<P>,
        /// Maximum acceleration of a point of its surface per force on it, 1/kg; 0 in the world.
        pub mobility: P,
    }
}
