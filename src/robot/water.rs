//! Hydrodynamics that a file states, in the body of a moving part.

use nalgebra::{Matrix6, Vector3};

use super::InWater;
use super::body::Built;
use super::merge::compose;
use super::outline::LIGHTEST;
use super::tree::Tree;
use crate::description::{ForwardDamping, Frame};

/// Gravity in the plugins that state a buoyancy, m/s2.
const GRAVITY: f64 = 9.81;

/// Blocks of the links of a part: link, its frame in the part, and what the file states of it.
pub type Blocks = Vec<(usize, Frame, InWater)>;

fn states(matrix: &Matrix6<f64>) -> bool {
    *matrix != Matrix6::zeros()
}

impl InWater {
    /// True if the file states how much water is displaced.
    pub(super) fn displaces(&self) -> bool {
        self.neutral || self.volume.is_some() || self.buoyancy.is_some()
    }

    pub(super) fn has_added_mass(&self) -> bool {
        states(&self.added_mass)
    }

    pub(super) fn has_damping(&self) -> bool {
        [&self.linear, &self.quadratic, &self.linear_forward_speed].into_iter().any(states)
    }

    fn size(&self) -> f64 {
        self.added_mass.trace() + self.linear.trace() + self.quadratic.trace()
    }
}

impl Built {
    /// Sets the hydrodynamics that the file states; estimates stay for added mass, damping or volume of which it states nothing.
    /// `others` is the mass of the part's links without a block, kg.
    pub(super) fn state(
        &mut self,
        tree: &Tree,
        blocks: &Blocks,
        others: f64,
        (density, hull): (f64, bool),
        notes: &mut Vec<String>,
    ) {
        let name = |link: usize| &tree.robot.links[link].name;
        let mut keys = self.displace(tree, blocks, others, (density, hull), notes);
        let coefficients = blocks.iter().filter(|(.., own)| own.has_added_mass() || own.has_damping());
        let main = coefficients.clone().max_by(|a, b| a.2.size().total_cmp(&b.2.size()));
        if let Some((link, at, own)) = main {
            let (at, link) = (compose(at, &own.frame), *link);
            keys.push("hydrodynamic_frame");
            let body = &mut self.body;
            let before = relative(&at, &body.hydrodynamic_frame);
            if coefficients.clone().any(|(.., own)| own.has_added_mass()) {
                body.added_mass = Matrix6::zeros();
                keys.push("added_mass");
            } else {
                body.added_mass = moved(&body.added_mass, &before);
                body.added_mass = (body.added_mass + body.added_mass.transpose()) / 2.0;
                notes.push(format!("{}: no added mass in the file: estimated", name(link)));
            }
            if coefficients.clone().any(|(.., own)| own.has_damping()) {
                (body.damping.linear, body.damping.quadratic) = (Matrix6::zeros(), Matrix6::zeros());
                keys.push("damping");
            } else {
                body.damping.linear = moved(&body.damping.linear, &before);
                body.damping.quadratic = quadratic(&body.damping.quadratic, &before);
                notes.push(format!("{}: no damping in the file: estimated", name(link)));
            }
            body.hydrodynamic_frame = at;
        }
        for (link, at, own) in coefficients {
            let x = relative(&self.body.hydrodynamic_frame, &compose(at, &own.frame));
            let added = moved(&own.added_mass, &x);
            self.body.added_mass += (added + added.transpose()) / 2.0;
            self.body.damping.linear += moved(&own.linear, &x);
            self.body.damping.quadratic += quadratic(&own.quadratic, &x);
            if states(&own.linear_forward_speed) {
                self.forward(&own.linear_forward_speed, &compose(at, &own.frame), name(*link), hull, notes);
            }
        }
        for (link, ..) in blocks {
            notes.push(format!("{}: hydrodynamics of the file", name(*link)));
        }
        let cited = format!("cited: {}", tree.robot.file_name());
        let below = |key: &str, of: &str| key == of || key.starts_with(&format!("{of}."));
        self.origins.retain(|(key, _)| !keys.iter().any(|of| below(key, of)));
        self.origins.extend(keys.into_iter().map(|key| (key, cited.clone())));
    }

    /// Sets volume and centre of buoyancy, and returns the keys; none for a volume that no vehicle has.
    fn displace(
        &mut self,
        tree: &Tree,
        blocks: &Blocks,
        others: f64,
        (density, hull): (f64, bool),
        notes: &mut Vec<String>,
    ) -> Vec<&'static str> {
        let mass = |link: usize| tree.robot.links[link].inertial.as_ref().map_or(0.0, |own| own.mass);
        // Simulators merge links on fixed joints, so a neutrally buoyant link bears the ones that have no block.
        let bearing = blocks.iter().filter(|(.., own)| own.neutral).max_by(|a, b| mass(a.0).total_cmp(&mass(b.0)));
        let bearing = bearing.map(|(link, ..)| *link);
        let (mut volume, mut moment) = (0.0, Vector3::zeros());
        for (link, at, own) in blocks {
            let part = match (own.volume, own.buoyancy) {
                _ if own.neutral && bearing == Some(*link) => (mass(*link) + others) / density,
                _ if own.neutral => mass(*link) / density,
                (Some(volume), _) => volume,
                (None, Some(buoyancy)) => buoyancy / (density * GRAVITY),
                (None, None) => 0.0,
            };
            volume += part;
            moment += compose(at, &Frame { position: own.center_of_buoyancy, rpy: Vector3::zeros() }).position * part;
        }
        if !volume.is_finite() || !blocks.iter().any(|(.., own)| own.displaces()) {
            return Vec::new();
        }
        if hull && self.body.mass < LIGHTEST * volume {
            notes.push(format!(
                "{}: its volume in the file, {:.3} L, is left out: no vehicle has {:.0} kg/m3",
                tree.robot.links[blocks[0].0].name,
                1e3 * volume,
                self.body.mass / volume
            ));
            return Vec::new();
        }
        self.displaces = true;
        self.body.volume = Some(volume);
        self.body.center_of_buoyancy = if volume > 0.0 { moment / volume } else { Vector3::zeros() };
        vec!["volume", "center_of_buoyancy"]
    }

    /// Adds a damping by forward speed, of coefficients in the frame `at`.
    fn forward(&mut self, matrix: &Matrix6<f64>, at: &Frame, name: &str, hull: bool, notes: &mut Vec<String>) {
        if !hull || self.forward.is_some() {
            notes.push(format!("{name}: its damping by forward speed is left out: only a vehicle has one"));
            return;
        }
        if at.rpy != Vector3::zeros() {
            notes.push(format!("{name}: its damping by forward speed acts with the speed along x of the vehicle"));
        }
        // A scene has the point of the coefficients, in the vehicle's axes.
        let axes = Frame { position: Vector3::zeros(), rpy: at.rpy }.adjoint_inverse();
        self.forward = Some(ForwardDamping { position: at.position, matrix: moved(matrix, &axes) });
    }
}

/// Takes twists in one frame of a body to another frame of it.
fn relative(from: &Frame, to: &Frame) -> Matrix6<f64> {
    if from == to {
        return Matrix6::identity();
    }
    let mut back = Matrix6::zeros();
    let (r, p) = (from.rotation(), from.position.cross_matrix());
    back.fixed_view_mut::<3, 3>(0, 0).copy_from(&r);
    back.fixed_view_mut::<3, 3>(0, 3).copy_from(&(p * r));
    back.fixed_view_mut::<3, 3>(3, 3).copy_from(&r);
    to.adjoint_inverse() * back
}

/// `X^T M X` of the twists that X takes to the frame of M.
fn moved(matrix: &Matrix6<f64>, x: &Matrix6<f64>) -> Matrix6<f64> {
    if *x == Matrix6::identity() { *matrix } else { x.transpose() * matrix * x }
}

/// Quadratic damping in another frame: exact for motion along or about a single axis.
fn quadratic(matrix: &Matrix6<f64>, x: &Matrix6<f64>) -> Matrix6<f64> {
    if *x == Matrix6::identity() { *matrix } else { x.transpose() * matrix * x.component_mul(&x.abs()) }
}
