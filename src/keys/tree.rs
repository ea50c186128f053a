//! Deserialisation from trees of values of TOML or JSON, with the place of an error. Both become one kind of tree: for each type
//! one function is compiled then, where `serde_path_to_error` around both libraries would compile six.

use std::fmt::{self, Display, Formatter};
use std::vec::IntoIter;

use serde::de::value::{MapAccessDeserializer, StringDeserializer};
use serde::de::{
    DeserializeOwned, DeserializeSeed, Deserializer, Error, Expected, IntoDeserializer, MapAccess, SeqAccess,
    Unexpected, Visitor,
};
use serde::forward_to_deserialize_any;

/// Deserialises data from a tree of values; integers may stand for floats.
///
/// # Errors
/// The first error, with its place.
pub fn read_tree<T: DeserializeOwned>(tree: impl Into<Tree>) -> Result<T, TreeError> {
    T::deserialize(tree.into())
}

/// Value of TOML or JSON.
pub enum Tree {
    Null,
    Bool(bool),
    Integer(i64),
    Natural(u64),
    Number(f64),
    Text(String),
    List(Vec<Tree>),
    Table(Vec<(String, Tree)>),
}

impl From<toml::Value> for Tree {
    fn from(value: toml::Value) -> Self {
        match value {
            toml::Value::Boolean(x) => Self::Bool(x),
            toml::Value::Integer(x) => Self::Integer(x),
            toml::Value::Float(x) => Self::Number(x),
            toml::Value::String(text) => Self::Text(text),
            toml::Value::Datetime(time) => Self::Text(time.to_string()),
            toml::Value::Array(list) => Self::List(list.into_iter().map(Self::from).collect()),
            toml::Value::Table(table) => Self::Table(table.into_iter().map(|(key, x)| (key, x.into())).collect()),
        }
    }
}

impl From<serde_json::Value> for Tree {
    fn from(value: serde_json::Value) -> Self {
        match value {
            serde_json::Value::Null => Self::Null,
            serde_json::Value::Bool(x) => Self::Bool(x),
            serde_json::Value::Number(x) => match (x.as_u64(), x.as_i64()) {
                (Some(x), _) => Self::Natural(x),
                (None, Some(x)) => Self::Integer(x),
                (None, None) => Self::Number(x.as_f64().unwrap_or(f64::NAN)),
            },
            serde_json::Value::String(text) => Self::Text(text),
            serde_json::Value::Array(list) => Self::List(list.into_iter().map(Self::from).collect()),
            serde_json::Value::Object(table) => {
                Self::Table(table.into_iter().map(|(key, x)| (key, x.into())).collect())
            }
        }
    }
}

/// An error in a tree.
#[derive(Debug)]
pub struct TreeError {
    /// Place such as `a.b[2]`; empty for the whole tree.
    pub place: String,
    /// The error there.
    pub message: String,
}

impl TreeError {
    /// The error of a value that stands at this key or index.
    fn below(self, key: String) -> Self {
        let dot = if self.place.is_empty() || self.place.starts_with('[') { "" } else { "." };
        Self { place: key + dot + &self.place, ..self }
    }
}

impl Display for TreeError {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self { place, message } = self;
        if place.is_empty() { f.write_str(message) } else { write!(f, "{place}: {message}") }
    }
}

impl std::error::Error for TreeError {}

impl Error for TreeError {
    fn custom<T: Display>(message: T) -> Self {
        Self { place: String::new(), message: message.to_string() }
    }

    fn invalid_type(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        match found {
            Unexpected::Unit => Self::custom(format_args!("invalid type: null, expected {expected}")),
            found => Self::custom(format_args!("invalid type: {found}, expected {expected}")),
        }
    }
}

impl Tree {
    /// Visits anything but lists and tables.
    fn visit_scalar<'de, V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, TreeError> {
        match self {
            Self::Null => visitor.visit_unit(),
            Self::Bool(x) => visitor.visit_bool(x),
            Self::Integer(x) => visitor.visit_i64(x),
            Self::Natural(x) => visitor.visit_u64(x),
            Self::Number(x) => visitor.visit_f64(x),
            Self::Text(text) => visitor.visit_string(text),
            Self::List(_) => Err(Error::invalid_type(Unexpected::Seq, &visitor)),
            Self::Table(_) => Err(Error::invalid_type(Unexpected::Map, &visitor)),
        }
    }
}

impl<'de> Deserializer<'de> for Tree {
    type Error = TreeError;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, TreeError> {
        match self {
            Self::List(list) => {
                let (count, mut entries) = (list.len(), Entries { index: 0, rest: list.into_iter() });
                let value = visitor.visit_seq(&mut entries)?;
                complete(entries.rest.len(), count, &"fewer elements in array")?;
                Ok(value)
            }
            Self::Table(table) => visit_table(table, visitor),
            scalar => scalar.visit_scalar(visitor),
        }
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, TreeError> {
        match self {
            Self::Table(table) => visit_table(table, visitor),
            other => other.visit_scalar(visitor),
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, TreeError> {
        match self {
            Self::Null => visitor.visit_none(),
            some => visitor.visit_some(some),
        }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, TreeError> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, TreeError> {
        match self {
            Self::Text(variant) => visitor.visit_enum(IntoDeserializer::<TreeError>::into_deserializer(variant)),
            Self::Table(table) if table.len() == 1 => visitor.visit_enum(MapAccessDeserializer::new(Table::new(table))),
            other => other.visit_scalar(visitor),
        }
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit unit_struct seq tuple
        tuple_struct map identifier ignored_any
    }
}

fn visit_table<'de, V: Visitor<'de>>(table: Vec<(String, Tree)>, visitor: V) -> Result<V::Value, TreeError> {
    let (count, mut table) = (table.len(), Table::new(table));
    let value = visitor.visit_map(&mut table)?;
    complete(table.rest.len(), count, &"fewer elements in map")?;
    Ok(value)
}

/// An error where entries are left.
fn complete(left: usize, count: usize, expected: &dyn Expected) -> Result<(), TreeError> {
    if left == 0 { Ok(()) } else { Err(Error::invalid_length(count, expected)) }
}

/// Entries of a list that are left, and the index of the first one.
struct Entries {
    index: usize,
    rest: IntoIter<Tree>,
}

impl<'de> SeqAccess<'de> for Entries {
    type Error = TreeError;

    fn next_element_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<Option<S::Value>, TreeError> {
        let Some(entry) = self.rest.next() else { return Ok(None) };
        let index = self.index;
        self.index += 1;
        seed.deserialize(entry).map(Some).map_err(|error| error.below(format!("[{index}]")))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.rest.len())
    }
}

/// Entries of a table that are left, and the one whose key has been read.
struct Table {
    current: Option<(String, Tree)>,
    rest: IntoIter<(String, Tree)>,
}

impl Table {
    fn new(table: Vec<(String, Tree)>) -> Self {
        Self { current: None, rest: table.into_iter() }
    }
}

impl<'de> MapAccess<'de> for Table {
    type Error = TreeError;

    fn next_key_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<Option<S::Value>, TreeError> {
        self.current = self.rest.next();
        let Some((key, _)) = &self.current else { return Ok(None) };
        let name: StringDeserializer<TreeError> = key.clone().into_deserializer();
        seed.deserialize(name).map(Some).map_err(|error| error.below(key.clone()))
    }

    fn next_value_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<S::Value, TreeError> {
        let Some((key, value)) = self.current.take() else { return Err(Error::custom("a value without key")) };
        seed.deserialize(value).map_err(|error| error.below(key))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.rest.len())
    }
}
