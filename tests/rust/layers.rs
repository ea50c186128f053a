//! The layers of `src/lib.rs`, enforced: imports go strictly downward, and `unsafe` stays among the lanes and where their
//! working memory is made.

use std::fs;
use std::path::{Path, PathBuf};

/// Each layer, lowest first, and what it may import. Every layer may import `error`.
const LAYERS: [(&str, &[&str]); 16] = [
    ("lane", &[]),
    ("error", &["lane"]),
    ("lie", &["lane"]),
    ("spatial", &["lane", "lie"]),
    ("hydro", &["lane", "lie", "spatial"]),
    ("description", &[]),
    ("estimate", &["description"]),
    ("urdf", &["description", "estimate"]),
    ("system", &["lane", "lie", "spatial", "hydro", "description"]),
    ("dynamics", &["lane", "lie", "spatial", "hydro", "description", "system"]),
    ("integrate", &["lane", "lie"]),
    ("render", &["lane", "lie", "description", "system"]),
    ("control", &["lane", "lie", "spatial", "description", "system", "dynamics"]),
    ("task", &["lane", "lie", "spatial", "hydro", "description", "system", "dynamics", "control"]),
    (
        "batch",
        &["lane", "lie", "spatial", "hydro", "description", "system", "dynamics", "integrate", "control", "task"],
    ),
    (
        "python",
        &[
            "lane",
            "lie",
            "spatial",
            "hydro",
            "description",
            "system",
            "dynamics",
            "integrate",
            "control",
            "task",
            "batch",
            "estimate",
            "urdf",
            "render",
        ],
    ),
];

/// Rust files below `folder`.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries
        .flat_map(|path| {
            if path.is_dir() {
                files(&path)
            } else if path.extension().is_some_and(|e| e == "rs") {
                vec![path]
            } else {
                Vec::new()
            }
        })
        .collect()
}

fn source() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

/// Layer that a file belongs to: `src/lie/so3.rs` and `src/lie.rs` to `lie`.
fn layer(file: &Path) -> String {
    let first = file.strip_prefix(source()).unwrap().components().next().unwrap();
    first.as_os_str().to_str().unwrap().trim_end_matches(".rs").to_owned()
}

/// Code of a file, line by line, without comments.
fn code(file: &Path) -> Vec<String> {
    let text = fs::read_to_string(file).unwrap();
    text.lines().map(|line| line.split("//").next().unwrap_or("").to_owned()).collect()
}

/// Modules named by `crate::name` or by the braces of `use crate::{a, b::c}`.
fn imports(line: &str) -> Vec<String> {
    let name = |text: &str| text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    let after = line
        .match_indices("crate::")
        .filter(|(at, _)| !line[..*at].ends_with('$'))
        .map(|(at, m)| &line[at + m.len()..]);
    after
        .flat_map(|rest| match rest.strip_prefix('{') {
            None => vec![name(rest)],
            Some(list) => {
                // Names at the first depth of the braces.
                let mut depth = 0;
                let mut names = vec![String::new()];
                for c in list.chars() {
                    match c {
                        '{' => depth += 1,
                        '}' => depth -= 1,
                        ',' if depth == 0 => names.push(String::new()),
                        c if depth == 0 => names.last_mut().expect("never empty").push(c),
                        _ => {}
                    }
                }
                names.iter().map(|n| name(n.trim())).collect()
            }
        })
        .filter(|name| !name.is_empty())
        .collect()
}

/// Imports that the table does not allow.
fn upward(layer: &str, line: &str) -> Vec<String> {
    let Some((_, allowed)) = LAYERS.iter().find(|(name, _)| *name == layer) else {
        return vec![format!("{layer} is no layer")];
    };
    let known = |name: &str| LAYERS.iter().any(|(layer, _)| *layer == name);
    let fine = |name: &str| name == layer || name == "error" || allowed.contains(&name) || !known(name);
    imports(line).into_iter().filter(|name| !fine(name)).collect()
}

#[test]
fn imports_go_downward_only() {
    let mut seen = 0;
    for file in files(&source()) {
        let layer = layer(&file);
        if layer == "lib" {
            continue;
        }
        for (number, line) in code(&file).iter().enumerate() {
            let bad = upward(&layer, line);
            assert!(bad.is_empty(), "{}:{}: {layer} imports {bad:?}", file.display(), number + 1);
            seen += imports(line).len();
        }
    }
    assert!(seen > 50, "only {seen} imports seen");
}

#[test]
fn the_table_allows_only_layers_below() {
    for (i, (layer, allowed)) in LAYERS.iter().enumerate() {
        let below = |name: &&str| LAYERS[..i].iter().any(|(lower, _)| lower == name);
        assert!(allowed.iter().all(below), "{layer}");
    }
}

#[test]
fn an_upward_import_is_seen() {
    assert_eq!(upward("lie", "use crate::batch::Simulator;"), ["batch"]);
    assert_eq!(upward("control", "    let x = crate::task::layout();"), ["task"]);
    assert_eq!(upward("integrate", "use crate::{lane::Lane, hydro::{Drag, lie}, error};"), ["hydro"]);
    assert!(upward("task", "use crate::control::Pd;").is_empty());
    assert!(upward("lane", "use $crate::batch::Simulator;").is_empty());
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
        for (number, line) in code(&file).iter().enumerate() {
            let words: Vec<&str> = line.split(|c: char| !c.is_alphanumeric() && c != '_').collect();
            let place = format!("{}:{}", file.display(), number + 1);
            let may = layer == "lane" || file.ends_with("batch/stepping/step.rs");
            assert!(may || !words.contains(&"unsafe"), "{place}: unsafe");
            let binding = words.contains(&"pyo3") || words.contains(&"numpy");
            assert!(layer == "python" || !binding, "{place}: the Python binding");
        }
    }
}
