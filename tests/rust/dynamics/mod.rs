//! Equations of motion.

mod articulated;
mod closed_form;
mod implicit;
mod momentum;
mod se3;
