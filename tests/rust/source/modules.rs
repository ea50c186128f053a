//! Rust files read as modules: what each defines and imports, and where a path leads.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use super::files;

/// An import: its path, the name that it gives, and whether it is a re-export.
#[derive(Debug, Clone, PartialEq)]
pub struct Import {
    pub path: Vec<String>,
    pub name: String,
    pub public: bool,
}

/// A file as a module.
#[derive(Debug, Default)]
pub struct Module {
    pub file: String,
    /// Names of functions, types, constants and macros defined at its top level.
    pub defined: BTreeSet<String>,
    pub imports: Vec<Import>,
    /// Code without imports, as words and `::`.
    pub tokens: Vec<String>,
}

/// Modules of a crate by path from its root.
pub type Crate = BTreeMap<Vec<String>, Module>;

/// Code without comments.
fn code(text: &str) -> String {
    text.lines().map(|line| line.split("//").next().unwrap_or("").to_owned() + "\n").collect()
}

/// Words, `::` and single other characters.
fn tokens(code: &str) -> Vec<String> {
    let mut tokens = Vec::new();
    let mut rest = code;
    while let Some(first) = rest.chars().next() {
        let word = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
        let length = if word > 0 {
            word
        } else if rest.starts_with("::") {
            2
        } else {
            first.len_utf8()
        };
        if !first.is_whitespace() {
            tokens.push(rest[..length].to_owned());
        }
        rest = &rest[length..];
    }
    tokens
}

/// Paths of a use tree and the name that each gives; `*` for a glob.
fn expand(tree: &[String], before: &[String], paths: &mut Vec<(Vec<String>, String)>) {
    let brace = tree.iter().position(|token| token == "{");
    let Some(brace) = brace else {
        let mut path = before.to_vec();
        let mut words = tree.iter().filter(|token| *token != "::");
        let mut name = None;
        while let Some(word) = words.next() {
            match word.as_str() {
                "as" => name = words.next().cloned(),
                _ => path.push(word.clone()),
            }
        }
        if path.len() > before.len() {
            // `a::{self}` gives a.
            if path.last().is_some_and(|last| last == "self") && path.len() > 1 {
                path.pop();
            }
            let name = name.unwrap_or_else(|| path.last().expect("never empty").clone());
            paths.push((path, name));
        }
        return;
    };
    let mut stem = before.to_vec();
    stem.extend(tree[..brace].iter().filter(|token| *token != "::").cloned());
    let (mut depth, mut start) = (0, brace + 1);
    for (at, token) in tree.iter().enumerate().skip(brace) {
        match token.as_str() {
            "{" => depth += 1,
            "}" => depth -= 1,
            _ => {}
        }
        if (token == "," && depth == 1) || (token == "}" && depth == 0) {
            expand(&tree[start..at], &stem, paths);
            start = at + 1;
        }
    }
}

/// A path as seen from the file, written in a module `within` levels below it.
fn outside(path: &mut Vec<String>, within: usize) {
    for _ in 0..within {
        if path[0] == "super" {
            path.remove(0);
            if path[0] != "super" {
                path.insert(0, "self".to_owned());
            }
        }
    }
}

impl Module {
    pub fn read(file: String, text: &str) -> Self {
        // Unit tests, if there are any, follow the code.
        let text = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or("");
        let all = tokens(&code(text));
        let mut module = Self { file, ..Self::default() };
        let (mut depth, mut at) = (0, 0);
        // Depths of the modules written within the file that enclose the place; `super` in the first is the file itself.
        let mut within: Vec<i32> = Vec::new();
        while at < all.len() {
            let token = all[at].as_str();
            match token {
                "{" => depth += 1,
                "}" => {
                    depth -= 1;
                    within.retain(|module| *module <= depth);
                }
                "mod" if all.get(at + 2).is_some_and(|token| token == "{") => {
                    module.defined.insert(all[at + 1].clone());
                    within.push(depth + 1);
                }
                "use" => {
                    let end = at + all[at..].iter().position(|token| token == ";").unwrap_or(all.len() - at);
                    let public = at > 0 && (all[at - 1] == "pub" || all[at - 1] == ")");
                    let mut paths = Vec::new();
                    expand(&all[at + 1..end], &[], &mut paths);
                    for (path, _) in &mut paths {
                        outside(path, within.len());
                    }
                    // A glob of the file itself.
                    paths.retain(|(path, _)| *path != ["self", "*"]);
                    module.imports.extend(paths.into_iter().map(|(path, name)| Import { path, name, public }));
                    at = end + 1;
                    continue;
                }
                "fn" | "struct" | "enum" | "trait" | "type" | "const" | "static" | "union" if depth == 0 => {
                    if let Some(name) = all.get(at + 1) {
                        module.defined.insert(name.clone());
                    }
                }
                "macro_rules" if depth == 0 => {
                    module.defined.insert(all[at + 2].clone());
                }
                _ => {}
            }
            let inner = !within.is_empty() && token == "super";
            module.tokens.push(if inner { "self".to_owned() } else { token.to_owned() });
            at += 1;
        }
        module
    }

    /// Paths in the code besides imports: `crate::a::b`, `super::a`, `a::b`.
    pub fn paths(&self) -> Vec<Vec<String>> {
        let mut paths = Vec::new();
        for at in 0..self.tokens.len() {
            let before = if at == 0 { "" } else { &self.tokens[at - 1] };
            let follows = |at: usize| self.tokens.get(at).is_some_and(|token| token == "::");
            if before == "::" || before == "$" || !follows(at + 1) {
                continue;
            }
            let mut path = vec![self.tokens[at].clone()];
            let mut next = at + 1;
            while follows(next) {
                path.extend(self.tokens.get(next + 1).cloned());
                next += 2;
            }
            paths.push(path);
        }
        paths
    }
}

/// Modules of the crate whose root file lies in `folder`, without the crates below it.
pub fn read(folder: &Path) -> Crate {
    let mut modules = Crate::new();
    for file in files(folder) {
        let name = file.strip_prefix(folder).unwrap().to_str().unwrap().to_owned();
        let below = name.rsplit_once('/').is_some_and(|(parent, _)| {
            let parents = Path::new(parent).ancestors().filter(|parent| parent.file_name().is_some());
            parents.into_iter().any(|parent| folder.join(parent).join("Cargo.toml").exists())
        });
        if below || name.ends_with("tests.rs") {
            continue;
        }
        let mut path: Vec<String> = name.trim_end_matches(".rs").split('/').map(str::to_owned).collect();
        if path.last().is_some_and(|last| last == "mod" || last == "lib") {
            path.pop();
        }
        let text = fs::read_to_string(&file).unwrap();
        modules.insert(path, Module::read(name, &text));
    }
    modules
}

/// Where a path leads.
#[derive(Debug, Clone, PartialEq)]
pub enum Target {
    Module(Vec<String>),
    /// A name and the module that defines it.
    Item(Vec<String>),
}

/// Follows `path` as written in the module `here`; `None` where it leaves the crate.
pub fn resolve(modules: &Crate, here: &[String], path: &[String], depth: usize) -> Option<Target> {
    let (mut at, mut rest) = match path.first()?.as_str() {
        "crate" => (Vec::new(), &path[1..]),
        "self" => (here.to_vec(), &path[1..]),
        "super" => (here[..here.len().saturating_sub(1)].to_vec(), &path[1..]),
        _ => (here.to_vec(), path),
    };
    while rest.first().is_some_and(|word| word == "super") {
        at.pop();
        rest = &rest[1..];
    }
    for (k, word) in rest.iter().enumerate() {
        let child = [&at[..], std::slice::from_ref(word)].concat();
        if modules.contains_key(&child) {
            at = child;
            continue;
        }
        // What follows a type (an associated function, a variant) lies where the type does.
        if modules.get(&at)?.defined.contains(word) {
            return Some(Target::Item(at));
        }
        if depth > 8 {
            return None;
        }
        let imports = &modules[&at].imports;
        let named =
            imports.iter().filter(|import| import.name == *word && import.path != path[..=k.min(path.len() - 1)]);
        let globs = imports.iter().filter(|import| import.name == "*").map(|import| {
            let mut path = import.path.clone();
            *path.last_mut().expect("never empty") = word.clone();
            path
        });
        let paths: Vec<Vec<String>> = named.map(|import| import.path.clone()).chain(globs).collect();
        let target = paths.iter().find_map(|path| resolve(modules, &at, path, depth + 1))?;
        match target {
            Target::Item(_) => return Some(target),
            Target::Module(module) => at = module,
        }
    }
    Some(Target::Module(at))
}
