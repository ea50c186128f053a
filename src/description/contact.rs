//! Contact: spheres on the robot, shapes in the world or on fixtures, and the numbers of the law between them.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{ContactShape, Scene, WORLD};
use crate::error::Problem;
use crate::keys::{Fault, check_names, check_not_negative, none_of, numbers, range};

/// Maximum number of spheres, and of shapes.
const MAX_ELEMENTS: usize = 64;

/// Spheres on the robot and shapes that they touch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Contact {
    /// Stiffness k, N/m.
    pub stiffness: f64,
    /// Dissipation d, s/m: the normal force is the elastic force times `1 + d v` at the rate v of penetration, and never pulls.
    pub dissipation: f64,
    /// Penetration e over which the stiffness rises from 0, m.
    pub ramp: f64,
    /// Coefficient mu of Coulomb friction.
    pub friction: f64,
    /// Slip speed v_s over which friction is smoothed, m/s.
    pub slip_speed: f64,
    /// Spheres on the robot.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub spheres: Vec<Sphere>,
    /// Shapes in the world and on fixtures.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub shapes: Vec<ContactShape>,
}

impl Default for Contact {
    fn default() -> Self {
        Self {
            stiffness: 5000.0,
            dissipation: 2.0,
            ramp: 0.0005,
            friction: 0.4,
            slip_speed: 0.003,
            spheres: Vec::new(),
            shapes: Vec::new(),
        }
    }
}

/// A sphere on a body of the robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sphere {
    /// Name, unique among the spheres.
    pub name: String,
    /// Body that carries it: `vehicle`, `base` or a link.
    pub on: String,
    /// Centre in the frame of this body, m.
    #[serde(with = "numbers::vector3")]
    pub position: Vector3<f64>,
    /// Radius, m.
    pub radius: f64,
}

/// Numbers of the law of contact with one shape, as in [`Contact`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactLaw {
    /// Stiffness k, N/m.
    pub stiffness: f64,
    /// Dissipation d, s/m.
    pub dissipation: f64,
    /// Ramp e, m.
    pub ramp: f64,
    /// Coefficient of friction mu.
    pub friction: f64,
    /// Slip speed v_s, m/s.
    pub slip_speed: f64,
}

impl Contact {
    /// Numbers of the law of contact with a shape.
    pub fn law(&self, shape: &ContactShape) -> ContactLaw {
        ContactLaw {
            stiffness: shape.stiffness.unwrap_or(self.stiffness),
            dissipation: shape.dissipation.unwrap_or(self.dissipation),
            ramp: shape.ramp.unwrap_or(self.ramp),
            friction: shape.friction.unwrap_or(self.friction),
            slip_speed: shape.slip_speed.unwrap_or(self.slip_speed),
        }
    }

    /// Numbers of the law of a shape that states none.
    fn common_law(&self) -> ContactLaw {
        let Self { stiffness, dissipation, ramp, friction, slip_speed, .. } = *self;
        ContactLaw { stiffness, dissipation, ramp, friction, slip_speed }
    }
}

impl ContactLaw {
    /// Checks the numbers; `key` is the path of their table.
    fn check(&self, key: &str) -> Result<(), Fault> {
        for (name, value) in [("stiffness", self.stiffness), ("ramp", self.ramp)] {
            range(value > 0.0, value, "> 0", || format!("{key}.{name}"))?;
        }
        let (friction, slip_speed) = (self.friction, self.slip_speed);
        check_not_negative(
            key,
            [("dissipation", self.dissipation), ("friction", friction), ("slip_speed", slip_speed)],
        )?;
        let rule = "> 0 where there is friction";
        range(slip_speed > 0.0 || friction == 0.0, slip_speed, rule, || format!("{key}.slip_speed"))
    }
}

impl Scene {
    /// Checks spheres, shapes and the numbers of the law.
    pub(super) fn validate_contact(&self) -> Result<(), Fault> {
        let Some(contact) = &self.contact else { return Ok(()) };
        let (spheres, shapes) = (&contact.spheres, &contact.shapes);
        for (key, found) in [("contact.spheres", spheres.len()), ("contact.shapes", shapes.len())] {
            if found > MAX_ELEMENTS {
                return Err(Fault::new(key, Problem::TooMany { found, max: MAX_ELEMENTS }));
            }
        }
        contact.common_law().check("contact")?;
        check_names(spheres.iter().map(|sphere| sphere.name.as_str()), &[], "contact.spheres")?;
        check_names(shapes.iter().map(|shape| shape.name.as_str()), &[], "contact.shapes")?;
        let fixtures: Vec<&str> = self.fixtures.iter().map(|fixture| fixture.name.as_str()).collect();
        for (i, sphere) in spheres.iter().enumerate() {
            let key = format!("contact.spheres[{i}]");
            self.check_robot_body(&sphere.on, &format!("{key}.on"))?;
            range(sphere.radius > 0.0, sphere.radius, "> 0", || format!("{key}.radius"))?;
        }
        for (i, shape) in shapes.iter().enumerate() {
            let key = format!("contact.shapes[{i}]");
            if shape.on != WORLD && !fixtures.contains(&shape.on.as_str()) {
                return Err(none_of(
                    &shape.on,
                    "bodies that carry shapes",
                    [WORLD].into_iter().chain(fixtures),
                    format!("{key}.on"),
                ));
            }
            shape.check_dimensions(&key)?;
            contact.law(shape).check(&key)?;
        }
        Ok(())
    }
}
