//! Dotted paths into a scene: `vehicle.body.mass`, `arm.links[2].body.added_mass[0]`, `arm.links[elbow].body`.

use toml::Value;
use uvms_gym::description::path::{coverage, parse, resolve};

fn example() -> Value {
    toml::from_str("a = 1\n[[list]]\nname = 'one'\nx = [1, 2]\n[[list]]\nname = 'two'\nx = [3, 4]").unwrap()
}

#[test]
fn a_name_and_an_index_lead_to_the_same_element() {
    let root = example();
    assert_eq!(resolve(&root, "list[two].x[0]"), resolve(&root, "list[1].x[0]"));
    assert_eq!(resolve(&root, "list[1].x[0]").unwrap().1, &Value::Integer(3));
    assert_eq!(resolve(&root, "list[three]"), None);
}

#[test]
fn a_pattern_covers_what_it_is_a_prefix_of() {
    let root = example();
    let path = resolve(&root, "list[1].x[0]").unwrap().0;
    assert_eq!(coverage(&parse("list"), &path, &root), Some((1, 0)));
    assert_eq!(coverage(&parse("list.x"), &path, &root), Some((3, 0)));
    assert_eq!(coverage(&parse("list[two].x"), &path, &root), Some((3, 1)));
    assert_eq!(coverage(&parse("list[one].x"), &path, &root), None);
    assert_eq!(coverage(&parse("a"), &path, &root), None);
}

#[test]
fn any_text_parses() {
    for text in ["", ".", "[", "]", "a[", "a]b", "..[[]].", "a[b.c].d", "\u{e9}.[\u{e9}]"] {
        parse(text);
        resolve(&example(), text);
    }
    assert_eq!(parse("a[b.c].d").len(), 3);
}
