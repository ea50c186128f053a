//! Gradient through the application of an action.

use super::frames::{Acted, BLOCK, GradientWidths, pack, unpack};
use crate::control::ACTIONS;
use crate::lane::{Dual, Kernel, Lane, Real, Rows};
use crate::task::kernel::{ActionKernel, Command};

/// Result of [`super::TaskGradient::act_vjp`].
pub(super) fn act_vjp(
    kernel: ActionKernel<'_, f64>,
    widths: GradientWidths,
    frames: &Acted<'_>,
    cotangents: &[f64],
) -> Vec<f64> {
    let GradientWidths { action: a, force, memory: coordinates, .. } = widths;
    let count = frames.actions.len() / a;
    let mut block = ActBlock {
        kernel,
        widths,
        corrects: frames.base.is_some(),
        count: 0,
        memory: vec![0.0; 2 * BLOCK * widths.rows],
        actions: vec![0.0; BLOCK * a],
        base: vec![0.0; BLOCK * a],
        cotangents: vec![0.0; BLOCK * (force + coordinates)],
        out: vec![0.0; BLOCK * (2 * a + coordinates)],
    };
    let mut out = vec![0.0; count * (2 * a + coordinates)];
    for first in (0..count).step_by(BLOCK) {
        pack(frames.memory, 0..widths.rows, widths.rows, first, &mut block.memory);
        pack(frames.actions, 0..a, a, first, &mut block.actions);
        if let Some(base) = frames.base {
            pack(base, 0..a, a, first, &mut block.base);
        }
        pack(cotangents, 0..force + coordinates, force + coordinates, first, &mut block.cotangents);
        // The action overwrites its own rows of the memory; the others stay.
        block.out[2 * a * BLOCK..].copy_from_slice(&block.cotangents[force * BLOCK..]);
        block.out[2 * a * BLOCK..(3 * a + 4) * BLOCK].fill(0.0);
        block.count = BLOCK.min(count - first);
        f64::dispatch_wide(&mut block);
        unpack(&block.out, 2 * a + coordinates, first, &mut out);
    }
    out
}

/// Columns of frames before the physics.
struct ActBlock<'a> {
    kernel: ActionKernel<'a, f64>,
    widths: GradientWidths,
    /// Actions are corrections to a base controller's.
    corrects: bool,
    count: usize,
    /// Values, and behind them slopes.
    memory: Vec<f64>,
    actions: Vec<f64>,
    base: Vec<f64>,
    cotangents: Vec<f64>,
    out: Vec<f64>,
}

impl Kernel<f64> for ActBlock<'_> {
    /// One pass for each entry of action, base and previous action.
    #[inline(always)]
    fn run<L: Lane<Real = f64>>(&mut self) {
        let (kernel, widths, corrects) = (self.kernel, self.widths, self.corrects);
        let (a, row, thrusters) = (widths.action, kernel.rows.action, kernel.actuation.thrusters());
        let (zero, one) = (L::zero(), L::c(1.0));
        let mut command = Command::none();
        for group in (0..self.count).step_by(L::LANES) {
            let mut memory = Rows::of_block(&mut self.memory, group);
            let mut previous = [zero; ACTIONS];
            for k in 0..a {
                previous[k] = memory.get::<Dual<L>>(row + k).value;
            }
            for along in 0..3 * a {
                if !corrects && along >= a && along < 2 * a {
                    continue;
                }
                let (mut action, mut base) = ([Dual::zero(); ACTIONS], [Dual::zero(); ACTIONS]);
                for k in 0..a {
                    let at = k * BLOCK + group;
                    action[k] = Dual::new(L::load(&self.actions[at..]), if along == k { one } else { zero });
                    base[k] = Dual::new(L::load(&self.base[at..]), if along == a + k { one } else { zero });
                    memory.set(row + k, Dual::new(previous[k], if along == 2 * a + k { one } else { zero }));
                }
                kernel.act(&mut memory, &mut action, if corrects { Some(&base) } else { None }, &mut command);
                let (cotangents, mut sum) = (&self.cotangents[group..], zero);
                for k in 0..widths.force {
                    let actuated = &command.actuated;
                    let force = if k < thrusters { actuated.thrusts[k] } else { actuated.torques[k - thrusters] };
                    sum = force.slope.mul_add(L::load(&cotangents[k * BLOCK..]), sum);
                }
                for k in 0..a + 4 {
                    let number: Dual<L> = memory.get(row + k);
                    sum = number.slope.mul_add(L::load(&cotangents[(widths.force + k) * BLOCK..]), sum);
                }
                sum.store(&mut self.out[along * BLOCK + group..]);
            }
        }
    }
}
