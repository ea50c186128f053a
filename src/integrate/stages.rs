//! Memory of a step's stages, and sums over them.

use super::Rates;
use super::motion::Motion;
use super::tableau::{Contrast, STAGES, Support, Tableau};
use crate::lane::{Lane, unroll};
use crate::lie::Vector6;

/// Rates at each stage: working memory.
#[derive(Debug, Clone)]
pub struct Stages<L, const N: usize> {
    /// Rates of the chart's coordinates: of Theta; of the position, and the angles or the quaternion's vector part.
    pub(super) pose: [Vector6<L>; STAGES],
    /// Rates of the quaternion's scalar part, for charts that keep the attitude.
    pub(super) scalar: [L; STAGES],
    /// V' and q''.
    pub(super) rates: [Rates<L, N>; STAGES],
    /// q and q' of the stage at hand.
    pub(super) q_at: [L; N],
    pub(super) qd_at: [L; N],
}

/// A stage without its joints: increments of its coordinates from the start, and its twist.
pub(super) struct Point<L> {
    pub pose: Vector6<L>,
    pub scalar: L,
    pub twist: Vector6<L>,
}

impl<L: Lane> Point<L> {
    /// Zeros.
    #[inline(always)]
    fn zero() -> Self {
        Self { pose: Vector6::zero(), scalar: L::zero(), twist: Vector6::zero() }
    }
}

/// Weights of a stage's point or of the step's end.
pub(super) struct Weights<'a> {
    /// Its time as a fraction of the step.
    pub time: f64,
    /// Weights of the rates.
    pub speed: &'a [f64; STAGES],
    /// Weights of the accelerations in the coordinates.
    pub place: &'a [f64; STAGES],
    /// Where these two are not zero.
    pub support: &'a [Support; 2],
}

impl<'a> Weights<'a> {
    /// Weights of stage `i`.
    #[inline(always)]
    pub(super) fn of(tableau: &'a Tableau, i: usize) -> Self {
        let Tableau { a, c, place, support, .. } = tableau;
        Self { time: c[i], speed: &a[i], place: &place[i], support: &support[i] }
    }
}

impl<L: Lane, const N: usize> Stages<L, N> {
    /// Zeroed memory.
    pub fn blank() -> Self {
        let zero = [L::zero(); N];
        Self {
            pose: [Vector6::zero(); STAGES],
            scalar: [L::zero(); STAGES],
            rates: [Rates::zero(); STAGES],
            q_at: zero,
            qd_at: zero,
        }
    }

    /// The step's start.
    #[inline(always)]
    pub(super) fn start(&mut self, n: usize, from: &Motion<L, N>) -> Point<L> {
        for k in 0..n {
            self.q_at[k] = from.q[k];
            self.qd_at[k] = from.qd[k];
        }
        Point { pose: Vector6::zero(), scalar: L::zero(), twist: from.twist }
    }

    /// The start plus `h sum w_j k_j` over the stages that count; leaves q and q' in `q_at`, `qd_at`.
    #[inline(always)]
    pub(super) fn weigh(&mut self, weights: &Weights, n: usize, h: L, keeps: bool, from: &Motion<L, N>) -> Point<L> {
        let [speeds, places] = weights.support;
        // The classical tableau's sums separately: with a constant number of stages sums stay in registers.
        match (speeds.as_slice(), places.as_slice()) {
            (&[a], &[]) => self.weigh_stages([a], [], weights, n, h, keeps, from),
            (&[a], &[b]) => self.weigh_stages([a], [b], weights, n, h, keeps, from),
            (&[a, b, c, d], &[e, f, g]) => self.weigh_stages([a, b, c, d], [e, f, g], weights, n, h, keeps, from),
            _ => self.weigh_any(weights, n, h, keeps, from),
        }
    }

    /// [`Self::weigh`] with these stages in the speeds and in the places.
    #[allow(clippy::too_many_arguments)]
    #[inline(always)]
    fn weigh_stages<const S: usize, const P: usize>(
        &mut self,
        speeds: [usize; S],
        places: [usize; P],
        weights: &Weights,
        n: usize,
        h: L,
        keeps: bool,
        from: &Motion<L, N>,
    ) -> Point<L> {
        let (mut speed, mut place, mut sum) = ([L::zero(); S], [L::zero(); P], Point::zero());
        for i in 0..S {
            let j = speeds[i].min(STAGES - 1);
            speed[i] = h * L::c(weights.speed[j]);
            self.add(j, speed[i], keeps, &mut sum);
        }
        for i in 0..P {
            place[i] = h * h * L::c(weights.place[places[i].min(STAGES - 1)]);
        }
        let way = h * L::c(weights.time);
        for k in 0..n {
            let (mut q, mut qd) = (from.qd[k] * way, L::zero());
            for i in 0..S {
                qd = self.rates[speeds[i].min(STAGES - 1)].qd[k].mul_add(speed[i], qd);
            }
            for i in 0..P {
                q = self.rates[places[i].min(STAGES - 1)].qd[k].mul_add(place[i], q);
            }
            self.q_at[k] = q + from.q[k];
            self.qd_at[k] = qd + from.qd[k];
        }
        sum.twist = from.twist + sum.twist;
        sum
    }

    /// The same for any stages. Joints in the inner loop: otherwise every joint would iterate over the support again.
    #[inline(always)]
    fn weigh_any(&mut self, weights: &Weights, n: usize, h: L, keeps: bool, from: &Motion<L, N>) -> Point<L> {
        let ([speeds, places], mut sum) = (weights.support, Point::zero());
        let (way, h2) = (h * L::c(weights.time), h * h);
        for k in 0..n {
            self.q_at[k] = from.qd[k] * way;
            self.qd_at[k] = L::zero();
        }
        for i in 0..speeds.count() {
            let j = speeds.stage(i);
            let weight = h * L::c(weights.speed[j]);
            self.add(j, weight, keeps, &mut sum);
            for k in 0..n {
                self.qd_at[k] = self.rates[j].qd[k].mul_add(weight, self.qd_at[k]);
            }
        }
        for i in 0..places.count() {
            let j = places.stage(i);
            let weight = h2 * L::c(weights.place[j]);
            for k in 0..n {
                self.q_at[k] = self.rates[j].qd[k].mul_add(weight, self.q_at[k]);
            }
        }
        for k in 0..n {
            self.q_at[k] += from.q[k];
            self.qd_at[k] += from.qd[k];
        }
        sum.twist = from.twist + sum.twist;
        sum
    }

    /// Adds the rates of stage `j`, without its joints, times a weight.
    #[inline(always)]
    fn add(&self, j: usize, weight: L, keeps: bool, sum: &mut Point<L>) {
        sum.twist = self.rates[j].twist.scale_add(weight, sum.twist);
        sum.pose = self.pose[j].scale_add(weight, sum.pose);
        if keeps {
            sum.scalar = self.scalar[j].mul_add(weight, sum.scalar);
        }
    }

    /// Square of the length of `h sum e_j k_j`, each entry of twist, q and q' by one plus its magnitude at the start.
    #[inline(always)]
    pub(super) fn error(&self, tableau: &Tableau, weights: &[f64; STAGES], n: usize, h: L, from: &Motion<L, N>) -> L {
        let (mut pose, mut twist) = (Vector6::zero(), Vector6::zero());
        for j in 0..STAGES {
            let weight = h * L::c(weights[j]);
            pose = self.pose[j].scale_add(weight, pose);
            twist = self.rates[j].twist.scale_add(weight, twist);
        }
        let mut sum = pose.dot(pose);
        let (twist, size) = (twist.to_array(), from.twist.to_array());
        unroll!(k in 0 1 2 3 4 5 => {
            sum += squared_share(twist[k], size[k]);
        });
        for k in 0..n {
            let (mut q, mut qd) = (L::zero(), L::zero());
            for j in 0..STAGES {
                let weight = h * L::c(weights[j]);
                q = self.rates[j].qd[k].mul_add(h * h * L::c(tableau.place_error[j]), q);
                qd = self.rates[j].qd[k].mul_add(weight, qd);
            }
            sum += squared_share(q, from.q[k]) + squared_share(qd, from.qd[k]);
        }
        sum
    }

    /// Change of the right-hand side between states within the step. Squares of the states' difference, first its
    /// coordinates and then its velocities times h; and of the accelerations' change times h^2.
    ///
    /// Written in the accelerations: coordinates differ by `h` times the difference of the velocities before them.
    #[inline(always)]
    pub(super) fn contrast(&self, contrast: &Contrast, n: usize, h: L, from: &Motion<L, N>) -> [L; 3] {
        let Contrast { three, place, speed, change: [last, before], .. } = *contrast;
        let (mut squares, mut across) = ([L::zero(); 3], L::zero());
        let [a, b, c] = [&self.rates[0].twist, &self.rates[1].twist, &self.rates[2].twist];
        unroll!(k in 0 1 2 => {
            let linear = [from.twist.linear.0[k], a.linear.0[k], b.linear.0[k], c.linear.0[k]];
            add_differences(three, linear, &mut squares, &mut across);
            let angular = [from.twist.angular.0[k], a.angular.0[k], b.angular.0[k], c.angular.0[k]];
            add_differences(three, angular, &mut squares, &mut across);
        });
        for k in 0..n {
            let joint = [from.qd[k], self.rates[0].qd[k], self.rates[1].qd[k], self.rates[2].qd[k]];
            add_differences(three, joint, &mut squares, &mut across);
        }
        let [first, second, third] = squares;
        let change = third * L::c(last * last) + across * L::c(2.0 * last * before) + second * L::c(before * before);
        let speeds = second * L::c(speed * speed);
        let places = first * L::c(place * place);
        let (h2, h4) = (h * h, h * h * (h * h));
        let places = if three { places * h4 } else { places * h2 };
        [places, h4 * speeds, h4 * change.max(L::zero())]
    }

    /// Makes the last stage the first one of the next step where the mask holds; `at` is that step's start.
    #[inline(always)]
    pub(super) fn carry(&mut self, mask: L::Mask, n: usize, at: &Motion<L, N>) {
        let [first, .., last] = &mut self.rates;
        unroll!(k in 0 1 2 => {
            first.twist.linear.0[k] = L::select(mask, last.twist.linear.0[k], first.twist.linear.0[k]);
            first.twist.angular.0[k] = L::select(mask, last.twist.angular.0[k], first.twist.angular.0[k]);
        });
        for k in 0..n {
            first.qd[k] = L::select(mask, last.qd[k], first.qd[k]);
        }
        self.pose[0] = at.twist;
    }
}

/// Adds squares of first quantity and successive differences, and the product of the two differences.
#[inline(always)]
fn add_differences<L: Lane>(three: bool, [v, a, b, c]: [L; 4], squares: &mut [L; 3], across: &mut L) {
    let [x, y, z] = if three { [a, b - a, c - b] } else { [v, a, b - a] };
    squares[0] = x.mul_add(x, squares[0]);
    squares[1] = y.mul_add(y, squares[1]);
    squares[2] = z.mul_add(z, squares[2]);
    *across = y.mul_add(z, *across);
}

/// `(x / (1 + |size|))^2`
#[inline(always)]
fn squared_share<L: Lane>(x: L, size: L) -> L {
    let share = x / (size.abs() + L::c(1.0));
    share * share
}
