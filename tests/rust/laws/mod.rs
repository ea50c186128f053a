//! Laws of physics and of convergence, on whole simulated motions.

mod adaptive;
mod baselines;
mod bodies;
mod end_stops;
mod energy;
mod flow;
mod joints;
mod links;
mod momentum;
mod order;
mod prescribed;
mod rotors;
mod springs;
mod stiffness;
mod table1;
mod trees;
