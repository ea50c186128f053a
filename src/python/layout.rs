//! Layouts of observations, actions and privileged information: lists of dicts with the fields of `Block`.

use pyo3::prelude::*;
use pyo3::types::{PyList, PyTuple};

use super::arrays::dict;
use super::task::Task;
use uvms_gym::task::privileged_layout;

/// Blocks in order, without gaps.
struct BlockList<'py> {
    list: Bound<'py, PyList>,
    offset: usize,
}

impl<'py> BlockList<'py> {
    fn new(py: Python<'py>) -> Self {
        Self { list: PyList::empty(py), offset: 0 }
    }

    /// Appends a block whose entries have these scales and physical ranges.
    fn push(&mut self, name: &str, scale: &[f64], ranges: &[[f64; 2]], unit: &str, text: &str) -> PyResult<()> {
        let py = self.list.py();
        let block = dict! { py;
            "name": name,
            "offset": self.offset,
            "length": scale.len(),
            "scale": PyTuple::new(py, scale)?,
            "low": PyTuple::new(py, ranges.iter().map(|range| range[0]))?,
            "high": PyTuple::new(py, ranges.iter().map(|range| range[1]))?,
            "unit": unit,
            "description": text,
        };
        self.offset += scale.len();
        self.list.append(block)
    }
}

#[pymethods]
impl Task {
    /// Blocks of an observation.
    #[getter]
    fn layout<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let mut blocks = BlockList::new(py);
        for block in self.batch.task().layout().blocks() {
            let ranges = block.bound.iter().zip(&block.scale).map(|(bound, scale)| [-bound * scale, bound * scale]);
            let ranges: Vec<_> = ranges.collect();
            blocks.push(block.name, &block.scale, &ranges, block.unit, block.description)?;
        }
        Ok(blocks.list)
    }

    /// Entries of an action, one block each.
    #[getter]
    fn action_layout<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let mut blocks = BlockList::new(py);
        for range in self.batch.task().action_ranges() {
            blocks.push(&range.name, &[range.limits[1]], &[range.limits], range.unit, range.description)?;
        }
        Ok(blocks.list)
    }

    /// Parts of a row of `privileged`.
    #[getter]
    fn privileged_layout<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let mut blocks = BlockList::new(py);
        for part in privileged_layout(self.batch.task().coordinate_count()) {
            let ranges = vec![[f64::NEG_INFINITY, f64::INFINITY]; part.length];
            blocks.push(part.name, &vec![1.0; part.length], &ranges, part.unit, part.description)?;
        }
        Ok(blocks.list)
    }
}
