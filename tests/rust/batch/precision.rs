//! Range of single precision, and its rounding over many steps.

use uvms_gym::batch::{Inputs, Precision, Simulator, SimulatorOptions};
use uvms_gym::description::Scene;
use uvms_gym::system::State;

#[test]
fn single_precision_holds_what_does_not_round_to_infinity() {
    let border = f64::from(f32::MAX) + 0.5 * (f64::from(f32::MAX) - f64::from(f32::MAX.next_down()));
    for x in [border, border.next_down(), border.next_up(), 0.0, f64::from(f32::MAX), 1e300, f64::INFINITY, f64::NAN] {
        for x in [x, -x] {
            assert_eq!(Precision::Single.is_finite(x), (x as f32).is_finite(), "{x}");
            assert_eq!(Precision::Double.is_finite(x), x.is_finite(), "{x}");
        }
    }
}

/// A rotor without forces, 955 revolutions in 20 s: the angle is the number of steps times one increment.
#[test]
fn joint_angles_keep_their_precision_over_many_turns_and_small_steps() {
    let text = "name = 'rotor'\nwater = { density = 0.0, gravity = [0.0, 0.0, 0.0] }\n\
                [vehicle]\nname = 'held'\nfixed = true\nbody = { mass = 1.0, inertia = [1.0, 1.0, 1.0] }\n\
                [arm]\nname = 'arm'\n[[arm.links]]\nname = 'rotor'\n\
                joint = { kind = 'revolute', axis = [0.0, 0.0, 1.0] }\nbody = { mass = 0.5, inertia = [0.01, 0.01, 0.01] }\n";
    let scene = Scene::from_toml_str(text, "rotor").unwrap();
    let (rate, time) = (300.0, 20.0);
    for integrator in ["mk4", "mk2", "mk54", "ros2", "ros3"] {
        for dt in [0.001, 0.0001] {
            let precision = Precision::Single;
            let options = SimulatorOptions { dt, precision, integrator: integrator.into(), ..Default::default() };
            let mut simulator = Simulator::new(scene.clone(), options).unwrap();
            let mut state = State::default();
            state.qd[0] = rate;
            simulator.set_state(0, &state);
            simulator.step(&Inputs::default(), (time / dt).round() as usize).unwrap();
            // Half a unit in the last place of the step and of the increment.
            let bound = rate * time * f64::from(f32::EPSILON);
            let error = (simulator.state(0).q[0] - rate * time).abs();
            assert!(error < bound, "{integrator} at {dt}: {error} rad, bound {bound}");
        }
    }
}
