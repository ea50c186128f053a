//! What each entry of an observation is.

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
    /// Greatest magnitude, in scaled units, per entry.
    pub bound: Vec<f64>,
    /// Unit of the physical value.
    pub unit: &'static str,
    /// One sentence for people.
    pub description: &'static str,
}

impl Block {
    /// Number of entries.
    pub fn len(&self) -> usize {
        self.scale.len()
    }

    /// Whether there is no entry; a layout holds no such block.
    pub fn is_empty(&self) -> bool {
        self.scale.is_empty()
    }
}

/// Blocks in order, without gaps.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Layout {
    blocks: Vec<Block>,
    scale: Vec<f64>,
    bound: Vec<f32>,
}

impl Layout {
    /// Appends a block with a (scale, greatest physical magnitude) per entry; without entries, nothing.
    pub(super) fn push(
        &mut self,
        name: &'static str,
        unit: &'static str,
        description: &'static str,
        entries: &[(f64, f64)],
    ) {
        if entries.is_empty() {
            return;
        }
        let scale: Vec<f64> = entries.iter().map(|e| e.0).collect();
        let bound: Vec<f64> = entries.iter().map(|e| e.1 / e.0).collect();
        let offset = self.len();
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

    /// Entries of a row.
    pub fn len(&self) -> usize {
        self.scale.len()
    }

    /// Whether a row has no entry.
    pub fn is_empty(&self) -> bool {
        self.scale.is_empty()
    }

    /// Greatest magnitude of each entry: a row lies in `[-bound, bound]`.
    pub fn bound(&self) -> &[f32] {
        &self.bound
    }

    /// Writes the scaled and clipped row for physical values. Infinite values become their bound and NaN the upper
    /// bound, so that a broken state never looks like one on target.
    pub(super) fn write(&self, values: impl IntoIterator<Item = f64>, row: &mut [f32]) {
        let entries = self.scale.iter().zip(&self.bound);
        for ((out, value), (scale, &bound)) in row.iter_mut().zip(values).zip(entries) {
            let scaled = (value / scale) as f32;
            *out = if scaled.is_nan() { bound } else { scaled.clamp(-bound, bound) };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_scaled_clipped_and_never_broken() {
        let mut layout = Layout::default();
        layout.push("a", "m", "", &[(0.5, 10.0), (2.0, 10.0)]);
        layout.push("nothing", "m", "", &[]);
        layout.push("b", "m", "", &[(1.0, 3.0); 3]);
        assert_eq!((layout.len(), layout.blocks().len()), (5, 2));
        assert_eq!(layout.block("b").unwrap().offset, 2);
        let mut row = [0.0; 5];
        layout.write([1.0, -100.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY], &mut row);
        assert_eq!(row, [2.0, -5.0, 3.0, 3.0, -3.0]);
    }
}
