//! The serial chain between two links of a tree.

use super::file::{Joint, Kind, Robot, fault};
use crate::error::DescriptionError;

/// Joints from a base link to a tip link, including fixed ones.
pub struct Chain {
    pub base: usize,
    pub tip: usize,
    /// Indices of the joints.
    pub joints: Vec<usize>,
}

type Result<T> = std::result::Result<T, DescriptionError>;

impl Robot {
    fn link_called(&self, name: &str, role: &str, source: &str) -> Result<usize> {
        self.links.iter().position(|link| link.name == name).ok_or_else(|| {
            let known: Vec<_> = self.links.iter().map(|link| link.name.as_str()).collect();
            fault(
                source,
                1,
                "<robot>",
                format!("has no link \"{name}\" for the {role}; its links are {}", known.join(", ")),
            )
        })
    }

    /// Joints with this link as parent.
    pub fn joints_of(&self, link: usize) -> impl Iterator<Item = (usize, &Joint)> {
        self.joints.iter().enumerate().filter(move |(_, joint)| joint.parent == link)
    }

    fn moves(&self, joint: usize) -> bool {
        let child = self.joints[joint].child;
        self.joints[joint].kind != Kind::Fixed || self.joints_of(child).any(|(next, _)| self.moves(next))
    }

    /// Refuses loops; all later steps assume a tree.
    fn no_loops(&self, source: &str) -> Result<()> {
        for (start, link) in self.links.iter().enumerate() {
            let mut at = start;
            for _ in 0..self.links.len() {
                match self.joints.iter().find(|joint| joint.child == at) {
                    Some(joint) => at = joint.parent,
                    None => break,
                }
            }
            if self.joints.iter().any(|joint| joint.child == at) {
                return Err(fault(source, 1, &format!("link \"{}\"", link.name), "is part of a loop of joints"));
            }
        }
        Ok(())
    }

    fn root(&self, source: &str) -> Result<usize> {
        let roots: Vec<_> = (0..self.links.len()).filter(|i| self.joints.iter().all(|j| j.child != *i)).collect();
        match roots[..] {
            [root] => Ok(root),
            _ => {
                let names: Vec<_> = roots.iter().map(|i| self.links[*i].name.as_str()).collect();
                let problem = format!("has several links without parent ({}): choose the base", names.join(", "));
                Err(fault(source, 1, "<robot>", problem))
            }
        }
    }

    /// The chain from `base` (default: the root) to `tip` (default: the only end).
    pub fn chain(&self, base: Option<&str>, tip: Option<&str>, source: &str) -> Result<Chain> {
        self.no_loops(source)?;
        let base = match base {
            Some(name) => self.link_called(name, "base", source)?,
            None => self.root(source)?,
        };
        let (joints, tip) = match tip {
            Some(name) => {
                let tip = self.link_called(name, "tip", source)?;
                (self.path(base, tip, source)?, tip)
            }
            None => self.only_path(base, source)?,
        };
        if let Some(joint) = joints.iter().map(|i| &self.joints[*i]).find(|joint| joint.mimic) {
            let element = format!("joint \"{}\" <mimic>", joint.name);
            return Err(fault(source, joint.line, &element, "mimic joints are not supported"));
        }
        Ok(Chain { base, tip, joints })
    }

    fn path(&self, base: usize, tip: usize, source: &str) -> Result<Vec<usize>> {
        let mut joints = Vec::new();
        let mut at = tip;
        while at != base {
            let Some(up) = self.joints.iter().position(|joint| joint.child == at) else {
                let (base, tip) = (&self.links[base].name, &self.links[tip].name);
                return Err(fault(
                    source,
                    1,
                    &format!("link \"{tip}\""),
                    format!("is not a descendant of the base link \"{base}\""),
                ));
            };
            joints.push(up);
            at = self.joints[up].parent;
        }
        joints.reverse();
        Ok(joints)
    }

    /// Follows the only moving branch, else the only branch.
    fn only_path(&self, base: usize, source: &str) -> Result<(Vec<usize>, usize)> {
        let mut joints = Vec::new();
        let mut at = base;
        loop {
            let branches: Vec<_> = self.joints_of(at).map(|(i, _)| i).collect();
            let moving: Vec<_> = branches.iter().copied().filter(|i| self.moves(*i)).collect();
            let choice = if moving.is_empty() { &branches } else { &moving };
            match choice[..] {
                [] => return Ok((joints, at)),
                [one] => {
                    joints.push(one);
                    at = self.joints[one].child;
                }
                _ => {
                    let ways: Vec<_> = choice
                        .iter()
                        .map(|i| {
                            format!(
                                "\"{}\" by joint \"{}\"",
                                self.links[self.joints[*i].child].name, self.joints[*i].name
                            )
                        })
                        .collect();
                    let problem = format!("the chain branches here, to {}: choose the tip", ways.join(" and to "));
                    let line = self.joints[choice[1]].line;
                    return Err(fault(source, line, &format!("link \"{}\"", self.links[at].name), problem));
                }
            }
        }
    }
}
