//! Equations of motion of the nominal model, vehicle and arm together in still water, and their exact derivatives.

use std::cell::OnceCell;

use nalgebra as na;
use nalgebra::{Cholesky, Const, SMatrix, SVector};

use super::nominal_model::NominalModel;
use super::observer::load;
use crate::dynamics::aba::{Scratch, link_twists};
use crate::dynamics::{implicit_joint_torque, inverse_dynamics};
use crate::lane::{Function, Lane, differentiate, inverse_sqrt};
use crate::lie::{Vector3, Vector6};
use crate::system::{EndEffector, JOINTS, Joints};

/// Maximum number of velocities `[V; q']`.
pub const VELOCITIES: usize = 6 + JOINTS;
/// Velocities `[V; q']` or generalized forces `[F; tau]`; entries past the scene's are 0.
pub type Velocities = SVector<f64, VELOCITIES>;
/// Mass matrix; identity past the scene's velocities.
pub type MassMatrix = SMatrix<f64, VELOCITIES, VELOCITIES>;

/// Velocities of most scenes: a smaller factor takes less time.
const FEW: usize = 15;

/// State of vehicle and arm in still water.
#[derive(Debug, Clone, Copy)]
pub struct ChainState<'a> {
    /// Direction against gravity, vehicle axes; of any length.
    pub up: &'a na::Vector3<f64>,
    /// Joint coordinates, rad or m.
    pub q: &'a Joints,
    /// Velocities `[V; q']`.
    pub velocities: &'a Velocities,
}

// Places in arguments `[up; q; V; q'; accelerations]`.
const Q: usize = 3;
const VELOCITY: usize = Q + JOINTS;
const STATE: usize = VELOCITY + VELOCITIES;
const ARGUMENT: usize = STATE + VELOCITIES;

impl ChainState<'_> {
    /// `[up; q; V; q'; accelerations]`, or the first K of these.
    fn argument<const K: usize>(&self, accelerations: &Velocities) -> [f64; K] {
        let all = self.up.iter().chain(self.q).chain(self.velocities).chain(accelerations);
        let mut argument = [0.0; K];
        argument.iter_mut().zip(all).for_each(|(entry, x)| *entry = *x);
        argument
    }
}

/// `(M + T D) [V'; q''] + bias = [F; tau]` at a state: M includes added mass, and D is the decrease of the joints' passive torques
/// per rate, over a time T ahead.
#[derive(Debug, Clone)]
pub struct Equations {
    /// `M + T D`
    pub inertia: MassMatrix,
    /// `C [V; q']` minus damping, weight, buoyancy, fins, tether, and the joints' friction, springs, detents and end stops.
    pub bias: Velocities,
    /// End-effector body twist per `[V; q']`.
    pub jacobian: SMatrix<f64, 6, VELOCITIES>,
    /// The same of each further end effector that is held still.
    pub held: Vec<SMatrix<f64, 6, VELOCITIES>>,
    /// Number of velocities.
    size: usize,
    /// Factor of the inertia, made when it is needed first.
    factor: OnceCell<Factor>,
}

/// Factor of a mass matrix; none where it is not positive definite, which does not happen.
#[derive(Debug, Clone)]
enum Factor {
    Few(Option<Box<Cholesky<f64, Const<FEW>>>>),
    All(Option<Box<Cholesky<f64, Const<VELOCITIES>>>>),
}

/// Product with the first `size` entries of velocities: the others are 0.
pub(super) fn product<const ROWS: usize>(
    matrix: &SMatrix<f64, ROWS, VELOCITIES>,
    velocities: &Velocities,
    size: usize,
) -> SVector<f64, ROWS> {
    matrix.columns(0, size) * velocities.rows(0, size)
}

impl Equations {
    /// `(M + T D)^-1` times a force; 0 without a factor.
    pub fn solve(&self, force: &Velocities) -> Velocities {
        let factor = self.factor.get_or_init(|| match self.size {
            0..=FEW => Factor::Few(self.inertia.fixed_view::<FEW, FEW>(0, 0).into_owned().cholesky().map(Box::new)),
            _ => Factor::All(self.inertia.cholesky().map(Box::new)),
        });
        let mut solution = Velocities::zeros();
        match factor {
            Factor::Few(Some(factor)) => {
                let few = factor.solve(&force.fixed_rows::<FEW>(0).into_owned());
                solution.fixed_rows_mut::<FEW>(0).copy_from(&few);
            }
            Factor::All(Some(factor)) => solution = factor.solve(force),
            Factor::Few(None) | Factor::All(None) => {}
        }
        solution
    }

    /// `(M + T D)` times accelerations.
    pub fn force(&self, accelerations: &Velocities) -> Velocities {
        product(&self.inertia, accelerations, self.size)
    }

    /// Twist of the end effector.
    pub fn twist(&self, velocities: &Velocities) -> na::Vector6<f64> {
        product(&self.jacobian, velocities, self.size)
    }
}

impl NominalModel {
    /// Equations of motion at a state, implicit in the joints' passive torques over a time T, s.
    pub fn equations(&self, at: ChainState, implicit: f64) -> Equations {
        let mut inertia = MassMatrix::identity();
        let force = Force { model: self, implicit };
        let size = 6 + self.joints();
        let by: Vec<usize> = (STATE..STATE + size).collect();
        let (bias, forces) = differentiate(&force, &at.argument(&Velocities::zeros()), &by);
        let by: Vec<usize> = (VELOCITY..VELOCITY + size).collect();
        let jacobian = |of: &EndEffector| {
            let (_, twists) = differentiate(&EffectorTwist(self, of), &at.argument(&Velocities::zeros()), &by);
            let mut jacobian = SMatrix::<f64, 6, VELOCITIES>::zeros();
            twists.into_iter().enumerate().for_each(|(k, twist)| jacobian.set_column(k, &na::Vector6::from(twist)));
            jacobian
        };
        forces.into_iter().enumerate().for_each(|(k, force)| inertia.set_column(k, &Velocities::from(force)));
        let held = self.held.iter().map(jacobian).collect();
        Equations {
            inertia,
            bias: bias.into(),
            jacobian: jacobian(&self.end_effector),
            held,
            size,
            factor: OnceCell::new(),
        }
    }

    /// Derivatives of the force `(M + T D) a + bias` by `[up; q; V; q']` at an acceleration a.
    pub fn force_derivatives(&self, at: ChainState, acceleration: &Velocities, implicit: f64) -> Vec<Velocities> {
        let n = self.joints();
        let by: Vec<usize> = (0..Q + n).chain(VELOCITY..VELOCITY + 6 + n).collect();
        let (_, slopes) = differentiate(&Force { model: self, implicit }, &at.argument(acceleration), &by);
        slopes.into_iter().map(Velocities::from).collect()
    }

    /// Derivatives of the end effector's twist by the joint coordinates.
    pub fn twist_derivatives(&self, at: ChainState) -> Vec<na::Vector6<f64>> {
        let by: Vec<usize> = (Q..Q + self.joints()).collect();
        let (_, slopes) =
            differentiate(&EffectorTwist(self, &self.end_effector), &at.argument(&Velocities::zeros()), &by);
        slopes.into_iter().map(na::Vector6::from).collect()
    }
}

/// Generalized force of `[up; q; V; q'; V'; q'']`.
struct Force<'a> {
    model: &'a NominalModel,
    implicit: f64,
}

impl Function<ARGUMENT, VELOCITIES> for Force<'_> {
    type Memory<L: Lane> = Scratch<L>;

    #[inline(always)]
    fn at<L: Lane<Real = f64>>(&self, x: &[L; ARGUMENT], scratch: &mut Scratch<L>) -> [L; VELOCITIES] {
        let Self { model, implicit } = self;
        let (system, h) = (&model.system, L::c(*implicit));
        let ((q, twist, qd), (_, rate, qdd)) = (motion(x, VELOCITY), motion(x, STATE));
        let up = Vector3([x[0], x[1], x[2]]);
        let gravity = up.scale(L::c(-model.gravity) * inverse_sqrt(up.dot(up).max(L::c(1e-30))));
        let (total, torques) = inverse_dynamics(system, gravity, [twist, rate], [&q, &qd, &qdd], scratch);
        let mut force = [L::zero(); VELOCITIES];
        force[..6].copy_from_slice(&(total - system.terms.passive_wrench(twist, gravity)).to_array());
        for (i, joint) in system.chain().iter().enumerate() {
            // At the present coordinate, h ahead of that before.
            let (passive, decrease) =
                implicit_joint_torque(joint, h, h.neg_mul_add(qd[i], q[i]), qd[i], L::zero(), None);
            force[6 + i] = decrease.mul_add(qdd[i], torques[i] - passive);
        }
        force
    }
}

/// End-effector body twist of `[up; q; V; q']`.
struct EffectorTwist<'a>(&'a NominalModel, &'a EndEffector);

impl Function<STATE, 6> for EffectorTwist<'_> {
    type Memory<L: Lane> = Scratch<L>;

    #[inline(always)]
    fn at<L: Lane<Real = f64>>(&self, x: &[L; STATE], scratch: &mut Scratch<L>) -> [L; 6] {
        let (q, twist, qd) = motion(x, VELOCITY);
        let mut twists = [twist; 1 + JOINTS];
        link_twists(&self.0.system, [twist, Vector6::zero()], &q, &qd, scratch, &mut twists[1..]);
        let (carrier, tip) = self.1.tip();
        tip.adjoint_apply_inverse(twists[carrier]).to_array()
    }
}

/// Joint coordinates of an argument, and the twist and joint rates, or their rates, from place `at` on.
#[inline(always)]
fn motion<L: Lane>(x: &[L], at: usize) -> ([L; JOINTS], Vector6<L>, [L; JOINTS]) {
    let (mut q, mut qd) = ([L::zero(); JOINTS], [L::zero(); JOINTS]);
    q.copy_from_slice(&x[Q..VELOCITY]);
    qd.copy_from_slice(&x[at + 6..at + VELOCITIES]);
    (q, load(x, at), qd)
}
