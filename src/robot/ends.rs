//! End effectors: the links that arms end in, and fingers beyond them.

use std::collections::HashSet;

use super::element::Result;
use super::merge::Part;
use super::tree::Tree;
use crate::description::Frame;

/// Largest number of joints in a row of a finger.
const FINGER: usize = 3;
/// Parts of the names of frames that mark an end effector.
const TOOLS: [&str; 9] = ["tool", "tcp", "tip", "ee", "eef", "effector", "grasp", "hand", "gripper"];

/// An end effector: its name, the moving part that carries it and its frame there.
pub struct End {
    pub name: String,
    pub part: usize,
    pub frame: Frame,
}

/// Parts that each part carries.
pub fn children(parts: &[Part]) -> Vec<Vec<usize>> {
    let mut children = vec![Vec::new(); parts.len()];
    for (i, part) in parts.iter().enumerate().skip(1) {
        children[part.carrier].push(i);
    }
    children
}

/// Joints in the longest row that begins with each part's.
fn heights(parts: &[Part]) -> Vec<usize> {
    let mut heights = vec![1; parts.len()];
    for (i, part) in parts.iter().enumerate().skip(1).rev() {
        heights[part.carrier] = heights[part.carrier].max(heights[i] + 1);
    }
    heights
}

/// For each part, true if it belongs to a finger: short rows of joints side by side on a hand, and joints that follow others.
pub fn is_finger(tree: &Tree, parts: &[Part]) -> Vec<bool> {
    let (children, heights) = (children(parts), heights(parts));
    let follows = |i: usize| parts[i].joint.is_some_and(|j| tree.robot.joints[j].mimic.is_some());
    let short = |list: &Vec<usize>| list.iter().filter(|k| heights[**k] <= FINGER).count();
    let short: Vec<usize> = children.iter().map(short).collect();
    let mut finger = vec![false; parts.len()];
    for i in 1..parts.len() {
        let carrier = parts[i].carrier;
        let on_hand = carrier != 0 && heights[i] <= FINGER && short[carrier] > 1;
        finger[i] = finger[carrier] || on_hand || follows(i);
    }
    finger
}

/// End effectors by default: each end of the tree that is no finger, the longest arm's first.
fn default_parts(tree: &Tree, parts: &[Part]) -> Vec<usize> {
    let finger = is_finger(tree, parts);
    let carries: Vec<bool> =
        (0..parts.len()).map(|i| (1..parts.len()).any(|k| parts[k].carrier == i && !finger[k])).collect();
    let mut ends: Vec<usize> = (1..parts.len()).filter(|i| !finger[*i] && !carries[*i]).collect();
    let mut depth = vec![0; parts.len()];
    for i in 1..parts.len() {
        depth[i] = depth[parts[i].carrier] + 1;
    }
    let longest = ends.iter().map(|i| depth[*i]).max().unwrap_or(0);
    // A camera's pan or tilt beside an arm is no arm.
    ends.retain(|i| depth[*i] > 1 || longest == 1);
    ends.sort_by_key(|i| std::cmp::Reverse(depth[*i]));
    if ends.is_empty() { vec![0] } else { ends }
}

/// Link of a part whose frame is the end effector's: the only frame called so, else the last link in the only row.
fn tool(tree: &Tree, part: &Part) -> usize {
    let links = &tree.robot.links;
    let is_tool = |i: usize| {
        let name = links[i].name.to_lowercase();
        name.split(|c: char| !c.is_alphabetic()).any(|word| TOOLS.contains(&word))
    };
    let within: HashSet<usize> = part.links.iter().map(|(link, _)| *link).collect();
    let mut at = part.links[0].0;
    loop {
        let next: Vec<usize> = tree.below[at].iter().map(|j| tree.child[*j]).filter(|i| within.contains(i)).collect();
        match next[..] {
            [only] => at = only,
            [] => return at,
            _ => break,
        }
    }
    let mut called = part.links.iter().map(|(i, _)| *i).filter(|i| is_tool(*i) && links[*i].inertial.is_none());
    match (called.next(), called.next()) {
        (Some(only), None) => only,
        _ => at,
    }
}

/// End effectors: the ones that the user names, else the default ones.
///
/// # Errors
/// Links that are unknown or that belong to no part.
pub fn ends(tree: &Tree, parts: &[Part], tips: &[(String, String)], notes: &mut Vec<String>) -> Result<Vec<End>> {
    let place = |link: usize| {
        let of = |(i, part): (usize, &Part)| part.links.iter().find(|(at, _)| *at == link).map(|(_, f)| (i, f.clone()));
        parts.iter().enumerate().find_map(of)
    };
    if tips.is_empty() {
        let (chosen, mut ends) = (default_parts(tree, parts), Vec::new());
        for part in chosen {
            let link = tool(tree, &parts[part]);
            let name = &tree.robot.links[link].name;
            let (part, frame) = place(link).expect("a link of the part");
            let role = if ends.is_empty() { "the end effector" } else { "a further end effector" };
            notes.push(format!("{name}: {role}, as the end of the tree: choose others with --tip"));
            ends.push(End { name: name.clone(), part, frame });
        }
        return Ok(ends);
    }
    let mut ends = Vec::new();
    for (name, link) in tips {
        let index = tree.link_called(link, "tip")?;
        let Some((part, frame)) = place(index) else {
            let base = &tree.robot.links[parts[0].links[0].0].name;
            let problem = format!("is not a descendant of the base link \"{base}\"");
            return tree.robot.fault(tree.robot.links[index].line, &format!("link \"{link}\""), problem);
        };
        ends.push(End { name: name.clone(), part, frame });
    }
    Ok(ends)
}
