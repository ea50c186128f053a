//! Reading scenes from TOML text, files and dicts, and writing them.

use std::io;
use std::path::Path;

use serde::de::DeserializeOwned;
use toml::Value;

use super::axes::NedTables;
use super::part::Parts;
use super::{Scene, SceneWarning, check, compose, path, shipped};
use crate::error::{DescriptionError, Problem};
use crate::keys::{Fault, read_tree};

/// Maximum size of a file of a scene, an outline or a robot.
const MAX_BYTES: u64 = 16_000_000;

impl Scene {
    /// TOML text of a scene with all keys; units and defaults are in comments.
    pub const TEMPLATE: &str = include_str!("template.toml");

    /// Names of the shipped scenes.
    pub fn shipped_names() -> Vec<&'static str> {
        shipped::scenes().collect()
    }

    /// Names of the shipped arms without vehicle, which are parts for scenes.
    pub fn shipped_arm_names() -> Vec<&'static str> {
        shipped::arms().collect()
    }

    /// A shipped scene.
    ///
    /// # Errors
    /// [`DescriptionError::UnknownScene`] lists the known names.
    pub fn shipped(name: &str) -> Result<Self, DescriptionError> {
        let (value, source_name) = shipped_value(name)?;
        Self::from_value(value, &source_name)
    }

    /// A shipped scene by name, or a file by a path that ends in `.toml`.
    ///
    /// # Errors
    /// As [`Scene::shipped`] and [`Scene::from_file`].
    pub fn load(name_or_path: &str) -> Result<Self, DescriptionError> {
        let (value, source_name) = Self::load_value(name_or_path)?;
        Self::from_value(value, &source_name)
    }

    /// As [`Self::load`]: the tree of values as stated, and its source's name.
    ///
    /// # Errors
    /// As [`Scene::load`], without those of [`Scene::from_value`].
    pub fn load_value(name_or_path: &str) -> Result<(Value, String), DescriptionError> {
        if name_or_path.ends_with(".toml") { file_value(Path::new(name_or_path)) } else { shipped_value(name_or_path) }
    }

    /// Reads and checks a TOML file.
    ///
    /// # Errors
    /// A file that cannot be read, or as [`Scene::from_toml_str`].
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self, DescriptionError> {
        let (value, source_name) = file_value(path.as_ref())?;
        Self::from_value(value, &source_name)
    }

    /// Reads and checks TOML text; `source_name` (a file's name) appears in errors.
    ///
    /// # Errors
    /// Text that is not TOML, by line and column, or as [`Scene::from_value`].
    pub fn from_toml_str(text: &str, source_name: &str) -> Result<Self, DescriptionError> {
        Self::from_value(parse_toml(text, source_name)?, source_name)
    }

    /// Reads and checks a tree of values, whose integers may stand for floats; `source_name` appears in errors. Files of parts are
    /// relative to the working directory.
    ///
    /// The scene is canonical: tables that state `axes = "ned"` are converted to x forward, y left, z up, directions have unit
    /// length, inertia and added mass are exactly symmetric. Warnings are left to [`Scene::check`].
    ///
    /// # Errors
    /// [`DescriptionError::Value`] names source, key and value of the first problem.
    pub fn from_value(value: Value, source_name: &str) -> Result<Self, DescriptionError> {
        Ok(Self::from_value_with_warnings(value, source_name)?.0)
    }

    /// As [`Self::from_value`], with warnings about the values as they are stated; those of the result are left to
    /// [`Scene::lint`].
    ///
    /// # Errors
    /// As [`Scene::from_value`].
    pub fn from_value_with_warnings(
        value: Value,
        source_name: &str,
    ) -> Result<(Self, Vec<SceneWarning>), DescriptionError> {
        let value = compose::expand(value, source_name, Path::new(""), &mut Parts::default())?;
        Self::from_tree(&value).map_err(|fault| fault.in_source(source_name, &value))
    }

    pub(super) fn from_tree(value: &Value) -> Result<(Self, Vec<SceneWarning>), Fault> {
        let mut tree = value.clone();
        let ned = NedTables::take(&mut tree)?;
        let mut scene: Self = deserialize(&tree)?;
        // Validity does not depend on the axes, and messages show the values as they are stated.
        let warnings = scene.validate()?;
        ned.convert(&mut scene);
        scene.make_canonical();
        Ok((scene, warnings))
    }

    /// TOML text of the scene; [`Scene::from_toml_str`] reads an equal scene from it.
    pub fn to_toml_string(&self) -> String {
        toml::to_string(self).expect("a scene is plain data")
    }
}

fn shipped_value(name: &str) -> Result<(Value, String), DescriptionError> {
    let Some(text) = shipped::text(name).filter(|_| shipped::scenes().any(|scene| scene == name)) else {
        return Err(DescriptionError::UnknownScene { name: name.to_owned(), shipped: Scene::shipped_names() });
    };
    let source_name = format!("{name}.toml");
    Ok((parse_toml(text, &source_name)?, source_name))
}

/// A scene's tree of values from a TOML file, its parts in place, and its path as errors name it.
///
/// # Errors
/// As [`read_file`], [`parse_toml`] and those of parts.
pub fn file_value(path: &Path) -> Result<(Value, String), DescriptionError> {
    let (text, source_name) = read_file(path)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let value = compose::expand(parse_toml(&text, &source_name)?, &source_name, folder, &mut Parts::default())?;
    Ok((value, source_name))
}

/// Text of a file, and its path as errors name it. Pipes and devices, which may have no end, are not opened.
///
/// # Errors
/// [`DescriptionError::File`] if it cannot be read, is no regular file or has more than 16 MB.
pub fn read_file(path: &Path) -> Result<(String, String), DescriptionError> {
    let read = || {
        let file = std::fs::metadata(path)?;
        if !file.is_file() && !file.is_dir() {
            return Err(io::Error::other("not a regular file"));
        }
        if file.len() > MAX_BYTES {
            return Err(io::Error::other(format!("{} bytes, but at most {MAX_BYTES} are read", file.len())));
        }
        String::from_utf8(std::fs::read(path)?).map_err(|error| io::Error::other(not_utf8(&error)))
    };
    let source_name = path.display().to_string();
    match read() {
        Ok(text) => Ok((text, source_name)),
        Err(error) => Err(DescriptionError::File { path: source_name, error }),
    }
}

/// Place and probable encoding of text that is not UTF-8.
fn not_utf8(error: &std::string::FromUtf8Error) -> String {
    let (bytes, at) = (error.as_bytes(), error.utf8_error().valid_up_to());
    let line = 1 + bytes[..at].iter().filter(|byte| **byte == b'\n').count();
    let encoding = match bytes {
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => "UTF-16",
        bytes if bytes.contains(&0) => "binary data",
        _ => "Latin-1 or another encoding",
    };
    format!("line {line}: byte 0x{:02X} is not UTF-8 text but {encoding}: save the file as UTF-8", bytes[at])
}

/// A tree of values from TOML text; `source_name` (a file's name) appears in errors.
///
/// # Errors
/// Text that is not TOML, by line and column.
pub fn parse_toml(text: &str, source_name: &str) -> Result<Value, DescriptionError> {
    let table = text.parse::<toml::Table>().map_err(|error| {
        let before = error.span().and_then(|span| text.get(..span.start)).unwrap_or_default();
        let line = before.matches('\n').count() + 1;
        let column = before.chars().rev().take_while(|&c| c != '\n').count() + 1;
        DescriptionError::Syntax {
            source_name: source_name.to_owned(),
            message: format!("line {line}, column {column}: {}", error.message().replace('\n', " ")),
        }
    })?;
    Ok(table.into())
}

/// Deserialises data from a tree of values, whose integers may stand for floats.
///
/// # Errors
/// [`DescriptionError::Value`] names the source, the key and the value.
pub fn read_value<T: DeserializeOwned>(value: Value, source_name: &str) -> Result<T, DescriptionError> {
    deserialize(&value).map_err(|fault| fault.in_source(source_name, &value))
}

/// Deserialises data from a tree of values.
pub(super) fn deserialize<T: DeserializeOwned>(value: &Value) -> Result<T, Fault> {
    // Before deserialising, so that a NaN is reported at its list entry.
    check::magnitudes(value)?;
    read_tree(value.clone()).map_err(|error| explain(value, &error.place, &error.message))
}

/// Translates serde's error at the path `at`.
fn explain(root: &Value, at: &str, message: &str) -> Fault {
    let quoted = |prefix| message.strip_prefix(prefix).and_then(|rest: &str| rest.split_once('`'));
    if let Some((field, _)) = quoted("missing field `") {
        return Fault::new(path::join(at, field), Problem::Missing);
    }
    let value = |key: &str| path::resolve(root, key).map_or_else(|| "absent".to_owned(), |(_, v)| path::short(v));
    if let Some((field, rest)) = quoted("unknown field `") {
        let key = if at.ends_with(field) { at.to_owned() } else { path::join(at, field) };
        let expected = rest.trim_start_matches(", expected ").replace('`', "");
        return Fault::new(key.clone(), Problem::UnknownKey { value: value(&key), expected });
    }
    Fault::new(at, Problem::Form { reason: message.replace('\n', " "), value: value(at) })
}
