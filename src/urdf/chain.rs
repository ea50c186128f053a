//! The serial chain between two links of a tree.

use super::element::Result;
use super::file::{JointType, Robot, UrdfJoint};

/// Joints from a base link to a tip link, including fixed ones.
pub struct Chain {
    pub base: usize,
    pub tip: usize,
    /// Indices of the joints.
    pub joints: Vec<usize>,
    /// For each joint of the robot, true where it is one of them.
    pub has: Vec<bool>,
}

impl Robot {
    fn link_called(&self, name: &str, role: &str) -> Result<usize> {
        if let Some(index) = self.links.iter().position(|link| link.name == name) {
            return Ok(index);
        }
        let known: Vec<_> = self.links.iter().map(|link| link.name.as_str()).collect();
        let problem = format!("has no link \"{name}\" for the {role}; its links are {}", known.join(", "));
        self.fault(1, "<robot>", problem)
    }

    /// Joints with this link as parent.
    pub fn joints_of(&self, link: usize) -> impl Iterator<Item = (usize, &UrdfJoint)> {
        self.below[link].iter().map(|index| (*index, &self.joints[*index]))
    }

    /// For each joint, true where it or a joint behind it moves.
    fn moving(&self) -> Vec<bool> {
        let mut moving = vec![false; self.joints.len()];
        for start in (0..self.joints.len()).filter(|i| self.joints[*i].kind != JointType::Fixed) {
            let mut next = Some(start);
            while let Some(joint) = next.filter(|joint| !moving[*joint]) {
                moving[joint] = true;
                next = self.above[self.joints[joint].parent];
            }
        }
        moving
    }

    /// Refuses loops; all later steps assume a tree.
    fn no_loops(&self) -> Result<()> {
        let mut ends = vec![false; self.links.len()];
        for (start, link) in self.links.iter().enumerate() {
            let (mut at, mut way) = (start, Vec::new());
            while !ends[at] {
                way.push(at);
                if way.len() > self.links.len() {
                    return self.fault(1, &format!("link \"{}\"", link.name), "is part of a loop of joints");
                }
                match self.above[at] {
                    Some(joint) => at = self.joints[joint].parent,
                    None => break,
                }
            }
            way.into_iter().for_each(|link| ends[link] = true);
        }
        Ok(())
    }

    fn root(&self) -> Result<usize> {
        // A link without mass and joints, such as the world above a floating vehicle, is no root.
        let stands_alone = |i: usize| self.below[i].is_empty() && self.links[i].inertial.is_none();
        let mut roots: Vec<_> = (0..self.links.len()).filter(|i| self.above[*i].is_none()).collect();
        if roots.iter().any(|&i| !stands_alone(i)) {
            roots.retain(|&i| !stands_alone(i));
        }
        match roots[..] {
            [root] => Ok(root),
            _ => {
                let names: Vec<_> = roots.iter().map(|i| self.links[*i].name.as_str()).collect();
                let problem = format!("has several links without parent ({}): choose the base", names.join(", "));
                self.fault(1, "<robot>", problem)
            }
        }
    }

    /// The chain from `base` (default: the root) to `tip` (default: the only end).
    pub fn chain(&self, base: Option<&str>, tip: Option<&str>) -> Result<Chain> {
        self.no_loops()?;
        let base = match base {
            Some(name) => self.link_called(name, "base")?,
            None => self.root()?,
        };
        let (joints, tip) = match tip {
            Some(name) => {
                let tip = self.link_called(name, "tip")?;
                (self.path(base, tip)?, tip)
            }
            None => self.only_path(base)?,
        };
        if let Some(joint) = joints.iter().map(|i| &self.joints[*i]).find(|joint| joint.mimic) {
            let element = format!("joint \"{}\" <mimic>", joint.name);
            return self.fault(joint.line, &element, "mimic joints are not supported");
        }
        let mut has = vec![false; self.joints.len()];
        joints.iter().for_each(|joint| has[*joint] = true);
        Ok(Chain { base, tip, joints, has })
    }

    fn path(&self, base: usize, tip: usize) -> Result<Vec<usize>> {
        let mut joints = Vec::new();
        let mut at = tip;
        while at != base {
            let Some(up) = self.above[at] else {
                let (base, tip) = (&self.links[base].name, &self.links[tip].name);
                let problem = format!("is not a descendant of the base link \"{base}\"");
                return self.fault(1, &format!("link \"{tip}\""), problem);
            };
            joints.push(up);
            at = self.joints[up].parent;
        }
        joints.reverse();
        Ok(joints)
    }

    /// Follows the only moving branch, else the only branch.
    fn only_path(&self, base: usize) -> Result<(Vec<usize>, usize)> {
        let (mut joints, all_moving) = (Vec::new(), self.moving());
        let mut at = base;
        loop {
            let branches: Vec<_> = self.joints_of(at).map(|(i, _)| i).collect();
            let moving: Vec<_> = branches.iter().copied().filter(|i| all_moving[*i]).collect();
            let choice = if moving.is_empty() { &branches } else { &moving };
            match choice[..] {
                [] => return Ok((joints, at)),
                [one] => {
                    joints.push(one);
                    at = self.joints[one].child;
                }
                _ => {
                    let way = |UrdfJoint { name, child, .. }: &UrdfJoint| {
                        format!("\"{}\" by joint \"{name}\"", self.links[*child].name)
                    };
                    let ways: Vec<_> = choice.iter().map(|i| way(&self.joints[*i])).collect();
                    let problem = format!("the chain branches here, to {}: choose the tip", ways.join(" and to "));
                    let line = self.joints[choice[1]].line;
                    return self.fault(line, &format!("link \"{}\"", self.links[at].name), problem);
                }
            }
        }
    }
}
