//! Numbers of 106 bits as lanes: differences of the kernels to 20 digits.
//!
//! Sums and products after Dekker (1971) and Knuth (TAOCP 2, 4.2.2), each to about 1e-31.

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use uvms_gym::lane::Lane;

/// Unevaluated sum of two numbers, of which the second is at most half a unit in the last place of the first.
#[derive(Debug, Clone, Copy)]
pub struct DoubleDouble {
    /// Nearest f64.
    pub high: f64,
    /// Rest.
    pub low: f64,
}

/// `a + b`, exactly.
#[inline(never)]
fn two_sum(a: f64, b: f64) -> DoubleDouble {
    let high = a + b;
    let part = high - a;
    DoubleDouble { high, low: (a - (high - part)) + (b - part) }.or_limit()
}

/// `a b`, exactly.
fn two_product(a: f64, b: f64) -> DoubleDouble {
    let split = |x: f64| {
        let high = 134_217_729.0 * x;
        let high = high - (high - x);
        (high, x - high)
    };
    let (high, (a, a_low), (b, b_low)) = (a * b, split(a), split(b));
    DoubleDouble { high, low: ((a * b - high) + a * b_low + a_low * b) + a_low * b_low }.or_limit()
}

impl DoubleDouble {
    /// Infinity and NaN without a rest.
    fn or_limit(self) -> Self {
        if self.high.is_finite() { self } else { Self { high: self.high, low: 0.0 } }
    }
}

impl Add for DoubleDouble {
    type Output = Self;
    #[inline(never)]
    fn add(self, b: Self) -> Self {
        let (sum, rest) = (two_sum(self.high, b.high), two_sum(self.low, b.low));
        let sum = two_sum(sum.high, sum.low + rest.high);
        two_sum(sum.high, sum.low + rest.low)
    }
}
impl Sub for DoubleDouble {
    type Output = Self;
    fn sub(self, b: Self) -> Self {
        self + -b
    }
}
impl Mul for DoubleDouble {
    type Output = Self;
    #[inline(never)]
    fn mul(self, b: Self) -> Self {
        let product = two_product(self.high, b.high);
        two_sum(product.high, product.low + (self.high * b.low + self.low * b.high))
    }
}
impl Div for DoubleDouble {
    type Output = Self;
    #[inline(never)]
    fn div(self, b: Self) -> Self {
        let mut quotient = Self { high: self.high / b.high, low: 0.0 };
        for _ in 0..2 {
            quotient += Self { high: (self - quotient * b).high / b.high, low: 0.0 };
        }
        quotient.or_limit()
    }
}
impl Neg for DoubleDouble {
    type Output = Self;
    fn neg(self) -> Self {
        Self { high: -self.high, low: -self.low }
    }
}
impl AddAssign for DoubleDouble {
    fn add_assign(&mut self, b: Self) {
        *self = *self + b;
    }
}
impl SubAssign for DoubleDouble {
    fn sub_assign(&mut self, b: Self) {
        *self = *self - b;
    }
}

impl Lane for DoubleDouble {
    type Real = f64;
    type Mask = bool;
    const LANES: usize = 1;

    fn splat(x: f64) -> Self {
        Self { high: x, low: 0.0 }
    }
    fn load(from: &[f64]) -> Self {
        Self::splat(from[0])
    }
    fn store(self, to: &mut [f64]) {
        to[0] = self.high;
    }
    /// First parts in the first half of the memory, rests in the second.
    fn read(numbers: &[f64], at: usize) -> Option<Self> {
        Some(two_sum(*numbers.get(at)?, *numbers.get(numbers.len() / 2 + at)?))
    }
    fn write(self, numbers: &mut [f64], at: usize) {
        let half = numbers.len() / 2;
        (numbers[at], numbers[half + at]) = (self.high, self.low);
    }
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }
    #[inline(never)]
    fn sqrt(self) -> Self {
        let root = Self::splat(self.high.sqrt());
        if root.high > 0.0 { root + (self - root * root) / Self::splat(2.0 * root.high) } else { root }
    }
    fn abs(self) -> Self {
        if self.high < 0.0 { -self } else { self }
    }
    /// As of f64: the rest decides only at integers and halves, where the kernels are not differentiable.
    fn round(self) -> Self {
        Self::splat(self.high.round_ties_even())
    }
    fn lt(self, b: Self) -> bool {
        self.high < b.high || (self.high == b.high && self.low < b.low)
    }
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }
    fn and(a: bool, b: bool) -> bool {
        a & b
    }
    fn bits(mask: bool) -> u32 {
        u32::from(mask)
    }
    fn split(self) -> (Self, Self) {
        let (mantissa, exponent) = self.high.split();
        (Self { high: mantissa, low: self.low * (mantissa / self.high) }, Self::splat(exponent))
    }
    fn inverse_sqrt_estimate(self) -> Self {
        Self::splat(self.high.inverse_sqrt_estimate())
    }
    fn load_single(from: &[f32]) -> Self {
        Self::splat(f64::from(from[0]))
    }
    fn store_single(self, to: &mut [f32]) {
        to[0] = self.high as f32;
    }
    fn store_double(self, to: &mut [f64]) {
        to[0] = self.high;
    }
}

#[test]
fn products_quotients_and_roots_have_thirty_digits() {
    let number = |x: f64| DoubleDouble::splat(x);
    let third = number(1.0) / number(3.0);
    let two = number(2.0).sqrt();
    for (rest, bound) in [(third * number(3.0) - number(1.0), 1e-31), (two * two - number(2.0), 1e-30)] {
        assert!((rest.high + rest.low).abs() < bound, "{rest:?}");
    }
    let (a, b) = (number(1.0) + number(1e-20), third * two);
    assert!(((a - number(1.0)).high - 1e-20).abs() < 1e-36);
    assert!(((b * b * number(4.5) - number(1.0)).high).abs() < 1e-30);
}
