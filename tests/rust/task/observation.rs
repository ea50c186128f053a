//! Observations: layout, blocks that several tasks share, and the writer.

use uvms_gym::task::observation::*;

#[test]
fn blocks_follow_each_other_without_gaps() {
    let mut layout = ObservationLayout::default();
    layout.push("a", "m", "", &[(0.5, 10.0), (2.0, 10.0)]);
    layout.push("nothing", "m", "", &[]);
    layout.push("b", "m", "", &[(1.0, 3.0); 3]);
    assert_eq!((layout.width(), layout.blocks().len()), (5, 2));
    assert_eq!(layout.block("b").unwrap().offset, 2);
    assert_eq!(layout.bound(), [20.0, 5.0, 3.0, 3.0, 3.0]);
    assert_eq!(layout.scaling().next(), Some([2.0, 20.0]));
}

#[test]
fn entries_are_scaled_clipped_and_never_invalid() {
    let mut row = [0.0; 5];
    let scaling = [[2.0, 20.0], [0.5, 5.0], [1.0, 3.0], [1.0, 3.0], [1.0, 3.0]];
    let mut writer = ObservationWriter::new(&scaling, &mut row, 1);
    for value in [1.0, -100.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        writer.put(value);
    }
    assert_eq!(row, [2.0, -5.0, 3.0, 3.0, -3.0]);
}
