//! Errors, one enum per boundary.
