//! Robots from XML text of any format.

use std::path::Path;

use roxmltree::{Document, Error};

use super::element::{Result, few_attributes};
use super::{Robot, element, sdf, urdf};
use crate::description::read_file;
use crate::error::DescriptionError;

/// Outermost elements of further formats, and their names.
const OTHERS: [(&str, &str); 5] = [
    ("mujoco", "MJCF, which uvms_gym.import_robot reads"),
    ("mujocoinclude", "a part of MJCF: import the file that includes it"),
    ("COLLADA", "a COLLADA mesh"),
    ("scenario", "a Stonefish scenario"),
    ("launch", "a ROS launch file"),
];

/// Maximum number of prefixes without a namespace.
const PREFIXES: usize = 16;

impl Robot {
    /// Reads a file.
    ///
    /// # Errors
    /// A file that cannot be read, or as [`Robot::from_text`].
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self> {
        let (text, source) = read_file(path.as_ref())?;
        Self::from_text(&text, &source)
    }

    /// Reads the text of a URDF or SDF file; `source` (a file's name) appears in errors.
    ///
    /// # Errors
    /// `DescriptionError::Syntax` for broken XML, `DescriptionError::Robot` with line and element.
    pub fn from_text(text: &str, source: &str) -> Result<Self> {
        few_attributes(text, source)?;
        if text.trim().is_empty() {
            return Err(element::error(source, 1, "the file", "is empty"));
        }
        let bound = bind_prefixes(text);
        let text = bound.as_str();
        let document = Document::parse(text).map_err(|error| {
            let problem = match &error {
                Error::DtdDetected => "a document type (<!DOCTYPE>) is not read: remove it".to_owned(),
                error => error.to_string(),
            };
            let message = format!("line {}: {problem}", error.pos().row);
            DescriptionError::Syntax { source_name: source.to_owned(), message }
        })?;
        let tag = document.root_element().tag_name().name();
        match tag {
            "robot" => urdf::read(&document, text, source),
            "sdf" => sdf::read(&document, text, source),
            _ => {
                let what = OTHERS.iter().find(|(other, _)| *other == tag);
                let what = what.map_or_else(String::new, |(_, what)| format!(" ({what})"));
                let problem = format!("the outermost element is <{tag}>{what}, but must be <robot> (URDF) or <sdf>");
                Err(element::error(source, 1, &format!("<{tag}>"), problem))
            }
        }
    }

    /// Reads a tree of values of the form of [`Robot`]; `source_name` appears in errors.
    ///
    /// # Errors
    /// [`DescriptionError::Value`] names source, key and value.
    pub fn from_value(value: toml::Value, source_name: &str) -> Result<Self> {
        crate::description::read_value(value, source_name)
    }
}

/// The text with every prefix of a name bound, as the parsers of simulators accept unbound ones. Lines stay.
fn bind_prefixes(text: &str) -> String {
    let mut text = text.to_owned();
    for _ in 0..PREFIXES {
        let Err(Error::UnknownNamespace(prefix, _)) = Document::parse(&text) else { break };
        let Some(at) = root_name_end(&text) else { break };
        text.insert_str(at, &format!(" xmlns:{prefix}=\"{prefix}\""));
    }
    text
}

/// End of the name of the outermost element.
fn root_name_end(text: &str) -> Option<usize> {
    let mut at = 0;
    loop {
        let start = at + text[at..].find('<')?;
        let rest = &text[start..];
        let skip =
            |open: &str, close: &str| rest.starts_with(open).then(|| rest.find(close).map(|end| end + close.len()));
        match skip("<!--", "-->").or(skip("<?", "?>")).or(skip("<!", ">")) {
            Some(end) => at = start + end?,
            None => return Some(start + rest.find(|c: char| c.is_whitespace() || c == '>' || c == '/')?),
        }
    }
}
