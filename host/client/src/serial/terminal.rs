//! Pseudo-terminals of a line. The system gives the name of one that was closed to the next program
//! that asks for one, so a line that was lost must not open the name again: bytes would go to
//! another program's terminal.
//!
//! One that was opened by a symbolic link may come back, once the link was made anew: that is what
//! the program behind it does when it is plugged in again.

use super::super::twin::link::is_left_behind;
use std::path::Path;

/// Folder of the pseudo-terminals of Linux and the BSDs.
const FOLDER: &str = "/dev/pts";

/// Beginning of the names of macOS.
const MACOS: &str = "/dev/ttys";

/// Pseudo-terminal behind a port's path, when the port was opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Terminal {
    /// The symbolic link that leads to it, if the path is one.
    link: Option<Identity>,
}

/// Number of the file of a link, and the time at which it was made, s and ns.
type Identity = (u64, i64, i64);

impl Terminal {
    /// Returns the pseudo-terminal that `path` leads to, if it leads to one.
    pub fn at(path: &str) -> Option<Self> {
        let real = Path::new(path).canonicalize().ok()?;
        let is_terminal =
            real.starts_with(FOLDER) || real.to_str().is_some_and(|real| real.starts_with(MACOS));
        is_terminal.then(|| Self {
            link: identity(path),
        })
    }

    /// Returns true if `path` may not lead to this program's station any more: it is the name of the
    /// pseudo-terminal itself, or a link whose program has crashed.
    pub fn is_gone(&self, path: &str) -> bool {
        self.link.is_none() || is_left_behind(Path::new(path))
    }

    /// Returns true if the link at `path` was made anew since, by a program that still runs.
    pub fn is_back(&self, path: &str) -> bool {
        let now = identity(path);
        let is_new = self.link.is_some() && now.is_some() && now != self.link;
        is_new && !is_left_behind(Path::new(path))
    }
}

#[cfg(unix)]
fn identity(path: &str) -> Option<Identity> {
    use std::os::unix::fs::MetadataExt as _;
    let about = std::fs::symlink_metadata(path).ok()?;
    let identity = || (about.ino(), about.mtime(), about.mtime_nsec());
    about.is_symlink().then(identity)
}

#[cfg(not(unix))]
fn identity(_: &str) -> Option<Identity> {
    None
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use crate::twin::far_end::Terminal as FarEnd;
    use std::os::unix::fs::symlink;

    #[test]
    fn terminal_by_own_name_never_comes_back() {
        let far = FarEnd::open().expect("a pseudo-terminal");
        let terminal = Terminal::at(far.name()).expect("it is one");
        assert!(terminal.is_gone(far.name()) && !terminal.is_back(far.name()));
        assert_eq!(Terminal::at("/dev/null"), None);
        assert_eq!(Terminal::at("/dev/no-such-port"), None);
    }

    #[test]
    fn only_link_made_anew_is_back() {
        let folder = tempfile::tempdir().expect("a folder");
        let (link, far) = (folder.path().join("port"), FarEnd::open().expect("one"));
        let path = link.to_str().expect("UTF-8");
        symlink(far.name(), path).expect("a link");
        let terminal = Terminal::at(path).expect("it is one");
        assert!(!terminal.is_gone(path) && !terminal.is_back(path));
        std::fs::remove_file(path).expect("ours");
        assert!(!terminal.is_back(path));
        // The clock of the file system may be coarse.
        std::thread::sleep(std::time::Duration::from_millis(20));
        symlink(far.name(), path).expect("a link");
        assert!(terminal.is_back(path));
    }
}
