//! Outline of a body: its shapes, as users state them.

use std::path::Path;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::solid::{Ends, Round, Solid};
use crate::description::{Frame, parse_toml, read_file, read_value};
use crate::error::{DescriptionError, Problem};
use crate::keys::numbers;

/// Shapes of a body, and the water.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Outline {
    /// Density of the water, kg/m3.
    #[serde(default = "fresh_water")]
    pub density: f64,
    /// Speed, m/s, and rate, rad/s, at which linear damping equals quadratic damping.
    #[serde(default = "slow", deserialize_with = "numbers::array")]
    pub speed: [f64; 2],
    /// Shapes, without overlap; their volumes and coefficients are summed.
    pub shapes: Vec<Shape>,
}

fn range(key: &str, value: f64, rule: &'static str) -> Option<(String, Problem)> {
    Some((key.to_owned(), Problem::Range { value, rule }))
}

fn fresh_water() -> f64 {
    1000.0
}

fn slow() -> [f64; 2] {
    [0.1, 0.3]
}

/// A shape: exactly one of `box`, `cylinder`, `capsule`, `ellipsoid`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Shape {
    /// Name of the shape in errors.
    pub name: String,
    /// Edges along x, y, z, m.
    #[serde(rename = "box", with = "numbers::optional_vector3")]
    pub cuboid: Option<Vector3<f64>>,
    /// A cylinder with flat ends.
    pub cylinder: Option<Round>,
    /// A cylinder between hemispheres.
    pub capsule: Option<Round>,
    /// Semi-axes along x, y, z, m.
    #[serde(with = "numbers::optional_vector3")]
    pub ellipsoid: Option<Vector3<f64>>,
    /// Centre in the body frame, m.
    #[serde(with = "numbers::vector3")]
    pub position: Vector3<f64>,
    /// Roll, pitch, yaw of the shape's axes in the body frame, rad.
    #[serde(with = "numbers::vector3")]
    pub rpy: Vector3<f64>,
    /// Ends of a box or cylinder: free, or joined to the next part.
    pub ends: Ends,
    /// Open fraction of the faces across x, y, z (or of all), 0 to 0.5, the range of the published reduction of added mass.
    #[serde(deserialize_with = "numbers::axes")]
    pub perforation: [f64; 3],
    /// Ratio of the damping to the damping of the closed shape, per axis or for all; default: the closed fraction of the faces.
    #[serde(deserialize_with = "numbers::optional_axes")]
    pub solidity: Option<[f64; 3]>,
    /// Displaced fraction of the envelope, 0 to 1; default 1.
    pub displaced: Option<f64>,
    /// Mass, kg, homogeneous in the envelope; default: from `relative_density`.
    pub mass: Option<f64>,
    /// Ratio of the mass to the mass of the displaced water; default 1, unless `mass` is given.
    pub relative_density: Option<f64>,
}

impl Shape {
    /// The solid; None unless exactly one is given.
    pub(crate) fn solid(&self) -> Option<Solid> {
        match (self.cuboid, self.cylinder, self.capsule, self.ellipsoid) {
            (Some(size), None, None, None) => Some(Solid::Box(size)),
            (None, Some(cylinder), None, None) => Some(Solid::Cylinder(cylinder)),
            (None, None, Some(capsule), None) => Some(Solid::Capsule(capsule)),
            (None, None, None, Some(semi_axes)) => Some(Solid::Ellipsoid(semi_axes)),
            _ => None,
        }
    }

    pub(super) fn frame(&self) -> Frame {
        Frame { position: self.position, rpy: self.rpy }
    }

    pub(super) fn solidities(&self) -> [f64; 3] {
        self.solidity.unwrap_or(self.perforation.map(|open| 1.0 - open))
    }

    pub(crate) fn displaced_volume(&self, solid: &Solid) -> f64 {
        solid.volume() * self.displaced.unwrap_or(1.0)
    }

    /// Key and problem of the first invalid number.
    pub(crate) fn faults(&self) -> Option<(String, Problem)> {
        let lengths = [("box", self.cuboid), ("ellipsoid", self.ellipsoid)].into_iter();
        let lengths = lengths.flat_map(|(key, v)| v.into_iter().flat_map(move |v| v.data.0[0]).map(move |x| (key, x)));
        let round = [("cylinder", &self.cylinder), ("capsule", &self.capsule)].into_iter();
        let round = round.flat_map(|(key, r)| r.iter().flat_map(move |r| [(key, r.radius), (key, r.length)]));
        if let Some((key, value)) = lengths.chain(round).find(|(_, x)| !(1e-6..=1e6).contains(x)) {
            return range(key, value, "between 1e-6 and 1e6 m");
        }
        if let Some(&open) = self.perforation.iter().find(|open| !(0.0..=0.5).contains(*open)) {
            return range("perforation", open, "between 0 and 0.5: describe more open bodies by their parts");
        }
        if let Some(&closed) = self.solidity.iter().flatten().find(|closed| !(0.0..=10.0).contains(*closed)) {
            return range("solidity", closed, "between 0 and 10");
        }
        if let Some(part) = self.displaced.filter(|part| !(0.0..=1.0).contains(part)) {
            return range("displaced", part, "between 0 and 1");
        }
        if let (Some(mass), Some(_)) = (self.mass, self.relative_density) {
            let (reason, value) = ("give mass or relative_density, not both".to_owned(), mass.to_string());
            return Some(("mass".to_owned(), Problem::Form { reason, value }));
        }
        for (key, value) in [("mass", self.mass), ("relative_density", self.relative_density)] {
            if let Some(value) = value.filter(|x| *x <= 0.0) {
                return range(key, value, "> 0");
            }
        }
        if self.mass.is_none() && self.displaced == Some(0.0) {
            return Some(("mass".to_owned(), Problem::Missing));
        }
        None
    }
}

impl Outline {
    /// Reads and checks a tree of values; `source_name` appears in errors.
    ///
    /// # Errors
    /// [`DescriptionError::Value`] names source, key and value of the first problem.
    pub fn from_value(value: toml::Value, source_name: &str) -> Result<Self, DescriptionError> {
        let outline: Self = read_value(value, source_name)?;
        match outline.faults() {
            None => Ok(outline),
            Some((key, problem)) => Err(DescriptionError::Value { source_name: source_name.to_owned(), key, problem }),
        }
    }

    /// Reads and checks TOML text.
    ///
    /// # Errors
    /// Text that is not TOML, by line and column, or as [`Outline::from_value`].
    pub fn from_toml_str(text: &str, source_name: &str) -> Result<Self, DescriptionError> {
        Self::from_value(parse_toml(text, source_name)?, source_name)
    }

    /// Reads and checks a TOML file.
    ///
    /// # Errors
    /// A file that cannot be read, or as [`Outline::from_toml_str`].
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self, DescriptionError> {
        let (text, source_name) = read_file(path.as_ref())?;
        Self::from_toml_str(&text, &source_name)
    }

    fn faults(&self) -> Option<(String, Problem)> {
        if self.density <= 0.0 {
            return range("density", self.density, "> 0");
        }
        if let Some(speed) = self.speed.into_iter().find(|speed| *speed < 0.0) {
            return range("speed", speed, ">= 0");
        }
        if self.shapes.is_empty() {
            return Some(("shapes".to_owned(), Problem::Missing));
        }
        self.shapes.iter().enumerate().find_map(|(i, shape)| {
            let key = format!("shapes[{i}]");
            if shape.solid().is_none() {
                let reason = "expected exactly one of box, cylinder, capsule, ellipsoid".to_owned();
                return Some((key, Problem::Form { reason, value: format!("'{}'", shape.name) }));
            }
            shape.faults().map(|(below, problem)| (format!("{key}.{below}"), problem))
        })
    }
}
