//! XML elements, read with errors that name line and element.

use std::cell::RefCell;

use nalgebra::Vector3;
use roxmltree::Node;

use crate::description::Frame;
use crate::error::DescriptionError;

/// Maximum magnitude of a number, as for scenes.
const MAX_MAGNITUDE: f64 = 1e12;

/// Magnitude of a limit beyond which it is none.
const UNBOUNDED: f64 = 1e6;

/// Maximum number of an element's attributes.
const ATTRIBUTES: usize = 100;

/// An XML element, with its path and file for errors.
#[derive(Clone)]
pub struct Element<'a> {
    pub node: Node<'a, 'a>,
    pub path: String,
    pub source: &'a str,
    /// Offsets of the lines' ends.
    pub lines: &'a [usize],
    /// What is read otherwise than the file says.
    pub notes: &'a RefCell<Vec<String>>,
}

pub type Result<T> = std::result::Result<T, DescriptionError>;

/// An error in an element.
pub fn error(source: &str, line: u32, element: &str, problem: impl Into<String>) -> DescriptionError {
    let (source_name, element, problem) = (source.to_owned(), element.to_owned(), problem.into());
    DescriptionError::Robot { source_name, line, element, problem }
}

impl<'a> Element<'a> {
    pub fn line(&self) -> u32 {
        self.lines.partition_point(|end| *end < self.node.range().start) as u32 + 1
    }

    pub fn error(&self, problem: impl Into<String>) -> DescriptionError {
        error(self.source, self.line(), &self.path, problem)
    }

    pub fn fault<T>(&self, problem: impl Into<String>) -> Result<T> {
        Err(self.error(problem))
    }

    pub fn missing(&self, attribute: &str) -> DescriptionError {
        self.error(format!("attribute {attribute} is missing"))
    }

    pub fn children(&self, tag: &'a str) -> impl Iterator<Item = Element<'a>> + use<'a> {
        let (path, source, lines, notes) = (self.path.clone(), self.source, self.lines, self.notes);
        let nodes = self.node.children().filter(move |node| node.has_tag_name(tag));
        nodes.map(move |node| Element { node, path: format!("{path} <{tag}>"), source, lines, notes })
    }

    /// The only child of this name, if there is one.
    pub fn child(&self, tag: &'a str) -> Result<Option<Element<'a>>> {
        let mut children = self.children(tag);
        let first = children.next();
        match children.next() {
            Some(second) => second.fault("is given twice"),
            None => Ok(first),
        }
    }

    pub fn needed(&self, tag: &'a str) -> Result<Element<'a>> {
        self.child(tag)?.ok_or_else(|| self.error(format!("<{tag}> is missing")))
    }

    pub fn text(&self, attribute: &str) -> Result<&'a str> {
        self.node.attribute(attribute).ok_or_else(|| self.missing(attribute))
    }

    pub fn numbers<const N: usize>(&self, attribute: &str) -> Result<Option<[f64; N]>> {
        let Some(text) = self.node.attribute(attribute) else { return Ok(None) };
        let numbers: std::result::Result<Vec<f64>, _> = text.split_whitespace().map(str::parse).collect();
        let array = numbers.ok().and_then(|list| <[f64; N]>::try_from(list).ok());
        let array = array.filter(|list| list.iter().all(|x| x.abs() <= MAX_MAGNITUDE));
        let what = if N == 1 { "a finite number".to_owned() } else { format!("{N} finite numbers") };
        array.map(Some).ok_or_else(|| self.error(format!("{attribute}=\"{text}\" is not {what}")))
    }

    pub fn number(&self, attribute: &str) -> Result<Option<f64>> {
        Ok(self.numbers::<1>(attribute)?.map(|[x]| x))
    }

    /// A number, None if it is so large that it stands for no bound.
    pub fn bound(&self, attribute: &str) -> Result<Option<f64>> {
        let raw = self.node.attribute(attribute).and_then(|text| text.trim().parse::<f64>().ok());
        if raw.is_some_and(|x| x.abs() > UNBOUNDED) { Ok(None) } else { self.number(attribute) }
    }

    pub fn needed_numbers<const N: usize>(&self, attribute: &str) -> Result<[f64; N]> {
        self.numbers(attribute)?.ok_or_else(|| self.missing(attribute))
    }

    pub fn positive(&self, attribute: &str) -> Result<f64> {
        let [x] = self.needed_numbers(attribute)?;
        if x > 0.0 { Ok(x) } else { self.fault(format!("{attribute} is {x}, but must be > 0")) }
    }

    pub fn at_least_zero(&self, attribute: &str) -> Result<Option<f64>> {
        match self.number(attribute)? {
            Some(x) if x < 0.0 => self.fault(format!("{attribute} is {x}, but must be >= 0")),
            x => Ok(x),
        }
    }

    pub fn note(&self, text: &str) {
        self.notes.borrow_mut().push(format!("{} (line {}): {text}", self.path, self.line()));
    }

    /// Pose of the first `<origin>`; the identity without it.
    pub fn origin(&self) -> Result<Frame> {
        let mut origins = self.children("origin");
        let Some(origin) = origins.next() else { return Ok(Frame::default()) };
        if let Some(second) = origins.next() {
            second.note("a second one is ignored");
        }
        if origin.node.has_attribute("quat_xyzw") {
            return origin.fault("quat_xyzw is not supported: give rpy");
        }
        let vector = |name| Ok(Vector3::from(origin.numbers::<3>(name)?.unwrap_or_default()));
        Ok(Frame { position: vector("xyz")?, rpy: vector("rpy")? })
    }
}

/// Refuses elements with very many attributes, which the parser compares each with each.
pub fn few_attributes(text: &str, source: &str) -> Result<()> {
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
