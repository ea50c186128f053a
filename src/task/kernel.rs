//! Tasks in lanes: what happens to a group of instances at a control instant.

use std::f64::consts::PI;
use std::iter::Zip;
use std::slice::{ChunksExactMut, Iter};

use super::disturbance::{MEASURED, Weather};
use super::episode::EpisodeRows;
use super::metrics::{INFO, Judgement};
use super::observation::{LEAK, POSITION_BOUND, RATE_BOUND, SPEED_BOUND, TURN_BOUND, joint_bounds};
use super::options::{Goal, TaskOptions};
use super::path::{path_advance, path_point};
use super::pose::PoseError;
use super::reference::{JointReference, hermite};
use super::stance::Stance;
use super::task::Rig;
use crate::control::{ACTIONS, ActionKind, Actuated, Actuation};
use crate::lane::{Lane, Real, Rows, Shared, ln_1p};
use crate::lie::{self, Vector3, rotation_angle};
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
    pub(super) actuation: Actuation<T>,
    end_effector: EndEffector<Shared<T>>,
    /// Control periods per second.
    frequency: T,
    /// What a period leaves of the integral of the pose error, and what it adds of an error that is constant over it.
    leak: [T; 2],
    home: [T; JOINTS],
    /// One over the scale, and the bound, of each entry of an observation.
    scaling: Vec<[T; 2]>,
    /// Of the reward's terms.
    weights: [T; 4],
    /// Errors of position and attitude below which a pose counts as reached.
    tolerance: [T; 2],
    /// Control period, s.
    period: T,
    /// Greatest correction to a classical controller's action, where that is what actions are.
    residual: Option<T>,
    /// World axis against gravity.
    up: [T; 3],
    /// Points seen ahead, and the periods between them.
    preview: (usize, T),
    /// Greatest distance of joint coordinates from home.
    travel: Vec<T>,
    weather: Option<Weather<T>>,
}

/// What the physics needs over one control period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command<L> {
    /// Thrusts and their wrench.
    pub actuated: Actuated<L>,
    /// Joint servo targets: per joint the cubic `c0 + c1 t + c2 t^2 + c3 t^3` in the time t since the period's start.
    /// It meets the reference's value and rate at both ends of the period. Zeros where no joint follows one.
    pub joints: [[L; 4]; JOINTS],
}

impl<L: Lane> Command<L> {
    /// Nothing: memory to work in.
    #[inline(always)]
    pub fn none() -> Self {
        Self { actuated: Actuated::none(), joints: [[L::zero(); 4]; JOINTS] }
    }
}

impl<T: Real> TaskKernel<T> {
    /// Numbers of the task in this precision.
    pub(super) fn new(options: &TaskOptions, rig: &Rig) -> Self {
        let (period, number) = (options.control_period(), T::from_f64);
        let (keep, weights, actions) = ((-LEAK * period).exp(), &options.reward, rig.actions.len());
        let rows = EpisodeRows::new(options.task, rig.joints, actions).with(&rig.disturbance, &rig.site);
        Self {
            rows,
            weather: rows.disturbance.map(|rows| Weather::new(rows, &rig.site)),
            actuation: Actuation::new(&rig.actions),
            end_effector: rig.end_effector.map(|Shared(x)| Shared(number(x))),
            frequency: number(1.0 / period),
            leak: [keep, (1.0 - keep) / LEAK].map(number),
            home: rig.home.map(number),
            scaling: rig.layout.scaling().map(|entry| entry.map(number)).collect(),
            weights: [-weights.pose, -weights.effort, -weights.rate / actions as f64, -weights.diverged].map(number),
            tolerance: [options.tolerance.position, options.tolerance.attitude].map(number),
            period: number(period),
            residual: (options.action == ActionKind::Residual).then(|| number(options.residual)),
            up: rig.up.map(number),
            preview: (options.preview.points as usize, number(options.preview.spacing / period)),
            travel: joint_bounds(&rig.layout).into_iter().map(number).collect(),
        }
    }

    /// Where the numbers of an episode lie.
    pub fn rows(&self) -> &EpisodeRows {
        &self.rows
    }

    /// What changes within episodes, if anything does.
    #[inline(always)]
    pub fn weather(&self) -> Option<&Weather<T>> {
        self.weather.as_ref()
    }

    /// Entries of an observation.
    pub fn observation_len(&self) -> usize {
        self.scaling.len()
    }

    /// Whether joints are acted on, rather than follow references.
    #[inline(always)]
    pub fn drives_joints(&self) -> bool {
        self.tracks()
    }

    /// Joints that follow references.
    #[inline(always)]
    fn following(&self) -> usize {
        if self.tracks() { 0 } else { self.rows.joints }
    }

    #[inline(always)]
    fn tracks(&self) -> bool {
        self.rows.goal == Goal::Track
    }

    /// Sets the reference's points from the reference itself, at an episode's start.
    #[inline(always)]
    pub fn aim<L: Lane<Real = T>>(&self, memory: &mut Rows<'_, T>) {
        if self.tracks() {
            self.aim_now::<L>(memory);
        }
        for i in 0..self.following() {
            let reference: JointReference<L> = self.rows.reference(memory, i);
            for (row, ahead) in [(self.rows.now, 0.0), (self.rows.next, 1.0)] {
                let point = reference.point(L::c(ahead), L::splat(self.frequency));
                self.rows.set_point(memory, row, i, &point);
            }
        }
    }

    /// Sets where the path is now.
    #[inline(always)]
    fn aim_now<L: Lane<Real = T>>(&self, memory: &mut Rows<'_, T>) {
        let point = path_point::<T, L>(memory, self.rows.path, L::zero(), L::splat(self.frequency));
        self.rows.set_target(memory, &point.pose);
        memory.set_all(self.rows.motion, &point.velocity.0);
        memory.set_all(self.rows.motion + 3, &point.turning.0);
    }

    /// Takes an action (entries beyond [-1, 1] are clipped, NaN counts as 0) for the coming control period; `base` is
    /// what the classical controller does, where actions are corrections to it. `action` becomes what is done.
    #[inline(always)]
    pub fn act<L: Lane<Real = T>>(
        &self,
        memory: &mut Rows<'_, T>,
        action: &mut [L; ACTIONS],
        base: Option<&[L; ACTIONS]>,
        command: &mut Command<L>,
    ) {
        let rows = &self.rows;
        let mut change = L::zero();
        for k in 0..rows.actions {
            // Two clips that differ for NaN alone: one makes it 1, the other -1.
            let (a, one) = (action[k], L::c(1.0));
            action[k] = (a.min(one).max(-one) + a.max(-one).min(one)) * L::c(0.5);
            let by = action[k] - memory.get(rows.action + k);
            change = by.mul_add(by, change);
            memory.set(rows.action + k, action[k]);
        }
        if let (Some(limit), Some(base)) = (self.residual, base) {
            for k in 0..rows.actions {
                let one = L::c(1.0);
                action[k] = action[k].mul_add(L::splat(limit), base[k]).min(one).max(-one);
            }
        }
        let Command { actuated, joints } = command;
        self.actuation.act_into(action, actuated);
        memory.set(rows.change, change);
        memory.set_all(rows.effort, &[actuated.square, actuated.power, actuated.saturation]);
        for i in 0..self.following() {
            let (now, next) = (rows.point(memory, rows.now, i), rows.point(memory, rows.next, i));
            joints[i] = hermite(&now, &next, L::splat(self.frequency));
        }
    }

    /// Moves what is to be followed to the next control instant.
    #[inline(always)]
    pub fn advance<L: Lane<Real = T>>(&self, memory: &mut Rows<'_, T>) {
        let rows = &self.rows;
        for i in 0..self.following() {
            let mut reference: JointReference<L> = rows.reference(memory, i);
            reference.advance();
            let now = rows.point::<T, L>(memory, rows.next, i);
            rows.set_point(memory, rows.now, i, &now);
            rows.set_point(memory, rows.next, i, &reference.point(L::c(1.0), L::splat(self.frequency)));
            memory.set_all(rows.reference + JointReference::<L>::LEN * i, &reference.moving());
        }
        if self.tracks() {
            path_advance::<T, L>(memory, rows.path);
            self.aim_now::<L>(memory);
        }
    }

    /// Judges episodes at the control instant that `stance` was reached at, after [`Self::advance`]; `share` is one over
    /// the number of control periods done, this one included.
    ///
    /// Errors that are beyond the bounds or no numbers count as the bounds, so that all results are finite.
    #[inline(always)]
    pub fn judge<L: Lane<Real = T>>(
        &self,
        memory: &mut Rows<'_, T>,
        stance: &Stance<L>,
        error: &PoseError<L>,
        share: L,
    ) -> Judgement<L> {
        let rows = &self.rows;
        let sound = self.sound(memory, stance, error);
        self.measure(memory, stance, error, sound);
        let ([keep, gain], seen) = (self.leak, self.seen(memory, stance, error));
        for k in 0..6 {
            let old: L = memory.get(rows.integral + k);
            let new = seen[k].mul_add(L::splat(gain), old * L::splat(keep));
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

        let mean: L = memory.get(rows.means + 6);
        info[19] = (info[18] - mean).mul_add(share, mean);
        memory.set(rows.means + 6, info[19]);
        let [was_astray, clock] = memory.get_all(rows.astray);
        let (one, zero) = (L::c(1.0), L::zero());
        let within = L::c(0.5).lt(info[18]);
        info[20] = L::select(within, clock, was_astray.mul_add(clock, L::splat(self.period)));
        memory.set_all(rows.astray, &[L::select(within, zero, one), info[20]]);

        let [pose, effort, rate, diverged] = self.weights;
        let angle = info[1] * L::c(RADIAN);
        let square = info[0].mul_add(info[0], angle * angle);
        let cost = square.sqrt().mul_add(L::c(1.0 / COARSE), ln_1p(square * L::c(1.0 / (FINE * FINE))));
        info[15] = cost * L::splat(pose);
        info[16] = memory.get::<L>(rows.effort) * L::splat(effort);
        info[17] = memory.get::<L>(rows.change) * L::splat(rate);
        info[21] = L::select(sound, zero, one);
        info[22] = L::select(sound, zero, L::splat(diverged));
        Judgement { reward: info[15] + info[16] + info[17] + info[22], info, sound }
    }

    /// What there is to say of episodes where they stand: measures as they are, no reward, no running means.
    #[inline(always)]
    pub fn survey<L: Lane<Real = T>>(
        &self,
        memory: &Rows<'_, T>,
        stance: &Stance<L>,
        error: &PoseError<L>,
    ) -> Judgement<L> {
        let sound = self.sound(memory, stance, error);
        let mut info = self.measures(memory, stance, error);
        info[21] = L::select(sound, L::zero(), L::c(1.0));
        Judgement { reward: L::zero(), info, sound }
    }

    /// Pose error of the vehicle, or of the end effector that follows a path.
    #[inline(always)]
    pub fn error<L: Lane<Real = T>>(&self, memory: &Rows<'_, T>, stance: &Stance<L>) -> PoseError<L> {
        let target = self.rows.target(memory);
        if self.tracks() { PoseError::of(&self.reached(stance), &target) } else { PoseError::of(&stance.pose, &target) }
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
        let mut page = Page { places: self.scaling.iter().zip(entries.chunks_exact_mut(L::LANES)) };
        let (n, seen): (_, [L; MEASURED]) = (rows.joints, self.seen(memory, stance, error));
        for k in 0..12 {
            page.put(seen[k]);
        }
        if self.tracks() {
            for k in 0..3 {
                page.put(seen[12 + 2 * n + k]);
            }
        }
        for i in 0..n {
            page.put(seen[12 + i] - L::splat(self.home[i]));
        }
        for i in 0..n {
            page.put(seen[12 + n + i]);
        }
        if self.tracks() {
            let reached = self.reached(stance);
            for part in [rows.motion, rows.motion + 3] {
                page.put_all(reached.rotation.apply_transposed(Vector3(memory.get_all(part))));
            }
            // What is seen ahead is off by what the present error is off by.
            let moved = Vector3([seen[0], seen[1], seen[2]]) - error.position;
            let turned = Vector3([seen[3], seen[4], seen[5]]) - error.rotation;
            let measured = self.sensors().is_some();
            let (points, apart) = self.preview;
            for k in 0..points {
                let ahead = L::c((k + 1) as f64) * L::splat(apart);
                let point = path_point::<T, L>(memory, rows.path, ahead, L::splat(self.frequency));
                let ahead = PoseError::of(&reached, &point.pose);
                page.put_all(if measured { ahead.position + moved } else { ahead.position });
                page.put_all(if measured { ahead.rotation + turned } else { ahead.rotation });
            }
        } else {
            for i in 0..n {
                page.put(memory.get::<L>(rows.next + 2 * i) - L::splat(self.home[i]));
            }
            for i in 0..n {
                page.put(memory.get::<L>(rows.next + 2 * i + 1));
            }
        }
        for k in 0..rows.actions {
            page.put(memory.get::<L>(rows.action + k));
        }
        for k in 0..6 {
            page.put(memory.get::<L>(rows.integral + k));
        }
    }

    /// Direction against gravity in body axes.
    #[inline(always)]
    pub(super) fn up<L: Lane<Real = T>>(&self, stance: &Stance<L>) -> Vector3<L> {
        stance.pose.rotation.apply_transposed(Vector3(splat_all(&self.up)))
    }

    /// Pose of the end effector.
    #[inline(always)]
    fn reached<L: Lane<Real = T>>(&self, stance: &Stance<L>) -> lie::Pose<L> {
        stance.pose.times(&self.end_effector.at(&stance.q))
    }

    /// Where the state is finite and within the bounds of `Task::violation`.
    #[inline(always)]
    fn sound<L: Lane<Real = T>>(&self, memory: &Rows<'_, T>, stance: &Stance<L>, error: &PoseError<L>) -> L::Mask {
        let mut sound = if self.tracks() {
            within(error.position, POSITION_BOUND)
        } else {
            let target: [L; 3] = memory.get_all(self.rows.target + 9);
            within(stance.pose.position - Vector3(target), POSITION_BOUND)
        };
        if self.tracks() {
            // Joints that nothing brings back.
            for i in 0..self.rows.joints {
                let apart = (stance.q[i] - L::splat(self.home[i])).abs();
                sound = L::and(sound, apart.lt(L::splat(self.travel[i])));
            }
        }
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
        let mut info = [L::zero(); INFO];
        info[0] = length(error.position, POSITION_BOUND);
        info[1] = error.angle.min(L::c(PI));
        if self.tracks() {
            (info[2], info[3]) = (info[0], info[1]);
        } else {
            let mut wanted_q = [L::zero(); JOINTS];
            for i in 0..rows.joints {
                wanted_q[i] = memory.get(rows.now + 2 * i);
            }
            // Both end effectors in the target's frame.
            let (reached, wanted) = (self.end_effector.at(&stance.q), self.end_effector.at(&wanted_q));
            let apart = error.turn.apply(reached.position + error.position) - wanted.position;
            let turned = wanted.rotation.transposed().times(&error.turn.times(&reached.rotation));
            info[2] = length(apart, POSITION_BOUND);
            info[3] = rotation_angle(&turned).min(L::c(PI));
        }
        info[4] = memory.get(rows.effort + 1);
        info[5] = memory.get(rows.effort + 2);
        for k in 0..3 {
            info[12 + k] = memory.get(rows.current + k);
        }
        let [position, attitude] = self.tolerance;
        let reached = L::and(info[0].lt(L::splat(position)), info[1].lt(L::splat(attitude)));
        info[18] = L::select(reached, L::c(1.0), L::zero());
        info[25] = L::c(1.0);
        if let Some(disturbance) = rows.disturbance {
            for k in 0..3 {
                info[23 + k] = memory.get(disturbance.shown + k);
            }
        }
        info
    }
}

/// The same numbers in every lane.
#[inline(always)]
fn splat_all<L: Lane, const K: usize>(numbers: &[L::Real; K]) -> [L; K] {
    let mut out = [L::zero(); K];
    for k in 0..K {
        out[k] = L::splat(numbers[k]);
    }
    out
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
    /// Scale and bound of the entries to come, and where they belong.
    places: Zip<Iter<'a, [T; 2]>, ChunksExactMut<'a, f32>>,
}

impl<T: Real> Page<'_, T> {
    #[inline(always)]
    fn put_all<L: Lane<Real = T>>(&mut self, values: Vector3<L>) {
        for k in 0..3 {
            self.put(values.0[k]);
        }
    }

    /// The next entry, scaled and clipped. Infinite values become their bound and NaN the upper bound, so that a broken
    /// state never looks like one on target.
    #[inline(always)]
    fn put<L: Lane<Real = T>>(&mut self, value: L) {
        let Some((&[by, bound], entry)) = self.places.next() else { unreachable!("more entries than the layout has") };
        let bound = L::splat(bound);
        (value * L::splat(by)).min(bound).max(-bound).store_single(entry);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_are_scaled_clipped_and_never_broken() {
        let mut row = [0.0; 5];
        let scaling = [[2.0, 20.0], [0.5, 5.0], [1.0, 3.0], [1.0, 3.0], [1.0, 3.0]];
        let mut page = Page { places: scaling.iter().zip(row.chunks_exact_mut(1)) };
        for value in [1.0, -100.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            page.put(value);
        }
        assert_eq!(row, [2.0, -5.0, 3.0, 3.0, -3.0]);
    }
}
