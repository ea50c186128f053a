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

    /// One over the scale, and the bound, of each entry.
    pub(super) fn scaling(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        self.scale.iter().zip(&self.bound).map(|(scale, bound)| [1.0 / scale, f64::from(*bound)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_follow_each_other_without_gaps() {
        let mut layout = Layout::default();
        layout.push("a", "m", "", &[(0.5, 10.0), (2.0, 10.0)]);
        layout.push("nothing", "m", "", &[]);
        layout.push("b", "m", "", &[(1.0, 3.0); 3]);
        assert_eq!((layout.len(), layout.blocks().len()), (5, 2));
        assert_eq!(layout.block("b").unwrap().offset, 2);
        assert_eq!(layout.bound(), [20.0, 5.0, 3.0, 3.0, 3.0]);
        assert_eq!(layout.scaling().next(), Some([2.0, 20.0]));
    }
}
