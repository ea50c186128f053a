//! Sizes of files.

use std::fs;

use super::{files, source};

/// Maximum number of lines of a file.
const MOST: usize = 400;

#[test]
fn files_have_at_most_400_lines() {
    let lines = |file: &_| fs::read_to_string(file).unwrap().lines().count();
    let long: Vec<_> = files(&source()).into_iter().filter(|file| lines(file) > MOST).collect();
    assert!(long.is_empty(), "{long:#?}");
}
