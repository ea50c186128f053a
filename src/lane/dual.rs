//! Dual numbers: a value and its directional derivative, for exact differentiation of the kernel.

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::number::{Lane, assigning_ops};

/// `value + slope e` with `e^2 = 0`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dual {
    /// Value.
    pub value: f64,
    /// Derivative.
    pub slope: f64,
}

impl Dual {
    /// From value and derivative.
    pub fn new(value: f64, slope: f64) -> Self {
        Self { value, slope }
    }
}

impl Add for Dual {
    type Output = Self;
    fn add(self, b: Self) -> Self {
        Self::new(self.value + b.value, self.slope + b.slope)
    }
}
impl Sub for Dual {
    type Output = Self;
    fn sub(self, b: Self) -> Self {
        Self::new(self.value - b.value, self.slope - b.slope)
    }
}
impl Mul for Dual {
    type Output = Self;
    fn mul(self, b: Self) -> Self {
        Self::new(self.value * b.value, self.slope * b.value + self.value * b.slope)
    }
}
impl Div for Dual {
    type Output = Self;
    fn div(self, b: Self) -> Self {
        let value = self.value / b.value;
        Self::new(value, (self.slope - value * b.slope) / b.value)
    }
}
impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        Self::new(-self.value, -self.slope)
    }
}
assigning_ops!(Dual);

impl Lane for Dual {
    type Real = f64;
    type Mask = bool;
    const LANES: usize = 1;

    fn splat(x: f64) -> Self {
        Self::new(x, 0.0)
    }
    fn load(from: &[f64]) -> Self {
        Self::splat(from[0])
    }
    fn store(self, to: &mut [f64]) {
        to[0] = self.value;
    }
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        Self::new(root, 0.5 * self.slope / root)
    }
    fn abs(self) -> Self {
        if self.value < 0.0 { -self } else { self }
    }
    fn round(self) -> Self {
        Self::splat(self.value.round_ties_even())
    }
    fn lt(self, other: Self) -> bool {
        self.value < other.value
    }
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }
    fn and(a: bool, b: bool) -> bool {
        a && b
    }
    fn bits(mask: bool) -> u32 {
        u32::from(mask)
    }
    fn split(self) -> (Self, Self) {
        let (mantissa, exponent) = self.value.split();
        (Self::new(mantissa, self.slope * (mantissa / self.value)), Self::splat(exponent))
    }
    fn inverse_sqrt_estimate(self) -> Self {
        Self::splat(1.0) / self.sqrt()
    }
    fn load_single(from: &[f32]) -> Self {
        Self::splat(f64::from(from[0]))
    }
    fn store_single(self, to: &mut [f32]) {
        to[0] = self.value as f32;
    }
    fn store_double(self, to: &mut [f64]) {
        to[0] = self.value;
    }
}
