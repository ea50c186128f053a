//! Hydrodynamic and hydrostatic wrenches: damping, restoring, thrusters, fins, tether. (Added mass is part of the inertia.)

mod central_frame;
mod damping;
mod fin;
mod implicit;
mod restoring;
mod tether;
mod thruster;

pub use central_frame::{CentralFrameTerms, FrameRotation};
pub use damping::{CoefficientFrame, CoefficientMatrix, Damping};
pub use fin::{FINS, Fin, FinAxes};
pub use restoring::Restoring;
pub use tether::Tether;
pub use thruster::{Branch, LagDecay, THRUSTERS, ThrustCourse, Thruster, ThrusterDynamics, Thrusts, thrust_wrench};
