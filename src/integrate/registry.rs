//! The integrators by name.

use super::chart::{Attitude, Chart, Correction};
use super::tableau::{DORMAND_PRINCE, EULER, HEUN3, MIDPOINT, RK4, Tableau};

/// Integration method.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Integrator {
    /// Explicit Runge-Kutta method.
    Explicit(Explicit),
    /// Linearly implicit Euler, extrapolated.
    LinearlyImplicit(Implicit),
}

/// A linearly implicit method.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Implicit {
    /// Order, 2 or 3.
    pub order: usize,
    /// Rotation within a step beyond which a lane halves it, rad. Smaller than for the explicit methods: Euler's equations and
    /// other products of velocities are treated explicitly, and an oscillation then grows by `(h rate)^4 / 8` a step.
    pub max_turn: f64,
    /// `h` times the frequency of a contact beyond which a sub-interval is divided. Smaller than for the explicit methods: bounces
    /// lose accuracy sooner by Euler's rule, extrapolated.
    pub max_contact: f64,
    /// `h |rate|` of a joint at its end stop beyond which a lane that loses a bounce, or gains by it, halves the step. L-stable steps lose
    /// bounces that are over within a step, whatever the step: none without it.
    pub bounce: Option<f64>,
}

/// An explicit Runge-Kutta method in coordinates of the pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Explicit {
    /// The method.
    pub tableau: &'static Tableau,
    /// The coordinates.
    pub chart: Chart,
    /// Bound on the estimated error of a sub-interval, for tableaus with an embedded method.
    pub tolerance: f64,
    /// Where added mass is a force from the filtered acceleration of earlier steps in place of inertia: weight of the last
    /// acceleration in the filter. Implemented by the right-hand side.
    pub lag: Option<f64>,
    /// Rotation within a sub-interval beyond which a lane halves it, rad. The maps are valid up to pi, but in body axes the velocity
    /// of a spinning body turns as fast, and grows where that is outside a tableau's stability region: 2.83 (RK4), 1.73 (Heun).
    pub max_turn: f64,
    /// `h` times the frequency of a contact beyond which a sub-interval is divided.
    pub max_contact: f64,
}

/// Numbers that users choose for an integrator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gains {
    /// Gain of eq. 14, for the quaternion integrators, 1/s.
    pub gamma: f64,
    /// Bound on the estimated error of a sub-interval, for adaptive integrators: see [`Tableau::error`].
    pub tolerance: f64,
}

/// Minimum tolerance over the precision's epsilon: no estimate is more accurate than rounding.
pub(super) const MIN_TOLERANCE: f64 = 8.0;

impl Gains {
    /// Gains of a simulator without options.
    pub const DEFAULT: Self = Self { gamma: 1.0, tolerance: 1e-8 };
}

/// Purpose of an integrator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum IntegratorKind {
    /// For use.
    Production,
    /// Method of other simulators, for comparison.
    Baseline,
}

/// Named integrator.
#[derive(Debug, Clone, Copy)]
pub struct NamedIntegrator {
    /// Name, by which options select the integrator.
    pub name: &'static str,
    /// Description in one line.
    pub summary: &'static str,
    /// Its purpose.
    pub kind: IntegratorKind,
    /// The integrator, with [`Gains::DEFAULT`].
    pub integrator: Integrator,
}

/// `h |rate|` of a joint at its end stop up to which linearly implicit steps follow a bounce within some percent.
const RESOLVED_BOUNCE: f64 = 0.125;

/// A quarter revolution, rad.
const QUARTER: f64 = std::f64::consts::FRAC_PI_2;

/// `h` times the frequency of a contact, up to which MK4 returns speeds within some 1e-4 from a bounce.
const CONTACT: f64 = 0.25;

const fn explicit(tableau: &'static Tableau, chart: Chart) -> Integrator {
    Integrator::Explicit(Explicit {
        tableau,
        chart,
        tolerance: Gains::DEFAULT.tolerance,
        lag: None,
        max_turn: QUARTER,
        max_contact: CONTACT,
    })
}

const fn implicit(order: usize) -> Integrator {
    Integrator::LinearlyImplicit(Implicit { order, max_turn: 0.5, max_contact: 0.5 * CONTACT, bounce: None })
}

const fn production(name: &'static str, summary: &'static str, integrator: Integrator) -> NamedIntegrator {
    NamedIntegrator { name, summary, kind: IntegratorKind::Production, integrator }
}

const fn baseline(name: &'static str, summary: &'static str, integrator: Integrator) -> NamedIntegrator {
    NamedIntegrator { name, summary, kind: IntegratorKind::Baseline, integrator }
}

const FOSSEN: Chart = Chart::Quaternion(Correction::Fossen { gamma: Gains::DEFAULT.gamma });
const NORMALISE: Chart = Chart::Quaternion(Correction::Normalise);

/// Lagged added mass with the filter of uuv_simulator.
const LAGGED: Integrator = Integrator::Explicit(Explicit {
    tableau: &EULER,
    chart: Chart::VelocityFirst,
    tolerance: Gains::DEFAULT.tolerance,
    lag: Some(0.3),
    max_turn: QUARTER,
    max_contact: CONTACT,
});

impl Integrator {
    /// All integrators; the first is the default.
    pub const NAMES: [NamedIntegrator; 13] = [
        production(
            "mk4",
            "Munthe-Kaas, order 4, closed-form inverse of dexp (the default)",
            explicit(&RK4, Chart::Exponential),
        ),
        production(
            "mk54",
            "Munthe-Kaas on Dormand and Prince's pair of orders 5 and 4: sub-intervals of a step by the tolerance",
            explicit(&DORMAND_PRINCE, Chart::Exponential),
        ),
        production("mk3", "Munthe-Kaas on Heun's third-order tableau", explicit(&HEUN3, Chart::Exponential)),
        production("mk2", "Munthe-Kaas on the midpoint rule", explicit(&MIDPOINT, Chart::Exponential)),
        baseline("mk1", "Munthe-Kaas on the Euler rule (Lie-Euler)", explicit(&EULER, Chart::Exponential)),
        production(
            "ros2",
            "linearly implicit, order 2, L-stable: for scenes too stiff for explicit methods at the wanted step",
            implicit(2),
        ),
        production(
            "ros3",
            "linearly implicit, order 3, L-stable: as 'ros2', far more accurate at twice its cost",
            implicit(3),
        ),
        baseline(
            "semi-implicit-euler",
            "Euler on the velocities, then on the pose with the new ones: the method of games and many robot simulators",
            explicit(&EULER, Chart::VelocityFirst),
        ),
        baseline(
            "lagged-added-mass",
            "semi-implicit-euler with added mass as a force from the filtered acceleration of earlier steps: the method of Gazebo's plugins",
            LAGGED,
        ),
        baseline(
            "euler-angles-rk4",
            "RK4 on roll, pitch and yaw: singular at a pitch of 90 degrees",
            explicit(&RK4, Chart::EulerAngles),
        ),
        baseline(
            "quaternion-euler",
            "Euler on a quaternion with the norm-restoring term of eq. 14",
            explicit(&EULER, FOSSEN),
        ),
        baseline(
            "quaternion-rk4",
            "RK4 on a quaternion with the norm-restoring term of eq. 14",
            explicit(&RK4, FOSSEN),
        ),
        baseline("rk4-normalise", "RK4 on a quaternion, normalised after each step", explicit(&RK4, NORMALISE)),
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

    /// Rescaled for steps `ratio` times longer, with tolerances `looser` times larger in a precision of this epsilon. The limit of
    /// rotation for sub-intervals scales with `ratio^3`: a motion from rest may turn by that much in the shorter step, and both would
    /// have the same sub-intervals.
    pub fn at_ratio(mut self, ratio: f64, looser: f64, epsilon: f64) -> Self {
        match &mut self {
            Integrator::Explicit(method) => {
                method.max_turn *= ratio.powi(3);
                method.max_contact *= ratio;
                method.tolerance = looser * method.tolerance.max(MIN_TOLERANCE * epsilon);
            }
            Integrator::LinearlyImplicit(method) => {
                method.max_turn *= ratio.powi(3);
                method.max_contact *= ratio;
            }
        }
        self
    }

    /// The same with bounces off end stops resolved: for motions that others are compared with.
    pub fn resolving_bounces(mut self) -> Self {
        if let Integrator::LinearlyImplicit(method) = &mut self {
            method.bounce = Some(RESOLVED_BOUNCE);
        }
        self
    }

    /// Order of convergence.
    pub fn order(&self) -> usize {
        match self {
            Integrator::Explicit(method) => method.tableau.order,
            Integrator::LinearlyImplicit(method) => method.order,
        }
    }

    /// True where the integrator divides steps into sub-intervals by their estimated error.
    pub fn adaptive(&self) -> bool {
        match self {
            Integrator::Explicit(method) => method.tableau.error.is_some(),
            Integrator::LinearlyImplicit(_) => false,
        }
    }

    /// True where a step solves linear systems.
    #[inline(always)]
    pub fn implicit(&self) -> bool {
        matches!(self, Integrator::LinearlyImplicit(_))
    }

    /// Weight of the last acceleration in the filter, where added mass is a lagged force.
    pub fn lag(&self) -> Option<f64> {
        match self {
            Integrator::Explicit(method) => method.lag,
            Integrator::LinearlyImplicit(_) => None,
        }
    }

    /// True for baseline methods with terms that production methods lack: attitude coordinates besides the rotation matrix, or
    /// added mass as a lagged force. The kernel of the production methods is compiled without them.
    pub fn needs_baseline_terms(&self) -> bool {
        self.attitude() != Attitude::Matrix || self.lag().is_some()
    }

    /// Representation of the attitude.
    pub fn attitude(&self) -> Attitude {
        match self {
            Integrator::Explicit(method) => method.chart.attitude(),
            Integrator::LinearlyImplicit(_) => Attitude::Matrix,
        }
    }
}
