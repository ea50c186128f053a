//! Imports between the files of a crate form no circle.
//!
//! A file depends on the files that define the names it imports: re-exports (`pub use`) are followed to the definition,
//! and are no dependency of the file that holds them. Names behind an imported module (`use super::tables`, then
//! `tables::plate`) and behind a glob count where the file uses them.

use std::collections::{BTreeMap, BTreeSet};

use super::modules::{Crate, Module, Target, read, resolve};
use super::source;

/// Files that the module `here` depends on.
fn dependencies(modules: &Crate, here: &[String]) -> BTreeSet<String> {
    let module = &modules[here];
    let mut found = BTreeSet::new();
    let mut add = |path: &[String]| {
        if let Some(Target::Item(at)) = resolve(modules, here, path, 0) {
            found.insert(modules[&at].file.clone());
        }
    };
    for import in module.imports.iter().filter(|import| !import.public) {
        if import.name == "*" {
            let mut path = import.path.clone();
            for word in module.tokens.iter().collect::<BTreeSet<_>>() {
                *path.last_mut().expect("never empty") = word.clone();
                if path[path.len() - 1] != "*" && !module.defined.contains(word) {
                    add(&path);
                }
            }
        } else {
            add(&import.path);
        }
    }
    module.paths().iter().collect::<BTreeSet<_>>().into_iter().for_each(|path| add(path));
    found.remove(&module.file);
    found
}

/// Files of each circle: those that reach each other.
fn circles(modules: &Crate) -> Vec<Vec<String>> {
    let direct: BTreeMap<String, BTreeSet<String>> =
        modules.iter().map(|(path, module)| (module.file.clone(), dependencies(modules, path))).collect();
    let reach = |from: &String| {
        let mut seen = BTreeSet::new();
        let mut todo = vec![from];
        while let Some(file) = todo.pop() {
            for next in &direct[file] {
                if seen.insert(next.clone()) {
                    todo.push(next);
                }
            }
        }
        seen
    };
    let reached: BTreeMap<&String, BTreeSet<String>> = direct.keys().map(|file| (file, reach(file))).collect();
    let mut circles = BTreeSet::new();
    for (file, seen) in &reached {
        if seen.contains(*file) {
            circles.insert(seen.iter().filter(|other| reached[other].contains(*file)).cloned().collect());
        }
    }
    circles.into_iter().collect()
}

#[test]
fn imports_between_files_form_no_circle() {
    let library = read(&source());
    let mut python = read(&source().join("python"));
    python.values_mut().for_each(|module| module.file.insert_str(0, "python/"));
    let count: usize = library.keys().map(|path| dependencies(&library, path).len()).sum();
    assert!(count > 200, "only {count} dependencies seen");
    let found = [circles(&library), circles(&python)].concat();
    assert!(found.is_empty(), "{found:#?}");
}

fn example(files: &[(&str, &str)]) -> Crate {
    files
        .iter()
        .map(|(path, text)| {
            let file = if path.is_empty() { "lib.rs".to_owned() } else { format!("{path}.rs") };
            let path = path.split("::").filter(|name| !name.is_empty()).map(str::to_owned).collect();
            (path, Module::read(file, text))
        })
        .collect()
}

#[test]
fn a_circle_is_found_through_re_exports_modules_and_globs() {
    let root = ("", "pub mod room;");
    let door = ("room", "mod one;\nmod two;\npub use one::One;\npub use two::{Two, helper as help};");
    let two = ("room::two", "use super::One;\npub struct Two(One);\npub fn helper() {}");
    let with = |one: &str| circles(&example(&[root, door, ("room::one", one), two]));
    let circle = vec![vec!["room::one.rs".to_owned(), "room::two.rs".to_owned()]];
    assert!(with("pub struct One;").is_empty());
    for one in [
        "use super::Two;\npub struct One;",
        "use crate::room::Two;\npub struct One;",
        "use crate::{room::{Two as Other}};\npub struct One;",
        "use super::two;\npub struct One;\nfn f() { two::helper() }",
        "use super::two::*;\npub struct One;\nfn f() { helper() }",
        "pub struct One;\nfn f() { super::help() }",
        "pub struct One;\nmod inner { use super::super::Two; }",
        "pub struct One;\nfn f() { let x = crate::room::Two::new(); }",
    ] {
        assert_eq!(with(one), circle, "{one}");
    }
    // A comment, a module within the file and a module that nothing is taken from are no imports.
    assert!(with("pub struct One;\npub struct Two;\nmod inner { use super::{One, Two}; use super::*; }").is_empty());
    assert!(with("// use super::Two;\nuse super::two;\npub struct One;").is_empty());
}

#[test]
fn a_module_that_its_children_import_from_is_in_a_circle_with_them() {
    let parent = "mod child;\nuse child::Child;\npub struct Parent(Child);";
    let child = "use super::Parent;\npub struct Child;";
    let crate_of = |child| example(&[("", "mod room;"), ("room", parent), ("room::child", child)]);
    assert_eq!(circles(&crate_of(child)), [["room.rs", "room::child.rs"].map(str::to_owned).to_vec()]);
    assert!(circles(&crate_of("pub struct Child;")).is_empty());
}
