//! Kernels are compiled once: the tests and the Python module build the library with the same features of every
//! dependency, as any difference would be a build of its own.

use std::collections::BTreeSet;
use std::process::Command;

/// Packages with versions and features, as cargo resolves them for a selection of packages.
fn resolved(selection: &[&str]) -> BTreeSet<String> {
    let mut cargo = Command::new(std::env::var("CARGO").unwrap_or("cargo".into()));
    cargo.current_dir(env!("CARGO_MANIFEST_DIR")).args(["tree", "--locked", "--prefix", "none", "--format", "{p} {f}"]);
    let output = cargo.args(selection).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().map(|line| line.trim_end_matches(" (*)").trim_end().to_owned()).collect()
}

#[test]
fn the_python_module_and_the_tests_share_one_build_of_the_library() {
    let module = resolved(&["--package", "uvms-gym-python", "--edges", "no-dev"]);
    let all = resolved(&[]);
    let others: Vec<_> = module.difference(&all).collect();
    assert!(others.is_empty(), "only in the module: {others:#?}");
    // Without the module among the selected packages some features are missing.
    assert!(!module.is_subset(&resolved(&["--package", "uvms-gym"])));
}
