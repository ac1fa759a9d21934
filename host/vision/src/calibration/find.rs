//! Search of a board's corners in an image: saddles, grid, names, sub-pixel places.

use std::fmt;

use super::board::Board;
use super::grid::{Grid, distance, grids};
use super::saddle::saddles;
use super::{blur, contrast, homography, refine};
use crate::images::Image;
use crate::matching::pyramid::Pyramid;

/// Ratio of half the refinement window to the distance to the nearest edge that is not the corner's
/// own.
///
/// Measured on photographs whose outer squares are cut to a third of their size: larger windows see
/// the board's border.
const WINDOW: f64 = 0.18;
/// Least half window, px. A smaller one holds only the blur of the edge.
const LEAST_HALF_WINDOW: usize = 3;
/// Largest half window, px. A larger one gains nothing and is sensitive to the lens's distortion.
const MOST_HALF_WINDOW: usize = 20;
/// Least ratio of half the refinement window to the blur of the board's edges. A smaller window shows
/// no edges: the corner is then the saddle of the blurred grey levels.
const LEAST_WINDOW_BLURS: f64 = 2.0;
/// Largest ratio of half the window of a saddle to the distance to the nearest edge that is not the
/// corner's own.
const MOST_SADDLE_WINDOW: f64 = 0.35;
/// Half window of the refinement on pyramid levels, px of the level.
const DESCENT_HALF_WINDOW: usize = 3;
/// Pyramid levels on which the board is searched, finest first.
const LEVELS: usize = 4;
/// Least share of corners that permits a search for the others at their predicted places.
const ENOUGH: f64 = 0.8;

/// Board found in an image.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundBoard {
    /// Pixels of all inner corners in the board's order, px from the centre of the top left pixel.
    pub corners: Vec<[f64; 2]>,
    /// Standard deviation of the edges' blur, px, in the worse of the board's two directions.
    pub blur_px: f64,
}

/// Reason why no board was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NotFound {
    /// The image shows no chessboard.
    Nothing,
    /// The image shows a chessboard, or part of one, with this many corners along its sides.
    Other([usize; 2]),
    /// Reason for a board with hidden or unclear corners, with their number.
    Hidden(usize),
}

impl std::error::Error for NotFound {}

impl fmt::Display for NotFound {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nothing => f.write_str("no board found"),
            Self::Other([columns, rows]) => {
                write!(
                    f,
                    "a grid of {columns} x {rows} inner corners found instead of the board"
                )
            }
            Self::Hidden(1) => f.write_str("a corner of the board is hidden or blurred"),
            Self::Hidden(count) => write!(f, "{count} corners of the board are hidden or blurred"),
        }
    }
}

/// Finds all inner corners of `board`. `half_window` sets half the refinement window in px;
/// without, it follows the size of the squares.
///
/// # Errors
/// [`NotFound`], for the most complete grid in the image.
pub fn find(
    image: &Image,
    board: &Board,
    half_window: Option<usize>,
) -> Result<FoundBoard, NotFound> {
    let pyramid = Pyramid::new(&contrast::stretched(image), LEVELS);
    let mut refusal = NotFound::Nothing;
    let mut most = 0;
    for (level, plane) in pyramid.levels.iter().enumerate() {
        for grid in grids(plane, &saddles(plane), 6) {
            let place = |at: [f64; 2]| descend(&pyramid, level, at);
            match corners(image, board, &grid, place, half_window) {
                Ok(corners) => {
                    let blur_px = blur::of_edges(image, board, &corners);
                    return Ok(FoundBoard { corners, blur_px });
                }
                // Part of a larger board would suffice for one camera, but its place in the board
                // is unknown.
                Err(reason) if is_larger(reason, board) => return Err(reason),
                Err(reason) if grid.len() > most => {
                    most = grid.len();
                    refusal = reason;
                }
                Err(_) => {}
            }
        }
    }
    Err(refusal)
}

/// Returns the place in the image of a corner found on a pyramid level, refined on each level below
/// it. A blurred corner is found on a coarse level only, whose pixels are too large to start from.
fn descend(pyramid: &Pyramid, level: usize, at: [f64; 2]) -> [f64; 2] {
    (0..level).rev().fold(at, |at, level| {
        let start = at.map(|c| 2.0 * c);
        refine::refine(&pyramid.levels[level], start, DESCENT_HALF_WINDOW).unwrap_or(start)
    })
}

/// Returns true if `grid` is a chessboard with more corners than `board`.
fn is_larger(found: NotFound, board: &Board) -> bool {
    let [a, b] = board.corners;
    matches!(found, NotFound::Other([long, short]) if long >= a.max(b) && short >= a.min(b))
}

/// Returns the board's corners if `grid` is the board.
fn corners(
    image: &Image,
    board: &Board,
    grid: &Grid,
    place: impl Fn([f64; 2]) -> [f64; 2],
    half_window: Option<usize>,
) -> Result<Vec<[f64; 2]>, NotFound> {
    let named = name(board, grid)?;
    let (indices, seen): (Vec<usize>, Vec<[f64; 2]>) =
        named.into_iter().map(|(i, at)| (i, place(at))).unzip();
    let hidden = NotFound::Hidden(board.count() - seen.len());
    if (seen.len() as f64) < ENOUGH * board.count() as f64 {
        return Err(hidden);
    }
    let points: Vec<[f64; 2]> = indices.iter().map(|i| board.point_mm(*i)).collect();
    let map = homography::fit(&points, &seen).ok_or(hidden)?;
    let mut rough: Vec<[f64; 2]> = board
        .points_mm()
        .iter()
        .map(|p| homography::apply(&map, *p))
        .collect();
    for (index, at) in indices.into_iter().zip(seen) {
        rough[index] = at;
    }
    let blur_px = blur::of_edges(image, board, &rough);
    let refined = |index: usize| {
        let (start, room) = (rough[index], room_px(board, &rough, index));
        let half = half_window.unwrap_or_else(|| {
            ((WINDOW * room).round() as usize).clamp(LEAST_HALF_WINDOW, MOST_HALF_WINDOW)
        });
        let is_blurred = (half as f64) < LEAST_WINDOW_BLURS * blur_px;
        let at = match half_window.is_none() && is_blurred {
            true => {
                let half = blur_px.min(MOST_SADDLE_WINDOW * room).round() as usize;
                refine::saddle(image, start, half.max(LEAST_HALF_WINDOW))
            }
            false => refine::refine(image, start, half),
        }?;
        (distance(at, start) < room / 3.0).then_some(at)
    };
    let refined: Vec<Option<[f64; 2]>> = (0..board.count()).map(refined).collect();
    let unclear = refined.iter().filter(|corner| corner.is_none()).count();
    refined
        .into_iter()
        .collect::<Option<_>>()
        .ok_or(NotFound::Hidden(unclear))
}

/// Returns the first and last cell along an axis.
fn bound(grid: &Grid, axis: usize) -> (i32, i32) {
    let along = || grid.keys().map(|cell| cell[axis]);
    (along().min().unwrap_or(0), along().max().unwrap_or(0))
}

/// Removes outermost lines that are nearly empty: if the board's border adjoins something dark, the
/// grid may continue by a saddle or two.
fn trimmed(grid: &Grid) -> Grid {
    let mut grid = grid.clone();
    loop {
        let before = grid.len();
        for axis in [0, 1] {
            let (first, last) = bound(&grid, 1 - axis);
            let length = (last - first + 1) as usize;
            let (low, high) = bound(&grid, axis);
            for line in [low, high] {
                if 3 * grid.keys().filter(|cell| cell[axis] == line).count() <= length {
                    grid.retain(|cell, _| cell[axis] != line);
                }
            }
        }
        if grid.len() == before {
            return grid;
        }
    }
}

/// Assigns the board's corners to the cells of the grid, in the right orientation.
fn name(board: &Board, grid: &Grid) -> Result<Vec<(usize, [f64; 2])>, NotFound> {
    let grid = &trimmed(grid);
    let [(left, right), (top, bottom)] = [0, 1].map(|axis| bound(grid, axis));
    let size = [right - left, bottom - top].map(|n| n as usize + 1);
    let [columns, rows] = board.corners;
    let turned = |quarters: usize, [i, j]: [i32; 2]| {
        let (c, r) = match quarters {
            0 => (i - left, j - top),
            1 => (j - top, right - i),
            2 => (right - i, bottom - j),
            _ => (bottom - j, i - left),
        };
        (c as usize, r as usize)
    };
    let fits = |quarters: &usize| match quarters % 2 {
        0 => size == [columns, rows],
        _ => size == [rows, columns],
    };
    // True if the square outside the first corner is black, by the colours at any corner: opposite
    // squares are alike, neighbours are not, and a quarter turn takes one square to its neighbour.
    let begins_black = |quarters: usize| {
        grid.iter().all(|(cell, member)| {
            let (c, r) = turned(quarters, *cell);
            member.is_bright == ((c + r + quarters) % 2 == 1)
        })
    };
    let first_px = |quarters: usize| {
        grid.iter()
            .map(|(cell, member)| (turned(quarters, *cell), member.at))
            .min_by_key(|((c, r), _)| c + r)
            .map_or(f64::MAX, |(_, at)| at[0] + at[1])
    };
    let ways = (0..4)
        .filter(fits)
        .filter(|q| !board.is_told_by_colours() || begins_black(*q));
    let way = ways.min_by(|a, b| first_px(*a).total_cmp(&first_px(*b)));
    let Some(quarters) = way else {
        return Err(NotFound::Other([
            size[0].max(size[1]),
            size[0].min(size[1]),
        ]));
    };
    let index = |cell: &[i32; 2]| {
        let (c, r) = turned(quarters, *cell);
        c + r * columns
    };
    Ok(grid
        .iter()
        .map(|(cell, member)| (index(cell), member.at))
        .collect())
}

/// Returns the distance of a corner from the nearest edge that is not its own, px: the smallest
/// height of the squares around it.
fn room_px(board: &Board, corners: &[[f64; 2]], index: usize) -> f64 {
    let [columns, rows] = board.corners;
    let (c, r) = (index % columns, index / columns);
    let side = |neighbour: Option<usize>| {
        neighbour.map(|other| [0, 1].map(|i| corners[other][i] - corners[index][i]))
    };
    let across = [
        side((c > 0).then(|| index.wrapping_sub(1))),
        side((c + 1 < columns).then_some(index + 1)),
    ];
    let down = [
        side((r > 0).then(|| index.wrapping_sub(columns))),
        side((r + 1 < rows).then_some(index + columns)),
    ];
    let mut room = f64::INFINITY;
    for a in across.into_iter().flatten() {
        for b in down.into_iter().flatten() {
            let area = (a[0] * b[1] - a[1] * b[0]).abs();
            room = room.min(area / a[0].hypot(a[1]).max(b[0].hypot(b[1])));
        }
    }
    room
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE_PX: f64 = 20.0;
    const MIDDLE_PX: f64 = 150.0;

    /// Draws a board turned clockwise about the middle of the image, black outside its first
    /// corner.
    fn drawn(board: &Board, turn_deg: f64) -> Image {
        drawn_with(board, turn_deg, 0.8, 90.0)
    }

    /// Does the same with edges that are `soft_px` wide and squares that are `contrast` grey levels
    /// brighter or darker than the mean.
    fn drawn_with(board: &Board, turn_deg: f64, soft_px: f64, contrast: f64) -> Image {
        let (sin, cos) = turn_deg.to_radians().sin_cos();
        let sides = board.corners.map(|n| n as f64 + 1.0);
        let grey = |i: usize| {
            let [x, y] = [i % 300, i / 300].map(|n| n as f64 - MIDDLE_PX);
            let at = [x * cos + y * sin, y * cos - x * sin];
            let [u, v] = [0, 1].map(|k| at[k] / SIDE_PX + sides[k] / 2.0);
            // Edges as soft as with a lens; border and background white.
            let edge = |a: f64| {
                let sign = if a.round() % 2.0 == 0.0 { 1.0 } else { -1.0 };
                sign * ((a - a.round()) * SIDE_PX / soft_px).tanh()
            };
            let inside = u > 0.0 && v > 0.0 && u < sides[0] && v < sides[1];
            let level = 125.0 - contrast * edge(u) * edge(v);
            let level = if inside { level } else { 125.0 + contrast };
            // Whole grey levels, spread by as much noise as one.
            (level + (i * 7919 % 256) as f64 / 256.0) as u8
        };
        Image {
            width: 300,
            height: 300,
            grey: (0..300 * 300).map(grey).collect(),
        }
    }

    /// Tests edges as soft as those of a board blurred by 4 px, and a fifteenth of the grey levels.
    #[test]
    fn blurred_and_faint_boards_are_found() {
        let board = Board {
            corners: [9, 6],
            square_mm: 1.0,
        };
        for (soft_px, contrast, off_px) in [(5.0, 90.0, 0.15), (0.8, 6.0, 0.3), (3.0, 12.0, 0.5)] {
            for turn_deg in [0.0, 12.0, 33.0] {
                let image = drawn_with(&board, turn_deg, soft_px, contrast);
                let found = find(&image, &board, None);
                let found = found.unwrap_or_else(|reason| panic!("{soft_px} {turn_deg}: {reason}"));
                let (sin, cos) = turn_deg.to_radians().sin_cos();
                for (index, corner) in found.corners.iter().enumerate() {
                    let at = board.point_mm(index);
                    let [x, y] =
                        [(at[0], 4.0), (at[1], 2.5)].map(|(c, middle)| (c - middle) * SIDE_PX);
                    let place = [x * cos - y * sin, x * sin + y * cos].map(|c| c + MIDDLE_PX);
                    let off = distance(*corner, place);
                    assert!(off < off_px, "{soft_px} {contrast} {turn_deg}: {off}");
                }
            }
        }
    }

    /// Tests that for any orientation the first corner is one of those that a colour-preserving
    /// turn maps to it.
    #[test]
    fn first_corner_follows_colours() {
        for corners in [[7, 7], [5, 5], [6, 6], [7, 5], [7, 6]] {
            let board = Board {
                corners,
                square_mm: 1.0,
            };
            for turn in (0..360).step_by(15) {
                let (sin, cos) = f64::from(turn).to_radians().sin_cos();
                let place = |index: usize| {
                    let at = board.point_mm(index);
                    let [x, y] =
                        [0, 1].map(|k| (at[k] - (corners[k] as f64 - 1.0) / 2.0) * SIDE_PX);
                    [x * cos - y * sin, x * sin + y * cos].map(|c| c + MIDDLE_PX)
                };
                let found = find(&drawn(&board, f64::from(turn)), &board, None);
                let found = found.unwrap_or_else(|reason| panic!("{corners:?} {turn}: {reason}"));
                let is_true = |quarters: &usize| {
                    let turned = |index| place(board.turned(index, *quarters));
                    let mut corners = found.corners.iter().enumerate();
                    corners.all(|(index, at)| distance(*at, turned(index)) < 0.5)
                };
                assert!(
                    board.symmetries().iter().any(is_true),
                    "{corners:?} turned by {turn} degrees"
                );
            }
        }
    }
}
