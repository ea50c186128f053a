//! Ranges of the parameters of episodes.

use serde::{Deserialize, Serialize};

use crate::error::TaskError;

/// A closed interval for uniform draws, written as `[low, high]`, or as one number for both ends.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(from = "Given", into = "[f64; 2]")]
pub struct Span {
    /// Minimum value.
    pub low: f64,
    /// Maximum value.
    pub high: f64,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "must be a number or a list of two, [minimum, maximum]")]
enum Given {
    Number(f64),
    Range([f64; 2]),
}

impl From<Given> for Span {
    fn from(given: Given) -> Self {
        match given {
            Given::Number(x) => Self::of(x, x),
            Given::Range([low, high]) => Self::of(low, high),
        }
    }
}

impl From<Span> for [f64; 2] {
    fn from(span: Span) -> Self {
        [span.low, span.high]
    }
}

impl Span {
    /// From minimum to maximum.
    pub const fn of(low: f64, high: f64) -> Self {
        Self { low, high }
    }

    /// Both ends times a factor.
    pub(super) fn times(self, factor: f64) -> Self {
        Self::of(self.low * factor, self.high * factor)
    }

    /// Both ends, s, in control periods.
    pub(super) fn in_periods(self, period: f64) -> [f64; 2] {
        [self.low / period, self.high / period]
    }

    /// The number at a share in [0, 1) of the interval.
    pub(super) fn at(self, share: f64) -> f64 {
        self.low + (self.high - self.low) * share
    }
}

/// Numbers that must lie within bounds.
pub(super) trait Bounded {
    /// Refuses numbers beyond these bounds.
    fn check(&self, key: &str, minimum: f64, maximum: f64) -> Result<(), TaskError>;
}

impl Bounded for f64 {
    fn check(&self, key: &str, minimum: f64, maximum: f64) -> Result<(), TaskError> {
        let valid = (minimum..=maximum).contains(self);
        if valid { Ok(()) } else { refuse(key, format!("{self} must be in [{minimum}, {maximum}]")) }
    }
}

impl Bounded for Span {
    fn check(&self, key: &str, minimum: f64, maximum: f64) -> Result<(), TaskError> {
        let Self { low, high } = self;
        if low > high || low.is_nan() || high.is_nan() {
            return refuse(key, format!("[{low}, {high}] is no range, minimum first"));
        }
        [*low, *high].check(key, minimum, maximum)
    }
}

impl<T: Bounded> Bounded for Option<T> {
    fn check(&self, key: &str, minimum: f64, maximum: f64) -> Result<(), TaskError> {
        self.iter().try_for_each(|numbers| numbers.check(key, minimum, maximum))
    }
}

impl<T: Bounded> Bounded for Vec<T> {
    fn check(&self, key: &str, minimum: f64, maximum: f64) -> Result<(), TaskError> {
        self.iter().try_for_each(|numbers| numbers.check(key, minimum, maximum))
    }
}

impl<T: Bounded, const N: usize> Bounded for [T; N] {
    fn check(&self, key: &str, minimum: f64, maximum: f64) -> Result<(), TaskError> {
        self.iter().try_for_each(|numbers| numbers.check(key, minimum, maximum))
    }
}

pub(super) fn refuse<T>(key: &str, reason: String) -> Result<T, TaskError> {
    Err(TaskError::Disturbance { key: key.to_owned(), reason })
}
