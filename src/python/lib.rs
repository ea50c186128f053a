//! The Python module `uvms_gym._core`: arguments in, arrays out, and nothing else.
#![deny(unsafe_code)]

mod arrays;
mod assessment;
mod computation;
mod contacts;
mod controllers;
mod derivatives;
mod disturbance;
mod errors;
mod gradient;
mod inputs;
mod inverse_dynamics;
mod layout;
mod model;
mod motion;
mod navigation;
mod outputs;
mod parameters;
mod planning;
mod renderer;
mod robots;
mod rollout;
mod scene;
mod sensors;
mod simulator;
mod stability;
mod starts;
mod state;
mod task;
mod thrusters;

use pyo3::prelude::*;

/// The native part of `uvms_gym`.
#[pymodule(name = "_core")]
mod core {
    #[pymodule_export]
    use super::assessment::{assess_scene, recommend_integration};
    #[pymodule_export]
    use super::controllers::{Controller, Mlp, gain_names};
    #[pymodule_export]
    use super::disturbance::disturbance_levels;
    #[pymodule_export]
    use super::errors::{SceneError, StepWarning};
    #[pymodule_export]
    use super::navigation::NavigationFilter;
    #[pymodule_export]
    use super::planning::{optimize_trajectory, trajectory_inputs};
    #[pymodule_export]
    use super::renderer::Renderer;
    #[pymodule_export]
    use super::robots::{assemble_robot, dump_scene, estimate, lint_scene, read_robot, scene_template};
    #[pymodule_export]
    use super::rollout::Rollout;
    #[pymodule_export]
    use super::scene::{arm_names, load_scene, scene_names, vehicle_terms};
    #[pymodule_export]
    use super::sensors::Sensors;
    #[pymodule_export]
    use super::simulator::Simulator;
    #[pymodule_export]
    use super::stability::integrators;
    #[pymodule_export]
    use super::task::{Task, task_defaults, tasks};
    #[pymodule_export]
    use super::thrusters::{pulse_of, thrust_of};
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("ATTITUDE_LEVER", uvms_gym::control::ATTITUDE_LEVER)?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
