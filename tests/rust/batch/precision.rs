//! Range of single precision.

use uvms_gym::batch::Precision;

#[test]
fn single_precision_holds_what_does_not_round_to_infinity() {
    let border = f64::from(f32::MAX) + 0.5 * (f64::from(f32::MAX) - f64::from(f32::MAX.next_down()));
    for x in [border, border.next_down(), border.next_up(), 0.0, f64::from(f32::MAX), 1e300, f64::INFINITY, f64::NAN] {
        for x in [x, -x] {
            assert_eq!(Precision::Single.holds(x), (x as f32).is_finite(), "{x}");
            assert_eq!(Precision::Double.holds(x), x.is_finite(), "{x}");
        }
    }
}
