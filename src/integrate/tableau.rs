//! Butcher tableaus, as data.

/// Maximum number of stages.
pub const STAGES: usize = 7;

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
    /// Weights of the accelerations in the coordinates of the stages, over `h^2`: `y_i = y + c_i h y' + h^2 sum_j place_ij k_j`;
    /// and in the coordinates of the step's end: `a a` and `b a`.
    pub place: [[f64; STAGES]; STAGES],
    /// See `place`.
    pub place_end: [f64; STAGES],
    /// The same for `error`.
    pub place_error: [f64; STAGES],
    /// Where the rows of `a` and `place`, and last `b` and `place_end`, are not zero.
    pub support: [[Support; 2]; STAGES + 1],
    /// Differences between the step weights and the weights of an embedded method of lower order, if there is one: its last stage is
    /// the step's end.
    pub error: Option<[f64; STAGES]>,
    /// Detection of fast rates from the stages, for methods of more than one stage.
    pub contrast: Option<Contrast>,
}

/// Stages with weights other than zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Support {
    stages: [usize; STAGES],
    count: usize,
}

impl Support {
    /// Stages of a row whose weights are not zero.
    const fn of(row: &[f64; STAGES]) -> Self {
        let (mut stages, mut count, mut j) = ([0; STAGES], 0, 0);
        while j < STAGES {
            if row[j] != 0.0 {
                stages[count] = j;
                count += 1;
            }
            j += 1;
        }
        Self { stages, count }
    }

    /// Their numbers.
    #[inline(always)]
    pub fn as_slice(&self) -> &[usize] {
        &self.stages[..self.count.min(STAGES)]
    }

    /// How many there are.
    #[inline(always)]
    pub fn count(&self) -> usize {
        self.count.min(STAGES)
    }

    /// The number of the i-th. (The bound, which always holds, spares index checks.)
    #[inline(always)]
    pub fn stage(&self, i: usize) -> usize {
        self.stages[i].min(STAGES - 1)
    }
}

/// Detection of rates from the first stages of a method. The right-hand side's change `dk` and the difference `dz` of
/// the states that it changes between are, in the accelerations k of the first stages and `h`:
///
/// ```text
///                    dk's accelerations                    dz's velocities       dz's coordinates
/// of three stages    change (k_3 - k_2, k_2 - k_1)         h speed (k_2 - k_1)   h^2 place k_1
/// of two             change (k_2 - k_1, k_1)               h speed k_1           h place V
/// ```
///
/// and `dk`'s velocities are `dz`'s. Terms linear in time cancel (of two stages, in the accelerations only).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contrast {
    /// True for three stages, false for two.
    pub three: bool,
    /// Weight of the coordinates.
    pub place: f64,
    /// Weight of the velocities.
    pub speed: f64,
    /// Weights of the accelerations.
    pub change: [f64; 2],
    /// Error of a step on a mode: `factor |h dk| (h |lambda|)^power`.
    pub error: (f64, u32),
}

/// A row of weights, filled up with zeros.
const fn row<const K: usize>(given: [f64; K]) -> [f64; STAGES] {
    let mut row = [0.0; STAGES];
    let mut k = 0;
    while k < K {
        row[k] = given[k];
        k += 1;
    }
    row
}

/// Stage weights: one row for each stage after the first.
const fn rows<const K: usize>(given: [[f64; STAGES]; K]) -> [[f64; STAGES]; STAGES] {
    let mut rows = [[0.0; STAGES]; STAGES];
    let mut k = 0;
    while k < K {
        rows[k + 1] = given[k];
        k += 1;
    }
    rows
}

/// `row a`
const fn times(row: &[f64; STAGES], a: &[[f64; STAGES]; STAGES]) -> [f64; STAGES] {
    let mut product = [0.0; STAGES];
    let mut j = 0;
    while j < STAGES {
        let mut k = 0;
        while k < STAGES {
            product[k] += row[j] * a[j][k];
            k += 1;
        }
        j += 1;
    }
    product
}

impl Tableau {
    /// A Runge-Kutta method, without estimates.
    const fn new<const K: usize>(order: usize, a: [[f64; STAGES]; K], b: [f64; STAGES], c: [f64; STAGES]) -> Self {
        let a = rows(a);
        let mut place = [[0.0; STAGES]; STAGES];
        let mut i = 0;
        while i < STAGES {
            place[i] = times(&a[i], &a);
            i += 1;
        }
        let place_end = times(&b, &a);
        let mut support = [[Support::of(&b), Support::of(&place_end)]; STAGES + 1];
        let mut i = 0;
        while i < STAGES {
            support[i] = [Support::of(&a[i]), Support::of(&place[i])];
            i += 1;
        }
        let place_error = [0.0; STAGES];
        Self { stages: K + 1, order, a, b, c, place, place_end, place_error, support, error: None, contrast: None }
    }
}

/// Euler's rule.
pub static EULER: Tableau = Tableau::new(1, [], row([1.0]), row([]));

/// The midpoint rule.
///
/// ```text
///  0  |
/// 1/2 | 1/2
///     |  0   1
/// ```
pub static MIDPOINT: Tableau = Tableau {
    // Error: z^3 / 6 by z^2 / 2.
    contrast: Some(Contrast { three: false, place: 0.5, speed: 0.5, change: [1.0, 0.0], error: (1.0 / 3.0, 1) }),
    ..Tableau::new(2, [row([0.5])], row([0.0, 1.0]), row([0.0, 0.5]))
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
    // Error: z^4 / 24 by 2 z^3 / 9.
    contrast: Some(Contrast {
        three: true,
        place: 2.0 / 9.0,
        speed: 2.0 / 3.0,
        change: [1.0, -1.0],
        error: (3.0 / 16.0, 1),
    }),
    ..Tableau::new(
        3,
        [row([1.0 / 3.0]), row([0.0, 2.0 / 3.0])],
        row([0.25, 0.0, 0.75]),
        row([0.0, 1.0 / 3.0, 2.0 / 3.0]),
    )
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
    // Error: z^5 / 120 by z^3 / 4.
    contrast: Some(Contrast { three: true, place: 0.25, speed: 0.5, change: [1.0, 0.0], error: (1.0 / 30.0, 2) }),
    ..Tableau::new(
        4,
        [row([0.5]), row([0.0, 0.5]), row([0.0, 0.0, 1.0])],
        row([1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0]),
        row([0.0, 0.5, 0.5, 1.0]),
    )
};

/// Dormand and Prince's pair of orders 5 and 4; continues with order 5. `[DP80]`
pub static DORMAND_PRINCE: Tableau = Tableau {
    error: Some(DORMAND_PRINCE_ERROR),
    place_error: times(&DORMAND_PRINCE_ERROR, &rows(DORMAND_PRINCE_STAGES)),
    contrast: Some(Contrast { three: true, place: 0.09, speed: 0.45, change: [2.0, -1.0], error: (0.0, 0) }),
    ..Tableau::new(5, DORMAND_PRINCE_STAGES, DORMAND_PRINCE_END, row([0.0, 0.2, 0.3, 0.8, 8.0 / 9.0, 1.0, 1.0]))
};
const DORMAND_PRINCE_STAGES: [[f64; STAGES]; 6] = [
    row([1.0 / 5.0]),
    row([3.0 / 40.0, 9.0 / 40.0]),
    row([44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0]),
    row([19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0]),
    row([9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0]),
    DORMAND_PRINCE_END,
];
const DORMAND_PRINCE_ERROR: [f64; STAGES] =
    row([71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339200.0, 22.0 / 525.0, -1.0 / 40.0]);
const DORMAND_PRINCE_END: [f64; STAGES] =
    row([35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0]);
