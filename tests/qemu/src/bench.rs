//! Instructions and stack.
use crate::Failure;
/// Runs all measurements.
pub fn run() -> Result<(), Failure> {
    Err(Failure("later"))
}
