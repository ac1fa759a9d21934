//! Progress of a long command, on standard error.

use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal as _;
use std::time::{Duration, Instant};
use trinocular_rig::notice;

/// Period of the status line.
const RENEWED: Duration = Duration::from_millis(100);

/// Progress as a bar on a terminal; elsewhere as a line at every tenth.
pub struct Progress {
    bar: Option<ProgressBar>,
    what: &'static str,
    told: u32,
}

impl Progress {
    /// Starts at 0 %.
    pub fn new(what: &'static str) -> Self {
        let bar = std::io::stderr().is_terminal().then(|| {
            let style = ProgressStyle::with_template("{msg} [{bar:40}] {percent:>3} %  {elapsed}");
            let bar = ProgressBar::new(1000).with_message(what);
            match style {
                Ok(style) => bar.with_style(style.progress_chars("=> ")),
                Err(_) => bar,
            }
        });
        Self { bar, what, told: 0 }
    }

    /// Makes a progress that is not shown, because something else shows it.
    pub fn hidden() -> Self {
        Self {
            bar: Some(ProgressBar::hidden()),
            what: "",
            told: 0,
        }
    }

    /// Shows the share that is done, 0 to 1.
    pub fn at(&mut self, share: f64) {
        match &self.bar {
            Some(bar) => bar.set_position((share.clamp(0.0, 1.0) * 1000.0) as u64),
            None => {
                let tenth = (share * 10.0) as u32;
                if tenth > self.told {
                    self.told = tenth;
                    notice!("{}: {} %", self.what, (tenth * 10).min(100));
                }
            }
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// State of a run in one line that is renewed, where rows would scroll by too fast to be read.
pub struct StatusLine {
    bar: ProgressBar,
    shown: Instant,
    /// Frame sets since the line was shown last.
    frames: u32,
}

impl StatusLine {
    /// Makes the line if rows of text would go to a terminal; otherwise the caller prints rows.
    pub fn new(as_json: bool) -> Option<Self> {
        let is_terminal = std::io::stdout().is_terminal() && std::io::stderr().is_terminal();
        (is_terminal && !as_json).then(|| {
            let bar = ProgressBar::new_spinner();
            let bar = match ProgressStyle::with_template("{wide_msg}") {
                Ok(style) => bar.with_style(style),
                Err(_) => bar,
            };
            Self {
                bar,
                shown: Instant::now(),
                frames: 0,
            }
        })
    }

    /// Takes in a frame set; renews the line ten times a second, with the text that `text` makes of
    /// the frame sets per second.
    pub fn show(&mut self, text: impl FnOnce(f64) -> String) {
        self.frames += 1;
        let passed = self.shown.elapsed();
        if passed >= RENEWED {
            let rate = f64::from(self.frames) / passed.as_secs_f64();
            self.bar.set_message(text(rate));
            self.bar.tick();
            (self.shown, self.frames) = (Instant::now(), 0);
        }
    }
}

impl Drop for StatusLine {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// Progress without a known end: a counter on a terminal, unless results go there too; elsewhere a
/// line at every hundred.
pub struct Count {
    bar: Option<ProgressBar>,
    is_told: bool,
    what: &'static str,
}

impl Count {
    /// Starts at 0.
    pub fn new(what: &'static str) -> Self {
        let is_terminal = std::io::stderr().is_terminal();
        let is_free = is_terminal && !std::io::stdout().is_terminal();
        let bar = is_free.then(|| ProgressBar::new_spinner().with_message(what));
        Self {
            bar,
            is_told: !is_terminal,
            what,
        }
    }

    /// Shows the count.
    pub fn at(&mut self, count: usize) {
        if let Some(bar) = &self.bar {
            bar.set_message(format!("{count} {}", self.what));
            bar.tick();
        } else if self.is_told && count.is_multiple_of(100) {
            notice!("{count} {}", self.what);
        }
    }
}

impl Drop for Count {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
