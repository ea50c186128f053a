//! Links of an SDF model: inertia and geometry.

use nalgebra::{Matrix3, Vector3};
use roxmltree::Node;

use super::frames::local;
use crate::estimate::{Axis, Ends, Outline, Round, Shape};
use crate::robot::element::{Element, Result};
use crate::robot::plugins::fluid_added_mass;
use crate::robot::{Inertial, Mesh, RobotLink};

/// A link, in its own frame.
pub fn link(element: &Element, notes: &mut Vec<String>) -> Result<RobotLink> {
    let name = element.text("name")?.to_owned();
    let element = &Element { path: format!("link \"{name}\""), ..element.clone() };
    let mut link = RobotLink { name, line: element.line(), ..RobotLink::default() };
    for tag in ["collision", "visual"] {
        let none = link.shapes.is_empty() && link.meshes.is_empty();
        for part in element.children(tag) {
            match geometry(&part, tag == "visual")? {
                Some(Geometry::Shape(shape)) if none => link.shapes.push(shape),
                Some(Geometry::Mesh(mesh)) => link.meshes.push(mesh),
                _ => {}
            }
        }
    }
    let Some(inertial) = element.child("inertial")? else {
        notes.push(format!(
            "{}: no <inertial>: a frame without mass (SDF's own default is 1 kg and 1 kg m2)",
            link.name
        ));
        return Ok(link);
    };
    link.inertial = Some(self::inertial(&inertial, &link)?);
    if let Some(added) = inertial.child("fluid_added_mass")? {
        link.water.get_or_insert_default().added_mass = fluid_added_mass(&added)?;
    }
    for (tag, off) in [("gravity", false), ("kinematic", true)] {
        if element.flag(tag)? == Some(off) {
            element.note(&format!("<{tag}> {off} is not read"));
        }
    }
    Ok(link)
}

fn inertial(element: &Element, link: &RobotLink) -> Result<Inertial> {
    if matches!(element.node.attribute("auto"), Some("true" | "1")) && !link.shapes.is_empty() {
        let density = element.positive_value("density")?.unwrap_or(1000.0);
        let body = Outline { density, speed: [0.0; 2], shapes: link.shapes.clone() }.estimate().body;
        element.note(&format!("mass and moments of the collision geometry at {density} kg/m3"));
        let (position, rpy) = (body.center_of_mass, Vector3::zeros());
        return Ok(Inertial { mass: body.mass, position, rpy, inertia: body.inertia });
    }
    let frame = local(element)?;
    let mass = element.at_least_zero_value("mass")?.unwrap_or(1.0);
    let inertia = match element.child("inertia")? {
        None => {
            element.note("no <inertia>: a point mass (SDF's own default is 1 kg m2)");
            Matrix3::zeros()
        }
        Some(element) => {
            let entry = |tag, default| Ok(element.value(tag)?.unwrap_or(default));
            let (xx, yy, zz) = (entry("ixx", 1.0)?, entry("iyy", 1.0)?, entry("izz", 1.0)?);
            let (xy, xz, yz) = (entry("ixy", 0.0)?, entry("ixz", 0.0)?, entry("iyz", 0.0)?);
            Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
        }
    };
    Ok(Inertial { mass, position: frame.position, rpy: frame.rpy, inertia })
}

enum Geometry {
    Shape(Shape),
    Mesh(Mesh),
}

/// The geometry of a `<collision>` or `<visual>`; none, with a note, if it encloses no volume.
fn geometry(element: &Element, visual: bool) -> Result<Option<Geometry>> {
    let geometry = element.needed("geometry")?;
    let frame = local(element)?;
    let shape = Shape { position: frame.position, rpy: frame.rpy, ends: Ends::Joined, ..Shape::default() };
    let Some(solid) = geometry.node.children().find(Node::is_element) else {
        return geometry.fault("is empty");
    };
    let tag = solid.tag_name().name();
    let solid = Element { node: solid, path: format!("{} <{tag}>", geometry.path), ..geometry };
    let radius = || solid.needed_positive_value("radius");
    let round = || Ok(Round { radius: radius()?, length: solid.needed_positive_value("length")?, axis: Axis::Z });
    let lengths = |tag| {
        let child = solid.needed(tag)?;
        let list = child.listed(3)?;
        match list.iter().find(|x| **x <= 0.0) {
            Some(x) => child.fault(format!("has {x}, but lengths must be > 0")),
            None => Ok(Vector3::from_row_slice(&list)),
        }
    };
    Ok(Some(Geometry::Shape(match tag {
        "box" => Shape { cuboid: Some(lengths("size")?), ..shape },
        "cylinder" => Shape { cylinder: Some(round()?), ..shape },
        "capsule" => Shape { capsule: Some(round()?), ends: Ends::Free, ..shape },
        "sphere" => Shape { ellipsoid: Some(Vector3::repeat(radius()?)), ..shape },
        "ellipsoid" => Shape { ellipsoid: Some(lengths("radii")?), ..shape },
        "mesh" => {
            let file = solid.needed("uri")?.content().to_owned();
            let scale = solid.values::<3>("scale")?.unwrap_or([1.0; 3]).into();
            let (position, rpy) = (frame.position, frame.rpy);
            return Ok(Some(Geometry::Mesh(Mesh { file, scale, position, rpy, visual, ..Mesh::default() })));
        }
        _ => {
            if !visual {
                solid.note("is not read: shapes are box, cylinder, capsule, sphere, ellipsoid and mesh");
            }
            return Ok(None);
        }
    })))
}
