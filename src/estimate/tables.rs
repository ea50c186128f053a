//! Published coefficients, interpolated linearly.
//!
//! `[DNV-H103]`: DNV-RP-H103, Modelling and Analysis of Marine Operations, appendix A and section 4.6.
//! `[DNV-C205]`: DNV-RP-C205, Environmental Conditions and Environmental Loads, section 6.
//! `[Hoerner]`: Hoerner, Fluid-Dynamic Drag, 1965. `[White]`: White, Fluid Mechanics, table 7.3.

use std::f64::consts::FRAC_PI_4;

/// Linear interpolation between points of ascending abscissa, constant beyond the ends.
pub fn interpolate(points: &[(f64, f64)], x: f64) -> f64 {
    let after = points.partition_point(|point| point.0 < x);
    let (from, to) = (points[after.saturating_sub(1)], points[after.min(points.len() - 1)]);
    if from.0 == to.0 { from.1 } else { from.1 + (to.1 - from.1) * (x - from.0) / (to.0 - from.0) }
}

/// Added mass of a rectangular plate over `pi/4 short^2 long`. `[DNV-H103 table A-2]`
pub fn plate(short_over_long: f64) -> f64 {
    const POINTS: [(f64, f64); 13] = [
        (0.0, 1.0),
        (0.1, 0.947),
        (0.125, 0.934),
        (0.16, 0.917),
        (0.2, 0.897),
        (0.25, 0.872),
        (1.0 / 3.0, 0.83),
        (0.4, 0.801),
        (0.5, 0.757),
        (1.0 / 1.5, 0.69),
        (0.8, 0.642),
        (1.0, 0.579),
        (2.0, 0.579),
    ];
    interpolate(&POINTS, short_over_long)
}

/// Ratio of the added mass of a square prism along its length to the added mass of its end, a square plate. `[DNV-H103 table A-2]`
pub fn square_prism(length_over_side: f64) -> f64 {
    // Coefficient times length over side: added mass over side^3.
    const POINTS: [(f64, f64); 9] = [
        (0.0, 0.579 * FRAC_PI_4),
        (1.0, 0.68),
        (2.0, 0.72),
        (3.0, 0.72),
        (4.0, 0.76),
        (5.0, 0.75),
        (6.0, 0.78),
        (7.0, 0.77),
        (10.0, 0.8),
    ];
    interpolate(&POINTS, length_over_side) / POINTS[0].1
}

/// Ratio of the added mass of a rectangular section to the added mass of a plate of its width. `[DNV-H103 table A-1]`
pub fn rectangle(thickness_over_width: f64) -> f64 {
    const POINTS: [(f64, f64); 8] =
        [(0.0, 1.0), (0.1, 1.14), (0.2, 1.21), (0.5, 1.36), (1.0, 1.51), (2.0, 1.7), (5.0, 1.98), (10.0, 2.23)];
    interpolate(&POINTS, thickness_over_width)
}

/// Added moment of inertia of a rotating rectangular section over `pi rho (long/2)^4`. `[DNV-H103 table A-1]`
pub fn turning_rectangle(short_over_long: f64) -> f64 {
    const POINTS: [(f64, f64); 5] = [(0.0, 0.125), (0.1, 0.147), (0.2, 0.15), (0.5, 0.15), (1.0, 0.234)];
    interpolate(&POINTS, short_over_long)
}

/// Added mass across a cylinder of finite length over the water it displaces. `[DNV-H103 table A-2]`
pub fn finite_cylinder(length_over_diameter: f64) -> f64 {
    const POINTS: [(f64, f64); 6] =
        [(0.0, 1.0), (1.0 / 9.0, 0.96), (0.2, 0.9), (0.4, 0.78), (1.0 / 1.2, 0.62), (10.0, 0.62)];
    // Below the table it is proportional to the length, as for a disc on edge.
    interpolate(&POINTS, 1.0 / length_over_diameter) * (length_over_diameter / 1.2).min(1.0)
}

/// Ratio of the added mass of a perforated face to the added mass of a closed one, by the open fraction of its area. `[DNV-H103 section 4.6.4]`
pub fn perforated(perforation: f64) -> f64 {
    let percent = 100.0 * perforation;
    if percent <= 5.0 {
        1.0
    } else if percent < 34.0 {
        0.7 + 0.3 * (std::f64::consts::PI * (percent - 5.0) / 34.0).cos()
    } else {
        ((10.0 - percent) / 28.0).exp()
    }
}

/// Drag coefficient across a long circular cylinder, subcritical.
pub const CYLINDER: f64 = 1.1;
/// Drag coefficient along a cylinder with blunt ends. `[Hoerner]`
pub const BLUNT: f64 = 0.8;
/// Drag coefficient of a long square section. `[Hoerner]`
pub const SQUARE: f64 = 2.05;
/// Drag coefficient of a cube, face on. `[Hoerner]`
pub const CUBE: f64 = 1.05;
/// Drag coefficient of a sphere, subcritical. `[White]`
pub const SPHERE: f64 = 0.47;

/// Ratio of the drag of a cylinder of finite length to the drag of as much of an infinite one. `[DNV-C205 table 6-2]`
pub fn slender_cylinder(length_over_diameter: f64) -> f64 {
    const POINTS: [(f64, f64); 7] =
        [(2.0, 0.58), (5.0, 0.62), (10.0, 0.68), (20.0, 0.74), (40.0, 0.82), (50.0, 0.87), (100.0, 0.98)];
    interpolate(&POINTS, length_over_diameter)
}

/// Drag coefficient of a box's face, between a cube's and a square section's, by the slenderness factor of plates. `[DNV-C205
/// table 6-2]`
pub fn face(long_over_short: f64) -> f64 {
    const POINTS: [(f64, f64); 8] = [
        (1.0, CUBE),
        (2.0, 0.62 * SQUARE),
        (5.0, 0.66 * SQUARE),
        (10.0, 0.69 * SQUARE),
        (20.0, 0.81 * SQUARE),
        (40.0, 0.87 * SQUARE),
        (50.0, 0.9 * SQUARE),
        (100.0, 0.95 * SQUARE),
    ];
    interpolate(&POINTS, long_over_short)
}

/// Drag coefficient of an ellipsoid by its frontal area; at no thickness, a disc's. `[White]`
pub fn ellipsoid(length_over_width: f64) -> f64 {
    const POINTS: [(f64, f64); 6] = [(0.0, 1.17), (0.75, 0.5), (1.0, SPHERE), (2.0, 0.27), (4.0, 0.25), (8.0, 0.2)];
    interpolate(&POINTS, length_over_width)
}
