//! Parameters of a system, in lanes.

use std::mem::MaybeUninit;

use super::dual::Dual;
use super::number::Lane;

/// A parameter of the system: shared by all lanes, or one number per lane.
pub trait Param<L: Lane>: Copy {
    /// True if the parameter is the same in all lanes.
    const SHARED: bool;

    /// The parameter in lanes.
    fn get(self) -> L;
}

impl<L: Lane> Param<L> for L {
    const SHARED: bool = false;

    #[inline(always)]
    fn get(self) -> L {
        self
    }
}

/// A number per lane, as a constant in differentiation.
impl<L: Lane> Param<Dual<L>> for L {
    const SHARED: bool = false;

    #[inline(always)]
    fn get(self) -> Dual<L> {
        Dual::new(self, L::c(-0.0))
    }
}

/// A parameter shared by all lanes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(transparent)]
pub struct Shared<T>(pub T);

impl<L: Lane> Param<L> for Shared<L::Real> {
    const SHARED: bool = true;

    #[inline(always)]
    fn get(self) -> L {
        L::splat(self.0)
    }
}

/// Parameters in lanes. (Not `map`: a closure would not inherit the caller's instruction set.)
#[inline(always)]
pub fn get_all<L: Lane, P: Param<L>, const K: usize>(parameters: &[P; K]) -> [L; K] {
    let mut out = MaybeUninit::<[L; K]>::uninit();
    unroll!(k < K => {
        // SAFETY: entry k of K.
        unsafe { out.as_mut_ptr().cast::<L>().add(k).write(parameters[k].get()) }
    });
    // SAFETY: all K entries are written.
    unsafe { out.assume_init() }
}

/// An optional parameter in lanes. (Not `map`: a closure would not inherit the caller's instruction set.)
#[expect(clippy::manual_map, reason = "a closure would not inherit the caller's instruction set")]
#[inline(always)]
pub fn get_option<L: Lane, P: Param<L>>(parameter: Option<P>) -> Option<L> {
    match parameter {
        Some(parameter) => Some(parameter.get()),
        None => None,
    }
}
