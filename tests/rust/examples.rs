//! The examples run. The first is the quick start of the crate's documentation.

#[path = "../../examples/compare_integrators.rs"]
mod compare_integrators;
#[path = "../../examples/derivatives.rs"]
mod derivatives;
#[path = "../../examples/step.rs"]
mod step;

#[test]
fn an_example_steps_a_scene() {
    step::main().unwrap();
}

#[test]
fn an_example_compares_integrators() {
    compare_integrators::main().unwrap();
}

#[test]
fn an_example_differentiates_a_step() {
    derivatives::main().unwrap();
}
