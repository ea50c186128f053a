//! Points of a body, and a mass at one.

use proptest::prelude::*;
use uvms_gym::lie::{Vector3, Vector6};
use uvms_gym::spatial::{BodyPoint, PointMass};

proptest! {
    #[test]
    fn the_bias_of_a_point_mass_is_that_of_its_inertia(
        [x, y, z] in prop::array::uniform3(-2.0..2.0f64), mass in 0.0..5.0f64,
        v in prop::array::uniform3(-3.0..3.0f64), w in prop::array::uniform3(-3.0..3.0f64),
        g in prop::array::uniform3(-10.0..10.0f64),
    ) {
        let (twist, gravity) = (Vector6 { linear: Vector3(v), angular: Vector3(w) }, Vector3(g));
        for point in [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z], [x, y, z]] {
            let mass_point = PointMass { mass, position: BodyPoint::of(point) };
            let mut bias = twist;
            mass_point.add_bias(twist, gravity, &mut bias);
            let weight = gravity.scale(mass);
            let weight = Vector6 { linear: weight, angular: Vector3(point).cross(weight) };
            let expected = twist + (mass_point.inertia().bias_wrench(twist) - weight);
            for (got, expected) in bias.to_array().into_iter().zip(expected.to_array()) {
                prop_assert!((got - expected).abs() < 1e-12 * (1.0 + expected.abs()), "{mass_point:?}: {got}, {expected}");
            }
        }
    }
}
