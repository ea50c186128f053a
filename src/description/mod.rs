//! Scenes as plain data: what a user writes, in SI units, before anything is computed from it.
//!
//! Axes are REP-103: body x forward, y left, z up; world z up. Every 6-vector and 6x6 matrix is ordered
//! `[linear; angular]`.

mod actuator;
mod appendages;
mod arm;
mod body;
mod check;
mod check_body;
mod derived;
mod doubts;
pub(crate) mod numbers;
mod path;
mod provenance;
mod read;
mod scene;
mod shape;
mod thrust_map;
mod vehicle;

pub use actuator::LinearActuator;
pub use appendages::{Fin, Tether};
pub use arm::{Arm, Friction, Joint, JointKind, JointLimits, JointServo, Link, Mount};
pub use body::{Body, Damping, Frame, InertiaPoint};
use check::Fault;
pub use check::Warning;
pub use derived::{BASE, MAX_LINKS, VEHICLE};
pub use doubts::Doubt;
pub use provenance::{Number, Origin, Provenance};
pub use read::{parse_toml, read_value};
pub use scene::{Payload, Scene, Water};
pub use shape::{Shape, ShapeKind};
pub use thrust_map::ThrustMap;
pub use vehicle::{Thruster, Vehicle, VehicleServo};
