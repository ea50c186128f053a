//! Formulas in words, and the TOML table of a body.

use toml::Value;

use super::body::{added_mass_formula, drag_formula};
use super::solid::Solid;
use super::{Estimate, Outline};

/// Joins texts without duplicates.
fn distinct<'a>(texts: impl Iterator<Item = &'a str>) -> String {
    let mut list: Vec<&str> = Vec::new();
    texts.for_each(|text| {
        if !list.contains(&text) {
            list.push(text)
        }
    });
    list.join("; ")
}

impl Outline {
    pub(super) fn formulas(&self, solids: &[Solid]) -> Vec<(&'static str, String)> {
        let several = solids.len() > 1;
        let shapes = || self.shapes.iter().zip(solids);
        let sum = if several { "sum over shapes: " } else { "" };
        let volume = distinct(shapes().map(|(_, solid)| match solid {
            Solid::Box(_) => "x y z",
            Solid::Cylinder(_) => "pi r^2 l",
            Solid::Capsule(_) => "pi r^2 (l + 4/3 r)",
            Solid::Ellipsoid(_) => "4/3 pi a b c",
        }));
        let mass = distinct(shapes().map(|(shape, _)| match (shape.mass, shape.relative_density) {
            (Some(_), _) => "as given",
            (None, Some(_)) => "relative density times displaced water",
            (None, None) => "displaced water (neutral)",
        }));
        let part = if self.shapes.iter().any(|s| s.displaced.is_some()) { " times displaced fraction" } else { "" };
        let open = self.shapes.iter().any(|s| s.perforation != [0.0; 3]);
        let open = if open { ", times the factor of perforation (DNV-RP-H103 4.6.4)" } else { "" };
        let closed = self.shapes.iter().any(|s| s.solidities() != [1.0; 3]);
        let closed = if closed { ", times solidity" } else { "" };
        let added_mass = distinct(shapes().map(|(shape, solid)| added_mass_formula(solid, shape.ends)));
        let drag = distinct(shapes().map(|(shape, solid)| drag_formula(solid, shape.ends)));
        let [speed, rate] = self.speed;
        let axes = if several { "; moved to the origin by parallel axes" } else { "" };
        let columns = if several { "; about the origin, exact along each single axis" } else { "" };
        vec![
            ("mass", format!("{sum}{mass}")),
            ("center_of_mass", "centre of homogeneous shapes".to_owned()),
            (
                "inertia",
                format!(
                    "homogeneous shapes about the centre of mass{}",
                    if several { ", by parallel axes" } else { "" }
                ),
            ),
            ("volume", format!("{sum}{volume}{part}")),
            ("center_of_buoyancy", "centre of the displaced volume".to_owned()),
            (
                "hydrodynamic_frame",
                if several { "the body's origin" } else { "the shape's centre and axes" }.to_owned(),
            ),
            ("added_mass", format!("{sum}{added_mass}{open}{axes}")),
            ("damping.quadratic", format!("{sum}{drag}{closed}{columns}")),
            ("damping.linear", format!("equal to the quadratic damping at {speed} m/s and {rate} rad/s")),
        ]
    }
}

/// TOML value in one line, or one line per row of a matrix.
fn written(value: &Value) -> String {
    match value {
        Value::Array(rows) if rows.iter().all(Value::is_array) => {
            let rows: Vec<_> = rows.iter().map(|row| format!("  {row},\n")).collect();
            format!("[\n{}]", rows.concat())
        }
        other => other.to_string(),
    }
}

impl Estimate {
    /// The body as the TOML table `table` (example: `vehicle.body`), with formulas in comments and as entries of `[provenance]`.
    pub fn to_toml(&self, table: &str) -> String {
        let tree = Value::try_from(&self.body).expect("a body is plain data");
        let mut text = format!("[{table}]\n");
        for (key, formula) in &self.formulas {
            let value = key.split('.').try_fold(&tree, |node, step| node.get(step));
            let Some(value) = value else { continue };
            text += &format!("# derived: {formula}\n{key} = {}\n", written(value));
        }
        text += "\n[provenance]\n";
        for (key, formula) in &self.formulas {
            text += &format!("\"{table}.{key}\" = \"derived: {formula}\"\n");
        }
        text
    }
}
