//! Stops of the stage for hand-eye calibration.

/// Stop of the stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// Position along the stage's axes, mm.
    pub position_mm: [f64; 3],
    /// True if images are taken at this stop.
    pub looks: bool,
}

/// Stops with images on each axis, as shares of the reach.
const PLACES: [f64; 6] = [-1.0, -0.6, -0.2, 0.2, 0.6, 1.0];

/// Start of each axis, without images, as a share of the reach. The stage approaches every stop in
/// the same direction, so that backlash has no effect.
const RUN_UP: f64 = -1.2;

/// Returns the stops along each axis through `centre_mm`, `reach_mm` either way, and back to the
/// centre. The keyframe is taken at the first stop.
pub fn stops(centre_mm: [f64; 3], reach_mm: f64) -> Vec<Stop> {
    let at = |axis: usize, share: f64, looks| {
        let mut position_mm = centre_mm;
        position_mm[axis] += share * reach_mm;
        Stop { position_mm, looks }
    };
    let run_up = Stop {
        position_mm: centre_mm.map(|mm| mm + RUN_UP * reach_mm),
        looks: false,
    };
    let centre = |looks| Stop {
        position_mm: centre_mm,
        looks,
    };
    let mut stops = vec![run_up, centre(true)];
    for axis in 0..3 {
        stops.push(at(axis, RUN_UP, false));
        stops.extend(PLACES.map(|share| at(axis, share, true)));
        stops.push(at(axis, RUN_UP, false));
        stops.push(centre(false));
    }
    stops
}

/// Largest distance of a stop from the centre, as a share of the reach.
pub const FARTHEST: f64 = -RUN_UP;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_look_is_from_below() {
        let stops = stops([1.0, 2.0, 3.0], 5.0);
        assert_eq!(stops.iter().filter(|stop| stop.looks).count(), 19);
        for pair in stops.windows(2) {
            let [from, to] = [pair[0], pair[1]];
            let back = (0..3).any(|axis| to.position_mm[axis] < from.position_mm[axis]);
            assert!(!(to.looks && back), "{from:?} to {to:?}");
        }
        for stop in stops {
            for (axis, centre) in [1.0, 2.0, 3.0].into_iter().enumerate() {
                assert!((stop.position_mm[axis] - centre).abs() <= FARTHEST * 5.0 + 1e-9);
            }
        }
    }
}
