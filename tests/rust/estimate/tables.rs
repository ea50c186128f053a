//! Published coefficients, with straight lines between their points.

use uvms_gym::estimate::tables::{finite_cylinder, interpolate, perforated, plate, rectangle};

#[test]
fn tables_give_their_points_and_lines_between_them() {
    assert_eq!(interpolate(&[(0.0, 1.0), (1.0, 3.0), (2.0, 0.0)], 0.5), 2.0);
    assert_eq!(interpolate(&[(0.0, 1.0), (1.0, 3.0), (2.0, 0.0)], 1.0), 3.0);
    assert_eq!(interpolate(&[(0.0, 1.0), (1.0, 3.0)], -1.0), 1.0);
    assert_eq!(interpolate(&[(0.0, 1.0), (1.0, 3.0)], 9.0), 3.0);
    assert_eq!((plate(1.0), plate(0.0), rectangle(1.0)), (0.579, 1.0, 1.51));
    assert!((finite_cylinder(5.0) - 0.9).abs() < 1e-12 && (finite_cylinder(0.6) - 0.31).abs() < 1e-12);
}

#[test]
fn perforation_takes_the_factors_of_the_petasus_scene() {
    assert!((perforated(0.5) - 0.2397).abs() < 5e-5 && (perforated(0.34) - 0.4244).abs() < 5e-5);
    assert_eq!((perforated(0.0), perforated(0.05)), (1.0, 1.0));
    assert!(perforated(0.33999) - perforated(0.34) < 0.01);
}
