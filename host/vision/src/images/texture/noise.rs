//! Smooth random fields.

use crate::images::spline;
use trinocular_rig::random::Random;

/// Adds up one smooth random field per entry of `cells`, mean about 0 and standard deviation 1,
/// repeating every `size` texels. A field varies over about its cell, which must divide `size`;
/// coarser fields are stronger by the square root of two per octave.
pub(super) fn octaves(size: usize, cells: &[usize], random: &mut Random) -> Vec<f32> {
    let mut sum = vec![0.0; size * size];
    let mut strength = 1.0;
    for &cell in cells {
        add(&mut sum, size, cell, strength, random);
        strength *= std::f32::consts::SQRT_2;
    }
    let count = sum.len() as f64;
    let square: f64 = sum.iter().map(|&v| f64::from(v) * f64::from(v)).sum();
    let scale = (count / square.max(f64::MIN_POSITIVE)).sqrt() as f32;
    for value in &mut sum {
        *value *= scale;
    }
    sum
}

/// Adds a cubic B-spline through independent Gaussian values on a lattice `cell` texels wide.
fn add(sum: &mut [f32], size: usize, cell: usize, strength: f32, random: &mut Random) {
    let nodes = size / cell;
    let lattice: Vec<f32> = (0..nodes * nodes)
        .map(|_| strength * random.gaussian() as f32)
        .collect();
    // The taps of a texel: lattice indices and weights, the same along rows and columns.
    let taps: Vec<([usize; 4], [f32; 4])> = (0..size)
        .map(|x| {
            let first = x / cell + nodes - 1;
            let weights = spline::weights((x % cell) as f32 / cell as f32);
            (std::array::from_fn(|k| (first + k) % nodes), weights)
        })
        .collect();
    let mut line = vec![0.0; nodes];
    for (row, (rows, down)) in sum.chunks_exact_mut(size).zip(&taps) {
        for (x, value) in line.iter_mut().enumerate() {
            *value = (0..4).map(|k| down[k] * lattice[rows[k] * nodes + x]).sum();
        }
        for (value, (columns, across)) in row.iter_mut().zip(&taps) {
            *value += (0..4).map(|k| across[k] * line[columns[k]]).sum::<f32>();
        }
    }
}
