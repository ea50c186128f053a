//! Butcher tableaus, as data.

/// Greatest number of stages.
pub const STAGES: usize = 4;

/// An explicit Runge-Kutta method: `a` strictly lower triangular, `c` its row sums.
#[derive(Debug, PartialEq)]
pub struct Tableau {
    /// Number of stages.
    pub stages: usize,
    /// Order of convergence.
    pub order: usize,
    /// Stage weights.
    pub a: [[f64; STAGES]; STAGES],
    /// Step weights.
    pub b: [f64; STAGES],
    /// Stage times.
    pub c: [f64; STAGES],
}

/// Euler's rule.
pub static EULER: Tableau = Tableau { stages: 1, order: 1, a: [[0.0; 4]; 4], b: [1.0, 0.0, 0.0, 0.0], c: [0.0; 4] };

/// The midpoint rule.
///
/// ```text
///  0  |
/// 1/2 | 1/2
///     |  0   1
/// ```
pub static MIDPOINT: Tableau = Tableau {
    stages: 2,
    order: 2,
    a: [[0.0; 4], [0.5, 0.0, 0.0, 0.0], [0.0; 4], [0.0; 4]],
    b: [0.0, 1.0, 0.0, 0.0],
    c: [0.0, 0.5, 0.0, 0.0],
};

/// Heun's third-order method.
///
/// ```text
///  0  |
/// 1/3 | 1/3
/// 2/3 |  0  2/3
///     | 1/4  0  3/4
/// ```
pub static HEUN3: Tableau = Tableau {
    stages: 3,
    order: 3,
    a: [[0.0; 4], [1.0 / 3.0, 0.0, 0.0, 0.0], [0.0, 2.0 / 3.0, 0.0, 0.0], [0.0; 4]],
    b: [0.25, 0.0, 0.75, 0.0],
    c: [0.0, 1.0 / 3.0, 2.0 / 3.0, 0.0],
};

/// The classical fourth-order method, which the paper uses.
///
/// ```text
///  0  |
/// 1/2 | 1/2
/// 1/2 |  0  1/2
///  1  |  0   0   1
///     | 1/6 1/3 1/3 1/6
/// ```
pub static RK4: Tableau = Tableau {
    stages: 4,
    order: 4,
    a: [[0.0; 4], [0.5, 0.0, 0.0, 0.0], [0.0, 0.5, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
    b: [1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0],
    c: [0.0, 0.5, 0.5, 1.0],
};
