//! Scenes as data: what is read, what is refused, and how it is said.

mod common;

use common::random_scene::{Options, random_scene, random_state};
use uvms_gym::description::{MAX_LINKS, Scene};

#[test]
fn random_scenes_are_valid_and_repeatable() {
    for seed in 0..60 {
        let scene = random_scene(seed, Options::default());
        assert_eq!(scene, random_scene(seed, Options::default()));
        let back = Scene::from_toml_str(&scene.to_toml_string(), "random").unwrap();
        assert_eq!(back, scene, "seed {seed}");
        let state = random_state(seed, &scene);
        assert!((state.rotation.determinant() - 1.0).abs() < 1e-14);
        assert_eq!(state.q.len(), MAX_LINKS + 1);
    }
}
