//! A robot as its file describes it, in one form for all formats: links, joints and thrusters as plain data.
//!
//! Axes are REP-103: x forward, y left, z up. Each format has a reader into this form; [`super::Assembly`] makes a scene of it.

use nalgebra::{Matrix3, Matrix6, Vector3};
use serde::{Deserialize, Serialize};

use crate::description::{Fin, Frame, MeshFile, ThrustMap};
use crate::error::DescriptionError;
use crate::estimate::Shape;
use crate::keys::numbers;

/// Maximum number of links or joints that a message names.
const NAMED: usize = 24;

/// A robot of any format.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Robot {
    /// Name that the file states; may be empty.
    pub name: String,
    /// The file, for errors and provenance.
    pub source: String,
    /// "URDF", "SDF" or "MJCF".
    pub format: String,
    /// Readings that differ from the file, one sentence each, beginning with the link, joint or element.
    pub notes: Vec<String>,
    /// Links, in any order.
    pub links: Vec<RobotLink>,
    /// Joints, in any order.
    pub joints: Vec<RobotJoint>,
    /// Thrusters, in the order of thrust arrays.
    pub thrusters: Vec<RobotThruster>,
    /// Fins, in the order of fin arrays.
    pub fins: Vec<RobotFin>,
    /// Density of the water, kg/m3, if the file states it.
    pub fluid_density: Option<f64>,
}

/// A rigid body.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RobotLink {
    /// Name, unique among links.
    pub name: String,
    /// Line in the file; 0 if unknown.
    pub line: u32,
    /// Rigid body; absent for a mere frame.
    pub inertial: Option<Inertial>,
    /// Primitives of the collision geometry, else of the visual geometry.
    pub shapes: Vec<Shape>,
    /// Meshes of collision and visual geometry.
    pub meshes: Vec<Mesh>,
    /// Hydrodynamics that the file states.
    pub water: Option<InWater>,
}

/// Inertial properties in the link frame.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Inertial {
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass, m.
    #[serde(default, with = "numbers::vector3")]
    pub position: Vector3<f64>,
    /// Axes of `inertia`: roll, pitch, yaw, rad.
    #[serde(default, with = "numbers::vector3")]
    pub rpy: Vector3<f64>,
    /// About the centre of mass, kg m2: `[xx, yy, zz]`, `[xx, xy, xz, yy, yz, zz]` or three rows of three; 0 for a point mass.
    #[serde(default, with = "numbers::inertia")]
    pub inertia: Matrix3<f64>,
}

/// A mesh, with the measures that a reader of meshes adds.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mesh {
    /// File as the document names it.
    pub file: String,
    /// Factors on the mesh's coordinates.
    #[serde(default = "ones", with = "numbers::vector3")]
    pub scale: Vector3<f64>,
    /// Origin of the mesh in the link frame, m.
    #[serde(default, with = "numbers::vector3")]
    pub position: Vector3<f64>,
    /// Axes of the mesh in the link frame: roll, pitch, yaw, rad.
    #[serde(default, with = "numbers::vector3")]
    pub rpy: Vector3<f64>,
    /// True for visual, false for collision geometry.
    #[serde(default)]
    pub visual: bool,
    /// Enclosed volume after scaling, m3; absent if it was not measured.
    pub volume: Option<f64>,
    /// Centre of the volume in the mesh's axes, m.
    #[serde(default, with = "numbers::optional_vector3")]
    pub center: Option<Vector3<f64>>,
    /// Moments of inertia of the volume at density 1 about `center`, mesh axes, m5.
    pub inertia: Option<MeshInertia>,
    /// Box around the mesh: lower corner in the mesh's axes, m.
    #[serde(default, with = "numbers::optional_vector3")]
    pub lower: Option<Vector3<f64>>,
    /// Box around the mesh: upper corner in the mesh's axes, m.
    #[serde(default, with = "numbers::optional_vector3")]
    pub upper: Option<Vector3<f64>>,
    /// The file as it is found, in the link frame, where it draws the link.
    pub drawing: Option<MeshFile>,
}

/// Moments of inertia in any form of a scene's `inertia`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct MeshInertia(#[serde(with = "numbers::inertia")] pub Matrix3<f64>);

/// Hydrodynamics of a link that its file states: in the link frame, with the signs and units of a scene's body.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct InWater {
    /// Added mass: six diagonal numbers or six rows of six.
    #[serde(with = "numbers::matrix6")]
    pub added_mass: Matrix6<f64>,
    /// Linear damping.
    #[serde(with = "numbers::matrix6")]
    pub linear: Matrix6<f64>,
    /// Quadratic damping.
    #[serde(with = "numbers::matrix6")]
    pub quadratic: Matrix6<f64>,
    /// Damping by forward speed, as of a scene's `vehicle.forward_damping`.
    #[serde(with = "numbers::matrix6")]
    pub linear_forward_speed: Matrix6<f64>,
    /// Displaced volume, m3.
    pub volume: Option<f64>,
    /// Buoyancy, N, instead of the volume.
    pub buoyancy: Option<f64>,
    /// Centre of buoyancy, m.
    #[serde(with = "numbers::vector3")]
    pub center_of_buoyancy: Vector3<f64>,
    /// True where the file sets the buoyancy equal to the weight.
    pub neutral: bool,
    /// Frame of added mass and damping in the link frame.
    pub frame: Frame,
}

/// Kind of joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RobotJointKind {
    /// No motion.
    #[default]
    Fixed,
    /// Rotation within limits.
    Revolute,
    /// Rotation without limits.
    Continuous,
    /// Translation within limits.
    Prismatic,
    /// Six degrees of freedom: the child is a vehicle.
    Floating,
}

/// A joint between two links.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RobotJoint {
    /// Name, unique among joints.
    pub name: String,
    /// Line in the file; 0 if unknown.
    pub line: u32,
    /// Motion.
    pub kind: RobotJointKind,
    /// Name of the link that carries the other one.
    pub parent: String,
    /// Name of the link that is carried.
    pub child: String,
    /// Child frame in the parent frame at coordinate 0: position, m.
    #[serde(with = "numbers::vector3")]
    pub position: Vector3<f64>,
    /// Child frame in the parent frame: roll, pitch, yaw, rad.
    #[serde(with = "numbers::vector3")]
    pub rpy: Vector3<f64>,
    /// Axis in the child frame; of any length.
    #[serde(with = "numbers::vector3")]
    pub axis: Vector3<f64>,
    /// Lower and upper limit, rad or m.
    #[serde(deserialize_with = "numbers::optional_array")]
    pub limits: Option<[f64; 2]>,
    /// Maximum torque or force, N m or N.
    pub effort: Option<f64>,
    /// Maximum speed, rad/s or m/s.
    pub speed: Option<f64>,
    /// Viscous friction, N m s/rad or N s/m.
    pub damping: f64,
    /// Coulomb friction, N m or N.
    pub friction: f64,
    /// Reflected inertia of the rotor, kg m2 or kg.
    pub armature: f64,
    /// Stiffness of a spring, N m/rad or N/m.
    pub stiffness: f64,
    /// Coordinate at which the spring rests, rad or m.
    pub spring_rest: f64,
    /// Coordinate as a function of another joint's.
    pub mimic: Option<Mimic>,
}

/// `q = multiplier q_joint + offset`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mimic {
    /// Name of the other joint.
    pub joint: String,
    /// Factor on its coordinate.
    #[serde(default = "one")]
    pub multiplier: f64,
    /// Coordinate where the other one is 0, rad or m.
    #[serde(default)]
    pub offset: f64,
}

/// A thruster: a force along an axis at a point of a link.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RobotThruster {
    /// Name, unique among thrusters.
    pub name: String,
    /// Line in the file; 0 if unknown.
    pub line: u32,
    /// Link that carries it: the propeller's or the hull. Absent where `joint` is stated.
    pub link: Option<String>,
    /// The propeller's joint, whose child carries the thruster and which is no joint of an arm.
    pub joint: Option<String>,
    /// Position in the link frame, m.
    #[serde(with = "numbers::vector3")]
    pub position: Vector3<f64>,
    /// Direction of the force at positive thrust in the link frame; 0 stands for the joint's axis.
    #[serde(with = "numbers::vector3")]
    pub axis: Vector3<f64>,
    /// Minimum and maximum thrust, N.
    #[serde(deserialize_with = "numbers::optional_array")]
    pub limits: Option<[f64; 2]>,
    /// Time constant, s.
    pub lag: Option<f64>,
    /// Dead band, N.
    pub dead_band: Option<f64>,
    /// Static map from command to thrust.
    pub map: Option<ThrustMap>,
}

/// A fin on a link of its own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotFin {
    /// Link that is the fin.
    pub link: String,
    /// Joint that deflects it, which is no joint of an arm; none of a fixed fin.
    pub joint: Option<String>,
    /// The fin in the link frame, without limits.
    pub fin: Fin,
}

fn one() -> f64 {
    1.0
}

fn ones() -> Vector3<f64> {
    Vector3::repeat(1.0)
}

/// The first names of a list, separated by commas.
pub fn listed<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    let mut names = names.into_iter();
    let first: Vec<_> = names.by_ref().take(NAMED).collect();
    let rest = names.count();
    first.join(", ") + &if rest > 0 { format!(" and {rest} more") } else { String::new() }
}

impl Inertial {
    /// Frame of the centre of mass and of the axes of the moments.
    pub fn frame(&self) -> Frame {
        Frame { position: self.position, rpy: self.rpy }
    }
}

impl RobotJoint {
    /// Child frame in the parent frame at coordinate 0.
    pub fn frame(&self) -> Frame {
        Frame { position: self.position, rpy: self.rpy }
    }

    /// True unless it is fixed.
    pub fn moves(&self) -> bool {
        self.kind != RobotJointKind::Fixed
    }
}

impl Robot {
    /// Name of the file without its folder.
    pub(super) fn file_name(&self) -> String {
        let name = std::path::Path::new(&self.source).file_name();
        name.map_or_else(|| self.source.clone(), |name| name.to_string_lossy().into_owned())
    }

    /// An error of the robot as a whole.
    pub(super) fn refuse<T>(&self, problem: impl Into<String>) -> Result<T, DescriptionError> {
        self.fault(0, if self.format == "URDF" { "<robot>" } else { "the robot" }, problem)
    }

    /// An error at a line of the file; no line is named if it is 0.
    pub(super) fn fault<T>(&self, line: u32, place: &str, problem: impl Into<String>) -> Result<T, DescriptionError> {
        Err(self.error(line, place, problem))
    }

    /// An error at a line of the file; no line is named if it is 0.
    pub fn error(&self, line: u32, place: impl Into<String>, problem: impl Into<String>) -> DescriptionError {
        super::element::error(&self.source, line, &place.into(), problem)
    }
}
