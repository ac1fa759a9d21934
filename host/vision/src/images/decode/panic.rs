//! Panics of foreign decoders as values, without the message that a panic prints.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

thread_local! {
    /// True while this thread runs a decoder, whose panics are not printed.
    static IS_QUIET: Cell<bool> = const { Cell::new(false) };
}

/// Runs a decoder of foreign bytes; returns `None` if it panics. No message is printed.
pub fn caught<T>(decode: impl FnOnce() -> T) -> Option<T> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let others = take_hook();
        set_hook(Box::new(move |panic| {
            if !IS_QUIET.get() {
                others(panic);
            }
        }));
    });
    let before = IS_QUIET.replace(true);
    // A decoder owns all state that it changes, and none of it is used after a panic.
    let outcome = catch_unwind(AssertUnwindSafe(decode));
    IS_QUIET.set(before);
    outcome.ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panic_of_decoder_is_caught() {
        assert_eq!(caught(|| 7), Some(7));
        assert_eq!(caught(|| -> u8 { panic!("a decoder's") }), None);
        assert!(!IS_QUIET.get());
    }
}
