//! Outlines of links: primitives, measured meshes, else the ellipsoid of mass and moments.

use nalgebra::{Matrix3, Vector3};

use super::element::Result;
use super::merge::{angles, compose};
use super::parts::listed;
use super::tree::Tree;
use super::{Inertial, Mesh, RobotLink};
use crate::description::Frame;
use crate::estimate::{Outline, Shape};

/// Minimum semi-axis of the ellipsoid that represents a link without geometry, m.
const THINNEST: f64 = 1e-3;
/// Density below which moments and volumes are no body's, kg/m3: frames with dummy moments, open meshes, meshes in another unit and
/// hulls with a dummy volume.
pub const LIGHTEST: f64 = 100.0;
/// Density below which a mesh is in millimetres rather than open, kg/m3.
const MILLIMETRES: f64 = 1e-3;
/// Minimum edge of a box that stands for a mesh, m.
const FLAT: f64 = 1e-4;

/// Densities of links, kg/m3, by name; no name for all links without mass.
pub type Densities = [(Option<String>, f64)];

/// Homogeneous ellipsoid of the same mass and moments, and its density, kg/m3.
fn ellipsoid(inertial: &Inertial) -> (Shape, f64) {
    let (moments, turn) = if inertial.inertia == Matrix3::from_diagonal(&inertial.inertia.diagonal()) {
        (inertial.inertia.diagonal(), Matrix3::identity())
    } else {
        let eigen = inertial.inertia.symmetric_eigen();
        let mut turn = eigen.eigenvectors;
        if turn.determinant() < 0.0 {
            turn.column_mut(0).neg_mut();
        }
        (eigen.eigenvalues, turn)
    };
    let square = Vector3::from_fn(|i, _| 2.5 * (moments.sum() - 2.0 * moments[i]) / inertial.mass);
    let axes = Frame { position: Vector3::zeros(), rpy: angles(&turn) };
    let frame = compose(&inertial.frame(), &axes);
    let semi_axes = square.map(|s| s.max(0.0).sqrt().max(THINNEST));
    let density = inertial.mass / (4.0 / 3.0 * std::f64::consts::PI * semi_axes.product());
    (Shape { ellipsoid: Some(semi_axes), position: frame.position, rpy: frame.rpy, ..Shape::default() }, density)
}

/// The box around a measured mesh, moved to the centre of its volume, of which the mesh's volume displaces water.
fn boxed(mesh: &Mesh) -> Option<Shape> {
    let (lower, upper, volume) = (mesh.lower?, mesh.upper?, mesh.volume?);
    let size = (upper - lower).map(|edge| edge.max(FLAT));
    if volume <= 0.0 {
        return None;
    }
    let displaced = Some((volume / size.product()).min(1.0));
    let at = Frame { position: mesh.position, rpy: mesh.rpy };
    let position = at.position + at.rotation() * mesh.center.unwrap_or((lower + upper) / 2.0);
    let ends = crate::estimate::Ends::Joined;
    Some(Shape { cuboid: Some(size), position, rpy: mesh.rpy, ends, displaced, ..Shape::default() })
}

/// Shapes of a link in its frame from its geometry, with or without its meshes; none if it has none that is known.
fn geometry(link: &RobotLink, measured: bool) -> Vec<Shape> {
    let meshes =
        |visual: bool| link.meshes.iter().filter(move |mesh| measured && mesh.visual == visual).filter_map(boxed);
    let shapes: Vec<_> = link.shapes.iter().cloned().chain(meshes(false)).collect();
    if shapes.is_empty() { meshes(true).collect() } else { shapes }
}

/// Volume of the measured meshes of a link, m3.
fn volume(link: &RobotLink) -> f64 {
    let of = |visual: bool| {
        let meshes = link.meshes.iter().filter(move |mesh| mesh.visual == visual && boxed(mesh).is_some());
        meshes.filter_map(|mesh| mesh.volume)
    };
    if link.shapes.is_empty() && of(false).next().is_none() { of(true).sum() } else { of(false).sum() }
}

/// A homogeneous link of measured meshes only; none if a mesh has no moments or the link has other geometry.
fn solid(link: &RobotLink, density: f64) -> Option<Inertial> {
    let of = |visual: bool| link.meshes.iter().filter(move |mesh| mesh.visual == visual && boxed(mesh).is_some());
    let visual = of(false).next().is_none();
    if !link.shapes.is_empty() || of(visual).next().is_none() {
        return None;
    }
    let place = |mesh: &Mesh| Frame { position: mesh.position, rpy: mesh.rpy };
    let (mut mass, mut moment) = (0.0, Vector3::zeros());
    for mesh in of(visual) {
        let m = density * mesh.volume?;
        (mass, moment) = (mass + m, moment + m * (mesh.position + place(mesh).rotation() * mesh.center?));
    }
    let (position, mut inertia) = (moment / mass, Matrix3::zeros());
    for mesh in of(visual) {
        let turn = place(mesh).rotation();
        let offset = (mesh.position + turn * mesh.center? - position).cross_matrix();
        inertia += density * (turn * mesh.inertia.as_ref()?.0 * turn.transpose() - mesh.volume? * offset * offset);
    }
    Some(Inertial { mass, position, rpy: Vector3::zeros(), inertia })
}

/// Shapes of a link in its frame, with a note unless its geometry states them; `part` is the mass of all that is rigidly connected
/// to it, kg.
pub fn outline(link: &RobotLink, inertial: Option<&Inertial>, part: f64, notes: &mut Vec<String>) -> Vec<Shape> {
    let (volume, own) = (volume(link), inertial.filter(|own| own.mass > 0.0));
    let doubtful = volume * LIGHTEST > part;
    let shapes = geometry(link, !doubtful);
    if doubtful && own.is_some() {
        let cause = if volume * MILLIMETRES > part { "in millimetres, scale 0.001?" } else { "not closed, or hollow?" };
        notes.push(format!("{}: its mesh encloses {volume:.3} m3 for {part:.3} kg: left out ({cause})", link.name));
    }
    let (true, Some(inertial)) = (shapes.is_empty(), own) else { return shapes };
    let why = match (link.meshes.is_empty(), doubtful) {
        (true, _) => "no geometry",
        (false, true) => "no other geometry",
        (false, false) => "geometry is a mesh, which was not measured",
    };
    let (shape, density) = ellipsoid(inertial);
    let (what, shapes) = if inertial.is_point() {
        ("no moments of inertia: a point mass, which displaces no water".to_owned(), Vec::new())
    } else if density < LIGHTEST {
        (format!("its moments belong to {density:.2e} kg/m3: no outline, it displaces no water"), Vec::new())
    } else {
        (format!("{why}: hydrodynamics of the homogeneous ellipsoid of its mass and moments"), vec![shape])
    };
    notes.push(format!("{}: {what}", link.name));
    shapes
}

/// Inertial properties of each link: stated, or of its geometry at a density.
///
/// # Errors
/// Densities of unknown links or of links without known geometry, and robots without any mass.
pub fn inertials(
    tree: &Tree,
    order: &[usize],
    densities: &Densities,
    notes: &mut Vec<String>,
) -> Result<Vec<Option<Inertial>>> {
    for (name, density) in densities {
        let role = name.as_deref().unwrap_or("all links without mass");
        if let Some(name) = name {
            tree.link_called(name, "density")?;
        }
        if !(density.is_finite() && *density > 0.0) {
            return tree.robot.refuse(format!("the density of {role} is {density}, but must be > 0"));
        }
    }
    let mut inertials: Vec<_> = tree.robot.links.iter().map(|link| link.inertial.clone()).collect();
    for &i in order {
        let link = &tree.robot.links[i];
        let own = link.inertial.as_ref().filter(|own| own.mass > 0.0);
        let named = densities.iter().find(|(name, _)| name.as_ref() == Some(&link.name)).map(|(_, density)| *density);
        let all = densities.iter().find(|(name, _)| name.is_none()).map(|(_, density)| *density);
        let Some(density) = named.or(all.filter(|_| own.is_none())) else { continue };
        let (mut shapes, speed) = (geometry(link, true), [0.1, 0.3]);
        if shapes.is_empty() {
            if named.is_some() {
                let problem = "has no shape and no measured mesh of which a density makes a mass";
                return tree.robot.fault(link.line, &format!("link \"{}\"", link.name), problem);
            }
            continue;
        }
        shapes.iter_mut().for_each(|shape| (shape.mass, shape.relative_density) = (None, None));
        let own = solid(link, density).unwrap_or_else(|| {
            let body = Outline { density, speed, shapes }.estimate().body;
            let (position, rpy) = (body.center_of_mass, Vector3::zeros());
            Inertial { mass: body.mass, position, rpy, inertia: body.inertia }
        });
        notes.push(format!(
            "{}: {:.4} kg by the volume of its geometry at {density} kg/m3, as chosen",
            link.name, own.mass
        ));
        inertials[i] = Some(own);
    }
    if order.iter().all(|i| inertials[*i].as_ref().is_none_or(|own| own.mass <= 0.0)) {
        let names = listed(order.iter().map(|i| tree.robot.links[*i].name.as_str()));
        let unread = tree.robot.notes.iter().find(|note| !densities.is_empty() && note.contains("mesh not read"));
        let unread = unread.map_or_else(String::new, |note| format!("; {note}"));
        let problem = format!(
            "no link has a mass ({names}): state a --density, of which shapes and measured meshes make masses{unread}",
        );
        return tree.robot.refuse(problem);
    }
    Ok(inertials)
}
