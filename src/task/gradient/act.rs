//! Gradient through the application of an action.

use super::frames::{Acted, BLOCK, GradientWidths, pack, unpack};
use crate::control::ACTIONS;
use crate::lane::{Dual, Kernel, Lane, Rows};
use crate::task::definition::{TaskDefinition, TaskKernel};
use crate::task::kernel::Command;

/// Kernel of [`super::TaskGradient::act_vjp`].
pub(super) struct ActGradient<'a, K: TaskDefinition> {
    pub kernel: &'a TaskKernel<f64, K>,
    pub widths: GradientWidths,
    pub frames: &'a Acted<'a>,
    pub cotangents: &'a [f64],
    pub out: Vec<f64>,
}

impl<K: TaskDefinition> Kernel<f64> for ActGradient<'_, K> {
    #[inline(always)]
    fn run<L: Lane<Real = f64>>(&mut self) {
        let (widths, rows) = (self.widths, &self.kernel.rows);
        let GradientWidths { action: a, force, memory: coordinates, .. } = widths;
        let count = self.frames.actions.len() / a;
        let mut memory = vec![0.0; 2 * BLOCK * widths.rows];
        let mut saved = vec![0.0; BLOCK * widths.rows];
        let mut actions = vec![0.0; BLOCK * a];
        let mut base = vec![0.0; BLOCK * a];
        let mut cotangents = vec![0.0; BLOCK * (force + coordinates)];
        let mut out = vec![0.0; BLOCK * (2 * a + coordinates)];
        for first in (0..count).step_by(BLOCK) {
            pack(self.frames.memory, widths.rows, first, &mut saved);
            memory[..saved.len()].copy_from_slice(&saved);
            memory[saved.len()..].fill(0.0);
            pack(self.frames.actions, a, first, &mut actions);
            if let Some(given) = self.frames.base {
                pack(given, a, first, &mut base);
            }
            pack(self.cotangents, force + coordinates, first, &mut cotangents);
            // The action overwrites its own rows of the memory; the others stay.
            out[2 * a * BLOCK..].copy_from_slice(&cotangents[force * BLOCK..]);
            out[2 * a * BLOCK..(3 * a + 4) * BLOCK].fill(0.0);
            for group in (0..BLOCK.min(count - first)).step_by(L::LANES) {
                for along in 0..3 * a {
                    if self.frames.base.is_none() && (a..2 * a).contains(&along) {
                        continue;
                    }
                    let sum: L = self.pass(&[&actions, &base, &cotangents], &mut memory, group, along);
                    sum.store(&mut out[along * BLOCK + group..]);
                    let written = rows.action * BLOCK..rows.integral * BLOCK;
                    memory[written.clone()].copy_from_slice(&saved[written.clone()]);
                    memory[saved.len() + written.start..saved.len() + written.end].fill(0.0);
                }
            }
            unpack(&out, 2 * a + coordinates, first, &mut self.out);
        }
    }
}

impl<K: TaskDefinition> ActGradient<'_, K> {
    /// Product of the cotangents with the derivatives along coordinate `along` of action, base and previous action.
    #[inline(always)]
    fn pass<L: Lane<Real = f64>>(
        &self,
        [actions, base, cotangents]: &[&[f64]; 3],
        memory: &mut [f64],
        group: usize,
        along: usize,
    ) -> L {
        let (kernel, a) = (self.kernel, self.widths.action);
        let rows = &kernel.rows;
        let half = memory.len() / 2;
        if along >= 2 * a {
            L::c(1.0).store(&mut memory[half + (rows.action + along - 2 * a) * BLOCK + group..]);
        }
        let mut memory = Rows::of_block(memory, group);
        let (mut action, mut correction) = ([Dual::zero(); ACTIONS], [Dual::zero(); ACTIONS]);
        for k in 0..a {
            let [by_action, by_base] = [along == k, along == a + k];
            action[k] = Dual::new(L::load(&actions[k * BLOCK + group..]), L::c(f64::from(u8::from(by_action))));
            correction[k] = Dual::new(L::load(&base[k * BLOCK + group..]), L::c(f64::from(u8::from(by_base))));
        }
        let mut command = Command::none();
        let base = if self.frames.base.is_some() { Some(&correction) } else { None };
        kernel.act(&mut memory, &mut action, base, &mut command);
        let thrusters = kernel.actuation.thrusters();
        let mut sum = L::zero();
        for k in 0..self.widths.force {
            let force: Dual<L> =
                if k < thrusters { command.actuated.thrusts[k] } else { command.actuated.torques[k - thrusters] };
            sum = force.slope.mul_add(L::load(&cotangents[k * BLOCK + group..]), sum);
        }
        for k in 0..a + 4 {
            let number: Dual<L> = memory.get(rows.action + k);
            sum = number.slope.mul_add(L::load(&cotangents[(self.widths.force + k) * BLOCK + group..]), sum);
        }
        sum
    }
}
