//! The principle of dynamical balance: systems composed of systems, in closed form. `[HC] [P05]`
//!
//! [`Composite`] composes; [`Balance`] composes a scene; [`ClosedForm`] is the scene's
//! `W F + L tau = M [V'; q''] + C [V; q']` at a state, with its solve, kinematics and books. All of it is plain
//! f64 with dense matrices. [`articulated`] solves the same balance in lanes and is what steps the simulation; each
//! checks the other.

mod appendages;
pub mod articulated;
pub mod body;
mod closed_form;
mod composite;
pub mod dense;
pub mod implicit;
mod inverse;
pub mod joint;
mod joint_torque;
mod kinematics;
mod ledger;
mod linearize;
mod modes;
mod momentum;
mod recursive;

pub use appendages::Appendages;
pub use closed_form::{Balance, BodyWrenches, ClosedForm, JointTorques, Loads, Residual};
pub use composite::{BodyMotion, Composite, Equations};
pub use inverse::Effort;
pub use ledger::{Energy, Momentum, Power, seen_from_water};
pub use linearize::{Linearization, linearize};
pub use modes::{Modes, Servos};
pub use momentum::Whole;
pub use recursive::{Masses, Passive, Recursion, Terms, VELOCITIES, Velocities};
