//! Motion of the target on station A.

use std::f64::consts::TAU;
use std::fmt;
use std::str::FromStr;

use trinocular_rig::choice::unknown;

/// Motion of the target over time, from zero.
///
/// ```
/// use trinocular::servo::path::TargetPath;
///
/// let path: TargetPath = "steps".parse()?;
/// assert_eq!(path.at(2.5), [8.0, 8.0, 2.0]);
/// # Ok::<(), trinocular::servo::path::UnknownTargetPath>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TargetPath {
    /// Moves of (4, 4, 1) mm, one every second, as in the paper.
    Steps,
    /// A line along (4, 4, 1) at 5 mm/s.
    Line,
    /// A circle of 10 mm radius in x and y, once in 8 s.
    Circle,
    /// A Lissajous figure of 20, 20 and 5 mm at frequencies 1 : 2 : 3, once in 16 s.
    Lissajous,
    /// No motion.
    Still,
}

impl TargetPath {
    /// All paths.
    pub const ALL: [Self; 5] = [
        Self::Steps,
        Self::Line,
        Self::Circle,
        Self::Lissajous,
        Self::Still,
    ];

    /// Returns the name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Steps => "steps",
            Self::Line => "line",
            Self::Circle => "circle",
            Self::Lissajous => "lissajous",
            Self::Still => "still",
        }
    }

    /// Returns the set position of the target after `time_s`, mm.
    pub fn at(self, time_s: f64) -> [f64; 3] {
        let t = time_s.max(0.0);
        match self {
            Self::Steps => [4.0, 4.0, 1.0].map(|d| d * t.floor()),
            Self::Line => [4.0, 4.0, 1.0].map(|d| d * 5.0 * t / 33f64.sqrt()),
            Self::Circle => {
                let angle = TAU * t / 8.0;
                [10.0 * angle.sin(), 10.0 * (1.0 - angle.cos()), 0.0]
            }
            Self::Lissajous => {
                let angle = TAU * t / 16.0;
                [
                    20.0 * angle.sin(),
                    20.0 * (2.0 * angle).sin(),
                    5.0 * (3.0 * angle).sin(),
                ]
            }
            Self::Still => [0.0; 3],
        }
    }
}

impl fmt::Display for TargetPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// A name that no [`TargetPath`] has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}", unknown("path", .0, &TargetPath::ALL.map(TargetPath::name)))]
pub struct UnknownTargetPath(String);

impl FromStr for TargetPath {
    type Err = UnknownTargetPath;

    fn from_str(name: &str) -> Result<Self, UnknownTargetPath> {
        let found = Self::ALL.into_iter().find(|path| path.name() == name);
        found.ok_or_else(|| UnknownTargetPath(name.to_owned()))
    }
}
