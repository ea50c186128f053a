//! Observations: layout, blocks that several tasks share, and the writer.

use std::f64::consts::PI;

use super::bounds::{POSITION_BOUND, RATE_BOUND, SPEED_BOUND, TURN_BOUND};
use super::reference::PRISMATIC_PER_RADIAN;
use crate::control::ACTIONS;
use crate::description::Joint;
use crate::lane::{Lane, Real};
use crate::lie::Vector3;
use crate::system::JOINTS;

/// Physical values of 1 in an observation, in metres, radians and seconds.
pub(super) const ERROR_SCALE: f64 = 0.1;
pub(super) const TWIST_SCALE: f64 = 0.2;
pub(super) const JOINT_SCALE: f64 = 0.5;
pub(super) const INTEGRAL_SCALE: f64 = 0.2;
/// Maximum number of points of a path ahead.
pub const PREVIEW: usize = 8;
/// Maximum number of entries of an observation.
pub const LONGEST: usize = 27 + 4 * JOINTS + ACTIONS + 6 * PREVIEW;
/// Joint coordinates are observed within this angle of home, rad, or within twice the joint's travel.
const JOINT_BOUND: f64 = 10.0;
/// Maximum entry of a unit vector: rounding included.
pub(super) const UNIT_BOUND: f64 = 1.001;

/// A named run of entries in a row of observations.
///
/// An entry is the physical value over its scale, clipped to its bound on either side.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// Key, unique in the layout.
    pub name: &'static str,
    /// First entry.
    pub offset: usize,
    /// Physical value of 1, per entry.
    pub scale: Vec<f64>,
    /// Maximum magnitude, in scaled units, per entry.
    pub bound: Vec<f64>,
    /// Unit of the physical value.
    pub unit: &'static str,
    /// One sentence for people.
    pub description: &'static str,
}

/// Layout of an observation: blocks in order, without gaps.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ObservationLayout {
    blocks: Vec<Block>,
    scale: Vec<f64>,
    bound: Vec<f32>,
}

impl ObservationLayout {
    /// Appends a block with a (scale, maximum physical magnitude) per entry; without entries, nothing.
    pub fn push(&mut self, name: &'static str, unit: &'static str, description: &'static str, entries: &[(f64, f64)]) {
        if entries.is_empty() {
            return;
        }
        let scale: Vec<f64> = entries.iter().map(|e| e.0).collect();
        let bound: Vec<f64> = entries.iter().map(|e| e.1 / e.0).collect();
        let offset = self.width();
        self.scale.extend(&scale);
        self.bound.extend(bound.iter().map(|b| *b as f32));
        self.blocks.push(Block { name, offset, scale, bound, unit, description });
    }

    /// Blocks, in order.
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// The block of that name.
    pub fn block(&self, name: &str) -> Option<&Block> {
        self.blocks.iter().find(|b| b.name == name)
    }

    /// Number of entries of a row.
    pub fn width(&self) -> usize {
        self.scale.len()
    }

    /// Maximum magnitude of each entry: a row lies in `[-bound, bound]`.
    pub fn bound(&self) -> &[f32] {
        &self.bound
    }

    /// One over the scale, and the bound, of each entry.
    pub fn scaling(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        self.scale.iter().zip(&self.bound).map(|(scale, bound)| [1.0 / scale, f64::from(*bound)])
    }
}

/// Scale and maximum magnitude per entry of a pose error: position, attitude.
pub(super) const POSE_ERROR: [(f64, f64); 2] = [(ERROR_SCALE, POSITION_BOUND), (ERROR_SCALE, PI)];
/// Scale and maximum magnitude per entry of a twist: linear, angular.
pub(super) const TWIST: [(f64, f64); 2] = [(TWIST_SCALE, SPEED_BOUND), (TWIST_SCALE, TURN_BOUND)];

/// Six entries from one (scale, bound) for the first three and one for the others.
pub(super) fn six([first, last]: [(f64, f64); 2]) -> [(f64, f64); 6] {
    [first, first, first, last, last, last]
}

/// Scale and bound of joint coordinates, and of joint rates.
pub(super) fn joint_entries(joints: &[Joint]) -> [Vec<(f64, f64)>; 2] {
    let unit = |joint: &Joint| if joint.slides() { PRISMATIC_PER_RADIAN } else { 1.0 };
    let coordinate = |joint: &Joint| {
        let travel = joint.limits.as_ref().map_or(0.0, |l| l.upper - l.lower);
        (JOINT_SCALE * unit(joint), (JOINT_BOUND * unit(joint)).max(2.0 * travel))
    };
    let rate = |joint: &Joint| (JOINT_SCALE * unit(joint), RATE_BOUND);
    [joints.iter().map(coordinate).collect(), joints.iter().map(rate).collect()]
}

/// Maximum distance of each joint coordinate from home.
pub(super) fn joint_bounds(layout: &ObservationLayout) -> Vec<f64> {
    let block = layout.block("joint_position");
    block.into_iter().flat_map(|b| b.bound.iter().zip(&b.scale).map(|(bound, scale)| bound * scale)).collect()
}

/// Writer of an observation's entries, in order.
pub struct ObservationWriter<'a, T> {
    /// Scale and bound of each entry.
    scaling: &'a [[T; 2]],
    /// Places of the entries, of `lanes` instances each.
    entries: &'a mut [f32],
    lanes: usize,
    /// Entries written so far.
    written: usize,
}

impl<'a, T: Real> ObservationWriter<'a, T> {
    /// For entries of `lanes` instances each, with these scales and bounds.
    #[inline(always)]
    pub fn new(scaling: &'a [[T; 2]], entries: &'a mut [f32], lanes: usize) -> Self {
        Self { scaling, entries, lanes, written: 0 }
    }

    /// Writes the next three entries.
    #[inline(always)]
    pub fn put_vector<L: Lane<Real = T>>(&mut self, values: Vector3<L>) {
        for k in 0..3 {
            self.put(values.0[k]);
        }
    }

    /// Writes the next entry, scaled and clipped. Infinite values become their bound and NaN the upper bound, so that an
    /// invalid state never reads like one on target.
    #[inline(always)]
    pub fn put<L: Lane<Real = T>>(&mut self, value: L) {
        let [by, bound] = self.scaling[self.written];
        let bound = L::splat(bound);
        (value * L::splat(by)).min(bound).max(-bound).store_single_at(self.entries, self.written * self.lanes);
        self.written += 1;
    }
}
