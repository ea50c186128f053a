//! The body of a moving part: rigid, with the hydrodynamics that the file states or that its outline suggests.

use nalgebra::{Matrix3, Vector3};

use super::element::Result;
use super::merge::{Part, compose, rigid};
use super::outline::outline;
use super::tree::Tree;
use super::water::Blocks;
use super::{InWater, Inertial};
use crate::description::{Body, ForwardDamping, Frame};
use crate::estimate::{Ends, Estimate, Outline, Shape};

/// Speed, m/s, and rate, rad/s, at which linear damping equals quadratic damping, as in the shipped scenes.
const SPEED: [f64; 2] = [0.1, 0.5];

/// A body, and what its numbers come from.
#[derive(Default)]
pub struct Built {
    pub body: Body,
    /// Texts of provenance by keys of the body.
    pub origins: Vec<(&'static str, String)>,
    /// Damping by forward speed, of a hull.
    pub forward: Option<ForwardDamping>,
    /// True if the file states how much water it displaces.
    pub displaces: bool,
    /// Shapes of the outline in the part's frame.
    pub shapes: Vec<Shape>,
}

/// Shapes of all links of a part, in its frame.
fn shapes(tree: &Tree, part: &Part, inertials: &[Option<Inertial>], notes: &mut Vec<String>) -> Vec<Shape> {
    let mut all = Vec::new();
    let mass = part.links.iter().filter_map(|(link, _)| Some(inertials[*link].as_ref()?.mass)).sum();
    for (link, at) in &part.links {
        for shape in outline(&tree.robot.links[*link], inertials[*link].as_ref(), mass, notes) {
            let frame = compose(at, &Frame { position: shape.position, rpy: shape.rpy });
            all.push(Shape { position: frame.position, rpy: frame.rpy, ..shape });
        }
    }
    all
}

/// The body of a part in water of this density; a hull has its ends in the water.
///
/// # Errors
/// Moments of inertia that no body has.
pub fn body(
    tree: &Tree,
    part: &Part,
    inertials: &[Option<Inertial>],
    (density, hull): (f64, bool),
    notes: &mut Vec<String>,
) -> Result<Built> {
    let name = &tree.robot.links[part.links[0].0].name;
    for (link, _) in &part.links[1..] {
        if inertials[*link].is_some() {
            notes.push(format!("{}: merged into {name}", tree.robot.links[*link].name));
        }
    }
    let rigid = rigid(tree, part, inertials, notes)?;
    let own = Body { center_of_mass: rigid.center_of_mass, inertia: rigid.inertia, ..Body::point(rigid.mass) };
    let mut built = Built { body: own, ..Built::default() };
    let link_at =
        |(link, at): &(usize, Frame)| tree.robot.links[*link].water.clone().map(|water| (*link, at.clone(), water));
    let blocks: Blocks = part.links.iter().filter_map(link_at).collect();
    let states = |has: fn(&InWater) -> bool| blocks.iter().any(|(.., water)| has(water));
    let outlined = !(states(InWater::displaces) && states(InWater::has_added_mass) && states(InWater::has_damping));
    if density > 0.0 && outlined {
        built.shapes = shapes(tree, part, inertials, notes);
    }
    if hull {
        built.shapes.iter_mut().for_each(|shape| shape.ends = Ends::Free);
        let coefficients = states(InWater::has_added_mass) || states(InWater::has_damping);
        if built.shapes.is_empty() && !coefficients && density > 0.0 {
            let radius = sphere(rigid.mass, density);
            notes.push(format!("{name}: no outline: a sphere of {radius:.3} m, which displaces its mass of water"));
            let ellipsoid = Some(Vector3::repeat(radius));
            built.shapes.push(Shape { ellipsoid, position: rigid.center_of_mass, ..Shape::default() });
        }
    }
    let estimate =
        (!built.shapes.is_empty()).then(|| Outline { density, speed: SPEED, shapes: built.shapes.clone() }.estimate());
    if rigid.mass > 0.0 && rigid.inertia.symmetric_eigenvalues().min() <= 0.0 && (hull || part.joint.is_some()) {
        built.guess_moments(estimate.as_ref(), density, name, notes);
    }
    if let Some(Estimate { body, formulas }) = estimate {
        let own = ["mass", "center_of_mass", "inertia"];
        let rigid = built.body;
        built.body = Body { mass: rigid.mass, center_of_mass: rigid.center_of_mass, inertia: rigid.inertia, ..body };
        built.origins.extend(
            formulas
                .into_iter()
                .filter(|(key, _)| !own.contains(key))
                .map(|(key, text)| (key, format!("derived: {text}"))),
        );
    }
    if !blocks.is_empty() {
        let without = part.links.iter().filter(|(link, _)| tree.robot.links[*link].water.is_none());
        let others = without.filter_map(|(link, _)| Some(inertials[*link].as_ref()?.mass)).sum();
        built.state(tree, &blocks, others, (density, hull), notes);
    }
    Ok(built)
}

/// Radius of a sphere of this mass and density, m.
fn sphere(mass: f64, density: f64) -> f64 {
    (0.75 * mass / (std::f64::consts::PI * density)).cbrt()
}

impl Built {
    /// Moments of a body of point masses: of its outline, else of a sphere of the water's density.
    fn guess_moments(&mut self, estimate: Option<&Estimate>, density: f64, name: &str, notes: &mut Vec<String>) {
        let mass = self.body.mass;
        let (inertia, what) = match estimate {
            Some(Estimate { body, .. }) if body.mass > 0.0 => (body.inertia * (mass / body.mass), "its outline's"),
            _ => {
                let moment = 0.4 * mass * sphere(mass, if density > 0.0 { density } else { 1000.0 }).powi(2);
                (Matrix3::from_diagonal_element(moment), "a sphere's")
            }
        };
        self.body.inertia = inertia;
        self.origins.push(("inertia", format!("assumed: the file has none; {what}")));
        notes.push(format!("{name}: no moments of inertia in the file: {what}"));
    }
}
