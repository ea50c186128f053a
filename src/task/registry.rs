//! Registry of the tasks.

use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::{Table, Value};

use super::button::Button;
use super::definition::{BaseController, Frame, TaskDefinition};
use super::dock::Dock;
use super::ee_track::EETrack;
use super::options::TaskOptions;
use super::station_keep::StationKeep;
use super::valve::Valve;
use crate::description::Integration;
use crate::error::TaskError;
use crate::keys::read_tree;

/// Declares the tasks: [`TaskKind`] and the macro `dispatch_task`.
macro_rules! tasks {
    ($dollar:tt $($task:ident),+ $(,)?) => {
        /// A task with its own options.
        #[derive(Debug, Clone, PartialEq)]
        pub enum TaskKind {
            $(#[doc = concat!("See [`", stringify!($task), "`].")] $task($task)),+
        }

        $(impl From<$task> for TaskKind {
            fn from(task: $task) -> Self {
                Self::$task(task)
            }
        })+

        /// Names and environments of the tasks.
        pub const TASKS: [(&str, &str); [$(<$task as TaskDefinition>::NAME),+].len()] =
            [$((<$task as TaskDefinition>::NAME, <$task as TaskDefinition>::ENVIRONMENT)),+];

        /// `dispatch_task!(kind, K, definition => expression)`: the expression with the task's type as `K` and a reference to
        /// its options as `definition`.
        macro_rules! dispatch_task {
            ($dollar kind:expr, $dollar K:ident, $dollar definition:ident => $dollar body:expr) => {
                match $dollar kind {
                    $($crate::task::TaskKind::$task($dollar definition) => {
                        type $dollar K = $crate::task::$task;
                        $dollar body
                    })+
                }
            };
        }

        /// Default options of the task of that name.
        fn defaults_of(name: &str) -> Option<TaskOptions> {
            match name {
                $(<$task as TaskDefinition>::NAME => {
                    let task = $task::default().into();
                    Some(TaskOptions { task, ..<$task as TaskDefinition>::defaults() })
                })+
                _ => None,
            }
        }
    };
}

tasks! { $ StationKeep, EETrack, Dock, Button, Valve }
pub(crate) use dispatch_task;

impl Default for TaskKind {
    fn default() -> Self {
        StationKeep::default().into()
    }
}

impl TaskKind {
    /// Name among options.
    pub fn name(&self) -> &'static str {
        dispatch_task!(self, K, _definition => K::NAME)
    }

    /// Name of the environment.
    pub fn environment(&self) -> &'static str {
        dispatch_task!(self, K, _definition => K::ENVIRONMENT)
    }

    /// Frame whose pose error counts.
    pub fn frame(&self) -> Frame {
        dispatch_task!(self, K, _definition => K::FRAME)
    }

    /// Controller that residual actions correct.
    pub fn base(&self) -> BaseController {
        dispatch_task!(self, K, _definition => K::BASE)
    }

    /// Joints are driven by the action, rather than follow references under their servos.
    pub fn drives_joints(&self) -> bool {
        dispatch_task!(self, K, _definition => K::DRIVES_JOINTS)
    }
}

impl TaskOptions {
    /// Default options of the task of that name.
    ///
    /// # Errors
    /// `TaskError::Options` for an unknown name.
    pub fn of(name: &str) -> Result<Self, TaskError> {
        let known = || TASKS.map(|(name, _)| format!("'{name}'")).join(", ");
        defaults_of(name).ok_or_else(|| TaskError::Options(format!("task is '{name}', but must be one of {}", known())))
    }

    /// From plain values over the defaults of the task that `task` names, by default station keeping. Without `dt`, the control
    /// period is `substeps` default steps of the task, and consists of steps for the `integration` of the scene.
    ///
    /// # Errors
    /// `TaskError::Options` for an unknown task or key, or a value of the wrong type.
    pub fn from_value(value: Value, integration: &Integration) -> Result<Self, TaskError> {
        let Value::Table(mut given) = value else {
            return Err(TaskError::Options("options must be a table".into()));
        };
        let name = match given.remove("task") {
            None => StationKeep::NAME.to_owned(),
            Some(Value::String(name)) => name,
            Some(other) => return Err(TaskError::Options(format!("task is {other}, but must be a name"))),
        };
        let defaults = Self::of(&name)?;
        let follows = !given.contains_key("dt");
        dispatch_task!(&defaults.task, K, definition => {
            let mut own = table(definition)?;
            let mut shared = table(&defaults)?;
            for (key, value) in given {
                let values = if own.contains_key(&key) { &mut own } else { &mut shared };
                match (values.get_mut(&key), value) {
                    (Some(Value::Table(old)), Value::Table(new)) => old.extend(new),
                    (_, value) => {
                        values.insert(key, value);
                    }
                }
            }
            let own: K = read(own)?;
            let options = Self { task: own.into(), ..read(shared)? };
            Ok(if follows { options.divided_for(integration) } else { options })
        })
    }

    /// Plain values of all options.
    ///
    /// # Errors
    /// `TaskError::Options`, which does not happen.
    pub fn to_value(&self) -> Result<Value, TaskError> {
        let mut values = table(self)?;
        values.extend(dispatch_task!(&self.task, K, definition => table::<K>(definition))?);
        values.insert("task".into(), self.task.name().into());
        Ok(values.into())
    }

    /// Refuses options out of their ranges.
    pub(super) fn check_all(&self) -> Result<(), TaskError> {
        self.check()?;
        dispatch_task!(&self.task, K, definition => K::check(definition, self.start_distance))
    }
}

fn table<T: Serialize>(values: &T) -> Result<Table, TaskError> {
    Table::try_from(values).map_err(|error| TaskError::Options(error.to_string()))
}

fn read<T: DeserializeOwned>(values: Table) -> Result<T, TaskError> {
    read_tree(Value::Table(values)).map_err(|error| TaskError::Options(error.to_string()))
}
