//! Bench tables of thrusters.

use std::sync::LazyLock;

use serde::{Deserialize, Serialize};

/// Maximum number of pulse widths of a table, and of pairs of a map: each evaluation visits all of them.
pub const MAX_POINTS: usize = 64;

/// Bench table of a thruster in still water: steady thrust by pulse width and supply voltage, linear in between in both.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ThrustTable {
    /// Pulse widths, us, ascending.
    pulses: Vec<f64>,
    /// Supply voltages, V, ascending.
    voltages: Vec<f64>,
    /// Thrust at each pulse width (rows) and voltage (columns), N; it never descends with the pulse width, and is 0 at a pulse width
    /// for all voltages.
    thrusts: Vec<Vec<f64>>,
}

/// Table of the T200: every fifth row of the maker's.
static T200: LazyLock<ThrustTable> = LazyLock::new(|| {
    let rows = include_str!("t200.csv").lines().filter(|line| !line.starts_with('#'));
    let mut rows = rows.map(|row| row.split(',').filter_map(|cell| cell.trim_end_matches('V').parse().ok()).collect());
    let voltages = rows.next().unwrap_or_default();
    let (pulses, thrusts) = rows.filter_map(|row: Vec<f64>| Some((*row.first()?, row[1..].to_vec()))).unzip();
    ThrustTable { pulses, voltages, thrusts }
});

impl ThrustTable {
    /// Table of Blue Robotics' T200 by its maker, 1100 to 1900 us and 10 to 20 V.
    pub fn t200() -> &'static Self {
        &T200
    }

    /// A table from its parts, see its fields.
    ///
    /// # Errors
    /// The reason why they are no table.
    pub fn new(pulses: Vec<f64>, voltages: Vec<f64>, thrusts: Vec<Vec<f64>>) -> Result<Self, String> {
        let table = Self { pulses, voltages, thrusts };
        table.check()?;
        Ok(table)
    }

    /// Refuses what is no table, by the reason.
    pub(super) fn check(&self) -> Result<(), String> {
        let Self { pulses, voltages, thrusts } = self;
        let count = pulses.len();
        if !(2..=MAX_POINTS).contains(&count) {
            return Err(format!("has {count} pulses, but must have 2 to {MAX_POINTS}"));
        }
        if voltages.is_empty() {
            return Err("has no voltages".into());
        }
        for (name, numbers) in [("pulses", pulses), ("voltages", voltages)] {
            if let Some([a, b]) = numbers.array_windows().find(|[a, b]| a >= b) {
                return Err(format!("{name} must ascend, but {b:?} follows {a:?}"));
            }
        }
        if thrusts.len() != count {
            return Err(format!("thrusts has {} rows, but there are {count} pulses", thrusts.len()));
        }
        if let Some(k) = thrusts.iter().position(|row| row.len() != voltages.len()) {
            let (found, of) = (thrusts[k].len(), voltages.len());
            return Err(format!("thrusts[{k}] has {found} numbers, but there are {of} voltages"));
        }
        let descends = |k: &usize| thrusts[*k].iter().zip(&thrusts[k + 1]).any(|(a, b)| a > b);
        if let Some(k) = (0..count - 1).find(descends) {
            return Err(format!("thrusts must not descend, but those of {:?} us do", pulses[k + 1]));
        }
        if self.neutral().is_none() {
            return Err("no pulse gives 0 N at every voltage".into());
        }
        Ok(())
    }

    /// Minimum and maximum voltage, V.
    pub fn voltages(&self) -> [f64; 2] {
        [self.voltages[0], self.voltages[self.voltages.len() - 1]]
    }

    /// Minimum and maximum pulse width, us.
    pub fn pulses(&self) -> [f64; 2] {
        [self.pulses[0], self.pulses[self.pulses.len() - 1]]
    }

    /// Neutral pulse width: the middle of those without thrust at every voltage, us.
    fn neutral(&self) -> Option<f64> {
        let still = |k: &usize| self.thrusts[*k].iter().all(|thrust| *thrust == 0.0);
        let mut still = (0..self.pulses.len()).filter(still);
        let first = still.next()?;
        Some(0.5 * (self.pulses[first] + self.pulses[still.next_back().unwrap_or(first)]))
    }

    /// Thrusts of all pulse widths at a voltage (V) within the table's, N.
    fn column(&self, voltage: f64) -> impl Fn(usize) -> f64 + '_ {
        let (k, share) = place(&self.voltages, voltage);
        move |row| {
            let row = &self.thrusts[row];
            between(row[k], row[(k + 1).min(row.len() - 1)], share)
        }
    }

    /// Steady thrust, N, of a pulse width (us) at a supply voltage (V); outside the table as at its edge.
    pub fn thrust(&self, pulse: f64, voltage: f64) -> f64 {
        let (thrust, (k, share)) = (self.column(voltage), place(&self.pulses, pulse));
        between(thrust(k), thrust(k + 1), share)
    }

    /// Pulse width, us, that gives a thrust (N) at a supply voltage (V): inverse of [`Self::thrust`]. The neutral one for 0 N, else
    /// the one that is closest to it; thrusts beyond the table's have its first and its last pulse width.
    pub fn pulse(&self, thrust: f64, voltage: f64) -> f64 {
        let (of, pulses, last) = (self.column(voltage), &self.pulses, self.pulses.len() - 1);
        let within = |k: usize| {
            let share = (thrust - of(k)) / (of(k + 1) - of(k));
            between(pulses[k], pulses[k + 1], share.clamp(0.0, 1.0))
        };
        if thrust > 0.0 {
            (1..=last).find(|k| of(*k) >= thrust).map_or(pulses[last], |k| within(k - 1))
        } else if thrust < 0.0 {
            (0..last).rev().find(|k| of(*k) <= thrust).map_or(pulses[0], within)
        } else {
            self.neutral().unwrap_or(pulses[0])
        }
    }

    /// Pairs `[command, thrust]` at a supply voltage (V), N, where commands are linear in the pulse width: 0 at the neutral one,
    /// the limits at the first and the last one.
    pub fn points(&self, [lower, upper]: [f64; 2], voltage: f64) -> Vec<[f64; 2]> {
        let (of, neutral) = (self.column(voltage), self.neutral().unwrap_or(self.pulses[0]));
        let [first, last] = self.pulses();
        let command = |pulse: f64| {
            let (limit, end) = if pulse < neutral { (lower, first) } else { (upper, last) };
            if pulse == neutral { 0.0 } else { limit * (pulse - neutral) / (end - neutral) }
        };
        let mut points: Vec<_> = (0..self.pulses.len()).map(|k| [command(self.pulses[k]), of(k)]).collect();
        // A limit of 0 leaves nothing on its side.
        points.retain(|[command, _]| *command != 0.0);
        let at = points.partition_point(|[command, _]| *command < 0.0);
        points.insert(at, [0.0; 2]);
        points
    }
}

/// Entry of an ascending list before `x` and the share of the way to the next one, at most the whole one.
fn place(list: &[f64], x: f64) -> (usize, f64) {
    let last = list.len().saturating_sub(2);
    let k = list.partition_point(|entry| *entry <= x).saturating_sub(1).min(last);
    let share = list.get(k + 1).map_or(0.0, |next| (x - list[k]) / (next - list[k]));
    (k, share.clamp(0.0, 1.0))
}

/// Value at a share of the way between two: exactly these at 0 and 1.
fn between(a: f64, b: f64, share: f64) -> f64 {
    (1.0 - share) * a + share * b
}
