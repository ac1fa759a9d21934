//! Chessboard: inner corners, numbered so that every camera gives a corner the same number.
//!
//! Corner `c + r * columns` lies at `(c, r, 0)` squares. Columns go right and rows down for a
//! viewer of the board, so its z axis goes into the board. The choice of the first corner is left.
//! On a board with one even and one odd number of inner corners a half turn exchanges black and
//! white, so the colours decide: *the square outside the first corner, diagonally across from the
//! board, is black.* A board with two even or two odd numbers looks the same after a half turn, a
//! square one with even numbers after a quarter turn too. There the corner nearest the top left of
//! the image comes first, and [`super::rig`] renumbers the corners of the other cameras until all
//! agree; this is possible because the cameras are nearly parallel. On a square board with odd
//! numbers a quarter turn exchanges black and white, so the colours leave two of its four corners.

use std::str::FromStr;

/// Chessboard.
///
/// ```
/// use trinocular_vision::calibration::board::Board;
///
/// let board = Board { corners: [9, 6], square_mm: 25.0 };
/// assert_eq!((board.count(), board.point_mm(10)), (54, [25.0, 25.0]));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Board {
    /// Number of inner corners along x and y: 3 to 100 each.
    pub corners: [usize; 2],
    /// Side of a square, mm.
    pub square_mm: f64,
}

impl Board {
    /// Returns the number of inner corners.
    pub fn count(&self) -> usize {
        self.corners[0] * self.corners[1]
    }

    /// Returns the place of corner `index` on the board, mm.
    pub fn point_mm(&self, index: usize) -> [f64; 2] {
        let columns = self.corners[0];
        [index % columns, index / columns].map(|n| n as f64 * self.square_mm)
    }

    /// Returns the places of all corners on the board, mm.
    pub fn points_mm(&self) -> Vec<[f64; 2]> {
        (0..self.count()).map(|i| self.point_mm(i)).collect()
    }

    /// Returns true if colours distinguish the first corner from the last.
    pub fn is_unique(&self) -> bool {
        (self.corners[0] + self.corners[1]) % 2 == 1
    }

    /// Returns true if colours rule out some of the rotations that the shape permits.
    pub fn is_told_by_colours(&self) -> bool {
        let ends = match self.corners[0] == self.corners[1] {
            true => 4,
            false => 2,
        };
        self.symmetries().len() < ends
    }

    /// Returns the corner at the place of corner `index` after `quarters` clockwise quarter turns
    /// of the board. Odd numbers are for boards with as many columns as rows.
    pub fn turned(&self, index: usize, quarters: usize) -> usize {
        let [columns, rows] = self.corners;
        let (c, r) = (index % columns, index / columns);
        let (c, r) = match quarters % 4 {
            0 => (c, r),
            1 => (columns - 1 - r, c),
            2 => (columns - 1 - c, rows - 1 - r),
            _ => (r, rows - 1 - c),
        };
        c + r * columns
    }

    /// Returns the rotations after which the board looks the same, in quarter turns.
    pub fn symmetries(&self) -> &'static [usize] {
        let [columns, rows] = self.corners;
        // Colours of the square at `(c, r)` follow the parity of c + r; a quarter turn of (n + 1)
        // squares keeps them for even n.
        match (columns == rows, self.is_unique()) {
            (_, true) => &[0],
            (true, _) if columns.is_multiple_of(2) => &[0, 1, 2, 3],
            _ => &[0, 2],
        }
    }
}

/// Number of inner corners in the form `9x6`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pattern(pub [usize; 2]);

/// Error of a text that is not a [`Pattern`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is not like 9x6: inner corners along the two sides, 3 to 100 each")]
pub struct WrongPattern(String);

impl FromStr for Pattern {
    type Err = WrongPattern;

    fn from_str(text: &str) -> Result<Self, WrongPattern> {
        let wrong = || WrongPattern(text.to_owned());
        let (columns, rows) = text.split_once(['x', 'X', '×']).ok_or_else(wrong)?;
        let side = |text: &str| {
            text.trim()
                .parse()
                .ok()
                .filter(|n| (3..=100).contains(n))
                .ok_or_else(wrong)
        };
        Ok(Self([side(columns)?, side(rows)?]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn board(columns: usize, rows: usize) -> Board {
        Board {
            corners: [columns, rows],
            square_mm: 25.0,
        }
    }

    #[test]
    fn repeated_turns_return_to_start() {
        for (board, turns) in [(board(9, 6), 2), (board(4, 4), 4)] {
            for index in 0..board.count() {
                let step = 4 / turns;
                let round = (0..turns).fold(index, |at, _| board.turned(at, step));
                assert_eq!(round, index);
            }
        }
        assert_eq!(board(4, 4).turned(0, 1), 3);
        assert_eq!(board(9, 6).turned(0, 2), 53);
        assert_eq!(board(9, 6).turned(10, 0), 10);
    }

    /// Returns the colour of the square up and left of corner `(c, r)`.
    fn colour(c: usize, r: usize) -> usize {
        (c + r) % 2
    }

    #[test]
    fn symmetries_keep_colours() {
        for (columns, rows) in [(9, 6), (6, 9), (8, 6), (7, 5), (4, 4), (5, 5)] {
            let board = board(columns, rows);
            let half = colour(0, 0) == colour(columns, rows);
            let quarter = columns == rows && colour(0, 0) == colour(columns, 0);
            assert_eq!(board.symmetries().contains(&2), half, "{columns} x {rows}");
            assert_eq!(
                board.symmetries().contains(&1),
                quarter,
                "{columns} x {rows}"
            );
            assert_eq!(board.is_unique(), !half);
        }
    }

    #[test]
    fn pattern_text_is_parsed() {
        assert_eq!("9x6".parse(), Ok(Pattern([9, 6])));
        for bad in [
            "", "9", "9x", "x6", "9x6x2", "2x6", "9x101", "-9x6", "9.0x6",
        ] {
            assert!(bad.parse::<Pattern>().is_err(), "{bad}");
        }
    }
}
