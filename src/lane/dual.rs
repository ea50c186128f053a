//! Dual numbers in lanes: values and their directional derivatives, for exact differentiation of the kernels.
//!
//! Every branch and mask compares only values, and every value is computed by the operations of the lanes beneath: values have
//! the same bits as without slopes. At the kinks of `min`, `max` and `select` the slope is the slope of the number chosen; at
//! the kinks of `abs` and `sqrt` it is 0.

use super::number::{Lane, Routine, operators};

/// `value + slope e` with `e^2 = 0`, in each lane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dual<L = f64> {
    /// Number that the lane beneath computes.
    pub value: L,
    /// Derivative along the direction.
    pub slope: L,
}

impl<L> Dual<L> {
    /// From value and derivative.
    #[inline(always)]
    pub fn new(value: L, slope: L) -> Self {
        Self { value, slope }
    }
}

operators! { [Dual<L> where L]
    Add add(a, b) = Self::new(a.value + b.value, a.slope + b.slope);
    Sub sub(a, b) = Self::new(a.value - b.value, a.slope - b.slope);
    Mul mul(a, b) = Self::new(a.value * b.value, a.slope.mul_add(b.value, a.value * b.slope));
    Div div(a, b) = {
        let value = a.value / b.value;
        // The reciprocal is the value where 1 is divided: the compiler then divides once.
        Self::new(value, value.neg_mul_add(b.slope, a.slope) * (L::c(1.0) / b.value))
    };
    Neg neg(a) = Self::new(-a.value, -a.slope);
}

/// A routine on dual numbers as one on the lanes beneath, which know their instruction set.
struct OnDuals<'a, R>(&'a mut R);

impl<L: Lane, R: Routine<Dual<L>>> Routine<L> for OnDuals<'_, R> {
    const PORTABLE: bool = R::PORTABLE;

    #[inline(always)]
    fn run(&mut self) {
        self.0.run();
    }
}

impl<L: Lane> Lane for Dual<L> {
    type Real = L::Real;
    type Mask = L::Mask;
    const LANES: usize = L::LANES;
    const SLOPES: bool = true;
    const ONE_FORM: bool = true;

    #[inline(always)]
    fn call<R: Routine<Self>>(routine: &mut R) {
        L::call(&mut OnDuals(routine));
    }
    /// Slope -0: adding -0 changes no number, so that the compiler omits the addition; it would not omit adding +0.
    #[inline(always)]
    fn splat(x: L::Real) -> Self {
        Self::new(L::splat(x), L::c(-0.0))
    }
    #[inline(always)]
    fn load(from: &[L::Real]) -> Self {
        Self::new(L::load(from), L::c(-0.0))
    }
    #[inline(always)]
    fn store(self, to: &mut [L::Real]) {
        self.value.store(to);
    }
    /// Values in the first half of the memory, slopes in the second.
    #[inline(always)]
    fn read(numbers: &[L::Real], at: usize) -> Option<Self> {
        match (L::read(numbers, at), L::read(numbers, numbers.len() / 2 + at)) {
            (Some(value), Some(slope)) => Some(Self::new(value, slope)),
            _ => None,
        }
    }
    #[inline(always)]
    fn write(self, numbers: &mut [L::Real], at: usize) {
        let half = numbers.len() / 2;
        self.value.write(numbers, at);
        self.slope.write(numbers, half + at);
    }
    #[inline(always)]
    fn store_single_at(self, numbers: &mut [f32], at: usize) {
        let half = numbers.len() / 2;
        self.value.store_single(&mut numbers[at..]);
        self.slope.store_single(&mut numbers[half + at..]);
    }
    #[inline(always)]
    fn constant(self) -> Self {
        Self::new(self.value, L::c(-0.0))
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        let slope = self.slope.mul_add(a.value, self.value.mul_add(a.slope, b.slope));
        Self::new(self.value.mul_add(a.value, b.value), slope)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        let slope = L::c(0.5) * self.slope / root;
        Self::new(root, L::select(L::zero().lt(self.value), slope, L::zero()))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        let (value, slope, zero) = (self.value, self.slope, L::zero());
        let slope = L::select(zero.lt(value), slope, L::select(value.lt(zero), -slope, zero));
        Self::new(value.abs(), slope)
    }
    #[inline(always)]
    fn round(self) -> Self {
        Self::new(self.value.round(), L::c(-0.0))
    }
    #[inline(always)]
    fn lt(self, other: Self) -> L::Mask {
        self.value.lt(other.value)
    }
    #[inline(always)]
    fn select(mask: L::Mask, yes: Self, no: Self) -> Self {
        Self::new(L::select(mask, yes.value, no.value), L::select(mask, yes.slope, no.slope))
    }
    #[inline(always)]
    fn and(a: L::Mask, b: L::Mask) -> L::Mask {
        L::and(a, b)
    }
    #[inline(always)]
    fn bits(mask: L::Mask) -> u32 {
        L::bits(mask)
    }
    #[inline(always)]
    fn split(self) -> (Self, Self) {
        let (mantissa, exponent) = self.value.split();
        (Self::new(mantissa, self.slope * (mantissa / self.value)), Self::new(exponent, L::c(-0.0)))
    }
    /// A constant: what follows corrects the estimate, and differentiates its correction.
    #[inline(always)]
    fn inverse_sqrt_estimate(self) -> Self {
        Self::new(self.value.inverse_sqrt_estimate(), L::c(-0.0))
    }
    #[inline(always)]
    fn load_single(from: &[f32]) -> Self {
        Self::new(L::load_single(from), L::c(-0.0))
    }
    #[inline(always)]
    fn store_single(self, to: &mut [f32]) {
        self.value.store_single(to);
    }
    #[inline(always)]
    fn store_double(self, to: &mut [f64]) {
        self.value.store_double(to);
    }
}
