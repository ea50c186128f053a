//! Coordinates of the arguments of steps, and their directions in rows.

use crate::batch::stepping::derivative::{DerivativeColumn, Directions, StartColumn};
use crate::batch::storage::inputs::CheckedInputs;
use crate::lie::Vector6;

/// Argument of a step with respect to which it is differentiated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Argument {
    /// State before the step.
    State,
    /// Thrusts, or commands of thrusters with dynamics, N.
    Thrust,
    /// Deflections of the fins, rad.
    Fin,
    /// Wrench on the vehicle, N and N m.
    Wrench,
    /// Joint torques, N m or N.
    JointTorque,
    /// Coefficients of the servo targets, by joints.
    JointTarget,
    /// External wrenches by bodies, N and N m.
    External,
    /// Target pose of the vehicle's servo: `T exp(xi)`.
    PoseTarget,
    /// Parameters, in the order in which they are asked for.
    Parameters,
}

impl Argument {
    /// Name as of the keyword of a step.
    pub fn name(self) -> &'static str {
        match self {
            Self::State => "state",
            Self::Thrust => "thrust",
            Self::Fin => "fin",
            Self::Wrench => "wrench",
            Self::JointTorque => "joint_torque",
            Self::JointTarget => "joint_target",
            Self::External => "external",
            Self::PoseTarget => "pose_target",
            Self::Parameters => "parameters",
        }
    }
}

/// Product made of the Jacobian.
#[derive(Clone, Copy)]
pub(super) enum Product<'a> {
    /// All of it.
    Jacobians,
    /// Its product with a tangent for each instance.
    Tangents(&'a [f64]),
    /// The product of a cotangent for each instance with it.
    Cotangents(&'a [f64]),
}

/// Coordinates of the arguments of a step: one direction per coordinate, or a single one along a tangent.
pub(super) struct Coordinates<'a> {
    pub inputs: &'a CheckedInputs<'a>,
    pub fixed: bool,
    pub parameters: &'a [usize],
    pub arguments: &'a [(Argument, usize)],
    pub size: usize,
    pub product: Product<'a>,
}

/// Entries of [`Factors`] that concern payload and thrust.
pub(super) const PAYLOAD: usize = 5;
const THRUST: usize = 6;

impl Directions for Coordinates<'_> {
    fn count(&self) -> usize {
        self.columns() - self.carried()
    }

    fn seed(&self, i: usize, k: usize, column: &mut DerivativeColumn) {
        let width = self.arguments_width();
        let tangent =
            if let Product::Tangents(tangents) = self.product { Some(&tangents[i * width..][..width]) } else { None };
        let (k, mut first) = (self.carried() + k, 0);
        let (start, mut to) = (column.start, |row: usize, slope: f64| column.add(row, slope));
        for &(argument, width) in self.arguments {
            match tangent {
                Some(tangent) => {
                    for (entry, &weight) in tangent[first..][..width].iter().enumerate() {
                        self.add(i, argument, entry, weight, start, &mut to);
                    }
                }
                None if (first..first + width).contains(&k) => {
                    self.add(i, argument, k - first, 1.0, start, &mut to);
                }
                None => {}
            }
            first += width;
        }
    }

    fn read(&self, k: usize, column: &DerivativeColumn, out: &mut [f64]) {
        let layout = &column.start.table.layout;
        let (rotation, position) = (|i, j| layout.rotation + 3 * i + j, |i| layout.position + i);
        let (columns, carried) = (self.columns(), self.carried());
        let sum = |i: &dyn Fn(usize) -> f64| i(0) + i(1) + i(2);
        let mut set = |row: usize, column: usize, x: f64| out[row * columns + column] = x;
        if k == 0 {
            // The steps carry a translation along: R_1^T R_0 of it.
            for (j, k) in (0..3).flat_map(|j| (0..carried).map(move |k| (j, k))) {
                set(j, k, sum(&|i| column.value(rotation(i, j)) * column.start.get(rotation(i, k))));
            }
        }
        let mut row = 0;
        let mut set = |x: f64| {
            set(row, carried + k, x);
            row += 1;
        };
        // R^T dr, and the axial vector of R^T dR.
        for j in 0..3 {
            let displacement = |i| column.derivative(position(i)) + column.derivative(position(i) + 3);
            set(sum(&|i| column.value(rotation(i, j)) * displacement(i)));
        }
        let turned = |j, k| sum(&|i| column.value(rotation(i, j)) * column.derivative(rotation(i, k)));
        for (j, k) in [(2, 1), (0, 2), (1, 0)] {
            set(0.5 * (turned(j, k) - turned(k, j)));
        }
        let rows = [
            (layout.q, layout.joints),
            (layout.twist, 6),
            (layout.qd, layout.joints),
            (layout.thrust, layout.thrusters),
        ];
        for row in rows.into_iter().flat_map(|(row, count)| row..row + count) {
            set(column.derivative(row));
        }
    }
}

impl Coordinates<'_> {
    /// Coordinates of all arguments.
    fn arguments_width(&self) -> usize {
        self.arguments.iter().map(|(_, width)| width).sum()
    }

    /// Columns of the derivatives.
    fn columns(&self) -> usize {
        if let Product::Tangents(_) = self.product { 1 } else { self.arguments_width() }
    }

    /// Numbers of an instance in the result.
    pub(super) fn width(&self) -> usize {
        if let Product::Cotangents(_) = self.product { self.columns() } else { self.size * self.columns() }
    }

    /// First columns that need no steps: translations, unless a servo holds the pose.
    fn carried(&self) -> usize {
        let none = matches!(self.product, Product::Tangents(_)) || self.inputs.inputs.pose_target.is_some();
        if none { 0 } else { 3 }
    }

    /// Adds the slopes of a coordinate of an argument, times a weight.
    #[inline(always)]
    pub(super) fn add(
        &self,
        i: usize,
        argument: Argument,
        k: usize,
        weight: f64,
        start: StartColumn,
        to: &mut impl FnMut(usize, f64),
    ) {
        let layout = &start.table.layout;
        let n = layout.joints;
        match argument {
            Argument::State if k < 6 => add_pose(layout.rotation, layout.position, k, weight, start, to),
            Argument::State if k < 6 + n => to(layout.q + k - 6, weight),
            Argument::State if k < 12 + n => {
                let weight = if self.fixed { 0.0 } else { weight };
                to(layout.twist + k - 6 - n, weight);
            }
            Argument::State if k < 12 + 2 * n => to(layout.qd + k - 12 - n, weight),
            Argument::State => to(layout.thrust + k - 12 - 2 * n, weight),
            Argument::Thrust => {
                let ([lower, upper], given) = (self.inputs.allocation_of(i).limits(k), self.given_thrust(i, k));
                if !(lower < given && given < upper) {
                    return;
                }
                if layout.thrusters > 0 {
                    to(layout.command + k, weight);
                } else {
                    let factor = start.get(layout.factors + THRUST);
                    self.add_thrust(i, k, weight * factor, layout.wrench, to);
                }
            }
            Argument::Fin => {
                let ([lower, upper], fins) = (self.inputs.fins_of(i)[k].range(), self.inputs.inputs.fin);
                let given = fins.map_or(0.0, |fins| fins[i * layout.fins + k]);
                let row = layout.fin + k;
                to(row, if lower < given && given < upper { weight } else { 0.0 });
            }
            Argument::Wrench => to(layout.wrench + k, weight),
            Argument::JointTorque => to(layout.torque + k, weight),
            Argument::JointTarget => {
                let terms = self.inputs.terms.max(1);
                to(layout.target + 4 * (k / terms) + k % terms, weight);
            }
            Argument::External if k < 6 => to(layout.wrench + k, weight),
            Argument::External => {
                let (link, entry) = (k / 6 - 1, k % 6);
                let links = start.table.links.get(i).or(start.table.links.first());
                let Some(frame) = links.and_then(|links| links.get(link)) else { return };
                let unit = Vector6::from_array(std::array::from_fn(|j| if j == entry { weight } else { 0.0 }));
                for (j, x) in frame.co_adjoint_apply_inverse(unit).to_array().into_iter().enumerate() {
                    to(layout.links + 6 * link + j, x);
                }
            }
            Argument::PoseTarget => add_pose(layout.station, layout.station + 9, k, weight, start, to),
            Argument::Parameters => {
                let factor = self.parameters[k];
                to(layout.factors + factor, weight);
                if factor == THRUST && layout.thrusters == 0 && self.inputs.inputs.thrust.is_some() {
                    for k in 0..self.inputs.allocation.count() {
                        let [lower, upper] = self.inputs.allocation_of(i).limits(k);
                        self.add_thrust(i, k, weight * self.given_thrust(i, k).clamp(lower, upper), layout.wrench, to);
                    }
                }
            }
        }
    }

    fn given_thrust(&self, i: usize, k: usize) -> f64 {
        self.inputs.inputs.thrust.map_or(0.0, |thrust| thrust[i * self.inputs.allocation.count() + k])
    }

    /// Adds the slope of an ideal thrust to the wrench.
    #[inline(always)]
    fn add_thrust(&self, i: usize, k: usize, weight: f64, row: usize, to: &mut impl FnMut(usize, f64)) {
        let wrench = self.inputs.allocation_of(i).column(k);
        for axis in 0..6 {
            to(row + axis, weight * wrench[axis]);
        }
    }
}

/// Adds the slopes of coordinate `k` of `T exp(xi)` to a pose, whose rotation is by rows.
#[inline(always)]
fn add_pose(
    rotation: usize,
    position: usize,
    k: usize,
    weight: f64,
    start: StartColumn,
    to: &mut impl FnMut(usize, f64),
) {
    for i in 0..3 {
        let entry = |j: usize| start.get(rotation + 3 * i + j % 3) * weight;
        if k < 3 {
            to(position + i, entry(k));
        } else {
            // R [e_k]: its two columns after the k-th are columns of R, swapped.
            let (one, two) = (entry(k + 2), -entry(k + 1));
            to(rotation + 3 * i + (k + 1) % 3, one);
            to(rotation + 3 * i + (k + 2) % 3, two);
        }
    }
}
