//! Numbers of a scene, with their provenance.

use toml::Value;

use super::{Origin, Provenance, Scene, path};

/// Path, value and origin of one number of a scene.
pub type Number = (String, f64, Option<(Origin, String)>);

impl Scene {
    /// The scene as a tree of TOML values, without its provenance.
    pub(super) fn to_tree(&self) -> Value {
        let bare = Scene { provenance: Provenance::default(), ..self.clone() };
        let mut tree = Value::try_from(bare).expect("a scene is plain data");
        tree.as_table_mut().expect("a scene is a table").remove("provenance");
        tree
    }

    /// Provenance of the numbers at `path` (example: `arm.links[elbow].body.mass`); None if it is not stated.
    pub fn provenance_of(&self, path: &str) -> Option<(Origin, &str)> {
        let root = self.to_tree();
        let (steps, _) = path::resolve(&root, path)?;
        self.provenance.lookup(&root, &steps)
    }

    /// All numbers of the system, including defaults: path, value and provenance. The step of the integration is none of them.
    pub fn numbers(&self) -> Vec<Number> {
        let root = Self { integration: None, ..self.clone() }.to_tree();
        let numbers = path::numbers(&root).into_iter();
        numbers
            .map(|(path, x)| {
                let origin = self.provenance.lookup(&root, &path::parse(&path));
                (path, x, origin.map(|(origin, text)| (origin, text.to_owned())))
            })
            .collect()
    }
}
