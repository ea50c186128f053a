//! Hydrodynamic and hydrostatic wrenches: damping, restoring, thrusters. (Added mass is part of the inertia; fins, tether and others
//! are in `terms`.)

mod central_frame;
mod damping;
mod damping_adjoint;
mod implicit;
mod restoring;
mod restoring_adjoint;
mod thruster;
mod thruster_adjoint;
mod thruster_dynamics;

pub use central_frame::{CentralFrameTerms, FrameRotation};
pub use damping::{CoefficientFrame, CoefficientMatrix, Damping};
pub use damping_adjoint::{DampedMotion, DampedSums};
pub use restoring::Restoring;
pub use thruster::{Branch, LagDecay, THRUSTERS, Thruster, Thrusts, thrust_wrench};
pub use thruster_adjoint::{CommandCotangents, CourseCotangents, ThrustCotangents, ThrusterCotangents};
pub use thruster_dynamics::{ThrustProfile, ThrustProfiles, ThrusterDynamics};
