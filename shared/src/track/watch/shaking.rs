//! A loop that shakes: windows of frames in which the apparent target moves as much as the stage.
//!
//! A loop can sustain a motion only if the effect of the stage returns to it in full: if the
//! apparent target `p` moves, because of the stage, at least about as much as the stage `s`. A
//! mount of gain `g` makes `p = (1 - g) s`, one that is turned by `a` makes `|p| = 2 sin(a/2) |s|`,
//! stamps that are off by `d` make `|p| = 2 sin(w d/2) |s|` at the angular frequency `w`. The loop
//! is stable up to `g` = 1.8 or `a` = 50 degrees, where `|p|` is 0.8 `|s|`.
//!
//! A window *feeds* the loop if `p` has 74 % of the energy of `s`. The prediction overshoots at
//! some frequencies, so a motion that does not die away is suspicious from 30 % on if it is large.
//! A target that is followed well moves as much as the stage, too, but then the error is small: an
//! error with less than a quarter of the stage's energy is not a sign of shaking.

use super::window::{Energy, Spread};

/// Share of the stage's energy in the apparent target from which on a loop feeds itself.
pub(super) const FEEDS: f32 = 0.74;

/// Share of the stage's energy in the apparent target that is enough for a large motion that lasts.
const LASTS: f32 = 0.3;

/// Share of the stage's energy in the error below which the target is followed.
const FOLLOWED: f32 = 0.25;

/// Energy of the stage below which it rests, steps².
const RESTS: f32 = 9.0;

/// Share of the error's largest energy below which a motion has died away.
const DIED: f32 = 0.4;

/// State of the detection over the last windows.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Shaking {
    /// Number of windows in succession that shook.
    lasts: u32,
    /// Number of windows in succession that fed the loop.
    feeds: u32,
    /// Largest energy of the error in these windows, steps².
    worst: f32,
    /// Variances of the last window.
    pub before: Option<[Spread; 3]>,
}

impl Shaking {
    /// Takes in a window's variances. `large` is the energy of a large motion, steps²; `again` says
    /// that the loop is under suspicion. Returns true if the loop is suspicious.
    pub fn see(
        &mut self,
        spreads: [Spread; 3],
        variance: [f32; 3],
        large: f32,
        again: bool,
    ) -> bool {
        self.before = Some(spreads);
        let energy = Energy::new(&spreads, variance);
        let large = energy.stage > large;
        let feeds = energy.target > FEEDS * energy.stage;
        let moves = energy.stage > RESTS && energy.error > FOLLOWED * energy.stage;
        if !(moves && (feeds || large && energy.target > LASTS * energy.stage)) {
            (self.lasts, self.feeds) = (0, 0);
            return false;
        }
        if self.lasts == 0 || energy.error < DIED * self.worst {
            (self.lasts, self.feeds, self.worst) = (1, u32::from(feeds), energy.error);
        } else {
            self.lasts = self.lasts.saturating_add(1);
            self.feeds = if feeds {
                self.feeds.saturating_add(1)
            } else {
                0
            };
            if energy.error > self.worst {
                self.worst = energy.error;
            }
        }
        let (lasts, feeding) = match (again, large) {
            (true, _) => (4, 2),
            (false, true) => (6, 2),
            (false, false) => (6, 3),
        };
        self.lasts >= lasts || self.feeds >= feeding
    }

    /// Returns true if the last window shook.
    pub fn is_active(&self) -> bool {
        self.lasts > 0
    }
}
