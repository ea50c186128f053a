//! Laws of allocation, actions and PD.

use nalgebra::{Vector3, Vector6};
use proptest::prelude::*;

use super::righting::afloat;
use super::{actuated, block};
use uvms_gym::control::*;
use uvms_gym::description::{Scene, Thruster, Vehicle, VehicleServo};
use uvms_gym::error::ControlError;
use uvms_gym::lane::Real;

pub fn heavy() -> Vehicle {
    Scene::shipped("bluerov2-heavy").unwrap().vehicle
}

/// Position, axis and limits.
pub type Short = ([f64; 3], [f64; 3], [f64; 2]);

/// Two thrusters beside each other.
const SIDES: [Short; 2] =
    [([0.0, 0.2, 0.0], [1.0, 0.0, 0.0], [-10.0, 20.0]), ([0.0, -0.2, 0.0], [1.0, 0.0, 0.0], [-10.0, 20.0])];

pub fn with_thrusters(thrusters: &[Short]) -> Vehicle {
    let thruster = |(i, (position, axis, limits)): (usize, &Short)| {
        Thruster::new(format!("t{i}"), Vector3::from(*position), Vector3::from(*axis), *limits)
    };
    Vehicle { thrusters: thrusters.iter().enumerate().map(thruster).collect(), ..heavy() }
}

fn wrench() -> impl Strategy<Value = Vector6<f64>> {
    prop::array::uniform6(-300.0..300.0f64).prop_map(Vector6::from)
}

fn allocation() -> Allocation {
    Allocation::new(&heavy()).unwrap()
}

/// Share of thrusters at their limit.
fn saturation(allocation: &Allocation, thrusts: &Thrusts) -> f64 {
    let full = |&i: &usize| {
        let limit = allocation.limits(i)[usize::from(thrusts[i] > 0.0)].abs();
        thrusts[i] != 0.0 && thrusts[i].abs() >= (1.0 - 1e-9) * limit
    };
    (0..allocation.count()).filter(full).count() as f64 / allocation.count().max(1) as f64
}

proptest! {
    #[test]
    fn reachable_wrenches_are_reconstructed(wrench in wrench()) {
        let a = allocation();
        let miss = (a.wrench(&a.unsaturated(&wrench)) - wrench).norm();
        prop_assert!(miss < 1e-11 * wrench.norm().max(1.0), "{miss}");
    }

    #[test]
    fn saturation_keeps_direction_and_limits(wrench in wrench()) {
        let a = allocation();
        let thrusts = a.allocate(&wrench);
        for (i, thrust) in thrusts.iter().enumerate().take(a.count()) {
            let [lower, upper] = a.limits(i);
            prop_assert!((lower..=upper).contains(thrust));
        }
        let reached = a.wrench(&thrusts);
        let share = reached.dot(&wrench) / wrench.norm_squared();
        prop_assert!(share > 0.0 && share < 1.0 + 1e-12);
        prop_assert!((reached - wrench * share).norm() < 1e-10 * wrench.norm());
        // Scaled down only because a thruster stands at its limit.
        prop_assert!(share > 1.0 - 1e-12 || saturation(&a, &thrusts) > 0.0);
    }

    #[test]
    fn no_other_thrusts_take_less_relative_effort(wrench in wrench(), null in prop::array::uniform8(-5.0..5.0f64)) {
        let mut uneven = heavy();
        for (i, thruster) in uneven.thrusters.iter_mut().enumerate() {
            thruster.limits = [-10.0 * (i + 1) as f64, 20.0];
        }
        let a = Allocation::new(&uneven).unwrap();
        let best = a.unsaturated(&wrench);
        // Thrusts that change no wrench: what is left of random ones once their own wrench is taken out.
        let mut other = Thrusts::default();
        other[..8].copy_from_slice(&null);
        let own = a.unsaturated(&a.wrench(&other));
        let other: Thrusts = std::array::from_fn(|i| best[i] + other[i] - own[i]);
        prop_assert!((a.wrench(&other) - a.wrench(&best)).norm() < 1e-10 * wrench.norm().max(1.0));
        let effort = |t: &Thrusts| a.relative(t).map(|u| u * u).sum::<f64>();
        prop_assert!(effort(&best) <= effort(&other) * (1.0 + 1e-12));
    }

    #[test]
    fn wrench_limits_are_the_max_pure_wrenches(axis in 0usize..6, sign in prop::sample::select(vec![-1.0, 1.0])) {
        let a = allocation();
        let limit = a.wrench_limits()[axis];
        let asked = Vector6::ith(axis, sign * limit);
        prop_assert!(limit > 1.0);
        prop_assert!((a.wrench(&a.allocate(&asked)) - asked).norm() < 1e-10 * limit);
        // A little more is too much, on one side at least.
        let more = [1.0, -1.0].map(|s| {
            let asked = Vector6::ith(axis, s * limit * 1.001);
            (a.wrench(&a.allocate(&asked)) - asked).norm() / limit
        });
        prop_assert!(more[0].max(more[1]) > 0.9e-3);
    }

    #[test]
    fn thruster_actions_and_wrench_actions_invert(wrench in wrench()) {
        let a = allocation();
        // Within the limits of each axis alone, which are the limits of the weaker side.
        let limits = Vector6::from(a.wrench_limits());
        let reached = a.wrench(&a.allocate(&wrench.component_div(&Vector6::repeat(300.0)).component_mul(&limits)));
        for kind in [ActionKind::Wrench, ActionKind::Thrusters] {
            let map = map(kind);
            let mut action = vec![0.0f32; map.len()];
            map.normalise(&reached, &[], &mut action);
            prop_assert!(action.iter().all(|x| x.abs() <= 1.0));
            // Within what f32 actions resolve.
            prop_assert!((a.wrench(&actuated(&map, &action).thrusts) - reached).norm() < 1e-4);
        }
    }
}

#[test]
fn symmetric_layout_gives_symmetric_thrust() {
    let a = allocation();
    let axes = a.configuration();
    // Thrusters that mirror each other in y = 0: same place and axis but for the sign of y.
    let vehicle = heavy();
    let mirror = |v: &Vector3<f64>| Vector3::new(v.x, -v.y, v.z);
    let partner = |i: usize| {
        let t = &vehicle.thrusters[i];
        let same = |o: &Thruster| {
            (o.position - mirror(&t.position)).norm() < 1e-12 && (o.axis - mirror(&t.axis)).norm() < 1e-12
        };
        vehicle.thrusters.iter().position(same).unwrap()
    };
    assert_eq!(axes.ncols(), 8);
    for (axis, parity) in [(0, 1.0), (1, -1.0), (2, 1.0), (3, -1.0), (4, 1.0), (5, -1.0)] {
        let thrusts = a.allocate(&Vector6::ith(axis, 5.0));
        for i in 0..8 {
            assert!((thrusts[i] - parity * thrusts[partner(i)]).abs() < 1e-13, "axis {axis}, thruster {i}");
        }
    }
}

#[test]
fn configuration_is_axis_and_lever() {
    let vehicle = with_thrusters(&[([0.0, 2.0, 0.0], [3.0, 0.0, 0.0], [-1.0, 1.0])]);
    let column = Allocation::new(&vehicle).unwrap().configuration();
    assert_eq!(column.column(0).as_slice(), [1.0, 0.0, 0.0, 0.0, 0.0, -2.0]);
}

#[test]
fn axes_without_thrust_have_no_limit_and_are_named() {
    let a = Allocation::new(&with_thrusters(&SIDES)).unwrap();
    assert_eq!(a.unactuated(), ["sway", "heave", "roll", "pitch"]);
    let limits = a.wrench_limits();
    assert!((limits[0] - 20.0).abs() < 1e-12, "both back at 10 N: {limits:?}");
    assert!((limits[5] - 4.0).abs() < 1e-12, "one back at 10 N: {limits:?}");
    assert_eq!(a.allocate(&Vector6::new(0.0, 5.0, 5.0, 5.0, 5.0, 0.0)), [0.0; THRUSTERS]);
    let none = Allocation::new(&with_thrusters(&[])).unwrap();
    assert_eq!(none.unactuated(), AXES);
    // A propeller above the origin pitches as it pushes: neither is to be had alone, unless the vehicle rights itself.
    let high = with_thrusters(&[([0.0, 0.0, 0.1], [1.0, 0.0, 0.0], [-10.0, 20.0])]);
    assert_eq!(Allocation::new(&afloat(&high, 0.0)).unwrap().wrench_limits(), [0.0; 6]);
    assert_eq!(Allocation::new(&afloat(&high, 0.02)).unwrap().wrench_limits(), [10.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
}

#[test]
fn one_sided_and_dead_thrusters_stay_within_their_limits() {
    let one_sided = [([0.0; 3], [1.0, 0.0, 0.0], [0.0, 20.0]), ([0.0; 3], [0.0, 1.0, 0.0], [0.0, 0.0])];
    let a = Allocation::new(&with_thrusters(&one_sided)).unwrap();
    assert_eq!(a.wrench_limits()[0], 0.0, "nothing pushes back");
    assert!((a.allocate(&Vector6::x())[0] - 1.0).abs() < 1e-12);
    assert_eq!(a.allocate(&-Vector6::x())[0], 0.0);
    let dead = a.allocate(&Vector6::y());
    assert_eq!(dead, [0.0; THRUSTERS]);
    assert!(a.relative(&dead).all(|u| u == 0.0));
}

/// Thrusts of an action by the kernel, in this precision.
fn in_lanes<T: Real>(map: &ActionMap, action: &[f64]) -> [f64; THRUSTERS] {
    let mut entries = [T::default(); ACTIONS];
    entries.iter_mut().zip(action).for_each(|(entry, a)| *entry = T::from_f64(*a));
    Actuation::<T>::new(map).act(&entries).thrusts.map(T::to_f64)
}

proptest! {
    /// Vehicles whose thrusters push alike both ways, more one way, or one way alone.
    #[test]
    fn the_kernel_allocates_as_the_allocation_does(
        action in prop::array::uniform6(-1.0..1.0f64),
        back in prop::collection::vec(prop::sample::select(vec![-60.0, -25.0, -1e-4, 0.0]), 8),
        even: bool,
    ) {
        let mut vehicle = heavy();
        for (thruster, back) in vehicle.thrusters.iter_mut().zip(back).filter(|_| !even) {
            thruster.limits = [back, 60.0];
        }
        let a = Allocation::new(&vehicle).unwrap();
        let map = ActionMap::new(ActionKind::Wrench, a.clone(), Vec::new());
        let asked = Vector6::from_fn(|k, _| action[k] * a.wrench_limits()[k]);
        let expected = a.allocate(&asked);
        for (got, near) in [(in_lanes::<f64>(&map, &action), 1e-10), (in_lanes::<f32>(&map, &action), 1e-2)] {
            for i in 0..THRUSTERS {
                prop_assert!((got[i] - expected[i]).abs() < near, "{i}: {} {}", got[i], expected[i]);
            }
        }
        let actuated = actuated(&map, &action.map(|a| a as f32));
        prop_assert!((actuated.saturation - saturation(&a, &actuated.thrusts)).abs() < 1e-12);
        let squares: f64 = a.relative(&actuated.thrusts).map(|u| u * u).sum();
        prop_assert!((actuated.square - squares / 8.0).abs() < 1e-12);
        let powers: f64 = a.relative(&actuated.thrusts).map(|u| u.abs().powf(1.5)).sum();
        prop_assert!((actuated.power - powers / 8.0).abs() < 1e-12);
        let wrench = Vector6::from(actuated.wrench.to_array());
        prop_assert!((wrench - a.wrench(&actuated.thrusts)).norm() < 1e-10);
    }
}

#[test]
fn impossible_thrusters_are_refused() {
    let refused = |limits, axis| Allocation::new(&with_thrusters(&[([0.0; 3], axis, limits)])).unwrap_err();
    assert!(matches!(refused([1.0, 2.0], [1.0, 0.0, 0.0]), ControlError::ThrusterLimits { lower: 1.0, .. }));
    assert!(matches!(refused([-1.0, f64::INFINITY], [1.0, 0.0, 0.0]), ControlError::ThrusterLimits { .. }));
    assert!(matches!(refused([-1.0, 1.0], [0.0; 3]), ControlError::ThrusterGeometry { .. }));
    let many = vec![([0.0; 3], [1.0, 0.0, 0.0], [-1.0, 1.0]); THRUSTERS + 1];
    assert!(matches!(Allocation::new(&with_thrusters(&many)), Err(ControlError::TooManyThrusters { count: 17, .. })));
}

#[test]
fn a_wrench_beyond_all_bounds_keeps_its_direction() {
    let allocation = allocation();
    let direction = Vector6::new(1.0, -0.4, 0.3, 0.1, -0.2, 0.05);
    let unit = allocation.wrench(&allocation.allocate(&(1e6 * direction)));
    let huge = allocation.wrench(&allocation.allocate(&(1.7e308 * direction)));
    assert!((huge - unit).norm() < 1e-9 * unit.norm());
}

fn map(kind: ActionKind) -> ActionMap {
    ActionMap::new(kind, allocation(), Vec::new())
}

fn indices() -> ObservationIndices {
    ObservationIndices { width: 12, error: block(0, 6, 0.1), twist: block(6, 6, 0.2) }
}

fn pd(kind: ActionKind) -> Pd {
    Pd::new(indices(), VehicleServo { kp: [100.0; 6], kd: [30.0; 6] }, map(kind))
}

#[test]
fn pd_pushes_back_along_every_axis() {
    for k in 0..12 {
        let mut observation = [0.0f32; 12];
        observation[k] = 0.5;
        let asked = pd(ActionKind::Wrench).wrench(&observation);
        let expected = if k < 6 { -100.0 * 0.05 } else { -30.0 * 0.1 };
        assert!((asked - Vector6::ith(k % 6, expected)).norm() < 1e-12);
        for kind in [ActionKind::Wrench, ActionKind::Thrusters] {
            let mut action = vec![0.0; map(kind).len()];
            pd(kind).act(&observation, &mut [], &mut action).unwrap();
            assert!((allocation().wrench(&actuated(&map(kind), &action).thrusts) - asked).norm() < 1e-4);
        }
    }
}

fn pid(kind: ActionKind, ki: f64) -> Pid {
    let gains = PidGains { kp: [100.0; 6], kd: [30.0; 6], ki: [ki; 6] };
    Pid::new(indices(), gains, map(kind), 0.1)
}

/// An observation of this error on one axis; its scale is 0.1.
fn error_on(axis: usize, error: f64) -> [f32; 12] {
    std::array::from_fn(|k| if k == axis { (error / 0.1) as f32 } else { 0.0 })
}

/// Action and integral after so many periods with one observation.
fn held(pid: &Pid, observation: &[f32; 12], periods: usize, integral: &mut [f64; 6]) -> Vec<f32> {
    let mut action = vec![0.0; pid.widths().action];
    for _ in 0..periods {
        pid.act(observation, integral, &mut action).unwrap();
    }
    action
}

#[test]
fn pid_without_integral_gains_is_the_pd() {
    let observation: [f32; 12] = std::array::from_fn(|k| (k as f32 - 5.0) * 0.03);
    for kind in [ActionKind::Wrench, ActionKind::Thrusters] {
        let mut action = vec![0.0; map(kind).len()];
        pd(kind).act(&observation, &mut [], &mut action).unwrap();
        assert_eq!(held(&pid(kind, 0.0), &observation, 30, &mut [0.0; 6]), action);
    }
}

#[test]
fn integral_grows_with_the_error_and_pushes_against_it() {
    for axis in 0..6 {
        let mut integral = [0.0; 6];
        let action = held(&pid(ActionKind::Wrench, 50.0), &error_on(axis, 0.01), 11, &mut integral);
        for (k, z) in integral.into_iter().enumerate() {
            assert!((z - if k == axis { 11.0 * 0.1 * 0.01 } else { 0.0 }).abs() < 1e-9);
        }
        // The first action knows no integral, the eleventh ten periods of it.
        let expected = -(100.0 * 0.01 + 50.0 * 0.01) / allocation().wrench_limits()[axis];
        assert!((f64::from(action[axis]) - expected).abs() < 1e-6);
    }
}

#[test]
fn integral_waits_while_its_axis_falls_short_and_turns_at_once() {
    for kind in [ActionKind::Wrench, ActionKind::Thrusters] {
        let pid = pid(kind, 50.0);
        let mut integral = [0.0; 6];
        // 100 N/m times 1 m is more than the thrusters reach upward, and the yaw error waits with it: all thrusts are
        // scaled down together.
        let mut observation = error_on(2, 3.0);
        observation[5] = 2.0;
        held(&pid, &observation, 1000, &mut integral);
        assert_eq!(integral[2], 0.0);
        // Out of saturation it grows until it saturates by itself, and no further.
        held(&pid, &error_on(2, 0.2), 10_000, &mut integral);
        let (full, limit) = (integral[2], allocation().wrench_limits()[2]);
        assert!((50.0 * full + 100.0 * 0.2 - limit).abs() < 50.0 * 0.2 * 0.1 + 1e-2 * limit, "{kind:?}: {full}");
        // An error of the other sign is taken at once, even while the axis still falls short.
        integral[2] = 2.0 * limit / 50.0;
        held(&pid, &error_on(2, -0.1), 1, &mut integral);
        assert!((integral[2] - (2.0 * limit / 50.0 - 0.01)).abs() < 1e-8);
    }
}

#[test]
fn integral_does_not_wind_up_on_an_axis_without_thrust() {
    let map = ActionMap::new(ActionKind::Wrench, Allocation::new(&with_thrusters(&SIDES)).unwrap(), Vec::new());
    let gains = PidGains { kp: [1.0; 6], kd: [1.0; 6], ki: [1.0; 6] };
    let pid = Pid::new(indices(), gains, map, 0.1);
    let mut integral = [0.0; 6];
    held(&pid, &error_on(1, 0.3), 100, &mut integral);
    assert_eq!(integral, [0.0; 6]);
    held(&pid, &error_on(0, 0.3), 100, &mut integral);
    assert!(integral[0] > 2.9);
}

#[test]
fn no_control_is_no_action() {
    let widths = Widths { observation: 12, memory: 0, action: 8 };
    let mut actions = [1.0; 24];
    NoControl::new(widths).act(&[0.5; 36], &mut [], &mut actions).unwrap();
    assert_eq!(actions, [0.0; 24]);
    assert!(NoControl::new(widths).act(&[0.5; 35], &mut [], &mut actions).is_err());
}
