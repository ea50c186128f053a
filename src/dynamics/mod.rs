//! Equations of motion: closed form by dynamical balance, articulated bodies, recursions, linearization. `[HC] [P05] [RF08]`
//!
//! | file | algorithm | arithmetic |
//! |---|---|---|
//! | [`aba`] | articulated-body algorithm: forward dynamics in O(n), the form that steps | lanes, over `System` |
//! | [`aba_implicit`] | the same for linearly implicit Euler | lanes, over `System` |
//! | [`contact`], `contact_adjoint` | wrenches of contacts on vehicle and links | lanes, over `System` |
//! | `composite_body` | composite inertia, momentum and outer forces of vehicle and arm | lanes, over `System` |
//! | [`tool_contact`] | contacts of a tool with a fixture | lanes, over `System` |
//! | `linearize`, `modes` | A and B by dual numbers through [`aba`]; eigenvalues | f64, over `System` |
//! | `rnea` | recursive Newton-Euler algorithm: inverse dynamics in O(n) | lanes, over `System` |
//! | `dynamical_balance` | the principle of dynamical balance: composition of M, C, W, L | dense f64 |
//! | `closed_form_model` | composition of a scene's vehicle, arm and payload | dense f64 |
//! | `surroundings` | contact and fixtures of the closed form | dense f64 |
//! | `closed_form` | `W F + L tau = M [V'; q''] + C [V; q']` of a scene at a state, with its solve | dense f64 |
//! | `fossen` | `M nu' + C(nu) nu + D(nu) nu + g(eta) = tau` from the closed form | dense f64 |
//! | `kinematics`, `inverse_dynamics`, `energy`, `momentum` | results of the closed form | dense f64 |
//!
//! The dense closed form is built from the scene and shares no arithmetic with the lane kernels, which are built from the
//! compiled `System`: each checks the other.

pub mod aba;
pub mod aba_adjoint;
pub mod aba_implicit;
mod articulation;
mod body_adjoint;
mod branches;
mod closed_form;
mod closed_form_model;
mod common_joint;
mod composite_body;
pub mod contact;
pub mod contact_adjoint;
pub mod dense;
mod dynamical_balance;
mod energy;
mod fossen;
mod inverse_dynamics;
mod joint_torque;
mod joint_torque_adjoint;
mod kinematics;
mod linearize;
mod link;
mod modes;
mod momentum;
pub mod place;
mod placement;
mod rnea;
mod surroundings;
pub mod tool_contact;

pub use closed_form::{BodyWrenches, ClosedForm, JointTorques, Loads, Residual};
pub use closed_form_model::{BodyFrame, ClosedFormModel};
pub use composite_body::CompositeBody;
pub use dynamical_balance::{BodyMotion, Composite, Equations};
pub use energy::{Energy, Power, relative_to_water};
pub use fossen::FossenForm;
pub use inverse_dynamics::GeneralizedForce;
pub use joint_torque::{implicit_joint_torque, lost_bounce};
pub use linearize::{Linearization, linearize};
pub use modes::{Modes, Servos};
pub use momentum::Momentum;
pub use rnea::{JointMotion, inverse_dynamics};
pub use surroundings::Contact;
