//! Record of the sub-intervals of steps, from which their adjoint is computed.

use std::hint::cold_path;

use super::Rates;
use super::motion::Motion;
use super::motion_adjoint::MotionCotangents;
use crate::lane::{Lane, Tape, unroll};
use crate::lie::Vector6;

/// Numbers for which a record keeps its memory: 64 MB.
const KEPT: usize = 1 << 23;

/// Recorder of steps. `()` and `None` record nothing.
pub trait Recorder<L: Lane, const N: usize> {
    /// The same recorder, for a routine.
    type Lent<'a>: Recorder<L, N>
    where
        Self: 'a;
    /// Lends it. (By value: behind a reference the caller would not know whether it still records nothing.)
    fn lend(&mut self) -> Self::Lent<'_>;
    /// Records the start of a step.
    fn begin(&mut self);
    /// Records its end, with further numbers of the state at its start: the reverse needs them first.
    fn end(&mut self, numbers: &[L], count: usize);
    /// Records the rates of a stage or of a solve.
    fn rates(&mut self, rates: &Rates<L, N>, joints: usize);
    /// Records a sub-interval: its start, its size and the time before it (s), and the lanes that took it. Its rates come before it.
    fn sub_interval(&mut self, from: &Motion<L, N>, joints: usize, when: [L; 2], taken: L::Mask);
}

impl<L: Lane, const N: usize> Recorder<L, N> for () {
    type Lent<'a> = ();
    #[inline(always)]
    fn lend(&mut self) {}
    #[inline(always)]
    fn begin(&mut self) {}
    #[inline(always)]
    fn end(&mut self, _: &[L], _: usize) {}
    #[inline(always)]
    fn rates(&mut self, _: &Rates<L, N>, _: usize) {}
    #[inline(always)]
    fn sub_interval(&mut self, _: &Motion<L, N>, _: usize, _: [L; 2], _: L::Mask) {}
}

/// Steps with and without record in one machine code.
impl<L: Lane, const N: usize> Recorder<L, N> for Option<&mut StepRecord<L>> {
    type Lent<'a>
        = Option<&'a mut StepRecord<L>>
    where
        Self: 'a;
    #[inline(always)]
    fn lend(&mut self) -> Option<&mut StepRecord<L>> {
        match self {
            Some(record) => Some(&mut **record),
            None => None,
        }
    }
    #[inline(always)]
    fn begin(&mut self) {
        if let Some(record) = self {
            cold_path();
            record.begin();
        }
    }
    #[inline(always)]
    fn end(&mut self, numbers: &[L], count: usize) {
        if let Some(record) = self {
            cold_path();
            record.end(numbers, count);
        }
    }
    #[inline(always)]
    fn rates(&mut self, rates: &Rates<L, N>, joints: usize) {
        if let Some(record) = self {
            cold_path();
            record.rates(rates, joints);
        }
    }
    #[inline(always)]
    fn sub_interval(&mut self, from: &Motion<L, N>, joints: usize, when: [L; 2], taken: L::Mask) {
        if let Some(record) = self {
            cold_path();
            record.sub_interval(from, joints, when, taken);
        }
    }
}

/// Sub-interval read from a record.
#[derive(Debug, Clone)]
pub struct SubInterval<L, const N: usize> {
    /// Start, without the rounding error of the position.
    pub from: Motion<L, N>,
    /// Size, s.
    pub h: L,
    /// Time before it in the interval, s.
    pub elapsed: L,
    /// 1 in lanes that took it, else 0.
    pub taken: L,
    /// Cotangents of its end; 0 in lanes that did not take it.
    pub of_end: MotionCotangents<L, N>,
}

impl<L: Lane, const N: usize> SubInterval<L, N> {
    /// Memory to read one into.
    #[inline(always)]
    pub fn blank() -> Self {
        let (zero, of_end) = (L::zero(), MotionCotangents::zero());
        Self { from: Motion::blank(), h: zero, elapsed: zero, taken: zero, of_end }
    }

    /// Reads the last one of a record with its `rates` and removes both; `of` has the cotangents of its end. In lanes that did not
    /// take it, rates and the cotangents here become zero. Returns the lanes that took it.
    #[inline(always)]
    pub(super) fn pop(
        &mut self,
        tape: &mut Tape<L::Real>,
        rates: &mut [Rates<L, N>],
        of: &MotionCotangents<L, N>,
        joints: usize,
    ) -> L::Mask {
        let (from, mut last) = (&mut self.from, [L::zero(); 3]);
        tape.pop(&mut last, 3);
        [self.h, self.elapsed, self.taken] = last;
        tape.pop(&mut from.qd, joints);
        tape.pop(&mut from.q, joints);
        pop_twist(tape, &mut from.twist);
        tape.pop(&mut from.pose.position.0, 3);
        tape.pop(from.pose.rotation.0.as_flattened_mut(), 9);
        let takes = L::c(0.5).lt(self.taken);
        for i in (0..rates.len()).rev() {
            rates[i].pop(tape, joints);
            rates[i].keep_where(takes, joints);
        }
        self.h = L::select(takes, self.h, L::zero());
        self.of_end.clear(joints);
        self.of_end.set_where(takes, of, joints);
        takes
    }
}

#[inline(always)]
fn pop_twist<L: Lane>(tape: &mut Tape<L::Real>, twist: &mut Vector6<L>) {
    let mut numbers = [L::zero(); 6];
    tape.pop(&mut numbers, 6);
    *twist = Vector6::from_array(numbers);
}

impl<L: Lane, const N: usize> Rates<L, N> {
    /// Sets these to 0 except where the mask holds.
    #[inline(always)]
    pub(super) fn keep_where(&mut self, mask: L::Mask, joints: usize) {
        let (zero, twist) = (L::zero(), &mut self.twist);
        for k in 0..3 {
            twist.linear.0[k] = L::select(mask, twist.linear.0[k], zero);
            twist.angular.0[k] = L::select(mask, twist.angular.0[k], zero);
        }
        for k in 0..joints {
            self.qd[k] = L::select(mask, self.qd[k], zero);
        }
    }

    /// Reads the last rates of a record and removes them.
    #[inline(always)]
    pub(super) fn pop(&mut self, tape: &mut Tape<L::Real>, joints: usize) {
        tape.pop(&mut self.qd, joints);
        pop_twist(tape, &mut self.twist);
    }
}

/// Record of steps in lanes: numbers, and how many sub-intervals each step has.
#[derive(Debug, Clone)]
pub struct StepRecord<L: Lane> {
    /// The numbers.
    pub tape: Tape<L::Real>,
    /// Sub-intervals of each step.
    pub sub_intervals: Vec<usize>,
}

impl<L: Lane> StepRecord<L> {
    /// Empty record.
    pub fn empty() -> Self {
        Self { tape: Tape::default(), sub_intervals: Vec::new() }
    }

    /// Frees memory that only very many steps need.
    pub fn trim(&mut self) {
        if self.tape.len() + self.tape.room() > KEPT {
            *self = Self::empty();
        }
    }
}

impl<L: Lane> StepRecord<L> {
    #[inline(always)]
    fn begin(&mut self) {
        self.sub_intervals.push(0);
    }

    #[inline(always)]
    fn end(&mut self, numbers: &[L], count: usize) {
        self.tape.reserve::<L>(count);
        self.tape.push(numbers, count);
    }

    #[inline(always)]
    fn rates<const N: usize>(&mut self, rates: &Rates<L, N>, joints: usize) {
        self.tape.reserve::<L>(6 + joints);
        self.tape.push(&rates.twist.to_array(), 6);
        self.tape.push(&rates.qd, joints);
    }

    #[inline(always)]
    fn sub_interval<const N: usize>(
        &mut self,
        from: &Motion<L, N>,
        joints: usize,
        [h, elapsed]: [L; 2],
        taken: L::Mask,
    ) {
        self.tape.reserve::<L>(21 + 2 * joints);
        unroll!(i in 0 1 2 => {
            self.tape.push(&from.pose.rotation.0[i], 3);
        });
        self.tape.push(&from.pose.position.0, 3);
        self.tape.push(&from.twist.to_array(), 6);
        self.tape.push(&from.q, joints);
        self.tape.push(&from.qd, joints);
        self.tape.push(&[h, elapsed, L::select(taken, L::c(1.0), L::zero())], 3);
        if let Some(count) = self.sub_intervals.last_mut() {
            *count += 1;
        }
    }
}
