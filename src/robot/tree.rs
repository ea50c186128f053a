//! The tree of links and joints, checked.

use std::collections::HashMap;

use super::element::Result;
use super::parts::listed;
use super::{Robot, RobotJoint, RobotJointKind};

/// A robot with the connections of its links by indices.
pub struct Tree<'a> {
    pub robot: &'a Robot,
    /// Links and joints by name.
    pub links: HashMap<&'a str, usize>,
    pub joints: HashMap<&'a str, usize>,
    /// Carrying and carried link of each joint.
    pub parent: Vec<usize>,
    pub child: Vec<usize>,
    /// Joint with each link as child, and joints with each link as parent; floating joints connect nothing.
    pub above: Vec<Option<usize>>,
    pub below: Vec<Vec<usize>>,
}

impl<'a> Tree<'a> {
    /// Connects the links.
    ///
    /// # Errors
    /// Names that are taken or unknown, links with two parents, loops.
    pub fn new(robot: &'a Robot) -> Result<Self> {
        let mut links = HashMap::new();
        for (i, link) in robot.links.iter().enumerate() {
            if links.insert(link.name.as_str(), i).is_some() {
                let problem = format!("the name \"{}\" is taken by an earlier link", link.name);
                return Err(robot.error(link.line, format!("link \"{}\"", link.name), problem));
            }
        }
        let mut names = HashMap::new();
        let (mut above, mut below) = (vec![None; robot.links.len()], vec![Vec::new(); robot.links.len()]);
        let (mut parents, mut children) = (Vec::new(), Vec::new());
        for (i, joint) in robot.joints.iter().enumerate() {
            let place = |part: &str| format!("joint \"{}\"{part}", joint.name);
            let fault = |part: &str, problem: String| Err(robot.error(joint.line, place(part), problem));
            if names.insert(joint.name.as_str(), i).is_some() {
                return fault("", "the name is taken by an earlier joint".to_owned());
            }
            let end = |tag: &str, name: &str| match links.get(name) {
                Some(link) => Ok(*link),
                None => Err(robot.error(joint.line, place(tag), format!("unknown link \"{name}\""))),
            };
            let (parent, child) = (end(" <parent>", &joint.parent)?, end(" <child>", &joint.child)?);
            if let Some(other) = above[child] {
                let before: &RobotJoint = &robot.joints[other];
                return fault(
                    "",
                    format!("link \"{}\" is the child of joint \"{}\" already", joint.child, before.name),
                );
            }
            if joint.kind != RobotJointKind::Floating {
                above[child] = Some(i);
                below[parent].push(i);
            }
            parents.push(parent);
            children.push(child);
        }
        let tree = Self { robot, links, joints: names, parent: parents, child: children, above, below };
        tree.no_loops()?;
        Ok(tree)
    }

    /// Refuses loops; all later steps assume a tree.
    fn no_loops(&self) -> Result<()> {
        let links = &self.robot.links;
        let mut ends = vec![false; links.len()];
        for (start, link) in links.iter().enumerate() {
            let (mut at, mut way) = (start, Vec::new());
            while !ends[at] {
                way.push(at);
                if way.len() > links.len() {
                    let place = format!("link \"{}\"", link.name);
                    return Err(self.robot.error(link.line, place, "is part of a loop of joints"));
                }
                match self.above[at] {
                    Some(joint) => at = self.parent[joint],
                    None => break,
                }
            }
            way.into_iter().for_each(|link| ends[link] = true);
        }
        Ok(())
    }

    /// The link of this name; `role` appears in the error.
    pub fn link_called(&self, name: &str, role: &str) -> Result<usize> {
        if let Some(index) = self.links.get(name) {
            return Ok(*index);
        }
        let known: Vec<_> = self.robot.links.iter().map(|link| link.name.as_str()).collect();
        let problem = format!("has no link \"{name}\" for the {role}; its links are {}", listed(known));
        self.robot.refuse(problem)
    }

    /// Joints with this link as parent.
    pub fn joints_of(&self, link: usize) -> impl Iterator<Item = (usize, &RobotJoint)> {
        self.below[link].iter().map(|index| (*index, &self.robot.joints[*index]))
    }

    /// The link from which everything hangs: `base`, else the child of the only floating joint, else the only link without parent.
    ///
    /// # Errors
    /// An unknown link, or several links without parent.
    pub fn root(&self, base: Option<&str>) -> Result<usize> {
        if let Some(name) = base {
            return self.link_called(name, "base");
        }
        // A link without mass and joints, such as the world above a floating vehicle, is no root.
        let links = &self.robot.links;
        let stands_alone = |i: usize| self.below[i].is_empty() && links[i].inertial.is_none();
        let mut roots: Vec<_> = (0..links.len()).filter(|i| self.above[*i].is_none()).collect();
        if roots.iter().any(|&i| self.floats(i)) {
            roots.retain(|&i| self.floats(i));
        } else if roots.iter().any(|&i| !stands_alone(i)) {
            roots.retain(|&i| !stands_alone(i));
        }
        match roots[..] {
            [root] => Ok(root),
            _ => {
                let names: Vec<_> = roots.iter().map(|i| links[*i].name.as_str()).collect();
                let problem =
                    format!("has several links without parent ({}): choose the base with --base", listed(names));
                self.robot.refuse(problem)
            }
        }
    }

    /// True if a floating joint carries the link.
    pub fn floats(&self, link: usize) -> bool {
        let floating =
            |(i, joint): (usize, &RobotJoint)| joint.kind == RobotJointKind::Floating && self.child[i] == link;
        self.robot.joints.iter().enumerate().any(floating)
    }

    /// Links below and including `root`, each after its parent.
    pub fn order(&self, root: usize) -> Vec<usize> {
        let (mut order, mut open) = (Vec::new(), vec![root]);
        while let Some(link) = open.pop() {
            order.push(link);
            open.extend(self.below[link].iter().rev().map(|joint| self.child[*joint]));
        }
        order
    }
}
