//! The layers of `src/lib.rs`, enforced: imports go strictly downward, and `unsafe` stays among the lanes and where their
//! working memory is made.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use super::{files, source};

/// Layers, lowest first, and what each may import. Every layer may import `error`.
const LAYERS: [(&str, &str); 24] = [
    ("lane", ""),
    ("error", "lane"),
    ("limits", ""),
    ("lie", "lane"),
    ("spatial", "lane lie"),
    ("hydro", "lane lie spatial"),
    ("contact", "lane lie"),
    ("keys", ""),
    ("terms", "lane lie keys"),
    ("description", "keys terms"),
    ("estimate", "keys description"),
    ("robot", "keys description estimate"),
    ("system", "lane lie spatial hydro contact terms description"),
    ("dynamics", "lane lie spatial hydro contact terms description system"),
    ("integrate", "lane lie"),
    ("render", "lane lie description system"),
    ("optimize", "limits"),
    ("control", "lane limits lie spatial description system dynamics optimize"),
    ("task", "lane limits lie spatial hydro keys description system dynamics control"),
    ("sensors", "lie keys task"),
    ("navigation", "lie sensors"),
    ("batch", "lane limits lie spatial hydro terms description system dynamics integrate control task"),
    ("planning", "lane limits lie system batch optimize"),
    (
        "python",
        "optimize planning lane limits lie spatial hydro terms description system dynamics integrate control task batch estimate \
         robot render sensors navigation",
    ),
];

/// Layer of a file: `src/lie/so3.rs` and `src/lie.rs` belong to `lie`.
fn layer(file: &Path) -> String {
    let first = file.strip_prefix(source()).unwrap().components().next().unwrap();
    first.as_os_str().to_str().unwrap().trim_end_matches(".rs").to_owned()
}

/// Code without comments.
fn code(text: &str) -> String {
    text.lines().map(|line| line.split("//").next().unwrap_or("").to_owned() + "\n").collect()
}

/// First names after `crate::`, or after `uvms_gym::` in the Python crate, `{` for a list of names.
fn imports(layer: &str, text: &str) -> BTreeSet<String> {
    let root = if layer == "python" { "uvms_gym::" } else { "crate::" };
    let code = code(text);
    let within = |c: char| c.is_alphanumeric() || c == '_' || c == '$';
    let starts = code.match_indices(root).filter(|(at, _)| !code[..*at].ends_with(within));
    let names = starts.map(|(at, _)| {
        let rest = &code[at + root.len()..];
        if rest.starts_with('{') { "{" } else { rest.split(|c| !within(c)).next().unwrap_or("") }
    });
    names.filter(|name| *name == "{" || LAYERS.iter().any(|(layer, _)| layer == name)).map(str::to_owned).collect()
}

/// Imports that the table does not allow.
fn upward(layer: &str, text: &str) -> Vec<String> {
    let Some((_, allowed)) = LAYERS.iter().find(|(name, _)| *name == layer) else {
        return vec![format!("{layer} is no layer")];
    };
    let allows = |name: &str| name == layer || name == "error" || allowed.split(' ').any(|other| other == name);
    imports(layer, text).into_iter().filter(|name| !allows(name)).collect()
}

#[test]
fn imports_go_downward_only() {
    let mut seen = 0;
    for file in files(&source()) {
        let layer = layer(&file);
        if layer == "lib" {
            continue;
        }
        let text = fs::read_to_string(&file).unwrap();
        let bad = upward(&layer, &text);
        assert!(bad.is_empty(), "{}: {layer} imports {bad:?}; one layer a line", file.display());
        seen += imports(&layer, &text).len();
    }
    assert!(seen > 50, "only {seen} imports seen");
}

#[test]
fn the_table_allows_only_layers_below() {
    for (i, (layer, allowed)) in LAYERS.iter().enumerate() {
        let below = |name: &str| LAYERS[..i].iter().any(|(lower, _)| *lower == name);
        assert!(allowed.split_whitespace().all(below), "{layer}");
    }
}

#[test]
fn an_upward_import_is_seen() {
    assert_eq!(upward("lie", "use crate::batch::Simulator;"), ["batch"]);
    assert_eq!(upward("control", "    let x = crate::task::layout();"), ["task"]);
    assert_eq!(upward("integrate", "use crate::{lane::Lane, hydro::{Drag, lie}, error};"), ["{"]);
    assert!(upward("python", "use uvms_gym::task::Task; use crate::task::Task;").is_empty());
    assert!(upward("task", "use crate::control::Pd; // crate::batch").is_empty());
    assert!(upward("lane", "$crate::batch::Simulator::new()").is_empty());
}

#[test]
fn every_layer_of_the_crate_is_in_the_table_and_in_its_drawing() {
    let lib = fs::read_to_string(source().join("lib.rs")).unwrap();
    for file in files(&source()) {
        let layer = layer(&file);
        assert!(layer == "lib" || LAYERS.iter().any(|(name, _)| *name == layer), "{layer}");
        if layer != "lib" && layer != "error" {
            let drawn = |line: &str| line.strip_prefix("//! ").is_some_and(|l| l.split(' ').next() == Some(&layer));
            assert!(lib.lines().any(drawn), "{layer} is not drawn in lib.rs");
        }
    }
}

#[test]
fn only_the_lanes_and_their_memory_are_unsafe_and_only_python_names_python() {
    for file in files(&source()) {
        let layer = layer(&file);
        let text = fs::read_to_string(&file).unwrap();
        for (number, line) in code(&text).lines().enumerate() {
            let words: Vec<&str> = line.split(|c: char| !c.is_alphanumeric() && c != '_').collect();
            let place = format!("{}:{}", file.display(), number + 1);
            let may = layer == "lane" || file.ends_with("batch/stepping/step.rs");
            assert!(may || !words.contains(&"unsafe"), "{place}: unsafe");
            let binding = words.contains(&"pyo3") || words.contains(&"numpy");
            assert!(layer == "python" || !binding, "{place}: the Python binding");
        }
    }
}

#[test]
fn files_have_at_most_400_lines() {
    let lines = |file: &_| fs::read_to_string(file).unwrap().lines().count();
    let long: Vec<_> = files(&source()).into_iter().filter(|file| lines(file) > 400).collect();
    assert!(long.is_empty(), "{long:#?}");
}
