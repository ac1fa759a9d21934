//! Logging over a debug probe, only with the feature `defmt`.

#[cfg(feature = "defmt")]
use defmt_rtt as _;

/// Writes a line to the log. Without `defmt` the compiler checks the arguments, and nothing
/// evaluates them.
macro_rules! note {
    ($text:literal $(, $value:expr)* $(,)?) => {{
        #[cfg(feature = "defmt")]
        ::defmt::info!($text $(, $value)*);
        #[cfg(not(feature = "defmt"))]
        { $( let _ = &$value; )* }
    }};
}
