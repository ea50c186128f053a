//! Pieces of text that warnings share.

use std::fmt;

use crate::integrate::Integrator;

/// Integrators for steps that are too long for the others: " or integrator 'ros2' or 'mk54'".
pub struct StiffIntegrators;

impl fmt::Display for StiffIntegrators {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let known = |name: &str| Integrator::NAMES.iter().any(|entry| entry.name == name);
        for (k, name) in ["ros2", "mk54"].into_iter().filter(|name| known(name)).enumerate() {
            write!(f, "{}'{name}'", if k == 0 { " or integrator " } else { " or " })?;
        }
        Ok(())
    }
}

/// With three significant digits.
pub fn digits(x: f64) -> String {
    let decimals = (2.0 - x.abs().log10().floor()).clamp(0.0, 12.0) as usize;
    format!("{x:.decimals$}")
}
