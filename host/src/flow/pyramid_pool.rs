//! Memory of images that are no longer needed, kept for the next ones: the system takes longer to
//! hand out fresh memory than the filter takes to fill it.

use std::sync::Mutex;

use super::Filtered;

/// At most one capture's images.
#[derive(Debug, Default)]
pub struct Spare(Mutex<Option<Filtered>>);

impl Spare {
    /// What is kept, if anything.
    pub fn take(&self) -> Option<Filtered> {
        self.0.lock().ok()?.take()
    }

    /// For later.
    pub fn keep(&self, filtered: Filtered) {
        if let Ok(mut kept) = self.0.lock() {
            *kept = Some(filtered);
        }
    }
}

/// Memory is not shared, nor worth a copy.
impl Clone for Spare {
    fn clone(&self) -> Self {
        Self::default()
    }
}
