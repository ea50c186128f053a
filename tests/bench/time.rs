//! Time per step and instance, by scene, precision and integrator, on one thread: `cargo bench --bench time`.

mod cases;

use std::time::{Duration, Instant};

use cases::{Case, PRECISIONS};
use criterion::{Criterion, criterion_group, criterion_main};
use uvms_gym::batch::Precision;
use uvms_gym::description::Scene;
use uvms_gym::integrate::{Integrator, IntegratorKind};

const INSTANCES: usize = 512;
const SUBSTEPS: usize = 5;

/// Prints times of one step of one instance.
fn time(criterion: &mut Criterion, scene: &str, integrator: &str, (name, precision): (&str, Precision)) {
    let mut case = Case::new(scene, precision, integrator, INSTANCES);
    criterion.bench_function(&format!("{scene}/{integrator}/{name}"), |bencher| {
        bencher.iter_custom(|calls| {
            let start = Instant::now();
            for _ in 0..calls {
                case.step(SUBSTEPS);
            }
            start.elapsed() / (INSTANCES * SUBSTEPS) as u32
        });
    });
    case.check();
}

fn steps(criterion: &mut Criterion) {
    for scene in Scene::shipped_names() {
        for precision in PRECISIONS {
            time(criterion, scene, Integrator::NAMES[0].name, precision);
        }
    }
    for entry in Integrator::NAMES.iter().skip(1).filter(|entry| entry.kind == IntegratorKind::Production) {
        for precision in PRECISIONS {
            time(criterion, "petasus-pum", entry.name, precision);
        }
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_millis(800));
    targets = steps
}
criterion_main!(benches);
