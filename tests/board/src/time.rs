//! Time of the emulated board: an integer that every clock of the chip divides.

/// Time since power-on in beats of 1/336 µs. The VCO runs at 336 MHz, so the processor's 168 MHz,
/// the buses' 84 and 42 MHz, USB's 48 MHz and the crystal's 8 MHz are all whole numbers of beats.
pub type Beats = u64;

/// Beats per microsecond.
pub const US: Beats = 336;

/// Beats per millisecond.
pub const MS: Beats = 1_000 * US;

/// Returns the beats of a period of `hz`, which must divide 336 MHz.
pub const fn period(hz: u64) -> Beats {
    assert!(336_000_000 % hz == 0);
    336_000_000 / hz
}
