//! Scenes as plain data in SI units, as users state them.
//!
//! Axes are REP-103: body x forward, y left, z up; world z up. 6-vectors and 6x6 matrices are ordered `[linear; angular]`. Tables in
//! Fossen's axes are converted on reading (`axes.rs`).

mod actuator;
mod arm;
mod attach;
mod axes;
mod body;
mod check;
mod check_body;
mod compose;
mod contact;
mod contact_shape;
mod contact_start;
mod derived;
mod editor;
mod end_effector;
mod fault;
mod fixture;
mod frame;
mod integration;
mod mesh_file;
mod part;
mod part_sources;
mod part_spheres;
pub mod path;
mod provenance;
mod read;
mod scene;
mod scene_numbers;
mod shape;
mod shipped;
mod thrust_map;
mod thrust_table;
mod vehicle;
mod vehicle_terms;
mod warnings;

pub use actuator::LinearActuator;
pub use arm::{Arm, Detent, Friction, Joint, JointKind, JointLimits, JointServo, JointSpring, Link, Mount, Parent};
pub use body::{Body, Damping, InertiaPoint};
pub use contact::{Contact, ContactLaw, Sphere};
pub use contact_shape::{ContactGeometry, ContactShape, DOCK};
pub use derived::{BASE, MAX_JOINTS, MAX_LINKS, VEHICLE, WORLD};
pub use editor::SceneEditor;
pub use end_effector::{DEFAULT_END_EFFECTOR, EndEffectorFrame};
pub use fixture::Fixture;
pub use frame::Frame;
pub use integration::Integration;
pub use mesh_file::MeshFile;
pub use provenance::{Origin, Provenance};
pub use read::{file_value, parse_toml, read_file, read_value};
pub use scene::{Payload, Scene, Water};
pub use scene_numbers::Number;
pub use shape::{Shape, ShapeKind};
pub use thrust_map::ThrustMap;
pub use thrust_table::ThrustTable;
pub use vehicle::{Thruster, VOLTAGE, Vehicle, VehicleServo};
pub use warnings::SceneWarning;

pub use crate::terms::tables::*;
