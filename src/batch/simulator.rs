//! The batched simulator without any task.
