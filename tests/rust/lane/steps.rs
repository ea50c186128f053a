//! Whole steps of every shipped scene, and of a tree, by every production integrator, on every width.

use std::process::Command;

use uvms_gym::batch::{Precision, Simulator, SimulatorOptions};
use uvms_gym::description::Scene;
use uvms_gym::integrate::{Integrator, IntegratorKind};
use uvms_gym::lane::Isa;
use uvms_gym::system::{Factors, State};

use crate::batch::inputs::{GENTLE, RandomInputs, Sizes};
use crate::cases::{bits, branched};
use crate::random_scene::{Random, random_state};

const INSTANCES: usize = 20;
const STEPS: usize = 4;

/// The states after a few steps under all loads, each instance in a state of its own, and with parameters of its own if
/// `varied`.
fn run(scene: &Scene, precision: Precision, integrator: &str, varied: bool) -> Vec<State> {
    let integrator = integrator.to_owned();
    let dt = 0.002;
    let options = SimulatorOptions { instances: INSTANCES, dt, precision, integrator, ..SimulatorOptions::default() };
    let mut simulator = Simulator::new(scene.clone(), options).unwrap();
    let mut random = Random::new(7);
    for i in 0..INSTANCES {
        simulator.set_state(i, &random_state(i as u64, scene));
        simulator.set_flow(i, random.vector(0.3));
    }
    if varied {
        let mut factor = || random.between(0.8, 1.2);
        let mut own = || {
            let (mass, added_mass, quadratic_damping, volume) = (factor(), factor(), factor(), factor());
            Factors { mass, added_mass, quadratic_damping, volume, ..Factors::ONE }
        };
        let factors: Vec<_> = (0..INSTANCES).map(|_| own()).collect();
        simulator.set_factors(&factors).unwrap();
    }
    let inputs = RandomInputs::of_count(INSTANCES, scene, Sizes { terms: 4, ..GENTLE });
    simulator.step(&inputs.inputs(scene), STEPS).unwrap();
    (0..INSTANCES).map(|i| simulator.state(i)).collect()
}

/// A number for all bits of the states.
fn digest(states: &[State]) -> u64 {
    let mut sum = 0_u64;
    for x in states.iter().flat_map(bits) {
        assert!(f64::from_bits(x).is_finite());
        sum = (sum.rotate_left(5) ^ x).wrapping_mul(0x517c_c1b7_2722_0a95);
    }
    sum
}

const MARK: &str = "digest: ";

/// Prints what `whole_steps_have_the_same_bits_on_all_fused_widths` compares between processes: the width is chosen once
/// in each.
#[test]
fn digests_of_whole_steps() {
    let shipped = Scene::shipped_names().into_iter().map(|name| Scene::shipped(name).unwrap());
    for scene in shipped.chain([branched()]) {
        for entry in Integrator::NAMES.iter().filter(|entry| entry.kind == IntegratorKind::Production) {
            for (precision, varied) in
                [Precision::Double, Precision::Single].into_iter().flat_map(|p| [(p, false), (p, true)])
            {
                let sum = digest(&run(&scene, precision, entry.name, varied));
                let own = if varied { "own parameters" } else { "shared parameters" };
                println!("{MARK}{}, {}, {precision:?}, {own}: {sum:016x}", scene.name, entry.name);
            }
        }
    }
}

#[test]
fn whole_steps_have_the_same_bits_on_all_fused_widths() {
    let command = |isa: Isa| {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command
            .args(["--exact", "lane::steps::digests_of_whole_steps", "--nocapture"])
            .env("UVMS_INSTRUCTION_SET", isa.name());
        std::thread::spawn(move || command.output().unwrap())
    };
    let running: Vec<_> = Isa::available().map(|isa| (isa, command(isa))).collect();
    let lines = running.into_iter().map(|(isa, output)| {
        let text = String::from_utf8(output.join().unwrap().stdout).unwrap();
        let lines: Vec<String> = text.lines().filter_map(|line| Some(line.split_once(MARK)?.1.to_owned())).collect();
        assert!(lines.len() > 100, "{}: {text}", isa.name());
        (isa, lines)
    });
    let (fused, plain): (Vec<_>, Vec<_>) = lines.partition(|(isa, _)| *isa != Isa::Plain);
    for (isa, lines) in &fused {
        for (line, expected) in lines.iter().zip(&fused[0].1) {
            assert_eq!(line, expected, "{} and {}", isa.name(), fused[0].0.name());
        }
        assert_eq!(lines.len(), fused[0].1.len());
        let unlike = lines.iter().zip(&plain[0].1).filter(|(line, plain)| line != plain).count();
        assert!(10 * unlike > 9 * lines.len(), "the digests tell roundings apart: {unlike} of {}", lines.len());
    }
}
