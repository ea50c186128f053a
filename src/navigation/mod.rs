//! Navigation filter: error-state Kalman filter on SE(3), which estimates pose, twist and biases from
//! [`crate::sensors`].
//!
//! It moves with the IMU and corrects by the other sensors. Errors are in body axes: the true position is `p^ + R^
//! rho`; the true attitude and velocity are `R^ exp(theta)` and `v^ + R^ J(theta) nu` with the left Jacobian J, the
//! exponential of SE(3). By this exponential the errors of attitude and velocity propagate linearly however large they
//! are. The position has none: the depth is then linear in its error. Covariance and innovations do not depend on the
//! world's position and heading. The position at the last acoustic ping is part of the state, so that a late fix
//! corrects the present through their correlation.

mod correction;
mod estimate;
mod filter;
mod propagation;
mod state;

pub use correction::{GATES, Innovation};
pub use estimate::{Estimate, OUTPUT};
pub use filter::{InstanceReadings, NavigationFilter, UPDATES};
pub use state::{Start, StartDeviations};
