//! Instructions per step and instance, as valgrind counts them: `cargo bench --bench instructions`.
//!
//! Unlike times they are the same on a busy machine. They are counted in the AVX2 lanes where there are any, as valgrind
//! may know no wider ones.

mod cases;

use std::env;
use std::process::{Command, ExitCode};

use cases::{Case, PRECISIONS};
use uvms_gym::description::Scene;
use uvms_gym::integrate::Integrator;
use uvms_gym::lane::Isa;

/// Full lanes, whatever the width.
const INSTANCES: usize = 64;
/// Two runs differ by these steps, and by nothing else.
const STEPS: [usize; 2] = [2, 12];
/// In the environment of a run: scene, precision and steps.
const RUN: &str = "UVMS_BENCH_RUN";

fn run(what: &str) {
    let [scene, precision, steps] = what.split(' ').collect::<Vec<_>>()[..] else { panic!("{RUN}={what}") };
    let (_, precision) = PRECISIONS.into_iter().find(|(name, _)| *name == precision).expect("a precision");
    let mut case = Case::new(scene, precision, Integrator::NAMES[0].name, INSTANCES);
    case.step(steps.parse().expect("a number"));
    case.check();
}

/// Instructions of a whole run.
fn count(isa: Isa, what: &str) -> Result<f64, String> {
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
        .arg(env::current_exe().expect("a path"))
        .env(RUN, what)
        .env("UVMS_INSTRUCTION_SET", isa.name())
        .output()
        .map_err(|error| format!("valgrind cannot be run, so nothing is counted: {error}"))?;
    let text = String::from_utf8_lossy(&output.stderr);
    let collected = text.lines().find_map(|line| line.split_once("Collected : ")?.1.parse().ok());
    collected.filter(|_| output.status.success()).ok_or_else(|| format!("{what}: {text}"))
}

fn table() -> Result<(), String> {
    let isa = Isa::available().find(|&isa| isa != Isa::Avx512).unwrap_or(Isa::Plain);
    println!("instructions per step and instance, {}, lanes {}", Integrator::NAMES[0].name, isa.name());
    for scene in Scene::shipped_names() {
        for (precision, _) in PRECISIONS {
            let [few, many] = STEPS.map(|steps| count(isa, &format!("{scene} {precision} {steps}")));
            let steps = INSTANCES * (STEPS[1] - STEPS[0]);
            println!("{scene:24} {precision} {:8.1}", (many? - few?) / steps as f64);
        }
    }
    Ok(())
}

fn main() -> ExitCode {
    if let Ok(what) = env::var(RUN) {
        run(&what);
        return ExitCode::SUCCESS;
    }
    match table() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}
