//! The integrators by name.

use super::chart::{Chart, Correction};
use super::tableau::{EULER, HEUN3, MIDPOINT, RK4, Tableau};
use crate::lie::DexpInverse;

/// How a step is taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Integrator {
    /// By an explicit Runge-Kutta method.
    Explicit(Explicit),
    /// By linearly implicit Euler, extrapolated to order 2.
    LinearlyImplicit,
}

/// An explicit Runge-Kutta method in coordinates of the pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Explicit {
    /// The method.
    pub tableau: &'static Tableau,
    /// The coordinates.
    pub chart: Chart,
}

/// What an integrator is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Meant to be used.
    Production,
    /// As others do it, for comparison.
    Rival,
}

/// An integrator under its name.
#[derive(Debug, Clone, Copy)]
pub struct Entry {
    /// Name.
    pub name: &'static str,
    /// What it is, in one line.
    pub summary: &'static str,
    /// What it is for.
    pub kind: Kind,
    /// The integrator, with the default gain of eq. 14.
    pub integrator: Integrator,
}

const fn explicit(tableau: &'static Tableau, chart: Chart) -> Integrator {
    Integrator::Explicit(Explicit { tableau, chart })
}

const fn production(name: &'static str, summary: &'static str, integrator: Integrator) -> Entry {
    Entry { name, summary, kind: Kind::Production, integrator }
}

const fn rival(name: &'static str, summary: &'static str, integrator: Integrator) -> Entry {
    Entry { name, summary, kind: Kind::Rival, integrator }
}

const CLOSED: Chart = Chart::Exponential(DexpInverse::Closed);
const TRUNCATED: Chart = Chart::Exponential(DexpInverse::Truncated);
const FOSSEN: Chart = Chart::Quaternion(Correction::Fossen { gamma: 1.0 });
const NORMALISE: Chart = Chart::Quaternion(Correction::Normalise);

impl Integrator {
    /// All integrators; the first is the default.
    pub const NAMES: [Entry; 9] = [
        production("mk4", "Munthe-Kaas, order 4, closed-form inverse of dexp (the default)", explicit(&RK4, CLOSED)),
        production(
            "mk4-truncated",
            "Munthe-Kaas, order 4, inverse of dexp cut off after ad^2/12: adds an error of order 5",
            explicit(&RK4, TRUNCATED),
        ),
        production("mk3", "Munthe-Kaas on Heun's third-order tableau", explicit(&HEUN3, CLOSED)),
        production("mk2", "Munthe-Kaas on the midpoint rule", explicit(&MIDPOINT, CLOSED)),
        production("mk1", "Munthe-Kaas on the Euler rule (Lie-Euler)", explicit(&EULER, CLOSED)),
        production(
            "ros2",
            "linearly implicit, order 2, L-stable: for scenes too stiff for the others at the step that is wanted",
            Integrator::LinearlyImplicit,
        ),
        rival(
            "quaternion-euler",
            "Euler on a quaternion with the norm-restoring term of eq. 14",
            explicit(&EULER, FOSSEN),
        ),
        rival("quaternion-rk4", "RK4 on a quaternion with the norm-restoring term of eq. 14", explicit(&RK4, FOSSEN)),
        rival("rk4-normalise", "RK4 on a quaternion, normalised after each step", explicit(&RK4, NORMALISE)),
    ];

    /// By name; `gamma` is the gain of eq. 14.
    pub fn named(name: &str, gamma: f64) -> Option<Self> {
        let found = Self::NAMES.into_iter().find(|entry| entry.name == name)?.integrator;
        Some(match found {
            Integrator::Explicit(Explicit { tableau, chart: Chart::Quaternion(Correction::Fossen { .. }) }) => {
                explicit(tableau, Chart::Quaternion(Correction::Fossen { gamma }))
            }
            other => other,
        })
    }

    /// Order of convergence.
    pub fn order(&self) -> usize {
        match self {
            Integrator::Explicit(method) => method.tableau.order,
            Integrator::LinearlyImplicit => 2,
        }
    }

    /// Coordinates of the attitude that it keeps besides the rotation matrix: 4 of a quaternion, else none.
    pub fn kept(&self) -> usize {
        match self {
            Integrator::Explicit(method) => method.chart.kept(),
            Integrator::LinearlyImplicit => 0,
        }
    }
}
