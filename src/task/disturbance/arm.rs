//! Motion of the arm's reference.

use super::component::{Component, component};

component! {
    /// Factors on the arm's reference, which stays within the joints' limits and speeds.
    #[derive(Copy)]
    pub struct ArmMotion = "arm" {
        /// Factor on its amplitude.
        amplitude: f64 = 1.0, in 0.0, 10.0;
        /// Factor on its speed.
        speed: f64 = 1.0, in 0.0, 10.0;
    }
}

impl Component for ArmMotion {
    const RESERVED: bool = false;
}
