//! Links and joints of a URDF file. `[URDF: wiki.ros.org/urdf/XML]`

use std::collections::HashMap;

use nalgebra::{Matrix3, Vector3};
use roxmltree::{Document, Node};

use crate::description::Frame;
use crate::error::DescriptionError;
use crate::estimate::{Axis, Ends, Round, Shape};

/// Maximum magnitude of a number, as for scenes.
const MAX_MAGNITUDE: f64 = 1e12;

/// Maximum number of an element's attributes.
const ATTRIBUTES: usize = 100;

/// All links and joints of a file.
pub struct Robot {
    pub name: String,
    /// The file, for errors.
    pub source: String,
    pub links: Vec<UrdfLink>,
    pub joints: Vec<UrdfJoint>,
    /// Joint with each link as child, and joints with each link as parent.
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
    /// About the centre of mass, in the axes of `frame`.
    pub inertia: Matrix3<f64>,
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
}

/// An XML element, with its path and file for errors.
#[derive(Clone)]
struct Element<'a> {
    node: Node<'a, 'a>,
    path: String,
    source: &'a str,
    /// Offsets of the lines' ends.
    lines: &'a [usize],
}

pub type Result<T> = std::result::Result<T, DescriptionError>;

/// An error in an element.
fn error(source: &str, line: u32, element: &str, problem: impl Into<String>) -> DescriptionError {
    let (source_name, element, problem) = (source.to_owned(), element.to_owned(), problem.into());
    DescriptionError::Urdf { source_name, line, element, problem }
}

impl<'a> Element<'a> {
    fn line(&self) -> u32 {
        self.lines.partition_point(|end| *end < self.node.range().start) as u32 + 1
    }

    fn error(&self, problem: impl Into<String>) -> DescriptionError {
        error(self.source, self.line(), &self.path, problem)
    }

    fn fault<T>(&self, problem: impl Into<String>) -> Result<T> {
        Err(self.error(problem))
    }

    fn missing(&self, attribute: &str) -> DescriptionError {
        self.error(format!("attribute {attribute} is missing"))
    }

    fn children(&self, tag: &'a str) -> impl Iterator<Item = Element<'a>> + use<'a> {
        let (path, source, lines) = (self.path.clone(), self.source, self.lines);
        let nodes = self.node.children().filter(move |node| node.has_tag_name(tag));
        nodes.map(move |node| Element { node, path: format!("{path} <{tag}>"), source, lines })
    }

    /// The only child of this name, if there is one.
    fn child(&self, tag: &'a str) -> Result<Option<Element<'a>>> {
        let mut children = self.children(tag);
        let first = children.next();
        match children.next() {
            Some(second) => second.fault("is given twice"),
            None => Ok(first),
        }
    }

    fn needed(&self, tag: &'a str) -> Result<Element<'a>> {
        self.child(tag)?.ok_or_else(|| self.error(format!("<{tag}> is missing")))
    }

    fn text(&self, attribute: &str) -> Result<&'a str> {
        self.node.attribute(attribute).ok_or_else(|| self.missing(attribute))
    }

    fn numbers<const N: usize>(&self, attribute: &str) -> Result<Option<[f64; N]>> {
        let Some(text) = self.node.attribute(attribute) else { return Ok(None) };
        let numbers: std::result::Result<Vec<f64>, _> = text.split_whitespace().map(str::parse).collect();
        let array = numbers.ok().and_then(|list| <[f64; N]>::try_from(list).ok());
        let array = array.filter(|list| list.iter().all(|x| x.abs() <= MAX_MAGNITUDE));
        let what = if N == 1 { "a finite number".to_owned() } else { format!("{N} finite numbers") };
        array.map(Some).ok_or_else(|| self.error(format!("{attribute}=\"{text}\" is not {what}")))
    }

    fn number(&self, attribute: &str) -> Result<Option<f64>> {
        Ok(self.numbers::<1>(attribute)?.map(|[x]| x))
    }

    fn needed_numbers<const N: usize>(&self, attribute: &str) -> Result<[f64; N]> {
        self.numbers(attribute)?.ok_or_else(|| self.missing(attribute))
    }

    fn positive(&self, attribute: &str) -> Result<f64> {
        let [x] = self.needed_numbers(attribute)?;
        if x > 0.0 { Ok(x) } else { self.fault(format!("{attribute} is {x}, but must be > 0")) }
    }

    fn at_least_zero(&self, attribute: &str) -> Result<Option<f64>> {
        match self.number(attribute)? {
            Some(x) if x < 0.0 => self.fault(format!("{attribute} is {x}, but must be >= 0")),
            x => Ok(x),
        }
    }

    /// Pose of `<origin>`; the identity without it.
    fn origin(&self) -> Result<Frame> {
        let Some(origin) = self.child("origin")? else { return Ok(Frame::default()) };
        if origin.node.has_attribute("quat_xyzw") {
            return origin.fault("quat_xyzw is not supported: give rpy");
        }
        let vector = |name| Ok(Vector3::from(origin.numbers::<3>(name)?.unwrap_or_default()));
        Ok(Frame { position: vector("xyz")?, rpy: vector("rpy")? })
    }
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
        let robot = Element { node: root, path: "<robot>".to_owned(), source, lines: &lines };
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
            above[joint.child] = Some(joints.len());
            below[joint.parent].push(joints.len());
            joints.push(joint);
        }
        let name = root.attribute("name").unwrap_or_default().to_owned();
        Ok(Self { name, source: source.to_owned(), links, joints, above, below })
    }
}

/// Refuses elements with very many attributes, which the parser compares each with each.
fn few_attributes(text: &str, source: &str) -> Result<()> {
    let mut line = 1;
    for tag in text.split('<') {
        let count = tag.matches("=\"").count() + tag.matches("='").count();
        if count > ATTRIBUTES {
            let name = tag.split(|c: char| c.is_whitespace()).next().unwrap_or_default();
            let problem = format!("has {count} attributes, but at most {ATTRIBUTES} are read");
            return Err(error(source, line, &format!("<{name}>"), problem));
        }
        line += tag.matches('\n').count() as u32;
    }
    Ok(())
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
    if kg > 0.0 && (moments[0] <= 0.0 || moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-6)) {
        let moments: Vec<_> = moments.iter().map(|x| format!("{x:.4e}")).collect();
        return inertia.fault(format!(
            "principal moments are {}, but must be > 0, the largest at most the sum of the others",
            moments.join(", ")
        ));
    }
    Ok(Inertial { mass: kg, frame: element.origin()?, inertia: matrix })
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
    let kind = match element.text("type")? {
        "fixed" => JointType::Fixed,
        "revolute" => JointType::Revolute,
        "continuous" => JointType::Continuous,
        "prismatic" => JointType::Prismatic,
        other => {
            return element.fault(format!("type is \"{other}\", but must be revolute, continuous, prismatic or fixed"));
        }
    };
    let end = |tag| {
        let end = element.needed(tag)?;
        let name = end.text("link")?;
        links.get(name).copied().ok_or_else(|| end.error(format!("unknown link \"{name}\"")))
    };
    let (parent, child) = (end("parent")?, end("child")?);
    let axis = match element.child("axis")? {
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
            if lower >= upper {
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
    let (frame, line) = (element.origin()?, element.line());
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
