//! Detection of a lost thruster by a bank of observers, and allocation without it. `[WJ76]`

use nalgebra as na;
use serde::{Deserialize, Serialize};

use super::Actuated;
use super::allocation::{Allocation, THRUSTERS};
use super::dob::FeedbackGains;
use super::observer::ObserverGains;
use crate::description::Vehicle;
use crate::error::ControlError;
use crate::lane::Lane;
use crate::lie::Vector6;

/// Gains of the detection.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FaultGains {
    /// Log-likelihood ratio from which a thruster counts as lost; 0: none is looked for.
    pub fault_threshold: f64,
    /// Minimum share of its thrust that a lost thruster has lost.
    pub fault_loss: f64,
    /// Time constant of forgetting, s.
    pub fault_memory: f64,
}

impl Default for FaultGains {
    fn default() -> Self {
        Self { fault_threshold: 0.0, fault_loss: 0.6, fault_memory: 1.0 }
    }
}

/// Gains of a control law, and of the detection of a lost thruster.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct FaultTolerant<G> {
    /// Gains of the law.
    #[serde(flatten)]
    pub law: G,
    /// Gains of the detection.
    #[serde(flatten)]
    pub fault: FaultGains,
}

impl<G> FaultTolerant<G> {
    /// These gains, without detection.
    pub fn new(law: G) -> Self {
        Self { law, fault: FaultGains::default() }
    }
}

/// Thrust per demand of a thruster's own wrench from which the others cannot replace it: 1 without redundancy.
const ALONE: f64 = 0.9;
/// Lost share from which a thruster that the others cannot replace is dead; below it is asked for more.
const DEAD: f64 = 0.85;
/// Maximum lost share that more demand makes up for.
const MOST: f64 = 0.999;
/// Thrust over the range with which a lost thruster is tried where nothing else commands it.
const TRIAL: f64 = 0.15;
/// Control periods of a trial, half of them in either direction.
const TRIAL_PERIODS: f64 = 4.0;
/// Squared normalised innovation from which a measurement counts less, as under a push.
const OUTLYING: f64 = 12.0;
/// Time constant of the innovations' variances, s.
const VARIANCE_TIME: f64 = 10.0;

/// Observers without a fault and without each thruster, beside the controller's: the generalised likelihood ratio of the loss of
/// a share of one thrust.
///
/// Innovations depend linearly on the lost share `s`: `nu = nu_0 + s (nu_i - nu_0)` with the innovation nu_0 without a fault and
/// nu_i without thruster i. The share of the greatest likelihood is a regression of nu_0 on the differences, which fades. A common
/// factor on all thrusts is estimated with it, so that neither weak thrusters nor a heavy vehicle count as a fault.
/// Variances of the innovations are those of the recent past.
#[derive(Debug, Clone, PartialEq)]
pub struct ThrusterFaults {
    gains: FaultGains,
    /// Remaining shares after a control period: of the regression and of the variances.
    retention: [f64; 2],
    thrusters: Vec<Loss>,
}

/// Loss of one thruster.
#[derive(Debug, Clone, PartialEq)]
struct Loss {
    /// Wrench per thrust.
    column: [f64; 6],
    /// Thrust per demanded wrench, and its limits, N.
    row: [f64; 6],
    limits: [f64; 2],
    /// Thrust per demand of its own wrench.
    own: f64,
    /// Demanded wrench to the closest one of the others, where they cannot replace it.
    others: Option<na::Matrix6<f64>>,
    /// Thrust of a trial, N.
    trial: f64,
}

// Places in a row of memory.
/// Number of the lost thruster, from 1 on; 0: none.
pub const LOST: usize = 0;
/// Its lost share.
pub const SHARE: usize = 1;
/// Number of decisions so far.
const ALARMS: usize = 2;
const PHASE: usize = 3;
/// Fading sums: count and squares of innovations; products of the common difference with itself and the innovation.
const COUNT: usize = 4;
const SQUARES: usize = 5;
const COMMON: usize = 11;
/// By thruster: products of its difference with itself, with the innovation and with the common difference.
const PRODUCTS: usize = 13;

impl ThrusterFaults {
    /// For a checked vehicle that is acted on every `period` s.
    ///
    /// # Errors
    /// As [`Allocation::new`].
    pub fn new(
        gains: FaultGains,
        vehicle: &Vehicle,
        allocation: &Allocation,
        period: f64,
    ) -> Result<Self, ControlError> {
        let fading = |time: f64| if time > 0.0 { (-period / time).exp() } else { 1.0 };
        let loss = |i: usize| -> Result<Loss, ControlError> {
            let (column, row) = (allocation.column(i), allocation.pseudo_inverse(i));
            let own = row.dot(&column);
            let others = match own < ALONE {
                true => None,
                false => {
                    let mut without = vehicle.clone();
                    without.thrusters.remove(i);
                    let others = Allocation::new(&without)?;
                    let reached = |k: usize| others.wrench(&others.unsaturated(&na::Vector6::ith(k, 1.0)));
                    Some(na::Matrix6::from_columns(&[0, 1, 2, 3, 4, 5].map(reached)))
                }
            };
            let (limits, trial) = (allocation.limits(i), TRIAL * allocation.range(i));
            Ok(Loss { column: column.into(), row: row.into(), limits, own, others, trial })
        };
        let thrusters = (0..allocation.count()).map(loss).collect::<Result<_, _>>()?;
        Ok(Self { gains, retention: [fading(gains.fault_memory), fading(VARIANCE_TIME)], thrusters })
    }

    /// Observers without a fault and without each thruster: slower than a controller's, so that they do not take a lost thrust
    /// for a disturbance at once.
    pub(super) fn observers(&self, delay: usize) -> Vec<FeedbackGains> {
        let observer = ObserverGains {
            observer_bandwidth: [1.0, 2.0],
            wave_acceleration: [0.4, 0.3],
            wave_frequency: 1.0,
            acceleration_noise: [0.2, 0.3],
            delay,
        };
        vec![FeedbackGains { observer, ..FeedbackGains::default() }; 1 + self.thrusters.len()]
    }

    /// Numbers of memory per instance.
    pub fn memory(&self) -> usize {
        PRODUCTS + 3 * self.thrusters.len()
    }

    /// Names and lengths of the blocks of memory.
    pub fn memory_layout(&self) -> Vec<(&'static str, usize)> {
        vec![("lost_thruster", 1), ("lost_share", 1), ("alarms", 1), ("fault_statistics", self.memory() - PHASE)]
    }

    /// Updates the decision by the innovation without a fault and the differences of the others from it, where these are
    /// predictions.
    #[inline(always)]
    pub fn decide<L: Lane<Real = f64>>(
        &self,
        innovation: Vector6<L>,
        differences: &[Vector6<L>; THRUSTERS],
        predicted: L::Mask,
        memory: &mut [L],
    ) {
        let (zero, one, small) = (L::zero(), L::c(1.0), L::c(1e-12));
        let (keep, keep_variance) = (L::c(self.retention[0]), L::c(self.retention[1]));
        let (innovation, mut common) = (innovation.to_array(), [zero; 6]);
        let (mut precision, mut size) = ([zero; 6], zero);
        for k in 0..6 {
            let square = innovation[k] * innovation[k];
            precision[k] = memory[COUNT] / memory[SQUARES + k].max(small);
            size = square.mul_add(precision[k], size);
            let fading = memory[SQUARES + k].mul_add(keep_variance, square);
            memory[SQUARES + k] = L::select(predicted, fading, memory[SQUARES + k]);
            for i in 0..self.thrusters.len() {
                common[k] += differences[i].to_array()[k];
            }
        }
        // Nothing counts before the variances do.
        let counts = L::and(predicted, L::c(5.0).lt(memory[COUNT]));
        let weight = L::select(counts, L::c(OUTLYING) / size.max(L::c(OUTLYING)), zero);
        memory[COUNT] = L::select(predicted, memory[COUNT].mul_add(keep_variance, one), memory[COUNT]);
        let mut products = [zero; 2];
        for k in 0..6 {
            let weighted = common[k] * precision[k] * weight;
            products[0] = common[k].mul_add(weighted, products[0]);
            products[1] = innovation[k].mul_add(weighted, products[1]);
        }
        for k in 0..2 {
            memory[COMMON + k] = memory[COMMON + k].mul_add(keep, products[k]);
        }
        let (of_common, of_both) = (memory[COMMON].max(small), memory[COMMON + 1]);
        let (mut best, mut best_ratio, mut best_share) = (zero, zero, zero);
        let (mut own_ratio, mut own_share, mut own_information) = (zero, zero, zero);
        for i in 0..self.thrusters.len() {
            let (row, difference) = (PRODUCTS + 3 * i, differences[i].to_array());
            let mut products = [zero; 3];
            for k in 0..6 {
                let weighted = difference[k] * precision[k] * weight;
                products[0] = difference[k].mul_add(weighted, products[0]);
                products[1] = innovation[k].mul_add(weighted, products[1]);
                products[2] = common[k].mul_add(weighted, products[2]);
            }
            for k in 0..3 {
                memory[row + k] = memory[row + k].mul_add(keep, products[k]);
            }
            // Without what a common factor explains.
            let by = memory[row + 2] / of_common;
            let information = (memory[row] - by * memory[row + 2]).max(small);
            let share = ((by * of_both - memory[row + 1]) / information).max(zero).min(one);
            let ratio = share * share * information * L::c(0.5);
            let number = L::c(1.0 + i as f64);
            let own = is_lost(memory, i);
            own_ratio = L::select(own, ratio, own_ratio);
            own_share = L::select(own, share, own_share);
            own_information = L::select(own, information, own_information);
            let better = L::and(best_ratio.lt(ratio), L::c(self.gains.fault_loss).lt(share));
            best = L::select(better, number, best);
            best_ratio = L::select(better, ratio, best_ratio);
            best_share = L::select(better, share, best_share);
        }
        let threshold = L::c(self.gains.fault_threshold);
        let alarm = (own_ratio + threshold).lt(best_ratio);
        let alarm = L::and(alarm, L::c(0.5).lt((best - memory[LOST]).abs()));
        // A thruster whose command would show its loss and does not is sound.
        let known = threshold.lt(own_information * L::c(0.5));
        let sound = L::and(known, own_share.lt(L::c(0.5 * self.gains.fault_loss)));
        let share = L::select(known, own_share, memory[SHARE]);
        memory[LOST] = L::select(alarm, best, L::select(sound, zero, memory[LOST]));
        memory[SHARE] = L::select(alarm, best_share, L::select(sound, zero, share));
        memory[ALARMS] = L::select(alarm, memory[ALARMS] + one, memory[ALARMS]);
        let next = memory[PHASE] + one;
        memory[PHASE] = L::select(next.lt(L::c(TRIAL_PERIODS - 0.5)), next, zero);
    }

    /// Wrench to demand in place of this one, so that the thrusters have its effect without the lost share (Sherman and
    /// Morrison's formula). Where one is dead that the others cannot replace, they come closest to it, and it is tried. The
    /// demand of the lost thruster stays within its limits, so that it does not scale down the others'.
    #[inline(always)]
    pub fn demand<L: Lane<Real = f64>>(&self, wrench: Vector6<L>, memory: &[L]) -> Vector6<L> {
        let (given, mut demand) = (wrench.to_array(), wrench.to_array());
        let (share, one) = (memory[SHARE].min(L::c(MOST)), L::c(1.0));
        for (i, loss) in self.thrusters.iter().enumerate() {
            let (mut wanted, mut thrust) = (given, L::zero());
            for k in 0..6 {
                thrust = given[k].mul_add(L::c(loss.row[k]), thrust);
            }
            // Demand of this thruster in all, within its limits.
            let [lower, upper] = loss.limits;
            let more = thrust * share / share.neg_mul_add(L::c(loss.own), one);
            let all = more.mul_add(L::c(loss.own), thrust);
            let excess = all - all.min(L::c(upper).max(thrust)).max(L::c(lower).min(thrust));
            let more = excess.neg_mul_add(L::c(1.0 / loss.own), more);
            let forward = memory[PHASE].lt(L::c(0.5 * TRIAL_PERIODS - 0.5));
            let trial = L::select(forward, L::c(loss.trial), L::c(-loss.trial));
            let dead = L::c(DEAD).lt(share);
            for k in 0..6 {
                wanted[k] = more.mul_add(L::c(loss.column[k]), given[k]);
                if let Some(others) = &loss.others {
                    let mut closest = trial * L::c(loss.column[k]);
                    for j in 0..6 {
                        closest = given[j].mul_add(L::c(others[(k, j)]), closest);
                    }
                    wanted[k] = L::select(dead, closest, wanted[k]);
                }
                demand[k] = L::select(is_lost(memory, i), wanted[k], demand[k]);
            }
        }
        Vector6::from_array(demand)
    }

    /// Index of a dead thruster that the others cannot replace, in a row of memory.
    pub(super) fn irreplaceable(&self, memory: &[f64]) -> Option<usize> {
        let lost = (memory[LOST] as usize).checked_sub(1)?;
        (self.thrusters[lost].others.is_some() && memory[SHARE] > DEAD).then_some(lost)
    }

    /// Wrench of an observer: 0, the controller's, knows of the lost share; 1 knows of none, and 2 + i is without thruster i.
    #[inline(always)]
    pub(super) fn wrench<L: Lane<Real = f64>>(&self, observer: usize, acted: &Actuated<L>, memory: &[L]) -> Vector6<L> {
        let mut wrench = acted.wrench.to_array();
        for (i, loss) in self.thrusters.iter().enumerate() {
            let share = match observer {
                0 => L::select(is_lost(memory, i), memory[SHARE], L::zero()),
                _ if observer == 2 + i => L::c(1.0),
                _ => L::zero(),
            };
            for k in 0..6 {
                wrench[k] = (share * acted.thrusts[i]).neg_mul_add(L::c(loss.column[k]), wrench[k]);
            }
        }
        Vector6::from_array(wrench)
    }
}

/// True where thruster i is the lost one.
#[inline(always)]
fn is_lost<L: Lane<Real = f64>>(memory: &[L], i: usize) -> L::Mask {
    (memory[LOST] - L::c(1.0 + i as f64)).abs().lt(L::c(0.5))
}
