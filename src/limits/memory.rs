//! Memory for arrays whose size comes from the caller.

use crate::error::OutOfMemory;

/// Bytes from which on the memory that is available is asked for: Linux promises more than it has.
const LARGE: u128 = 1 << 28;

/// Refuses what does not fit into memory: `bytes` are the product of these sizes.
///
/// # Errors
/// [`OutOfMemory`] names what needs it, and how much.
pub fn check(what: &'static str, sizes: &[usize]) -> Result<(), OutOfMemory> {
    let bytes = sizes.iter().fold(1_u128, |product, size| product.saturating_mul(*size as u128));
    let fits = usize::try_from(bytes).is_ok_and(|bytes| Vec::<u8>::new().try_reserve_exact(bytes).is_ok());
    if fits && (bytes < LARGE || available().is_none_or(|available| bytes <= available)) {
        return Ok(());
    }
    Err(OutOfMemory { what, gigabytes: bytes as f64 / 1e9 })
}

/// Bytes that can be used without swapping, where the system tells.
fn available() -> Option<u128> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kilobytes: u128 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(1024 * kilobytes)
}
