//! Allocation where roll or pitch is left to the righting moment.

use nalgebra::{Vector3, Vector6};

use super::actions::{Short, heavy, with_thrusters};
use uvms_gym::control::{AXES, Allocation, THRUSTERS};
use uvms_gym::description::Vehicle;

/// The vehicle with its centre of buoyancy this high above its centre of mass, m.
pub fn afloat(vehicle: &Vehicle, height: f64) -> Vehicle {
    let mut vehicle = vehicle.clone();
    vehicle.body.center_of_buoyancy = vehicle.body.center_of_mass + Vector3::new(0.0, 0.0, height);
    vehicle
}

/// Four vectored thrusters 7 cm below the origin and two vertical ones at its sides, ahead of it by `x`; turned to starboard or not.
fn six_thrusters(x: f64, turned: bool) -> Vehicle {
    let c = std::f64::consts::FRAC_1_SQRT_2;
    let mut all = vec![([x, 0.11, 0.0], [0.0, 0.0, 1.0]), ([x, -0.11, 0.0], [0.0, 0.0, 1.0])];
    for (a, b) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
        all.push(([0.14 * a, 0.1 * b, -0.07], [c, -c * a * b, 0.0]));
    }
    let turn = |[x, y, z]: [f64; 3]| if turned { [y, -x, z] } else { [x, y, z] };
    let all: Vec<Short> = all.into_iter().map(|(at, axis)| (turn(at), turn(axis), [-18.0, 18.0])).collect();
    with_thrusters(&all)
}

#[test]
fn a_moment_that_rights_itself_does_not_keep_thrusters_from_pushing() {
    // Surge pitches; where the vehicle is turned to starboard, sway rolls.
    for (turned, push, tilts) in [(false, 0, 4), (true, 1, 3)] {
        let vehicle = six_thrusters(0.0, turned);
        let [bare, righted] = [0.0, 0.02].map(|height| Allocation::new(&afloat(&vehicle, height)).unwrap());
        assert_eq!(bare.unactuated(), [AXES[push], AXES[tilts]]);
        assert_eq!(righted.unactuated(), [AXES[tilts]]);
        assert!(righted.wrench_limits()[push] > 50.0, "{:?}", righted.wrench_limits());
        let reached = righted.wrench(&righted.allocate(&Vector6::ith(push, 20.0)));
        let aside = if turned { 0.07 * 20.0 } else { -0.07 * 20.0 };
        let expected = Vector6::ith(push, 20.0) + Vector6::ith(tilts, aside);
        assert!((reached - expected).norm() < 1e-11, "{reached}");
        // Moments about that axis alone take no thrust, and axes reached before have the thrusts of before.
        assert_eq!(righted.allocate(&Vector6::ith(tilts, 1.0)), [0.0; THRUSTERS]);
        for axis in (0..6).filter(|axis| *axis != push && *axis != tilts) {
            let unit = Vector6::ith(axis, 1.0);
            assert_eq!(righted.unsaturated(&unit), bare.unsaturated(&unit));
            assert_eq!(righted.wrench_limits()[axis], bare.wrench_limits()[axis]);
        }
    }
    // Vertical thrusters ahead of the origin pitch as well.
    let ahead = Allocation::new(&afloat(&six_thrusters(0.01, false), 0.02)).unwrap();
    assert_eq!(ahead.unactuated(), ["pitch"]);
    // One vertical thruster beside the origin: neither roll nor pitch.
    let mut five = six_thrusters(0.01, false);
    five.thrusters.remove(0);
    let five = Allocation::new(&afloat(&five, 0.02)).unwrap();
    assert_eq!(five.unactuated(), ["roll", "pitch"]);
}

#[test]
fn thrusters_that_would_push_against_each_other_leave_pitch_to_the_righting_moment() {
    // The front ones are 1 cm lower: without a moment in pitch they push against the rear ones.
    let mut vehicle = six_thrusters(0.0, false);
    vehicle.thrusters.iter_mut().filter(|one| one.position.x > 0.1).for_each(|one| one.position.z -= 0.01);
    let [bare, righted] = [0.0, 0.02].map(|height| Allocation::new(&afloat(&vehicle, height)).unwrap());
    assert_eq!((bare.unactuated(), righted.unactuated()), (vec![], vec!["pitch"]));
    let [weak, strong] = [&bare, &righted].map(|one| one.wrench_limits()[0]);
    assert!(weak < 5.0 && strong > 50.0, "{weak} {strong}");
    assert!((strong - righted.maximum(0)[0]).abs() < 1e-9 && (strong - righted.maximum(0)[1]).abs() < 1e-9);
}

#[test]
fn rounded_angles_do_not_keep_thrusters_from_pushing() {
    // Angles of 1.5708 and 3.14 in place of pi / 2 and pi, and an angle that is not rounded.
    for (aside, pushes) in [(3.7e-6, true), (1.6e-3, true), (1e-2, false)] {
        let one = Allocation::new(&with_thrusters(&[([0.0; 3], [aside, -1.0, 0.0], [-18.0, 18.0])])).unwrap();
        assert_eq!(one.wrench_limits()[1] > 0.0, pushes, "{aside}");
    }
}

#[test]
fn righting_moments_do_not_change_vehicles_that_reach_all_axes() {
    let [low, high] = [-0.1, 0.5].map(|height| Allocation::new(&afloat(&heavy(), height)).unwrap());
    assert_eq!(low, high);
}
