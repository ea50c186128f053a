//! The integrators by name.

use super::chart::{Attitude, Chart, Correction};
use super::tableau::{DORMAND_PRINCE, EULER, HEUN3, MIDPOINT, RK4, Tableau};

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
    /// How well the estimated error is kept down, for tableaus with an embedded method.
    pub tolerance: f64,
    /// Where added mass is no inertia but a force of its own, by the acceleration seen in the steps before: the weight of
    /// the last one in that acceleration's filter. Left to whoever makes the right-hand side.
    pub lag: Option<f64>,
}

/// What users may choose about an integrator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gains {
    /// Gain of eq. 14, for the quaternion integrators, 1/s.
    pub gamma: f64,
    /// Bound on the estimated error of a piece, for adaptive integrators: see [`Tableau::error`].
    pub tolerance: f64,
}

impl Gains {
    /// The defaults.
    pub const DEFAULT: Self = Self { gamma: 1.0, tolerance: 1e-8 };
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
    /// The integrator, with [`Gains::DEFAULT`].
    pub integrator: Integrator,
}

const fn explicit(tableau: &'static Tableau, chart: Chart) -> Integrator {
    Integrator::Explicit(Explicit { tableau, chart, tolerance: Gains::DEFAULT.tolerance, lag: None })
}

const fn production(name: &'static str, summary: &'static str, integrator: Integrator) -> Entry {
    Entry { name, summary, kind: Kind::Production, integrator }
}

const fn rival(name: &'static str, summary: &'static str, integrator: Integrator) -> Entry {
    Entry { name, summary, kind: Kind::Rival, integrator }
}

const FOSSEN: Chart = Chart::Quaternion(Correction::Fossen { gamma: Gains::DEFAULT.gamma });
const NORMALISE: Chart = Chart::Quaternion(Correction::Normalise);

/// With the filter of uuv_simulator.
const LAGGED: Integrator = Integrator::Explicit(Explicit {
    tableau: &EULER,
    chart: Chart::VelocityFirst,
    tolerance: Gains::DEFAULT.tolerance,
    lag: Some(0.3),
});

impl Integrator {
    /// All integrators; the first is the default.
    pub const NAMES: [Entry; 12] = [
        production(
            "mk4",
            "Munthe-Kaas, order 4, closed-form inverse of dexp (the default)",
            explicit(&RK4, Chart::Exponential),
        ),
        production(
            "mk54",
            "Munthe-Kaas on Dormand and Prince's pair of orders 5 and 4: as many pieces to a step as the tolerance asks for",
            explicit(&DORMAND_PRINCE, Chart::Exponential),
        ),
        production("mk3", "Munthe-Kaas on Heun's third-order tableau", explicit(&HEUN3, Chart::Exponential)),
        production("mk2", "Munthe-Kaas on the midpoint rule", explicit(&MIDPOINT, Chart::Exponential)),
        rival("mk1", "Munthe-Kaas on the Euler rule (Lie-Euler)", explicit(&EULER, Chart::Exponential)),
        production(
            "ros2",
            "linearly implicit, order 2, L-stable: for scenes too stiff for the others at the step that is wanted",
            Integrator::LinearlyImplicit,
        ),
        rival(
            "semi-implicit-euler",
            "Euler on the velocities, then on the pose with the new ones: as games and many robot simulators step",
            explicit(&EULER, Chart::VelocityFirst),
        ),
        rival(
            "lagged-added-mass",
            "semi-implicit-euler with added mass as a force by the filtered acceleration before: as Gazebo's plugins do",
            LAGGED,
        ),
        rival(
            "euler-angles-rk4",
            "RK4 on roll, pitch and yaw: singular at a pitch of 90 degrees",
            explicit(&RK4, Chart::EulerAngles),
        ),
        rival(
            "quaternion-euler",
            "Euler on a quaternion with the norm-restoring term of eq. 14",
            explicit(&EULER, FOSSEN),
        ),
        rival("quaternion-rk4", "RK4 on a quaternion with the norm-restoring term of eq. 14", explicit(&RK4, FOSSEN)),
        rival("rk4-normalise", "RK4 on a quaternion, normalised after each step", explicit(&RK4, NORMALISE)),
    ];

    /// By name.
    pub fn named(name: &str, gains: &Gains) -> Option<Self> {
        let mut found = Self::NAMES.into_iter().find(|entry| entry.name == name)?.integrator;
        if let Integrator::Explicit(method) = &mut found {
            method.tolerance = gains.tolerance;
            if let Chart::Quaternion(Correction::Fossen { gamma }) = &mut method.chart {
                *gamma = gains.gamma;
            }
        }
        Some(found)
    }

    /// Order of convergence.
    pub fn order(&self) -> usize {
        match self {
            Integrator::Explicit(method) => method.tableau.order,
            Integrator::LinearlyImplicit => 2,
        }
    }

    /// Whether the integrator cuts steps into pieces by their estimated error.
    pub fn adaptive(&self) -> bool {
        match self {
            Integrator::Explicit(method) => method.tableau.error.is_some(),
            Integrator::LinearlyImplicit => false,
        }
    }

    /// Whether linear systems are solved within a step.
    pub fn implicit(&self) -> bool {
        matches!(self, Integrator::LinearlyImplicit)
    }

    /// Weight of the last acceleration in the filter, where added mass is a lagged force.
    pub fn lag(&self) -> Option<f64> {
        match self {
            Integrator::Explicit(method) => method.lag,
            Integrator::LinearlyImplicit => None,
        }
    }

    /// Whether the method needs terms that production methods lack: attitude coordinates besides the rotation matrix, or
    /// added mass as a lagged force. The kernel of the production methods is compiled without them.
    pub fn needs_baseline_terms(&self) -> bool {
        self.attitude() != Attitude::Matrix || self.lag().is_some()
    }

    /// What it keeps the attitude as.
    pub fn attitude(&self) -> Attitude {
        match self {
            Integrator::Explicit(method) => method.chart.attitude(),
            Integrator::LinearlyImplicit => Attitude::Matrix,
        }
    }
}
