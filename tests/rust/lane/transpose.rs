//! From numbers by instance to numbers by lane, and back.

use uvms_gym::lane::{Transposable, transpose};

fn every_entry_changes_places<T: Transposable + PartialEq + std::fmt::Debug>(number: impl Fn(usize) -> T) {
    let none = number(usize::MAX);
    for (rows, columns, beside) in (1..=17).flat_map(|r| (1..=45).flat_map(move |c| [(r, c, 0), (r, c, 3)])) {
        let (from_width, to_width) = (columns + beside, rows + beside);
        let from: Vec<T> = (0..rows * from_width).map(&number).collect();
        let mut to = vec![none; columns * to_width];
        transpose(&from, from_width, &mut to, to_width, [rows, columns]);
        for c in 0..columns {
            for r in 0..to_width {
                let expected = if r < rows { from[r * from_width + c] } else { none };
                assert_eq!(to[c * to_width + r], expected, "{rows} x {columns}, {beside} beside: {r}, {c}");
            }
        }
    }
}

#[test]
fn every_single_changes_places() {
    every_entry_changes_places(|k| k as f32);
}

#[test]
fn every_double_changes_places() {
    every_entry_changes_places(|k| k as f64);
}
