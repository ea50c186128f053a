//! Symmetric 6x6 inertia: rigid, added or articulated.

use crate::lane::{Lane, Param, get_all, numbers, unroll};
use crate::lie::{Matrix3, Pose, Vector3, Vector6};

numbers! {
    /// `[[M, H], [H^T, J]]`, M and J symmetric and stored as `xx, xy, xz, yy, yz, zz`: 21 numbers. `[HC eq. 5]`
    ///
    /// A rigid body has `M = m I` and `H = -m [c]`; added mass and articulated inertias are full matrices.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct SpatialInertia<P> {
        /// Linear block.
        pub m: [P; 6],
        /// Coupling block, by rows: linear from angular.
        pub h: [[P; 3]; 3],
        /// Angular block.
        pub j: [P; 6],
    }
}

/// Index of each entry of a symmetric 3x3 matrix among its six numbers.
pub(crate) const PACKED: [[usize; 3]; 3] = [[0, 1, 2], [1, 3, 4], [2, 4, 5]];

/// Packed form of a symmetric 3x3 matrix, from its upper half.
#[inline(always)]
fn packed<L: Copy>(m: &Matrix3<L>) -> [L; 6] {
    [m.0[0][0], m.0[0][1], m.0[0][2], m.0[1][1], m.0[1][2], m.0[2][2]]
}

/// Adjugate of a symmetric 3x3 matrix: inverse times determinant.
#[inline(always)]
fn adjugate<L: Lane>([xx, xy, xz, yy, yz, zz]: &[L; 6]) -> [L; 6] {
    let (xx, xy, xz, yy, yz, zz) = (*xx, *xy, *xz, *yy, *yz, *zz);
    [
        yy.mul_add(zz, -(yz * yz)),
        xz.mul_add(yz, -(xy * zz)),
        xy.mul_add(yz, -(xz * yy)),
        xx.mul_add(zz, -(xz * xz)),
        xy.mul_add(xz, -(xx * yz)),
        xx.mul_add(yy, -(xy * xy)),
    ]
}

/// Determinant of a symmetric 3x3 matrix, by its adjugate.
#[inline(always)]
fn determinant<L: Lane>(s: &[L; 6], adjugate: &[L; 6]) -> L {
    Vector3([s[0], s[1], s[2]]).dot(Vector3([adjugate[0], adjugate[1], adjugate[2]]))
}

/// `A - B [r]`, row by row: a row of `B [r]` is the cross product of the row with r.
#[inline(always)]
fn minus_crossed<L: Lane>(a: &Matrix3<L>, b: &Matrix3<L>, r: Vector3<L>) -> Matrix3<L> {
    let r = -r;
    let (a, b) = (&a.0, &b.0);
    Matrix3([
        Vector3(b[0]).cross_add(r, Vector3(a[0])).0,
        Vector3(b[1]).cross_add(r, Vector3(a[1])).0,
        Vector3(b[2]).cross_add(r, Vector3(a[2])).0,
    ])
}

/// `-ad_V^T h` of a momentum h.
#[inline(always)]
fn bias<L: Lane>(twist: Vector6<L>, momentum: Vector6<L>) -> Vector6<L> {
    Vector6 {
        linear: twist.angular.cross(momentum.linear),
        angular: twist.linear.cross_add(momentum.linear, twist.angular.cross(momentum.angular)),
    }
}

impl<P: Copy> SpatialInertia<P> {
    /// From a symmetric 6x6 matrix by entries (its upper half).
    pub fn from_entries(entry: impl Fn(usize, usize) -> P) -> Self {
        let block = |i: usize| {
            [
                entry(i, i),
                entry(i, i + 1),
                entry(i, i + 2),
                entry(i + 1, i + 1),
                entry(i + 1, i + 2),
                entry(i + 2, i + 2),
            ]
        };
        Self { m: block(0), h: [0, 1, 2].map(|i| [3, 4, 5].map(|k| entry(i, k))), j: block(3) }
    }

    /// True if only 13 numbers are not 0: M is diagonal, H has no diagonal, and J no products of inertia but xz. Links along an
    /// axis and most hulls with port-starboard symmetry are of this form.
    pub fn is_sparse(&self) -> bool
    where
        P: PartialEq + Default,
    {
        let (m, h, j) = (&self.m, &self.h, &self.j);
        [m[1], m[2], m[4], h[0][0], h[1][1], h[2][2], j[1], j[4]].iter().all(|x| *x == P::default())
    }

    /// The inertia in lanes.
    #[inline(always)]
    pub fn get<L: Lane>(&self) -> SpatialInertia<L>
    where
        P: Param<L>,
    {
        SpatialInertia {
            m: get_all(&self.m),
            h: [get_all(&self.h[0]), get_all(&self.h[1]), get_all(&self.h[2])],
            j: get_all(&self.j),
        }
    }
}

impl<L: Lane> SpatialInertia<L> {
    /// Inertia of no mass.
    #[inline(always)]
    pub fn zero() -> Self {
        let zero = L::zero();
        Self { m: [zero; 6], h: [[zero; 3]; 3], j: [zero; 6] }
    }

    /// Entry (i, k) of the 6x6 matrix.
    #[inline(always)]
    pub fn entry(&self, i: usize, k: usize) -> L {
        match (i < 3, k < 3) {
            (true, true) => self.m[PACKED[i][k]],
            (true, false) => self.h[i][k - 3],
            (false, true) => self.h[k][i - 3],
            (false, false) => self.j[PACKED[i - 3][k - 3]],
        }
    }

    /// Column K.
    #[inline(always)]
    pub fn column<const K: usize>(&self) -> Vector6<L> {
        Vector6::from_array([
            self.entry(0, K),
            self.entry(1, K),
            self.entry(2, K),
            self.entry(3, K),
            self.entry(4, K),
            self.entry(5, K),
        ])
    }

    /// Adds to entry (i, i).
    #[inline(always)]
    pub fn add_diagonal(&mut self, i: usize, x: L) {
        if i < 3 {
            self.m[PACKED[i][i]] += x;
        } else {
            self.j[PACKED[i - 3][i - 3]] += x;
        }
    }

    /// Adds `s` times a symmetric matrix to the angular block.
    #[inline(always)]
    pub fn add_angular(&mut self, s: L, j: &Matrix3<L>) {
        let j = packed(j);
        unroll!(i in 0 1 2 3 4 5 => {
            self.j[i] = j[i].mul_add(s, self.j[i]);
        });
    }

    /// Adds the inertia of a body; with `SPARSE`, one that [`Self::is_sparse`].
    #[inline(always)]
    pub fn plus_own<P: Param<L>, const SPARSE: bool>(&self, own: &SpatialInertia<P>) -> Self {
        let Self { mut m, mut h, mut j } = *self;
        unroll!(i in 0 1 2 3 4 5 => {
            if !SPARSE || i == 0 || i == 3 || i == 5 {
                m[i] += own.m[i].get();
            }
            if !SPARSE || (i != 1 && i != 4) {
                j[i] += own.j[i].get();
            }
        });
        unroll!(i in 0 1 2 => {
            unroll!(k in 0 1 2 => {
                if !SPARSE || i != k {
                    h[i][k] += own.h[i][k].get();
                }
            });
        });
        Self { m, h, j }
    }

    /// Momentum `A V`.
    #[inline(always)]
    pub fn apply(&self, twist: Vector6<L>) -> Vector6<L> {
        let h = Matrix3(self.h);
        Vector6 {
            linear: Matrix3::symmetric(&self.m).apply(twist.linear) + h.apply(twist.angular),
            angular: Matrix3::symmetric(&self.j).apply(twist.angular) + h.apply_transposed(twist.linear),
        }
    }

    /// Bias wrench `B V = -ad_V^T A V = [omega x p; v x p + omega x l]` with momentum `[p; l] = A V`.
    ///
    /// For a rigid body this is `[HC eq. 5]`; with added mass it contains the Munk moment.
    #[inline(always)]
    pub fn bias_wrench(&self, twist: Vector6<L>) -> Vector6<L> {
        bias(twist, self.apply(twist))
    }

    /// The same, to the last bit, of a body that [`Self::is_sparse`].
    #[inline(always)]
    pub fn sparse_bias_wrench(&self, twist: Vector6<L>) -> Vector6<L> {
        let (m, h, j) = (&self.m, &self.h, &self.j);
        let ([u, v, w], [p, q, r]) = (twist.linear.0, twist.angular.0);
        let momentum = Vector6 {
            linear: Vector3([
                m[0] * u + h[0][2].mul_add(r, h[0][1] * q),
                m[3] * v + h[1][2].mul_add(r, h[1][0] * p),
                m[5] * w + h[2][1].mul_add(q, h[2][0] * p),
            ]),
            angular: Vector3([
                j[2].mul_add(r, j[0] * p) + h[2][0].mul_add(w, h[1][0] * v),
                j[3] * q + h[2][1].mul_add(w, h[0][1] * u),
                j[5].mul_add(r, j[2] * p) + h[1][2].mul_add(v, h[0][2] * u),
            ]),
        };
        bias(twist, momentum)
    }

    /// `self * s`
    #[inline(always)]
    pub fn scale(&self, s: L) -> Self {
        self.scale_add(s, &Self::zero())
    }

    /// `self * s + b`, in the same frame.
    #[inline(always)]
    pub fn scale_add(&self, s: L, b: &Self) -> Self {
        let Self { mut m, mut h, mut j } = *self;
        unroll!(i in 0 1 2 3 4 5 => {
            m[i] = m[i].mul_add(s, b.m[i]);
            j[i] = j[i].mul_add(s, b.j[i]);
        });
        unroll!(i in 0 1 2 => {
            unroll!(k in 0 1 2 => {
                h[i][k] = h[i][k].mul_add(s, b.h[i][k]);
            });
        });
        Self { m, h, j }
    }

    /// Sum of two inertias in the same frame.
    #[inline(always)]
    pub fn plus(&self, b: &Self) -> Self {
        let mut sum = *self;
        sum.add(b);
        sum
    }

    /// Adds `b`.
    #[inline(always)]
    pub fn add(&mut self, b: &Self) {
        let Self { m, h, j } = self;
        unroll!(i in 0 1 2 3 4 5 => {
            m[i] += b.m[i];
            j[i] += b.j[i];
        });
        unroll!(i in 0 1 2 => {
            h[i][0] += b.h[i][0];
            h[i][1] += b.h[i][1];
            h[i][2] += b.h[i][2];
        });
    }

    /// `A - U U^T / D`: articulated inertia with a free direction, whose column of A is U. `[RF08 sec. 7.2]`
    #[inline(always)]
    pub fn eliminated(&self, u: Vector6<L>, over_d: L) -> Self {
        self.eliminate::<3>(u, over_d)
    }

    /// Articulated inertia with free rotation about z (that row and column are 0), `U / D` and `1 / D`.
    #[inline(always)]
    pub fn eliminate_revolute(&self) -> (Self, Vector6<L>, L) {
        let u = self.column::<5>();
        let (zero, over_d) = (L::zero(), L::c(1.0) / u.angular.0[2]);
        let mut a = self.eliminate::<2>(u, over_d);
        (a.j[2], a.j[4], a.j[5]) = (zero, zero, zero);
        (a.h[0][2], a.h[1][2], a.h[2][2]) = (zero, zero, zero);
        (a, u.scale(over_d), over_d)
    }

    /// Articulated inertia with free translation along z, `U / D` and `1 / D`.
    #[inline(always)]
    pub fn eliminate_prismatic(&self) -> (Self, Vector6<L>, L) {
        let u = self.column::<2>();
        let over_d = L::c(1.0) / u.linear.0[2];
        (self.eliminated(u, over_d), u.scale(over_d), over_d)
    }

    /// [`Self::eliminated`] for the first `ANGULAR` (2 or 3) angular rows and columns. Unrolled by hand: the compiler would not.
    #[inline(always)]
    fn eliminate<const ANGULAR: usize>(&self, u: Vector6<L>, over_d: L) -> Self {
        let (f, t) = (u.linear.0, u.angular.0);
        let (sf, st) = (u.linear.scale(over_d).0, u.angular.scale(over_d).0);
        let Self { mut m, mut h, mut j } = *self;
        m[0] = sf[0].neg_mul_add(f[0], m[0]);
        m[1] = sf[0].neg_mul_add(f[1], m[1]);
        m[2] = sf[0].neg_mul_add(f[2], m[2]);
        m[3] = sf[1].neg_mul_add(f[1], m[3]);
        m[4] = sf[1].neg_mul_add(f[2], m[4]);
        m[5] = sf[2].neg_mul_add(f[2], m[5]);
        h[0][0] = sf[0].neg_mul_add(t[0], h[0][0]);
        h[0][1] = sf[0].neg_mul_add(t[1], h[0][1]);
        h[1][0] = sf[1].neg_mul_add(t[0], h[1][0]);
        h[1][1] = sf[1].neg_mul_add(t[1], h[1][1]);
        h[2][0] = sf[2].neg_mul_add(t[0], h[2][0]);
        h[2][1] = sf[2].neg_mul_add(t[1], h[2][1]);
        j[0] = st[0].neg_mul_add(t[0], j[0]);
        j[1] = st[0].neg_mul_add(t[1], j[1]);
        j[3] = st[1].neg_mul_add(t[1], j[3]);
        if ANGULAR == 3 {
            h[0][2] = sf[0].neg_mul_add(t[2], h[0][2]);
            h[1][2] = sf[1].neg_mul_add(t[2], h[1][2]);
            h[2][2] = sf[2].neg_mul_add(t[2], h[2][2]);
            j[2] = st[0].neg_mul_add(t[2], j[2]);
            j[4] = st[1].neg_mul_add(t[2], j[4]);
            j[5] = st[2].neg_mul_add(t[2], j[5]);
        }
        Self { m, h, j }
    }

    /// Adds `A c` to p for an inertia of [`Self::eliminate_revolute`] and a c without components along and about z: x and y of both
    /// parts.
    #[inline(always)]
    pub fn apply_across(&self, [cx, cy, dx, dy]: [L; 4], p: &mut Vector6<L>) {
        let (m, h, j) = (&self.m, &self.h, &self.j);
        let (f, t) = (&mut p.linear.0, &mut p.angular.0);
        #[inline(always)]
        fn plus<L: Lane>(sum: L, a: L, x: L, b: L, y: L) -> L {
            a.mul_add(x, b.mul_add(y, sum))
        }
        f[0] = plus(plus(f[0], m[0], cx, m[1], cy), h[0][0], dx, h[0][1], dy);
        f[1] = plus(plus(f[1], m[1], cx, m[3], cy), h[1][0], dx, h[1][1], dy);
        f[2] = plus(plus(f[2], m[2], cx, m[4], cy), h[2][0], dx, h[2][1], dy);
        t[0] = plus(plus(t[0], h[0][0], cx, h[1][0], cy), j[0], dx, j[1], dy);
        t[1] = plus(plus(t[1], h[0][1], cx, h[1][1], cy), j[1], dx, j[3], dy);
    }

    /// `Ad_T^-T A Ad_T^-1`: the inertia of a child frame at `T`, seen from the parent frame.
    #[inline(always)]
    pub fn to_parent(&self, pose: &Pose<L>) -> Self {
        let r = &pose.rotation;
        let rt = r.transposed();
        let m = r.times(&Matrix3::symmetric(&self.m)).times(&rt);
        let h = r.times(&Matrix3(self.h)).times(&rt);
        let j = r.times(&Matrix3::symmetric(&self.j)).times(&rt);
        Self { m: packed(&m), h: h.0, j: packed(&j) }.shifted(pose.position)
    }

    /// The inertia of a child frame at `r`, its axes along the parent's, seen from the parent frame.
    #[inline(always)]
    pub fn shifted(&self, r: Vector3<L>) -> Self {
        // H' = H - M [r], J' = J - H^T [r] + [r] H', where [r] H' = -(H'^T [r])^T.
        let h = Matrix3(self.h);
        let h_new = minus_crossed(&h, &Matrix3::symmetric(&self.m), r);
        let half = minus_crossed(&Matrix3::symmetric(&self.j), &h.transposed(), r);
        let j_new = minus_crossed(&half.transposed(), &h_new.transposed(), r).transposed();
        Self { m: self.m, h: h_new.0, j: packed(&j_new) }
    }

    /// Solves `A x = b` for a positive definite A, by 3x3 blocks: with the Schur complement `S = J - H^T M^-1 H`,
    ///
    /// ```text
    /// S omega = b_2 - H^T M^-1 b_1,   M v = b_1 - H omega
    /// ```
    ///
    /// Two divisions, by the determinants, which run in parallel with the adjugates. Divisions take longest, and the six of an
    /// `L D L^T` depend on each other. The determinants stay in the range of f32 for entries from 1e-12 to 1e12.
    #[inline(always)]
    pub fn solve(&self, b: Vector6<L>) -> Vector6<L> {
        let (h, m) = (Matrix3(self.h), adjugate(&self.m));
        let over_m = L::c(1.0) / determinant(&self.m, &m);
        // adj(M) H and H^T adj(M) H
        let n = Matrix3::symmetric(&m).times(&h);
        let columns = (h.transposed().0, n.transposed().0);
        let mut s = self.j;
        unroll!(i in 0 1 2 => {
            for k in i..3 {
                let entry = Vector3(columns.0[i]).dot(Vector3(columns.1[k]));
                s[PACKED[i][k]] = entry.neg_mul_add(over_m, s[PACKED[i][k]]);
            }
        });
        let of_s = adjugate(&s);
        let over_s = L::c(1.0) / determinant(&s, &of_s);
        let rest = n.apply_transposed(b.linear).scale_add(-over_m, b.angular);
        let angular = Matrix3::symmetric(&of_s).apply(rest).scale(over_s);
        let linear = (Matrix3::symmetric(&m).apply(b.linear) - n.apply(angular)).scale(over_m);
        Vector6 { linear, angular }
    }
}
