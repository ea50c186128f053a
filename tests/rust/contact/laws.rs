//! Energy, momentum and order of convergence through contacts.

use nalgebra::{Vector3, Vector6};
use uvms_gym::batch::{Inputs, Simulator, SimulatorOptions};
use uvms_gym::dynamics::{ClosedFormModel, Loads};
use uvms_gym::system::State;

use super::scenes::{Numbers, ball, wrestling};
use super::twin::states;
use crate::cases::distance;

/// Work of a power over two steps of `h`, from its values at their start, middle and end.
fn simpson(h: f64, [start, middle, end]: [f64; 3]) -> f64 {
    h / 3.0 * (start + 4.0 * middle + end)
}

/// Energy at the end less energy at the start and the work done, relative to the energy exchanged; the robot among the shapes in still
/// water.
#[test]
fn val_energy_ledger_closes() {
    let scene = wrestling();
    let model = ClosedFormModel::new(&scene).unwrap();
    for state in states(3) {
        let dt = 2e-5;
        let mut simulator = Simulator::new(scene.clone(), SimulatorOptions { dt, ..Default::default() }).unwrap();
        simulator.set_state(0, &state);
        let at = |state: &State| {
            let form = model.at(state, Vector3::zeros());
            (form.energy(), form.power(&Loads::default()).unwrap().total())
        };
        let (start, mut power) = at(&state);
        let (mut work, mut exchanged) = (0.0, 0.0);
        for _ in 0..2000 {
            let mut two = || {
                simulator.step(&Inputs::default(), 1).unwrap();
                at(&simulator.state(0)).1
            };
            let powers = [power, two(), two()];
            work += simpson(dt, powers);
            exchanged += simpson(dt, powers.map(f64::abs));
            power = powers[2];
        }
        let (end, _) = at(&simulator.state(0));
        let error = (end.total() - start.total() - work).abs() / exchanged;
        println!("exchanged {exchanged} J, of it in contact {} J at the start: error {error:e}", start.contact);
        assert!(error < 1e-9, "{error:e}");
    }
}

/// A robot in a vacuum without gravity against a fixture that slides freely: what the one loses the other gains.
#[test]
fn val_momentum_goes_to_the_fixture() {
    let text = "
        name = 'push'
        water = { density = 0.0, gravity = [0.0, 0.0, 0.0] }
        [vehicle]
        name = 'body'
        body = { mass = 3.0, inertia = [0.1, 0.2, 0.3], center_of_mass = [0.02, 0.01, 0.0] }
        [arm]
        name = 'arm'
        [[arm.links]]
        name = 'finger'
        body = { mass = 0.7, inertia = [0.01, 0.01, 0.01], center_of_mass = [0.1, 0.0, 0.0] }
        joint = { kind = 'revolute', axis = [0.0, 1.0, 0.0], frame = { position = [0.2, 0.0, 0.0] } }
        [contact]
        stiffness = 3000.0
        friction = 0.0
        ramp = 0.002
        spheres = [{ name = 'tip', on = 'finger', position = [0.2, 0.0, 0.0], radius = 0.03 }]
        shapes = [{ name = 'face', on = 'block', kind = 'plane', frame = { rpy = [0.0, -1.5707963267948966, 0.0] } }]
        [[fixtures]]
        name = 'block'
        body = { mass = 2.0, inertia = [0.1, 0.1, 0.1] }
        joint = { kind = 'prismatic', axis = [1.0, 0.0, 0.0], frame = { position = [0.45, 0.0, 0.0] } }
    ";
    let scene = uvms_gym::description::Scene::from_toml_str(text, "push").unwrap();
    let model = ClosedFormModel::new(&scene).unwrap();
    let momentum = |state: &State| model.at(state, Vector3::zeros()).momentum().total()[0] + 2.0 * state.qd[1];
    let errors = [2e-3, 1e-3, 5e-4].map(|dt| {
        let mut simulator = Simulator::new(scene.clone(), SimulatorOptions { dt, ..Default::default() }).unwrap();
        let mut state = State { twist: Vector6::new(0.4, 0.0, 0.1, 0.0, 0.2, 0.0), ..State::default() };
        state.qd[0] = 0.3;
        simulator.set_state(0, &state);
        let before = momentum(&simulator.state(0));
        simulator.step(&Inputs::default(), (0.2 / dt) as usize).unwrap();
        let after = simulator.state(0);
        assert!(after.qd[1] > 0.2, "the block was pushed: {}", after.qd[1]);
        ((momentum(&after) - before) / before).abs()
    });
    println!("momentum: {errors:?}");
    assert!(errors[2] < 1e-9 && errors[2] < errors[0] / 50.0 + 1e-14, "{errors:?}");
}

/// Bounces with the ramp keep the order of MK4: root mean square error of bounces from 64 heights. Where in a step a ball touches
/// the floor changes the error of a single bounce by the jump of the third derivative there.
#[test]
fn val_bounces_keep_the_order_of_the_method() {
    let numbers = Numbers { stiffness: 2000.0, dissipation: 1.0, ramp: 0.02, friction: 0.3, slip_speed: 0.3 };
    let (scene, instances) = (ball(2.0, [0.0; 3], numbers), 64);
    let end = |dt: f64| -> Vec<State> {
        let options = SimulatorOptions { dt, instances, ..SimulatorOptions::default() };
        let mut simulator = Simulator::new(scene.clone(), options).unwrap();
        for i in 0..instances {
            let height = 0.11 + 0.004 * i as f64 / instances as f64;
            let mut state = State { position: Vector3::new(0.0, 0.0, height), ..State::default() };
            state.twist = Vector6::new(0.3, 0.1, -0.5, 1.0, 2.0, 3.0);
            simulator.set_state(i, &state);
        }
        simulator.step(&Inputs::default(), (0.256 / dt).round() as usize).unwrap();
        (0..instances).map(|i| simulator.state(i)).collect()
    };
    let exact = end(2.5e-5);
    let errors = [8e-4, 4e-4, 2e-4].map(|dt| {
        let squares = exact.iter().zip(&end(dt)).map(|(exact, found)| distance(exact, found).powi(2)).sum::<f64>();
        (squares / instances as f64).sqrt()
    });
    let orders = [errors[0] / errors[1], errors[1] / errors[2]].map(f64::log2);
    println!("errors {errors:?}, orders {orders:?}");
    assert!(orders.iter().all(|order| (order - 4.0).abs() < 0.1), "{errors:?} {orders:?}");
}
