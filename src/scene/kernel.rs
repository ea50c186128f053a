//! Tasks in lanes: what happens to a group of instances at a control instant.

use std::f64::consts::PI;

use super::episode::EpisodeRows;
use super::metrics::{INFO, Judgement};
use super::observation::{LEAK, POSITION_BOUND, RATE_BOUND, SPEED_BOUND, TURN_BOUND};
use super::options::TaskOptions;
use super::pose::PoseError;
use super::reference::{JointReference, hermite};
use super::stance::Stance;
use super::task::Rig;
use crate::control::{ACTIONS, Actuated, Actuation};
use crate::lane::{Lane, Real, Rows, Shared, ln_1p};
use crate::lie::{Vector3, rotation_angle};
use crate::system::{EndEffector, JOINTS};

/// Metres that a radian of attitude error counts as.
const RADIAN: f64 = 0.5;
/// Pose errors at which the reward's logarithm and its linear part set in, m. They are the user's accuracy, not the
/// vehicle's size: no scene scales them.
const FINE: f64 = 0.02;
const COARSE: f64 = 0.3;

/// Numbers of the task, in the precision of the lanes.
#[derive(Debug, Clone, PartialEq)]
pub struct TaskKernel<T> {
    rows: EpisodeRows,
    actuation: Actuation<T>,
    end_effector: EndEffector<Shared<T>>,
    /// Control periods per second.
    frequency: T,
    /// What a period leaves of the integral of the pose error, and what it adds of an error that is constant over it.
    leak: [T; 2],
    home: [T; JOINTS],
    /// One over the scale, and the bound, of each entry of an observation.
    scaling: Vec<[T; 2]>,
    /// Of the reward's terms.
    weights: [T; 3],
}

/// What the physics needs over one control period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command<L> {
    /// Thrusts and their wrench.
    pub actuated: Actuated<L>,
    /// Joint servo targets: per joint the cubic `c0 + c1 t + c2 t^2 + c3 t^3` in the time t since the period's start.
    /// It meets the reference's value and rate at both ends of the period. Zeros past the scene's joints.
    pub joints: [[L; 4]; JOINTS],
}

impl<T: Real> TaskKernel<T> {
    /// Numbers of the task in this precision.
    pub(super) fn new(options: &TaskOptions, rig: &Rig) -> Self {
        let (period, number) = (options.control_period(), T::from_f64);
        let (keep, weights, actions) = ((-LEAK * period).exp(), &options.reward, rig.actions.len());
        Self {
            rows: EpisodeRows::new(rig.joints, actions),
            actuation: Actuation::new(&rig.actions),
            end_effector: rig.end_effector.map(|Shared(x)| Shared(number(x))),
            frequency: number(1.0 / period),
            leak: [keep, (1.0 - keep) / LEAK].map(number),
            home: rig.home.map(number),
            scaling: rig.layout.scaling().map(|entry| entry.map(number)).collect(),
            weights: [-weights.pose, -weights.effort, -weights.rate / actions as f64].map(number),
        }
    }

    /// Where the numbers of an episode lie.
    pub fn rows(&self) -> &EpisodeRows {
        &self.rows
    }

    /// Entries of an observation.
    pub fn observation_len(&self) -> usize {
        self.scaling.len()
    }

    /// Sets the reference's points from the reference itself, at an episode's start.
    #[inline(always)]
    pub fn aim<L: Lane<Real = T>>(&self, memory: &mut Rows<'_, T>) {
        for i in 0..self.rows.joints {
            let reference: JointReference<L> = self.rows.reference(memory, i);
            for (row, ahead) in [(self.rows.now, 0.0), (self.rows.next, 1.0)] {
                let point = reference.point(L::c(ahead), L::splat(self.frequency));
                self.rows.set_point(memory, row, i, &point);
            }
        }
    }

    /// Takes an action (entries beyond [-1, 1] are clipped, NaN counts as 0) for the coming control period.
    #[inline(always)]
    pub fn act<L: Lane<Real = T>>(&self, memory: &mut Rows<'_, T>, action: &[L; ACTIONS]) -> Command<L> {
        let rows = &self.rows;
        let mut clipped = [L::zero(); ACTIONS];
        let mut change = L::zero();
        for k in 0..rows.actions {
            // Two clips that differ for NaN alone: one makes it 1, the other -1.
            let (a, one) = (action[k], L::c(1.0));
            clipped[k] = (a.min(one).max(-one) + a.max(-one).min(one)) * L::c(0.5);
            let by = clipped[k] - memory.get(rows.action + k);
            change = by.mul_add(by, change);
            memory.set(rows.action + k, clipped[k]);
        }
        let actuated = self.actuation.act(&clipped);
        memory.set(rows.change, change);
        memory.set_all(rows.effort, &[actuated.square, actuated.power, actuated.saturation]);
        let mut joints = [[L::zero(); 4]; JOINTS];
        for i in 0..rows.joints {
            let (now, next) = (rows.point(memory, rows.now, i), rows.point(memory, rows.next, i));
            joints[i] = hermite(&now, &next, L::splat(self.frequency));
        }
        Command { actuated, joints }
    }

    /// Moves episodes to the control instant that `stance` was reached at, and judges them; `share` is one over the
    /// number of control periods done, this one included.
    ///
    /// Errors that are beyond the bounds or no numbers count as the bounds, so that all results are finite.
    #[inline(always)]
    pub fn advance<L: Lane<Real = T>>(
        &self,
        memory: &mut Rows<'_, T>,
        stance: &Stance<L>,
        error: &PoseError<L>,
        share: L,
    ) -> Judgement<L> {
        let rows = &self.rows;
        for i in 0..rows.joints {
            let mut reference: JointReference<L> = rows.reference(memory, i);
            reference.advance();
            let now = rows.point::<T, L>(memory, rows.next, i);
            rows.set_point(memory, rows.now, i, &now);
            rows.set_point(memory, rows.next, i, &reference.point(L::c(1.0), L::splat(self.frequency)));
            memory.set_all(rows.reference + JointReference::<L>::LEN * i, &reference.to_array());
        }

        let sound = self.sound(memory, stance);
        let ([keep, gain], [x, y, z], [a, b, c]) = (self.leak, error.position.0, error.rotation.0);
        let error_entries = [x, y, z, a, b, c];
        for k in 0..6 {
            let old: L = memory.get(rows.integral + k);
            let new = error_entries[k].mul_add(L::splat(gain), old * L::splat(keep));
            memory.set(rows.integral + k, L::select(sound, new, old));
        }

        let mut info = self.measures(memory, stance, error);
        for k in 0..6 {
            let square = k < 4;
            let entry = if square { info[k] * info[k] } else { info[k] };
            let mean: L = memory.get(rows.means + k);
            let mean = (entry - mean).mul_add(share, mean);
            memory.set(rows.means + k, mean);
            info[6 + k] = if square { mean.sqrt() } else { mean };
        }

        let [pose, effort, rate] = self.weights;
        let angle = info[1] * L::c(RADIAN);
        let square = info[0].mul_add(info[0], angle * angle);
        let cost = square.sqrt().mul_add(L::c(1.0 / COARSE), ln_1p(square * L::c(1.0 / (FINE * FINE))));
        info[15] = cost * L::splat(pose);
        info[16] = memory.get::<L>(rows.effort) * L::splat(effort);
        info[17] = memory.get::<L>(rows.change) * L::splat(rate);
        Judgement { reward: info[15] + info[16] + info[17], info, sound }
    }

    /// What there is to say of episodes where they stand: measures as they are, no reward, no running means.
    #[inline(always)]
    pub fn survey<L: Lane<Real = T>>(
        &self,
        memory: &Rows<'_, T>,
        stance: &Stance<L>,
        error: &PoseError<L>,
    ) -> Judgement<L> {
        Judgement { reward: L::zero(), info: self.measures(memory, stance, error), sound: self.sound(memory, stance) }
    }

    /// Pose error of the vehicle.
    #[inline(always)]
    pub fn error<L: Lane<Real = T>>(&self, memory: &Rows<'_, T>, stance: &Stance<L>) -> PoseError<L> {
        PoseError::of(&stance.pose, &self.rows.target(memory))
    }

    /// Writes the observation at the current control instant, entry by entry, each of all lanes: always finite and
    /// within [`super::Layout::bound`].
    #[inline(always)]
    pub fn observe<L: Lane<Real = T>>(
        &self,
        memory: &Rows<'_, T>,
        stance: &Stance<L>,
        error: &PoseError<L>,
        entries: &mut [f32],
    ) {
        let rows = &self.rows;
        let mut page = Page { scaling: &self.scaling, entries };
        let (twist, n) = (stance.twist, rows.joints);
        for part in [error.position, error.rotation, twist.linear, twist.angular] {
            for k in 0..3 {
                page.put(part.0[k]);
            }
        }
        for i in 0..n {
            page.put(stance.q[i] - L::splat(self.home[i]));
        }
        for i in 0..n {
            page.put(stance.qd[i]);
        }
        for i in 0..n {
            page.put(memory.get::<L>(rows.next + 2 * i) - L::splat(self.home[i]));
        }
        for i in 0..n {
            page.put(memory.get::<L>(rows.next + 2 * i + 1));
        }
        for k in 0..rows.actions {
            page.put(memory.get::<L>(rows.action + k));
        }
        for k in 0..6 {
            page.put(memory.get::<L>(rows.integral + k));
        }
    }

    /// Where the state is finite and within the bounds of `Task::violation`.
    #[inline(always)]
    fn sound<L: Lane<Real = T>>(&self, memory: &Rows<'_, T>, stance: &Stance<L>) -> L::Mask {
        let target: [L; 3] = memory.get_all(self.rows.target + 9);
        let mut sound = within(stance.pose.position - Vector3(target), POSITION_BOUND);
        sound = L::and(sound, within(stance.twist.linear, SPEED_BOUND));
        sound = L::and(sound, within(stance.twist.angular, TURN_BOUND));
        // Zero times each number: NaN for one that is not finite.
        let mut sum = L::zero();
        for row in stance.pose.rotation.0 {
            for k in 0..3 {
                sum = row[k].mul_add(L::zero(), sum);
            }
        }
        let mut fastest = L::zero();
        for i in 0..self.rows.joints {
            sum = stance.q[i].mul_add(L::zero(), sum);
            sum = stance.qd[i].mul_add(L::zero(), sum);
            fastest = fastest.max(stance.qd[i].abs());
        }
        L::and(sound, L::and(fastest.lt(L::c(RATE_BOUND)), sum.lt(L::c(1.0))))
    }

    /// Measures at the current control instant; running means and reward terms are 0.
    #[inline(always)]
    fn measures<L: Lane<Real = T>>(&self, memory: &Rows<'_, T>, stance: &Stance<L>, error: &PoseError<L>) -> [L; INFO] {
        let rows = &self.rows;
        let mut wanted_q = [L::zero(); JOINTS];
        for i in 0..rows.joints {
            wanted_q[i] = memory.get(rows.now + 2 * i);
        }
        // Both end effectors in the target's frame.
        let (reached, wanted) = (self.end_effector.at(&stance.q), self.end_effector.at(&wanted_q));
        let apart = error.turn.apply(reached.position + error.position) - wanted.position;
        let turned = wanted.rotation.transposed().times(&error.turn.times(&reached.rotation));
        let mut info = [L::zero(); INFO];
        info[0] = length(error.position, POSITION_BOUND);
        info[1] = error.angle.min(L::c(PI));
        info[2] = length(apart, POSITION_BOUND);
        info[3] = rotation_angle(&turned).min(L::c(PI));
        info[4] = memory.get(rows.effort + 1);
        info[5] = memory.get(rows.effort + 2);
        for k in 0..3 {
            info[12 + k] = memory.get(rows.current + k);
        }
        info
    }
}

/// Length of a vector, at most `bound`; NaN counts as the bound.
#[inline(always)]
fn length<L: Lane>(v: Vector3<L>, bound: f64) -> L {
    v.dot(v).sqrt().min(L::c(bound))
}

/// Where a vector is shorter than `bound`.
#[inline(always)]
fn within<L: Lane>(v: Vector3<L>, bound: f64) -> L::Mask {
    v.dot(v).lt(L::c(bound * bound))
}

/// An observation that is being written.
struct Page<'a, T> {
    scaling: &'a [[T; 2]],
    entries: &'a mut [f32],
}

impl<T: Real> Page<'_, T> {
    /// The next entry, scaled and clipped. Infinite values become their bound and NaN the upper bound, so that a broken
    /// state never looks like one on target.
    #[inline(always)]
    fn put<L: Lane<Real = T>>(&mut self, value: L) {
        let ([by, bound], scaling) = (self.scaling[0], &self.scaling[1..]);
        let bound = L::splat(bound);
        let (entry, rest) = std::mem::take(&mut self.entries).split_at_mut(L::LANES);
        (value * L::splat(by)).min(bound).max(-bound).store_single(entry);
        (self.scaling, self.entries) = (scaling, rest);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_are_scaled_clipped_and_never_broken() {
        let mut row = [0.0; 5];
        let mut page =
            Page { scaling: &[[2.0, 20.0], [0.5, 5.0], [1.0, 3.0], [1.0, 3.0], [1.0, 3.0]], entries: &mut row };
        for value in [1.0, -100.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            page.put(value);
        }
        assert_eq!(row, [2.0, -5.0, 3.0, 3.0, -3.0]);
    }
}
