//! Links and joints of a URDF file. `[URDF: wiki.ros.org/urdf/XML]`

use std::cell::RefCell;
use std::collections::HashMap;

use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use roxmltree::{Document, Node};

use super::element::{Element, Result, error, few_attributes};
use super::links::{angles, compose};
use crate::description::Frame;
use crate::error::DescriptionError;
use crate::estimate::{Axis, Ends, Round, Shape};

/// All links and joints of a file.
pub struct Robot {
    pub name: String,
    /// The file, for errors.
    pub source: String,
    pub links: Vec<UrdfLink>,
    pub joints: Vec<UrdfJoint>,
    /// What was read otherwise than the file says, one sentence each.
    pub notes: Vec<String>,
    /// Joint with each link as child, and joints with each link as parent; floating joints connect nothing.
    pub above: Vec<Option<usize>>,
    pub below: Vec<Vec<usize>>,
}

pub struct UrdfLink {
    pub name: String,
    pub inertial: Option<Inertial>,
    /// Shapes of `<collision>`, or of `<visual>` if there are none.
    pub shapes: Vec<Shape>,
    /// True if any geometry is a mesh.
    pub mesh: bool,
}

/// Inertial properties in a link frame.
#[derive(Clone)]
pub struct Inertial {
    pub mass: f64,
    pub frame: Frame,
    /// About the centre of mass, in the axes of `frame`; 0 for a point mass.
    pub inertia: Matrix3<f64>,
    /// Error for a link that is part of the scene: line, element and problem.
    pub problem: Option<(u32, String, String)>,
}

pub struct UrdfJoint {
    pub name: String,
    pub kind: JointType,
    pub parent: usize,
    pub child: usize,
    /// Child frame in the parent frame.
    pub frame: Frame,
    pub axis: Vector3<f64>,
    pub limits: Option<[f64; 2]>,
    pub effort: Option<f64>,
    pub speed: Option<f64>,
    pub damping: f64,
    pub friction: f64,
    pub armature: f64,
    pub mimic: bool,
    /// Line of the element, for errors.
    pub line: u32,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointType {
    Fixed,
    Revolute,
    Continuous,
    Prismatic,
    /// Six degrees of freedom: the child is a vehicle.
    Floating,
}

impl Robot {
    /// An error in an element.
    pub fn fault<T>(&self, line: u32, element: &str, problem: impl Into<String>) -> Result<T> {
        Err(error(&self.source, line, element, problem))
    }

    /// Parses the text of a file.
    pub fn read(text: &str, source: &str) -> Result<Self> {
        few_attributes(text, source)?;
        let document = Document::parse(text).map_err(|error| DescriptionError::Syntax {
            source_name: source.to_owned(),
            message: format!("line {}: {error}", error.pos().row),
        })?;
        let root = document.root_element();
        let lines: Vec<usize> = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n').map(|(at, _)| at).collect();
        let notes = RefCell::default();
        let robot = Element { node: root, path: "<robot>".to_owned(), source, lines: &lines, notes: &notes };
        if !root.has_tag_name("robot") {
            return robot.fault(format!("the outermost element is <{}>, but must be <robot>", root.tag_name().name()));
        }
        let is_xacro = |node: Node| node.tag_name().namespace().is_some_and(|space| space.contains("xacro"));
        if let Some(node) = root.descendants().find(|node| is_xacro(*node)) {
            let name = format!("<xacro:{}>", node.tag_name().name());
            return Element { node, path: name, ..robot }.fault("run xacro on the file first");
        }
        let mut links: Vec<UrdfLink> = Vec::new();
        let mut indices = HashMap::new();
        for element in robot.children("link") {
            let link = link(&element)?;
            if indices.insert(link.name.clone(), links.len()).is_some() {
                return element.fault(format!("the name \"{}\" is taken by an earlier link", link.name));
            }
            links.push(link);
        }
        if links.is_empty() {
            return robot.fault("has no <link>");
        }
        let mut joints: Vec<UrdfJoint> = Vec::new();
        let (mut above, mut below) = (vec![None; links.len()], vec![Vec::new(); links.len()]);
        for element in robot.children("joint") {
            let joint = joint(&element, &indices)?;
            if let Some(other) = above[joint.child] {
                let (child, before): (_, &UrdfJoint) = (&links[joint.child].name, &joints[other]);
                let before = &before.name;
                return element.fault(format!("link \"{child}\" is the child of joint \"{before}\" already"));
            }
            if joint.kind != JointType::Floating {
                above[joint.child] = Some(joints.len());
                below[joint.parent].push(joints.len());
            }
            joints.push(joint);
        }
        let name = root.attribute("name").unwrap_or_default().to_owned();
        Ok(Self { name, source: source.to_owned(), links, joints, notes: notes.into_inner(), above, below })
    }
}

fn link(element: &Element) -> Result<UrdfLink> {
    let name = element.text("name")?.to_owned();
    let element = &Element { path: format!("link \"{name}\""), ..element.clone() };
    let inertial = element.child("inertial")?.map(|inertial| self::inertial(&inertial)).transpose()?;
    let (mut shapes, mut mesh) = (Vec::new(), false);
    for tag in ["collision", "visual"] {
        for part in element.children(tag) {
            match geometry(&part)? {
                Some(shape) => shapes.push(shape),
                None => mesh = true,
            }
        }
        if !shapes.is_empty() {
            break;
        }
    }
    Ok(UrdfLink { name, inertial, mesh: mesh && shapes.is_empty(), shapes })
}

fn inertial(element: &Element) -> Result<Inertial> {
    let mass = element.needed("mass")?;
    let kg = mass.at_least_zero("value")?.ok_or_else(|| mass.missing("value"))?;
    let inertia = element.needed("inertia")?;
    let entry = |name| inertia.needed_numbers(name);
    let ([xx], [xy], [xz]) = (entry("ixx")?, entry("ixy")?, entry("ixz")?);
    let ([yy], [yz], [zz]) = (entry("iyy")?, entry("iyz")?, entry("izz")?);
    let matrix = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    let mut moments: Vec<f64> = matrix.symmetric_eigenvalues().iter().copied().collect();
    moments.sort_by(f64::total_cmp);
    let valid = moments[0] > 0.0 && moments[2] <= (moments[0] + moments[1]) * (1.0 + 1e-6);
    let problem = (kg > 0.0 && !valid && matrix != Matrix3::zeros()).then(|| {
        let moments: Vec<_> = moments.iter().map(|x| format!("{x:.4e}")).collect();
        let rule = "but must be > 0, the largest at most the sum of the others";
        (inertia.line(), inertia.path.clone(), format!("principal moments are {}, {rule}", moments.join(", ")))
    });
    Ok(Inertial { mass: kg, frame: element.origin()?, inertia: matrix, problem })
}

/// The shape of a `<collision>` or `<visual>`; None if it is a mesh.
fn geometry(element: &Element) -> Result<Option<Shape>> {
    let geometry = element.needed("geometry")?;
    let frame = element.origin()?;
    let shape = Shape { position: frame.position, rpy: frame.rpy, ends: Ends::Joined, ..Shape::default() };
    let Some(solid) = geometry.node.children().find(Node::is_element) else {
        return geometry.fault("is empty");
    };
    let tag = solid.tag_name().name();
    let solid = Element { node: solid, path: format!("{} <{tag}>", geometry.path), ..geometry };
    let round = || Ok(Round { radius: solid.positive("radius")?, length: solid.positive("length")?, axis: Axis::Z });
    Ok(Some(match tag {
        "box" => {
            let size = solid.needed_numbers::<3>("size")?;
            if let Some(edge) = size.iter().find(|edge| **edge <= 0.0) {
                return solid.fault(format!("size has {edge}, but edges must be > 0"));
            }
            Shape { cuboid: Some(size.into()), ..shape }
        }
        "cylinder" => Shape { cylinder: Some(round()?), ..shape },
        "capsule" => Shape { capsule: Some(round()?), ends: Ends::Free, ..shape },
        "sphere" => Shape { ellipsoid: Some(Vector3::repeat(solid.positive("radius")?)), ..shape },
        "mesh" => return Ok(None),
        _ => return solid.fault("must be one of box, cylinder, capsule, sphere, mesh"),
    }))
}

fn joint(element: &Element, links: &HashMap<String, usize>) -> Result<UrdfJoint> {
    let name = element.text("name")?.to_owned();
    let element = &Element { path: format!("joint \"{name}\""), ..element.clone() };
    let mut kind = match element.text("type")? {
        "fixed" => JointType::Fixed,
        "revolute" => JointType::Revolute,
        "continuous" => JointType::Continuous,
        "prismatic" => JointType::Prismatic,
        "floating" => JointType::Floating,
        other => {
            return element
                .fault(format!("type is \"{other}\", but must be revolute, continuous, prismatic, fixed or floating"));
        }
    };
    let end = |tag| {
        let end = element.needed(tag)?;
        let name = end.text("link")?;
        links.get(name).copied().ok_or_else(|| end.error(format!("unknown link \"{name}\"")))
    };
    let (parent, child) = (end("parent")?, end("child")?);
    let axis = match element.child("axis")?.filter(|_| !matches!(kind, JointType::Fixed | JointType::Floating)) {
        None => Vector3::x(),
        Some(axis) => {
            let vector = Vector3::from(axis.needed_numbers::<3>("xyz")?);
            if vector.norm() < 1e-9 {
                return axis.fault("xyz must have a nonzero length");
            }
            vector
        }
    };
    let limit = element.child("limit")?;
    let (mut limits, mut effort, mut speed) = (None, None, None);
    if let Some(limit) = &limit {
        // Zero means "unknown" in most files: a motor without torque is not a motor.
        effort = limit.at_least_zero("effort")?.filter(|x| *x > 0.0);
        speed = limit.at_least_zero("velocity")?.filter(|x| *x > 0.0);
        let (lower, upper) = (limit.number("lower")?.unwrap_or(0.0), limit.number("upper")?.unwrap_or(0.0));
        if matches!(kind, JointType::Revolute | JointType::Prismatic) {
            if lower > upper {
                return limit.fault(format!("lower is {lower}, but must be below upper, {upper}"));
            }
            limits = Some([lower, upper]);
        }
    } else if matches!(kind, JointType::Revolute | JointType::Prismatic) {
        return element.fault("<limit> is missing, which revolute and prismatic joints need");
    }
    let dynamics = element.child("dynamics")?;
    let dynamics = |name| Ok(dynamics.as_ref().map(|d| d.at_least_zero(name)).transpose()?.flatten().unwrap_or(0.0));
    let mimic = element.child("mimic")?.is_some();
    let (damping, friction, armature) = (dynamics("damping")?, dynamics("friction")?, dynamics("armature")?);
    let (mut frame, line) = (element.origin()?, element.line());
    if let Some([at, _]) = limits.filter(|[lower, upper]| lower == upper) {
        element.note(&format!("its limits are equal, so it is locked at {at}"));
        frame = displaced(&frame, kind, &axis, at);
        kind = JointType::Fixed;
    }
    Ok(UrdfJoint {
        name,
        kind,
        parent,
        child,
        frame,
        axis,
        limits,
        effort,
        speed,
        damping,
        friction,
        armature,
        mimic,
        line,
    })
}

/// The child's frame at this joint coordinate.
fn displaced(frame: &Frame, kind: JointType, axis: &Vector3<f64>, at: f64) -> Frame {
    let axis = axis.normalize();
    match kind {
        JointType::Prismatic => compose(frame, &Frame { position: axis * at, rpy: Vector3::zeros() }),
        _ if at == 0.0 => frame.clone(),
        _ => {
            let turn = Rotation3::from_axis_angle(&Unit::new_unchecked(axis), at);
            compose(frame, &Frame { position: Vector3::zeros(), rpy: angles(turn.matrix()) })
        }
    }
}
