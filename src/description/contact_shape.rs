//! Shapes that spheres on the robot touch, and their keys.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{Frame, WORLD};
use crate::keys::{Fault, numbers, range};

/// A solid shape that spheres touch. Numbers of the law that it does not state are those of [`Contact`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ShapeTable", into = "ShapeTable")]
pub struct ContactShape {
    /// Name, unique among the shapes.
    pub name: String,
    /// `world` or a fixture, which moves the shape.
    pub on: String,
    /// Frame of the shape, in the world or in the fixture's frame.
    pub frame: Frame,
    /// Kind and dimensions.
    pub geometry: ContactGeometry,
    /// Stiffness, N/m.
    pub stiffness: Option<f64>,
    /// Dissipation, s/m.
    pub dissipation: Option<f64>,
    /// Ramp, m.
    pub ramp: Option<f64>,
    /// Coefficient of friction.
    pub friction: Option<f64>,
    /// Slip speed, m/s.
    pub slip_speed: Option<f64>,
    /// Red, green and blue in pictures, 0 to 1.
    pub colour: Option<[f64; 3]>,
}

/// Prefix of the names of the shapes of a dock.
pub const DOCK: &str = "dock";

/// Kind and dimensions of a shape, about the origin of its frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ContactGeometry {
    /// The half-space below z = 0.
    Plane,
    /// A box.
    Box {
        /// Full lengths along x, y and z, m.
        size: Vector3<f64>,
    },
    /// A cylinder about the z axis, with flat ends.
    Cylinder {
        /// Radius, m.
        radius: f64,
        /// Length along z, m.
        length: f64,
    },
    /// A torus about the z axis: the rim of a wheel.
    Torus {
        /// Radius of the circle in the xy plane, m.
        radius: f64,
        /// Radius of the tube about this circle, m.
        tube: f64,
    },
}

/// A shape as scenes state it: keys of its kind beside the others.
#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ShapeTable {
    name: String,
    #[serde(default = "world")]
    on: String,
    kind: ShapeKey,
    #[serde(default)]
    frame: Frame,
    #[serde(default, with = "numbers::optional_vector3", skip_serializing_if = "Option::is_none")]
    size: Option<Vector3<f64>>,
    radius: Option<f64>,
    length: Option<f64>,
    tube: Option<f64>,
    stiffness: Option<f64>,
    dissipation: Option<f64>,
    ramp: Option<f64>,
    friction: Option<f64>,
    slip_speed: Option<f64>,
    #[serde(default, deserialize_with = "numbers::optional_array", skip_serializing_if = "Option::is_none")]
    colour: Option<[f64; 3]>,
}

#[derive(Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum ShapeKey {
    Plane,
    Box,
    Cylinder,
    Torus,
}

fn world() -> String {
    WORLD.to_owned()
}

impl TryFrom<ShapeTable> for ContactShape {
    type Error = String;

    fn try_from(table: ShapeTable) -> Result<Self, String> {
        let ShapeTable { size, radius, length, tube, .. } = table;
        // In the words of serde, which the error of the key is made from.
        let stated = [
            ("size", size.is_some()),
            ("radius", radius.is_some()),
            ("length", length.is_some()),
            ("tube", tube.is_some()),
        ];
        let only = |keys: &[&str]| match stated.iter().find(|(key, stated)| *stated && !keys.contains(key)) {
            Some((key, _)) if keys.is_empty() => {
                Err(format!("unknown field `{key}`, expected no dimension of a plane"))
            }
            Some((key, _)) => Err(format!("unknown field `{key}`, expected {} of this kind", keys.join(" and "))),
            None => Ok(()),
        };
        let number = |key: &str, value: Option<f64>| value.ok_or_else(|| format!("missing field `{key}`"));
        let geometry = match table.kind {
            ShapeKey::Plane => only(&[]).map(|()| ContactGeometry::Plane)?,
            ShapeKey::Box => {
                only(&["size"])?;
                ContactGeometry::Box { size: size.ok_or("missing field `size`")? }
            }
            ShapeKey::Cylinder => {
                only(&["radius", "length"])?;
                ContactGeometry::Cylinder { radius: number("radius", radius)?, length: number("length", length)? }
            }
            ShapeKey::Torus => {
                only(&["radius", "tube"])?;
                ContactGeometry::Torus { radius: number("radius", radius)?, tube: number("tube", tube)? }
            }
        };
        let ShapeTable { name, on, frame, stiffness, dissipation, ramp, friction, slip_speed, colour, .. } = table;
        Ok(Self { name, on, frame, geometry, stiffness, dissipation, ramp, friction, slip_speed, colour })
    }
}

impl From<ContactShape> for ShapeTable {
    fn from(shape: ContactShape) -> Self {
        let (kind, size, radius, length, tube) = match shape.geometry {
            ContactGeometry::Plane => (ShapeKey::Plane, None, None, None, None),
            ContactGeometry::Box { size } => (ShapeKey::Box, Some(size), None, None, None),
            ContactGeometry::Cylinder { radius, length } => {
                (ShapeKey::Cylinder, None, Some(radius), Some(length), None)
            }
            ContactGeometry::Torus { radius, tube } => (ShapeKey::Torus, None, Some(radius), None, Some(tube)),
        };
        let ContactShape { name, on, frame, stiffness, dissipation, ramp, friction, slip_speed, colour, .. } = shape;
        Self {
            name,
            on,
            kind,
            frame,
            size,
            radius,
            length,
            tube,
            stiffness,
            dissipation,
            ramp,
            friction,
            slip_speed,
            colour,
        }
    }
}

impl ContactGeometry {
    /// Distance of a point, in the shape's frame, from the surface, m; negative inside.
    pub fn distance(&self, point: &Vector3<f64>) -> f64 {
        // Of a point that lies beyond these distances from the faces at right angles to each other.
        let beyond = |q: Vector3<f64>| q.sup(&Vector3::zeros()).norm() + q.max().min(0.0);
        let (across, along) = (point.x.hypot(point.y), point.z);
        match *self {
            Self::Plane => along,
            Self::Box { size } => beyond(point.abs() - size / 2.0),
            Self::Cylinder { radius, length } => {
                let [side, end] = [across - radius, along.abs() - length / 2.0];
                beyond(Vector3::new(side, end, f64::NEG_INFINITY))
            }
            Self::Torus { radius, tube } => (across - radius).hypot(along) - tube,
        }
    }
}

impl ContactShape {
    /// Checks kind, dimensions and colour; `key` is the path of the shape.
    pub(super) fn check_dimensions(&self, key: &str) -> Result<(), Fault> {
        for (i, colour) in self.colour.iter().flatten().enumerate() {
            range((0.0..=1.0).contains(colour), *colour, "0 to 1", || format!("{key}.colour[{i}]"))?;
        }
        let check = |name: &str, value: f64| range(value > 0.0, value, "> 0", || format!("{key}.{name}"));
        match self.geometry {
            ContactGeometry::Plane => Ok(()),
            ContactGeometry::Box { size } => {
                size.iter().enumerate().try_for_each(|(i, length)| check(&format!("size[{i}]"), *length))
            }
            ContactGeometry::Cylinder { radius, length } => check("radius", radius).and(check("length", length)),
            ContactGeometry::Torus { radius, tube } => {
                check("radius", radius).and(check("tube", tube))?;
                range(tube < radius, tube, "less than radius: the tube would fill the hole", || format!("{key}.tube"))
            }
        }
    }
}
