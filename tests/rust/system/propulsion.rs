//! Compilation of thrusters.

use uvms_gym::system::propulsion::t200_thrust;

/// Published: 1498 + 12.01 T - ..., so 1 N takes 1498 + 12.01 - 0.04731 - 0.002098 + 2.251e-5 us.
#[test]
fn val_the_t200_curve_is_inverted() {
    for (thrust, pulse) in [(1.0, 1_509.960_614_51), (-1.0, 1_485.944_81), (20.0, 1_706.093_6), (-30.0, 1_170.000_1)] {
        assert!((t200_thrust(pulse) - thrust).abs() < 1e-3, "{pulse}: {}", t200_thrust(pulse));
    }
    assert!((t200_thrust(1134.0) + 40.0).abs() < 1.5 && (t200_thrust(1887.0) - 60.0).abs() < 0.1);
}
