//! Pieces of text that warnings share.

use std::fmt;

/// Integrators that would do at a step that is too long for another: " or integrator 'ros2' or 'mk54'". None where neither would.
pub struct OtherIntegrators<'a> {
    /// The one that the step is too long for.
    pub failed: &'a str,
    /// True where a fast mode is the reason, which linearly implicit methods of order 2 let decay; they err more in all else.
    pub stiff: bool,
}

impl fmt::Display for OtherIntegrators<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let known = [("ros2", self.stiff), ("mk54", true)];
        let others = known.into_iter().filter(|&(name, helps)| helps && name != self.failed);
        for (k, (name, _)) in others.enumerate() {
            write!(f, "{}'{name}'", if k == 0 { " or integrator " } else { " or " })?;
        }
        Ok(())
    }
}

/// With three significant digits.
pub fn digits(x: f64) -> String {
    if x == 0.0 {
        return "0".into();
    }
    let decimals = (2.0 - x.abs().log10().floor()).clamp(0.0, 12.0) as usize;
    format!("{x:.decimals$}")
}
