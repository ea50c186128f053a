//! Scenes and parts that come with the package.

/// Scenes: name and text.
const SCENES: [(&str, &str); 11] = [
    ("petasus-pum", include_str!("../../uvms_gym/scenes/petasus-pum.toml")),
    ("bluerov2-heavy-alpha5", include_str!("../../uvms_gym/scenes/bluerov2-heavy-alpha5.toml")),
    ("bluerov2-heavy-two-alpha5", include_str!("../../uvms_gym/scenes/bluerov2-heavy-two-alpha5.toml")),
    ("bluerov2-heavy-alpha5-gripper", include_str!("../../uvms_gym/scenes/bluerov2-heavy-alpha5-gripper.toml")),
    ("bluerov2-heavy-alpha5-tool", include_str!("../../uvms_gym/scenes/bluerov2-heavy-alpha5-tool.toml")),
    ("bluerov2-alpha5-pool", include_str!("../../uvms_gym/scenes/bluerov2-alpha5-pool.toml")),
    ("bluerov2-heavy", include_str!("../../uvms_gym/scenes/bluerov2-heavy.toml")),
    ("petasus", include_str!("../../uvms_gym/scenes/petasus.toml")),
    ("free-body", include_str!("../../uvms_gym/scenes/free-body.toml")),
    ("rexrov", include_str!("../../uvms_gym/scenes/rexrov.toml")),
    ("remus-100", include_str!("../../uvms_gym/scenes/remus-100.toml")),
];

/// Arms without vehicle: name and text.
const ARMS: [(&str, &str); 4] = [
    ("reach-alpha5", include_str!("../../uvms_gym/scenes/reach-alpha5.toml")),
    ("alpha5-jaws", include_str!("../../uvms_gym/scenes/alpha5-jaws.toml")),
    ("reach-bravo7", include_str!("../../uvms_gym/scenes/reach-bravo7.toml")),
    ("pum", include_str!("../../uvms_gym/scenes/pum.toml")),
];

/// Names of the scenes.
pub fn scenes() -> impl Iterator<Item = &'static str> {
    SCENES.iter().map(|(name, _)| *name)
}

/// Names of the arms without vehicle.
pub fn arms() -> impl Iterator<Item = &'static str> {
    ARMS.iter().map(|(name, _)| *name)
}

/// Names of all parts: scenes, and arms without vehicle.
pub fn parts() -> impl Iterator<Item = &'static str> {
    scenes().chain(arms())
}

/// Text of a part.
pub fn text(name: &str) -> Option<&'static str> {
    SCENES.iter().chain(&ARMS).find(|(shipped, _)| *shipped == name).map(|(_, text)| *text)
}
