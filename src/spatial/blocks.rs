//! Screw transforms of an inertia that is in memory, one block at a time: linear, coupling, angular.
//!
//! Together they are [`Screw::inertia_to_parent`], with the same bits. A block fits into the registers of every instruction set,
//! a whole inertia only into those of AVX-512 and NEON.

use super::{LinkTwist, Screw};
use crate::lane::{Lane, Param};

/// Numbers of earlier blocks that a translation needs for later ones.
#[derive(Debug, Clone, Copy)]
pub struct EarlierBlocks<L> {
    /// Linear block before the transform, of rotations by a general angle only.
    m: [L; 6],
    /// Sums over the coupling block before and after the translation.
    sums: [L; 5],
}

impl<L: Lane> EarlierBlocks<L> {
    /// Zeros.
    #[inline(always)]
    pub fn zero() -> Self {
        Self { m: [L::zero(); 6], sums: [L::zero(); 5] }
    }
}

impl<T: Copy, S: Copy, const ALONG: usize> Screw<T, S, ALONG> {
    /// Linear block in the parent frame; the first of the three.
    #[inline(always)]
    pub fn linear_to_parent<L: Lane>(&self, m: &[L; 6], earlier: &mut EarlierBlocks<L>) -> [L; 6]
    where
        T: Param<L>,
        S: Param<L>,
    {
        if let (Some(_), LinkTwist::General(..)) = (self.translation, self.rotation) {
            earlier.m = *m;
        }
        self.rotate_symmetric::<L, false>(m)
    }

    /// Coupling block in the parent frame; the second. `m` is the linear block there.
    #[inline(always)]
    pub fn coupling_to_parent<L: Lane>(
        &self,
        h: &[[L; 3]; 3],
        m: &[L; 6],
        earlier: &mut EarlierBlocks<L>,
    ) -> [[L; 3]; 3]
    where
        T: Param<L>,
        S: Param<L>,
    {
        let mut moved = *h;
        if let Some(d) = self.translation {
            moved = Self::translate_coupling(&self.before(m, earlier), h, d.get());
            earlier.sums = Self::sums(h, &moved);
        }
        self.rotate_full::<L, false>(&moved)
    }

    /// Linear block before the transform: rotations by right angles are taken back.
    #[inline(always)]
    fn before<L: Lane>(&self, m: &[L; 6], earlier: &EarlierBlocks<L>) -> [L; 6]
    where
        T: Param<L>,
        S: Param<L>,
    {
        match self.rotation {
            LinkTwist::Deg0 => *m,
            LinkTwist::Deg90 => {
                let opposite = self.rotate_symmetric::<L, false>(&self.rotate_symmetric::<L, false>(m));
                self.rotate_symmetric::<L, false>(&opposite)
            }
            LinkTwist::Deg180 => self.rotate_symmetric::<L, false>(m),
            LinkTwist::General(..) => earlier.m,
        }
    }

    /// Angular block in the parent frame; the third.
    #[inline(always)]
    pub fn angular_to_parent<L: Lane>(&self, j: &[L; 6], earlier: &EarlierBlocks<L>) -> [L; 6]
    where
        T: Param<L>,
        S: Param<L>,
    {
        let mut moved = *j;
        if let Some(d) = self.translation {
            moved = Self::translate_angular::<L, false>(j, &earlier.sums, d.get());
        }
        self.rotate_symmetric::<L, false>(&moved)
    }
}
