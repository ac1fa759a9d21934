//! Grids of saddles that are the corners of one chessboard.
//!
//! From a seed the grid grows along the edge lines. The neighbour in a direction is the nearest
//! saddle whose edges run the same way, whose colours are exchanged, and to which an edge of
//! constant sign leads. The last condition excludes patterns that look alike only in part: two
//! squares further on, the sign has changed.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::f64::consts::PI;

use super::saddle::{Saddle, level};
use crate::matching::pyramid::Plane;

/// Largest angle between the direction to a neighbour and the edge, rad.
const ASTRAY: f64 = 0.26;
/// Largest angle between edges of neighbours, by perspective and lens, rad.
const TURNED: f64 = 0.45;
/// Largest ratio of one step of the grid to the next.
const STRETCH: f64 = 1.7;
/// Least step, px. The rings of nearer saddles overlap.
const LEAST_STEP_PX: f64 = 7.0;

/// Corner of a grid.
#[derive(Clone, Copy, Debug)]
pub struct Member {
    /// Pixel of the plane.
    pub at: [f64; 2],
    /// True if the square between the two positive directions is bright.
    pub is_bright: bool,
    saddle: usize,
    /// Directions in which the cells' first and second coordinate grow, rad; the second is
    /// clockwise from the first on the screen.
    axes: [f64; 2],
}

/// Connected piece of a grid; keys are cells, the seed's is `[0, 0]`.
pub type Grid = BTreeMap<[i32; 2], Member>;

/// Grows all grids of at least `least` corners, each saddle used once; the largest first.
pub fn grids(plane: &Plane, saddles: &[Saddle], least: usize) -> Vec<Grid> {
    let mut used = BTreeSet::new();
    let mut found = Vec::new();
    for seed in 0..saddles.len() {
        if used.contains(&seed) {
            continue;
        }
        let grid = even(grow(plane, saddles, seed));
        // Saddles that joined no grid here may join one that grows from a better seed.
        if grid.len() >= least {
            used.extend(grid.values().map(|member| member.saddle));
            found.push(grid);
        }
    }
    found.sort_by_key(|grid| std::cmp::Reverse(grid.len()));
    found
}

fn grow(plane: &Plane, saddles: &[Saddle], seed: usize) -> Grid {
    let mut grid = Grid::new();
    let axes = saddles[seed].edges;
    let mut taken = BTreeSet::from([seed]);
    grid.insert([0, 0], member(saddles, seed, axes));
    let mut queue = VecDeque::from([[0, 0]]);
    while let Some(cell) = queue.pop_front() {
        for (axis, sign) in [(0, 1), (1, 1), (0, -1), (1, -1)] {
            let mut target: [i32; 2] = cell;
            target[axis] += sign;
            if grid.contains_key(&target) {
                continue;
            }
            let from = grid[&cell];
            let step_px = known_step_px(&grid, cell, target);
            let angle = from.axes[axis] + if sign > 0 { 0.0 } else { PI };
            let way = Way {
                plane,
                saddles,
                from,
                angle,
                step_px,
            };
            if let Some((saddle, axes)) = way.neighbour(&taken) {
                taken.insert(saddle);
                grid.insert(target, member(saddles, saddle, axes));
                queue.push_back(target);
            }
        }
    }
    grid
}

/// Predicts the step from `cell` to `target` by its neighbours: the one before or, at the end of a
/// row, the ones in the neighbouring rows.
fn known_step_px(grid: &Grid, cell: [i32; 2], target: [i32; 2]) -> Option<f64> {
    let [di, dj] = [0, 1].map(|i| target[i] - cell[i]);
    let shifted = |cell: [i32; 2], i: i32, j: i32| [cell[0] + i, cell[1] + j];
    let pairs = [
        (shifted(cell, -di, -dj), cell),
        (shifted(cell, dj, di), shifted(target, dj, di)),
        (shifted(cell, -dj, -di), shifted(target, -dj, -di)),
    ];
    pairs
        .into_iter()
        .find_map(|(a, b)| Some(distance(grid.get(&a)?.at, grid.get(&b)?.at)))
}

/// Largest distance of a corner from its prediction by two neighbours in line, in steps.
const UNEVEN: f64 = 0.35;

/// Removes corners that no two neighbours in line confirm.
fn even(mut grid: Grid) -> Grid {
    loop {
        let odd: Vec<[i32; 2]> = grid
            .keys()
            .copied()
            .filter(|cell| !is_confirmed(&grid, *cell))
            .collect();
        if odd.is_empty() {
            return grid;
        }
        grid.retain(|cell, _| !odd.contains(cell));
    }
}

fn is_confirmed(grid: &Grid, cell: [i32; 2]) -> bool {
    let at = |axis: usize, steps: i32| {
        let mut place = cell;
        place[axis] += steps;
        grid.get(&place).map(|member| member.at)
    };
    let Some(here) = at(0, 0) else { return false };
    [0, 1].into_iter().any(|axis| {
        // Between two neighbours, or beyond two in a row: (a + b) / 2 and 2 a - b.
        [(1, -1, 0.5), (1, 2, 2.0), (-1, -2, 2.0)]
            .into_iter()
            .any(|(near, far, weight)| {
                let (Some(a), Some(b)) = (at(axis, near), at(axis, far)) else {
                    return false;
                };
                let expected = [0, 1].map(|i| weight * a[i] + (1.0 - weight) * b[i]);
                let step = distance(a, b) / f64::from((far - near).abs());
                distance(here, expected) < UNEVEN * step
            })
    })
}

fn member(saddles: &[Saddle], index: usize, axes: [f64; 2]) -> Member {
    let saddle = &saddles[index];
    Member {
        at: saddle.at,
        is_bright: saddle.is_bright(axes[0] + wrap(axes[1] - axes[0]) / 2.0),
        saddle: index,
        axes,
    }
}

/// Search for one neighbour.
struct Way<'a> {
    plane: &'a Plane,
    saddles: &'a [Saddle],
    from: Member,
    angle: f64,
    /// Step before this one, if it is known.
    step_px: Option<f64>,
}

impl Way<'_> {
    /// Finds the nearest fitting saddle and its axes.
    fn neighbour(&self, taken: &BTreeSet<usize>) -> Option<(usize, [f64; 2])> {
        let mut best = None;
        let mut best_px = f64::INFINITY;
        for (index, saddle) in self.saddles.iter().enumerate() {
            let apart = distance(self.from.at, saddle.at);
            if apart >= best_px || apart < LEAST_STEP_PX || taken.contains(&index) {
                continue;
            }
            let stretch = self
                .step_px
                .map_or(1.0, |step| (apart / step).max(step / apart));
            let [dx, dy] = [0, 1].map(|i| saddle.at[i] - self.from.at[i]);
            if stretch > STRETCH || wrap(dy.atan2(dx) - self.angle).abs() > ASTRAY {
                continue;
            }
            let Some(axes) = matching(saddle.edges, self.from.axes) else {
                continue;
            };
            let is_other = member(self.saddles, index, axes).is_bright != self.from.is_bright;
            if is_other && self.edge_leads_to(saddle) {
                best_px = apart;
                best = Some((index, axes));
            }
        }
        best
    }

    /// Returns true if the same side of the edge between the two is bright everywhere.
    fn edge_leads_to(&self, other: &Saddle) -> bool {
        let from = &self.saddles[self.from.saddle];
        let way = [0, 1].map(|i| other.at[i] - from.at[i]);
        let length = way[0].hypot(way[1]);
        let aside_px = (0.1 * length).max(1.5);
        let normal = [-way[1] / length * aside_px, way[0] / length * aside_px];
        let sign = if from.is_bright(self.angle + 0.4) {
            1.0
        } else {
            -1.0
        };
        let least = 0.2 * from.contrast.min(other.contrast);
        [0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8].iter().all(|share| {
            let side = |side: f64| {
                level(
                    self.plane,
                    [0, 1].map(|i| from.at[i] + share * way[i] + side * normal[i]),
                )
            };
            sign * (side(1.0) - side(-1.0)) > least
        })
    }
}

/// Orders and orients the edges like `axes`; `None` if they do not fit.
fn matching(edges: [f64; 2], axes: [f64; 2]) -> Option<[f64; 2]> {
    // The direction of an edge that is nearer to the axis.
    let along = |edge: f64, axis: f64| {
        let turn = wrap(edge - axis);
        axis + if turn.abs() > PI / 2.0 {
            wrap(turn + PI)
        } else {
            turn
        }
    };
    [[edges[0], edges[1]], [edges[1], edges[0]]]
        .map(|pair| [along(pair[0], axes[0]), along(pair[1], axes[1])])
        .into_iter()
        .find(|pair| (0..2).all(|i| (pair[i] - axes[i]).abs() < TURNED))
}

/// Wraps an angle to -π to π.
fn wrap(angle: f64) -> f64 {
    angle - 2.0 * PI * (angle / (2.0 * PI)).round()
}

/// Returns the distance of two pixels.
pub fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}
