//! Instructions of a step and of its machine code: `cargo bench --bench instructions`.
//!
//! Unlike times they are the same on a busy machine. valgrind counts instructions, reads and writes of memory per step and
//! instance, in the AVX2 lanes where there are any, as it may know no wider ones. objdump lists the kernels.

mod cases;

use std::collections::BTreeMap;
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

/// The numbers in the line of valgrind's summary that begins with this heading.
fn numbers(text: &str, heading: &str) -> Option<Vec<f64>> {
    let line = text.lines().find_map(|line| line.split_once(heading))?.1.replace(',', "");
    Some(line.split(|c: char| !c.is_ascii_digit()).filter_map(|number| number.parse().ok()).collect())
}

/// Instructions, reads and writes of a whole run.
fn count(isa: Isa, what: &str) -> Result<[f64; 3], String> {
    let output = Command::new("valgrind")
        .args(["--tool=cachegrind", "--cache-sim=yes", "--cachegrind-out-file=/dev/null"])
        .arg(env::current_exe().expect("a path"))
        .env(RUN, what)
        .env("UVMS_INSTRUCTION_SET", isa.name())
        .output()
        .map_err(|error| format!("valgrind cannot be run, so nothing is counted: {error}"))?;
    let text = String::from_utf8_lossy(&output.stderr);
    let (instructions, data) = (numbers(&text, "I   refs:"), numbers(&text, "D   refs:"));
    match (instructions.as_deref(), data.as_deref()) {
        (Some(&[instructions]), Some(&[_, reads, writes])) if output.status.success() => {
            Ok([instructions, reads, writes])
        }
        _ => Err(format!("{what}: {text}")),
    }
}

fn counts() -> Result<(), String> {
    let isa = Isa::available().find(|&isa| isa != Isa::Avx512).unwrap_or(Isa::Plain);
    println!("per step and instance, {}, lanes {}", Integrator::NAMES[0].name, isa.name());
    println!("{:34} {:>13} {:>8} {:>8}", "", "instructions", "reads", "writes");
    for scene in Scene::shipped_names() {
        for (precision, _) in PRECISIONS {
            let [few, many] = STEPS.map(|steps| count(isa, &format!("{scene} {precision} {steps}")));
            let (few, many) = (few?, many?);
            let steps = (INSTANCES * (STEPS[1] - STEPS[0])) as f64;
            let [instructions, reads, writes] = [0, 1, 2].map(|k| (many[k] - few[k]) / steps);
            println!("{scene:30} {precision} {instructions:13.0} {reads:8.0} {writes:8.0}");
        }
    }
    Ok(())
}

/// Machine code of a kernel: bytes, multiply-adds, loads from the stack (operands included), stores to it, broadcasts from memory.
#[derive(Default)]
struct Code([usize; 5]);

impl Code {
    /// Adds an instruction with its operands, as objdump writes them.
    fn add(&mut self, bytes: usize, instruction: &str) {
        let (name, operands) = instruction.split_once(' ').unwrap_or((instruction, ""));
        let on_stack = operands.contains("(%rsp") || operands.contains("(%rbp");
        let stores = name.starts_with("vmov") && operands.trim_end().ends_with(')');
        let multiply_add = ["vfmadd", "vfnmadd", "vfmsub", "vfnmsub"].iter().any(|kind| name.starts_with(kind));
        let broadcast = operands.contains('(') && (name.starts_with("vbroadcast") || operands.contains("{1to"));
        let kinds = [multiply_add, on_stack && name.starts_with('v') && !stores, on_stack && stores, broadcast];
        self.0[0] += bytes;
        for (sum, is) in self.0[1..].iter_mut().zip(kinds) {
            *sum += usize::from(is);
        }
    }
}

/// Kernel of a symbol: steps with shared parameters, by method and lanes.
fn kernel(symbol: &str) -> Option<String> {
    let method = ["ExplicitStep", "ImplicitStep"].into_iter().find(|method| symbol.contains(method))?;
    let lanes = ["F64x8", "F32x16", "F64x4", "F32x8", "F64x2", "F32x4"];
    let lanes = lanes.into_iter().find(|lanes| symbol.contains(lanes))?;
    (symbol.contains("6Shared") && !symbol.contains("Dual")).then(|| format!("{method} {lanes}"))
}

fn machine_code() -> Result<(), String> {
    let output = Command::new("objdump")
        .args(["-d", "--insn-width=16"])
        .arg(env::current_exe().expect("a path"))
        .output()
        .map_err(|error| format!("objdump cannot be run, so no machine code is counted: {error}"))?;
    let text = String::from_utf8_lossy(&output.stdout);
    let mut kernels = BTreeMap::<String, Code>::new();
    let mut current = None;
    for line in text.lines() {
        let fields = line.split('\t').collect::<Vec<_>>();
        if let Some((_, symbol)) = line.split_once(" <").filter(|_| line.ends_with(">:")) {
            current = kernel(symbol);
        } else if let (Some(name), [_, bytes, instruction]) = (&current, &fields[..]) {
            kernels.entry(name.clone()).or_default().add(bytes.split_whitespace().count(), instruction);
        }
    }
    println!("machine code of the kernels with shared parameters");
    let columns = ["bytes", "multiply-adds", "stack loads", "stack stores", "broadcasts"];
    println!("{:20} {}", "", columns.map(|column| format!("{column:>13}")).join(" "));
    for (name, code) in kernels {
        println!("{name:20} {}", code.0.map(|number| format!("{number:13}")).join(" "));
    }
    Ok(())
}

fn main() -> ExitCode {
    if let Ok(what) = env::var(RUN) {
        run(&what);
        return ExitCode::SUCCESS;
    }
    match machine_code().and_then(|()| counts()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}
