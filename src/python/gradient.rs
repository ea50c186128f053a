//! `_core.Task`: gradients through a control period without the physics.

use pyo3::prelude::*;

use super::arrays::{Rows, copied, matrix, read};
use super::computation::{detached, exclusive, shared};
use super::controllers::Controller;
use super::errors::OrRaise;
use super::task::Task;
use uvms_gym::task::{Acted, Evaluated, GradientWidths};

#[pymethods]
impl Task {
    /// Numbers of coordinates of gradients: state, measurement, memory, observation, action, force.
    #[getter]
    fn gradient_widths(&self) -> [usize; 6] {
        let GradientWidths { state, measurement, memory, observation, action, force, .. } =
            self.batch.task().gradient().widths();
        [state, measurement, memory, observation, action, force]
    }

    /// Controller that residual actions correct.
    #[getter]
    fn base(&self) -> Option<Controller> {
        self.batch.base().map(Controller::new)
    }

    /// Frames of all instances now: states and memories (N, .).
    fn frames<'py>(slf: &Bound<'py, Self>) -> PyResult<(Rows<'py, f32>, Rows<'py, f32>)> {
        let (py, this) = (slf.py(), &mut *exclusive(slf)?);
        let ([states, memories], n) = (this.batch.frames().or_raise()?, this.batch.instances());
        Ok((matrix(py, states, n)?, matrix(py, memories, n)?))
    }

    /// Forces (k, f) of actions (k, a) in frames with these memories, and servo targets of the joints (k, 4 n).
    #[pyo3(signature = (memories, actions, base=None))]
    fn forces<'py>(
        slf: &Bound<'py, Self>,
        memories: &Rows<'py, f32>,
        actions: &Bound<'py, PyAny>,
        base: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(Rows<'py, f64>, Rows<'py, f64>)> {
        let (py, this) = (slf.py(), shared(slf)?);
        let (memory, (shape, actions)) = (copied(memories)?, read("actions", actions)?);
        let base = base.map(|base| read("base", base)).transpose()?.map(|(_, base)| base);
        let frames = Acted { memory: &memory, actions: &actions, base: base.as_deref() };
        let task = this.batch.task();
        let [forces, targets] = detached(py, || task.gradient().forces(&frames))?.or_raise()?;
        Ok((matrix(py, forces, shape[0])?, matrix(py, targets, shape[0])?))
    }

    /// Cotangents of action, base and memory (k, 2 a + c) before an action is applied, from the cotangents of force and
    /// memory (k, f + c) after it.
    #[pyo3(signature = (memories, actions, cotangents, base=None))]
    fn act_vjp<'py>(
        slf: &Bound<'py, Self>,
        memories: &Rows<'py, f32>,
        actions: &Bound<'py, PyAny>,
        cotangents: &Bound<'py, PyAny>,
        base: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Rows<'py, f64>> {
        let (py, this) = (slf.py(), shared(slf)?);
        let (memory, (shape, actions)) = (copied(memories)?, read("actions", actions)?);
        let (cotangents, base) = (read("cotangents", cotangents)?.1, base.map(|base| read("base", base)).transpose()?);
        let frames = Acted { memory: &memory, actions: &actions, base: base.as_ref().map(|(_, base)| &base[..]) };
        let task = this.batch.task();
        matrix(py, detached(py, || task.gradient().act_vjp(&frames, &cotangents))?.or_raise()?, shape[0])
    }

    /// Cotangents of state, measurement and memory (k, s + w + c) before a state is evaluated, from the cotangents of
    /// observation, reward, measurement and memory (k, d + 1 + w + c) after it.
    ///
    /// `before` are the memories a control period before. Where `fresh` (k,) is true the measurement belongs to this state.
    /// With `perfect` the observation is that of perfect sensors.
    #[pyo3(signature = (states, memories, before, fresh, cotangents, *, perfect=false))]
    fn evaluate_vjp<'py>(
        slf: &Bound<'py, Self>,
        states: &Rows<'py, f32>,
        memories: &Rows<'py, f32>,
        before: &Rows<'py, f32>,
        fresh: Vec<bool>,
        cotangents: &Bound<'py, PyAny>,
        perfect: bool,
    ) -> PyResult<Rows<'py, f64>> {
        let (py, this) = (slf.py(), shared(slf)?);
        let (states, memory) = (copied(states)?, copied(memories)?);
        let (before, cotangents) = (copied(before)?, read("cotangents", cotangents)?.1);
        let frames = Evaluated { states: &states, memory: &memory, before: &before, fresh: &fresh, perfect };
        let task = this.batch.task();
        matrix(py, detached(py, || task.gradient().evaluate_vjp(&frames, &cotangents))?.or_raise()?, fresh.len())
    }
}
