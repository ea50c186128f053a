//! Compositions that cannot be: one line with file and key.

use uvms_gym::description::Scene;

use super::compose::Folder;

fn refused(text: &str) -> String {
    Scene::from_toml_str(text, "scene.toml").err().map_or_else(|| panic!("accepted: {text}"), |error| error.to_string())
}

#[test]
fn bad_compositions_are_one_line_with_file_and_key() {
    let vehicle = "name = \"x\"\n[vehicle]\nfile = \"petasus\"\n";
    let cases = [
        (
            "name = \"x\"\n[vehicle]\nfile = \"petasos\"",
            "scene.toml: vehicle.file: is \"petasos\": give a path that ends in .toml, or one of petasus-pum, ",
        ),
        (
            "name = \"x\"\n[vehicle]\nfile = \"no/such.toml\"",
            "scene.toml: vehicle.file: is \"no/such.toml\": no/such.toml: No such file",
        ),
        (
            "name = \"x\"\n[vehicle]\nfile = 3",
            "scene.toml: vehicle.file: a part is the name of a shipped one or the path of a TOML file; the value is 3",
        ),
        ("name = \"x\"\n[vehicle]\nfile = \"pum\"", "scene.toml: vehicle.file: is \"pum\": it has no table [vehicle]"),
        ("name = \"x\"\n[vehicle]\nfile = \"petasus\"\nbody.mass = -1.0", "scene.toml: vehicle.body.mass: is -1.0"),
        (
            "name = \"x\"\n[vehicle]\nfile = \"petasus\"\nbody.axes = \"ned\"",
            "scene.toml: vehicle.body.axes: values in place of a part's are in x forward",
        ),
        (
            "name = \"x\"\n[vehicle]\nfile = \"petasus\"\nthrusters.bow.lag = 0.1",
            "scene.toml: vehicle.thrusters: the part has no \"bow\" there; expected \"surge-left\", ",
        ),
        ("arms = 3\n", "scene.toml: arms: expected a list of tables; the value is 3"),
        ("[[arms]]\nfile = \"pum\"\n", "scene.toml: arms[0].name: missing"),
        ("[[arms]]\nname = \"a\"\n", "scene.toml: arms[0].file (a): missing"),
        ("[[arms]]\nname = 1\n", "scene.toml: arms[0].name: invalid type, expected a string; the value is 1"),
        (
            "[[arms]]\nname = \"a\"\nfile = \"petasus\"\n",
            "scene.toml: arms[0].file (a): is \"petasus\": it has no table [arm]",
        ),
        (
            "[[arms]]\nname = \"a\"\nfile = \"pum\"\non = \"tail\"\n",
            "scene.toml: arms[0].on (a): is \"tail\", but must be one of the bodies before it: \"vehicle\"",
        ),
        (
            "[[arms]]\nname = \"a\"\nfile = \"pum\"\nmount.frame = 3\n",
            "scene.toml: arms[0].mount.frame (a): invalid type",
        ),
        (
            "[[arms]]\nname = \"a\"\nfile = \"pum\"\nmount.joint = { kind = \"revolute\", axis = [0.0, 0.0, 1.0] }\n",
            "scene.toml: arms[0].base (a): missing: mount.joint moves the arm's base",
        ),
        (
            "[[arms]]\nname = \"a\"\nfile = \"pum\"\nlinks.wrist.joint.homme = 1.0\n",
            "scene.toml: arms[0].links[3].joint.homme (a): unknown key",
        ),
        (
            "[[arms]]\nname = \"a\"\nfile = \"pum\"\nlinks.wrist.body.mass = 0.0\n",
            "scene.toml: arm.links[4].body.mass (a-wrist): is 0.0",
        ),
        (
            "[[arms]]\nname = \"a\"\nfile = \"pum\"\n[[arms]]\nname = \"a\"\nfile = \"pum\"\n",
            "scene.toml: arms[1].name (a): the name 'a' is taken by an earlier element",
        ),
        ("arm = 3\n[[arms]]\nname = \"a\"\nfile = \"pum\"\n", "scene.toml: arm: must be a table, beside [[arms]]"),
    ];
    for (text, expected) in cases {
        let text = if text.starts_with("name") {
            text.to_owned()
        } else {
            let (top, tables) = text.split_at(text.find('[').unwrap_or(text.len()));
            format!("{top}{vehicle}{tables}")
        };
        let message = refused(&text);
        assert!(message.starts_with(expected), "{text}\n{message}");
        assert!(!message.contains('\n'), "{message}");
    }
}

#[test]
fn a_fault_of_a_part_names_its_file() {
    let arm = |mass: &str| {
        format!(
            "[arm]\nname = \"a\"\n[[arm.links]]\nname = \"l\"\njoint = {{ kind = \"revolute\", axis = [1.0, 0.0, 0.0] }}\nbody = {{ mass = {mass}, inertia = [1.0, 1.0, 1.0] }}\n"
        )
    };
    let on = |file: &str| {
        format!("name = \"s\"\n[vehicle]\nfile = \"petasus\"\n[[arms]]\nname = \"a\"\nfile = \"{file}\"\n")
    };
    let folder = Folder::new(
        "faults",
        &[
            ("parts/bad.toml", &arm("-1.0")),
            ("parts/broken.toml", "[arm\n"),
            ("parts/empty.toml", ""),
            ("parts/good.toml", &arm("1.0")),
            ("bad.toml", &on("parts/bad.toml")),
            ("broken.toml", &on("parts/broken.toml")),
            ("empty.toml", &on("parts/empty.toml")),
            ("folder.toml/x", ""),
            ("folder-part.toml", &on("folder.toml")),
            ("good.toml", &on("parts/good.toml")),
        ],
    );
    let refused = |name| folder.scene(name).unwrap_err();
    assert_eq!(refused("bad.toml"), "parts/bad.toml: arm.links[0].body.mass (l): is -1.0, but must be > 0");
    assert!(refused("broken.toml").starts_with("parts/broken.toml: line 1, column 5: "), "{}", refused("broken.toml"));
    assert_eq!(refused("empty.toml"), "empty.toml: arms[0].file (a): is \"parts/empty.toml\": it has no table [arm]");
    assert!(refused("folder-part.toml").starts_with("folder.toml: "), "{}", refused("folder-part.toml"));
    assert_eq!(folder.scene("good.toml").unwrap().joint_names(), ["a-l"]);
}

#[test]
fn files_that_are_parts_of_themselves_are_refused() {
    let vehicle = |file: &str| format!("name = \"s\"\n[vehicle]\nfile = \"{file}\"\n");
    let chain: Vec<(String, String)> =
        (0..10).map(|i| (format!("c{i}.toml"), vehicle(&format!("c{}.toml", i + 1)))).collect();
    let mut files: Vec<(&str, &str)> = chain.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect();
    let (own, there, back) = (vehicle("own.toml"), vehicle("back.toml"), vehicle("there.toml"));
    files.extend([("own.toml", own.as_str()), ("there.toml", &there), ("back.toml", &back)]);
    let folder = Folder::new("cycles", &files);
    assert_eq!(
        folder.scene("own.toml").unwrap_err(),
        "own.toml: vehicle.file: is \"own.toml\": it is a part of itself: own.toml -> own.toml"
    );
    let cycle = folder.scene("there.toml").unwrap_err();
    assert!(cycle.ends_with("it is a part of itself: back.toml -> there.toml -> back.toml"), "{cycle}");
    let deep = folder.scene("c0.toml").unwrap_err();
    assert!(deep.ends_with("more than 8 files are parts of each other"), "{deep}");
}
