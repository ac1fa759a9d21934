//! Registers of the chip and flash, as the processor's memory.

use crate::chip::Chip;
use crate::chip::flash::Accelerator;
use crate::image::FLASH_BASE;
use rsemu::core::error::BusError;
use rsemu::core::space::{AccessConstraints, MemAttrs, MemOps, MemResult};
use std::fmt;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard};

/// State shared by processor and chip.
pub(super) struct Junction {
    pub(super) chip: Mutex<Chip>,
    pub(super) now: AtomicU64,
    /// True after the processor accessed a register.
    pub(super) touched: AtomicBool,
}

impl Junction {
    pub(super) fn chip(&self) -> MutexGuard<'_, Chip> {
        self.chip.lock().expect("no model panics")
    }
}

/// Registers from an address on.
pub(super) struct Window {
    pub(super) base: u32,
    pub(super) junction: Arc<Junction>,
}

impl fmt::Debug for Window {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "registers from {:#x}", self.base)
    }
}

impl Window {
    /// Returns the chip at the moment of the access.
    fn chip(&self) -> MutexGuard<'_, Chip> {
        self.junction.touched.store(true, Relaxed);
        let mut chip = self.junction.chip();
        chip.fabric.now = self.junction.now.load(Relaxed);
        chip
    }
}

impl MemOps for Window {
    fn read(&self, offset: u64, into: &mut [u8], attrs: MemAttrs) -> MemResult {
        if attrs.debug {
            return Err(BusError::BadAccess);
        }
        let address = self.base + offset as u32;
        let word = self.chip().read(address & !3).to_le_bytes();
        let from = word.get(address as usize % 4..).unwrap_or_default();
        let from = from.get(..into.len()).ok_or(BusError::BadAccess)?;
        into.copy_from_slice(from);
        Ok(())
    }

    fn write(&self, offset: u64, from: &[u8], attrs: MemAttrs) -> MemResult {
        let address = self.base + offset as u32;
        // Narrower writes only to the low part of a register, as this firmware writes a UART's
        // byte.
        if attrs.debug || !address.is_multiple_of(4) || from.len() > 4 {
            return Err(BusError::BadAccess);
        }
        let mut word = [0; 4];
        word[..from.len()].copy_from_slice(from);
        self.chip().write(address, u32::from_le_bytes(word));
        Ok(())
    }
}

/// Flash whose reads take time.
pub(super) struct TimedFlash {
    pub(super) bytes: Vec<u8>,
    pub(super) accelerator: Arc<Mutex<Accelerator>>,
}

impl fmt::Debug for TimedFlash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "flash of {} bytes", self.bytes.len())
    }
}

impl MemOps for TimedFlash {
    fn read(&self, offset: u64, into: &mut [u8], attrs: MemAttrs) -> MemResult {
        let at = offset as usize;
        let from = self.bytes.get(at..at + into.len());
        into.copy_from_slice(from.ok_or(BusError::BadAccess)?);
        if !attrs.debug {
            let mut accelerator = self.accelerator.lock().expect("no model panics");
            let address = FLASH_BASE + offset as u32;
            match attrs.purpose.is_fetch() {
                true => accelerator.fetch(address),
                false => accelerator.load(address),
            }
        }
        Ok(())
    }

    fn write(&self, _: u64, _: &[u8], _: MemAttrs) -> MemResult {
        Err(BusError::BadAccess)
    }

    fn constraints(&self) -> AccessConstraints {
        AccessConstraints::ANY
    }
}
