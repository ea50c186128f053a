//! Dotted paths into a scene: `vehicle.body.mass`, `arm.links[2].body.added_mass[0]`, `arm.links[elbow].body`.

use toml::Value;

/// One step of a path.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Step {
    /// A table's key.
    Key(String),
    /// A list element, by index or by its `name`.
    Element(String),
}

/// Splits `a.b[2].c` into its steps.
pub fn parse(path: &str) -> Vec<Step> {
    let mut steps = Vec::new();
    let mut rest = path;
    while !rest.is_empty() {
        if let Some((element, after)) = rest.strip_prefix('[').and_then(|r| r.split_once(']')) {
            steps.push(Step::Element(element.to_owned()));
            rest = after;
        } else {
            rest = rest.strip_prefix('.').unwrap_or(rest);
            let end = rest.find(['.', '[']).filter(|&end| end > 0).unwrap_or(rest.len());
            steps.push(Step::Key(rest[..end].to_owned()));
            rest = &rest[end..];
        }
    }
    steps
}

/// `name` of a list element.
pub fn name_of(element: &Value) -> Option<&str> {
    element.get("name").and_then(Value::as_str)
}

/// Index of a list element given by index or name.
fn index_of(list: &[Value], element: &str) -> Option<usize> {
    element.parse().ok().filter(|&i| i < list.len()).or_else(|| list.iter().position(|e| name_of(e) == Some(element)))
}

/// Child of a node by one step, and the step with its name replaced by an index.
fn child<'a>(node: &'a Value, step: &Step) -> Option<(&'a Value, Step)> {
    match (step, node) {
        (Step::Key(key), Value::Table(table)) => Some((table.get(key)?, step.clone())),
        (Step::Element(element), Value::Array(list)) => {
            let i = index_of(list, element)?;
            Some((&list[i], Step::Element(i.to_string())))
        }
        _ => None,
    }
}

/// The path with every name replaced by an index, and the value there; None if there is none.
pub fn resolve<'a>(root: &'a Value, path: &str) -> Option<(Vec<Step>, &'a Value)> {
    let mut node = root;
    let mut steps = Vec::new();
    for step in parse(path) {
        let (next, step) = child(node, &step)?;
        node = next;
        steps.push(step);
    }
    Some((steps, node))
}

/// True if a pattern matches any node. A list without an element in the pattern stands for all of its elements.
pub fn matches_anything(pattern: &[Step], node: &Value) -> bool {
    match (pattern.split_first(), node) {
        (None, _) => true,
        (Some((Step::Key(_), _)), Value::Array(list)) => list.iter().any(|e| matches_anything(pattern, e)),
        (Some((step, rest)), _) => child(node, step).is_some_and(|(next, _)| matches_anything(rest, next)),
    }
}

/// Number of steps of the resolved path that `pattern` covers as a prefix, and number of elements that it names; None if it does
/// not match.
pub fn coverage(pattern: &[Step], path: &[Step], root: &Value) -> Option<(usize, usize)> {
    let mut node = root;
    let mut covered = 0;
    let mut elements = 0;
    for step in pattern {
        if let (Step::Key(_), Some(element @ Step::Element(_))) = (step, path.get(covered)) {
            node = child(node, element)?.0;
            covered += 1;
        }
        let (next, resolved) = child(node, step)?;
        if path.get(covered) != Some(&resolved) {
            return None;
        }
        node = next;
        covered += 1;
        elements += usize::from(matches!(step, Step::Element(_)));
    }
    Some((covered, elements))
}

/// Passes every node below `node`, lists as a whole where `is_leaf` says so, with its path.
fn walk(node: &Value, path: String, is_leaf: fn(&Value) -> bool, visit: &mut impl FnMut(String, &Value)) {
    match node {
        leaf if is_leaf(leaf) => visit(path, leaf),
        Value::Array(list) => {
            list.iter().enumerate().for_each(|(i, e)| walk(e, format!("{path}[{i}]"), is_leaf, visit));
        }
        Value::Table(table) => table.iter().for_each(|(key, e)| walk(e, join(&path, key), is_leaf, visit)),
        _ => {}
    }
}

/// Every number below `node`, with its path.
pub fn numbers(node: &Value) -> Vec<(String, f64)> {
    let mut out = Vec::new();
    walk(node, String::new(), |leaf| leaf.is_float() || leaf.is_integer(), &mut |path, leaf| {
        let number = leaf.as_float().or(leaf.as_integer().map(|i| i as f64));
        out.extend(number.map(|x| (path, x)));
    });
    out
}

/// Every key below `node` that holds numbers: one, or a list of them.
pub fn keys(node: &Value) -> Vec<String> {
    fn is_leaf(node: &Value) -> bool {
        node.is_float() || node.is_integer() || node.as_array().is_some_and(|list| !list.iter().any(Value::is_table))
    }
    let mut out = Vec::new();
    walk(node, String::new(), is_leaf, &mut |path, _| out.push(path));
    out
}

/// Sets the value at a path, whose last key may be new to its table; false where there is no such table or list element.
pub fn set(root: &mut Value, path: &str, value: Value) -> bool {
    let steps = parse(path);
    let Some((last, before)) = steps.split_last() else { return false };
    let mut node = root;
    for step in before {
        let next = match (step, node) {
            (Step::Key(key), Value::Table(table)) => table.get_mut(key),
            (Step::Element(element), Value::Array(list)) => index_of(list, element).and_then(move |i| list.get_mut(i)),
            _ => None,
        };
        let Some(next) = next else { return false };
        node = next;
    }
    match (last, node) {
        (Step::Key(key), Value::Table(table)) => {
            table.insert(key.clone(), value);
            true
        }
        (Step::Element(element), Value::Array(list)) => {
            let place = index_of(list, element).and_then(|i| list.get_mut(i));
            place.map(|place| *place = value).is_some()
        }
        _ => false,
    }
}

/// `path.key`.
pub fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}

/// The path with further steps.
pub fn below(path: String, steps: &[Step]) -> String {
    steps.iter().fold(path, |path, step| match step {
        Step::Key(key) => join(&path, key),
        Step::Element(element) => format!("{path}[{element}]"),
    })
}

/// The path, followed by the names of the list elements on it: `arm.links[2].body.mass (elbow)`.
pub fn with_names(root: &Value, path: &str) -> String {
    let mut node = root;
    let mut names = Vec::new();
    for step in parse(path) {
        let Some((next, _)) = child(node, &step) else { break };
        node = next;
        if matches!(step, Step::Element(_)) {
            names.extend(name_of(node));
        }
    }
    if names.is_empty() { path.to_owned() } else { format!("{path} ({})", names.join(", ")) }
}

/// A value in one short line, for messages.
pub fn short(value: &Value) -> String {
    const LONGEST: usize = 100;
    let text = value.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{} ...", &text[..end]),
        None => text,
    }
}
