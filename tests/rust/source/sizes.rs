//! Sizes of files.

use std::fs;

use super::{files, source};

/// Greatest number of lines of a file.
const MOST: usize = 400;

/// Longer files and the reason for each.
const LONG: [(&str, &str); 1] = [("python/model.rs", "the docstrings that Python shows")];

#[test]
fn files_have_at_most_400_lines_or_a_reason() {
    let mut long = Vec::new();
    for file in files(&source()) {
        let lines = fs::read_to_string(&file).unwrap().lines().count();
        let name = file.strip_prefix(source()).unwrap().to_str().unwrap().to_owned();
        if lines > MOST {
            long.push(name);
        }
    }
    let mut listed: Vec<_> = LONG.iter().map(|(name, _)| (*name).to_owned()).collect();
    listed.sort();
    assert_eq!(long, listed);
}
