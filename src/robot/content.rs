//! Values inside XML elements, `<mass>1.5</mass>`, as in SDF files and in the blocks of plugins.

use super::element::{Element, Result};

/// Maximum magnitude of a number, as for scenes.
const MAX_MAGNITUDE: f64 = 1e12;

impl<'a> Element<'a> {
    /// The text of the element, without white space around it.
    pub fn content(&self) -> &'a str {
        self.node.text().unwrap_or_default().trim()
    }

    /// All child elements.
    pub fn elements(&self) -> impl Iterator<Item = Element<'a>> + use<'a> {
        let (path, source, lines, notes) = (self.path.clone(), self.source, self.lines, self.notes);
        let nodes = self.node.children().filter(|node| node.is_element());
        nodes.map(move |node| Element {
            node,
            path: format!("{path} <{}>", node.tag_name().name()),
            source,
            lines,
            notes,
        })
    }

    /// The numbers in the element, separated by white space or, as some files have it, commas.
    pub fn list(&self) -> Result<Vec<f64>> {
        let words = self.content().split(|c: char| c.is_whitespace() || c == ',').filter(|word| !word.is_empty());
        let number = |word: &str| {
            let number = word.parse().ok().filter(|x: &f64| x.abs() <= MAX_MAGNITUDE);
            number.ok_or_else(|| self.error(format!("\"{word}\" is not a finite number")))
        };
        words.map(number).collect()
    }

    /// This count of numbers in the element.
    pub fn listed(&self, count: usize) -> Result<Vec<f64>> {
        let list = self.list()?;
        if list.len() == count {
            Ok(list)
        } else {
            self.fault(format!("has {} numbers, but must have {count}", list.len()))
        }
    }

    /// The only number in the element.
    pub fn number_inside(&self) -> Result<f64> {
        Ok(self.listed(1)?[0])
    }

    /// Number in the child of this name.
    pub fn value(&self, tag: &'a str) -> Result<Option<f64>> {
        self.child(tag)?.map(|child| child.number_inside()).transpose()
    }

    pub fn needed_value(&self, tag: &'a str) -> Result<f64> {
        self.needed(tag)?.number_inside()
    }

    pub fn positive_value(&self, tag: &'a str) -> Result<Option<f64>> {
        let rule = |child: Element| match child.number_inside()? {
            x if x > 0.0 => Ok(x),
            x => child.fault(format!("is {x}, but must be > 0")),
        };
        self.child(tag)?.map(rule).transpose()
    }

    pub fn needed_positive_value(&self, tag: &'a str) -> Result<f64> {
        self.needed(tag)?;
        Ok(self.positive_value(tag)?.expect("the element is there"))
    }

    pub fn at_least_zero_value(&self, tag: &'a str) -> Result<Option<f64>> {
        let rule = |child: Element| match child.number_inside()? {
            x if x >= 0.0 => Ok(x),
            x => child.fault(format!("is {x}, but must be >= 0")),
        };
        self.child(tag)?.map(rule).transpose()
    }

    /// Numbers in the child of this name.
    pub fn values<const N: usize>(&self, tag: &'a str) -> Result<Option<[f64; N]>> {
        let Some(child) = self.child(tag)? else { return Ok(None) };
        let list = child.listed(N)?;
        Ok(Some(list.try_into().expect("the length is checked")))
    }

    /// Text in the child of this name; none if it is empty.
    pub fn word(&self, tag: &'a str) -> Result<Option<&'a str>> {
        Ok(self.child(tag)?.map(|child| child.content()).filter(|text| !text.is_empty()))
    }

    /// Truth value in the child of this name.
    pub fn flag(&self, tag: &'a str) -> Result<Option<bool>> {
        let Some(child) = self.child(tag)? else { return Ok(None) };
        match child.content().to_lowercase().as_str() {
            "true" | "1" => Ok(Some(true)),
            "false" | "0" => Ok(Some(false)),
            text => child.fault(format!("is \"{text}\", but must be true or false")),
        }
    }
}
