//! Logging over a debug probe, compiled in by the feature `defmt` only.

#[cfg(feature = "defmt")]
use defmt_rtt as _;

/// A line in the log. Without `defmt` its arguments are looked at by the compiler and by nothing
/// else.
macro_rules! note {
    ($text:literal $(, $value:expr)* $(,)?) => {{
        #[cfg(feature = "defmt")]
        ::defmt::info!($text $(, $value)*);
        #[cfg(not(feature = "defmt"))]
        { $( let _ = &$value; )* }
    }};
}
