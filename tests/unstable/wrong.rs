//! Errors between a target's displacement and a frame.

use nalgebra::{Rotation3, Unit, Vector3};
use trinocular_tests::chase::RIGHT;

/// A loop with a wrong mount or wrong time stamps.
#[derive(Clone, Debug)]
pub struct Wrong {
    pub name: String,
    /// Matrix from true to measured displacements, by rows.
    pub mount: [[f64; 3]; 3],
    /// Delay of the time stamps after the capture, µs.
    pub late_us: i64,
    /// Delay from an image to its flow frame, µs.
    pub latency_us: u64,
}

fn mounted(name: &str, mount: [[f64; 3]; 3]) -> Wrong {
    Wrong {
        name: name.to_owned(),
        mount,
        late_us: 0,
        latency_us: 20_000,
    }
}

/// Returns loops with reversed, swapped or cycled axes.
pub fn signs() -> [Wrong; 7] {
    let [x, y, z] = RIGHT;
    let back = |row: [f64; 3]| row.map(|element| -element);
    [
        mounted("x reversed", [back(x), y, z]),
        mounted("z reversed", [x, y, back(z)]),
        mounted("all reversed", [back(x), back(y), back(z)]),
        mounted("x and y swapped", [y, x, z]),
        mounted("y and z swapped", [x, z, y]),
        mounted("x and z swapped", [z, y, x]),
        mounted("cycled", [y, z, x]),
    ]
}

/// Returns a loop rotated about an axis.
pub fn turned(axis: [i32; 3], degrees: f64) -> Wrong {
    let about = Unit::new_normalize(Vector3::from(axis.map(f64::from)));
    let turn = Rotation3::from_axis_angle(&about, degrees.to_radians());
    let mut mount = RIGHT;
    for (i, row) in mount.iter_mut().enumerate() {
        for (j, element) in row.iter_mut().enumerate() {
            *element = turn.matrix()[(i, j)];
        }
    }
    mounted(
        &format!("turned by {degrees} degrees about {axis:?}"),
        mount,
    )
}

/// Returns a loop with measured displacements too large by a factor per axis.
pub fn scaled([x, y, z]: [f64; 3]) -> Wrong {
    let mount = [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]];
    mounted(&format!("scaled by {x}, {y}, {z}"), mount)
}

/// Returns a loop whose stamps are late by `late_ms`, with `latency_ms` from image to frame.
pub fn late(late_ms: i64, latency_ms: u64) -> Wrong {
    Wrong {
        late_us: 1_000 * late_ms,
        latency_us: 1_000 * latency_ms,
        ..mounted(
            &format!("stamps late by {late_ms} ms of {latency_ms}"),
            RIGHT,
        )
    }
}
