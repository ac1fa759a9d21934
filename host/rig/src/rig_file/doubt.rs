//! Doubts about a rig that obeys every rule but probably has wrong units or exchanged names.

use super::{RigFile, Stage};

/// Size below which a rig is probably in metres, mm.
const METRES_MM: f64 = 0.5;
/// Size below which a rig is probably in centimetres, mm: less than the housings of two cameras.
const CENTIMETRES_MM: f64 = 20.0;
/// Largest size of a rig on one frame, mm.
const WIDEST_MM: f64 = 5_000.0;
/// Least focal length over the image's width: a field of view of 127 degrees.
const LEAST_FOCAL: f64 = 0.25;
/// Greatest focal length over the image's width: a field of view of 1 degree.
const GREATEST_FOCAL: f64 = 50.0;

impl Stage {
    /// Returns the probable mistake in the settings of tracking, as a sentence for the user.
    pub fn doubt(&self) -> Option<&'static str> {
        let doubt = "stage.prediction is false, which switches off the watch for lost steps, too \
                     (largest_unseen_mm): a stalled motor is not noticed; leave it true unless you \
                     compare";
        (!self.tracking.prediction).then_some(doubt)
    }
}

impl RigFile {
    /// Returns the probable mistakes of units or names, as sentences for the user.
    pub fn doubts(&self) -> Vec<String> {
        let mut doubts = Vec::new();
        doubts.extend(self.distance());
        doubts.extend(self.exchanged());
        doubts.extend(self.focal());
        doubts
    }

    fn distance(&self) -> Option<String> {
        let cameras = &self.rig.cameras;
        let apart = |a: usize, b: usize| {
            let [dx, dy] = [0, 1].map(|i| cameras[a].offset_mm[i] - cameras[b].offset_mm[i]);
            dx.hypot(dy)
        };
        let pairs = (0..cameras.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
        let widest = pairs.map(|(a, b)| apart(a, b)).fold(0.0, f64::max);
        let unit = match widest {
            w if w < METRES_MM => "metres",
            w if w < CENTIMETRES_MM => "centimetres",
            w if w > WIDEST_MM => "micrometres",
            _ => return None,
        };
        Some(format!(
            "the cameras are at most {widest:.2} mm apart: are the offsets in {unit}? offset_mm is \
             in mm"
        ))
    }

    fn exchanged(&self) -> Option<String> {
        let place = |wanted: &str| {
            let mut names = self.names.iter();
            let index = names.position(|name| name.eq_ignore_ascii_case(wanted))?;
            let name = self.names[index].as_str();
            Some((name, self.rig.cameras[index].offset_mm[0]))
        };
        let in_order = ["left", "middle", "centre", "center", "right"];
        let stands: Vec<_> = in_order.into_iter().filter_map(place).collect();
        // The pair that is farthest apart in the wrong order.
        let pairs = (0..stands.len()).flat_map(|b| (0..b).map(move |a| [a, b]));
        let wrong = pairs
            .map(|pair| pair.map(|index| stands[index]))
            .filter(|[(_, a), (_, b)]| a > b)
            .max_by(|[(_, a), (_, b)], [(_, c), (_, d)]| (a - b).total_cmp(&(c - d)));
        wrong.map(|[(left, a), (right, b)]| {
            format!(
                "camera `{left}` is {:.1} mm to the right of `{right}`: are their folders, their \
                 names or the signs of offset_mm exchanged?",
                a - b
            )
        })
    }

    fn focal(&self) -> Option<String> {
        let width = f64::from(self.rig.image_size_px[0]);
        let mut cameras = self.names.iter().zip(&self.rig.cameras);
        let (name, camera) = cameras.find(|(_, camera)| {
            let share = camera.focal_px[0] / width;
            !(LEAST_FOCAL..=GREATEST_FOCAL).contains(&share)
        })?;
        let focal = camera.focal_px[0];
        let angle = 2.0 * (0.5 * width / focal).atan().to_degrees();
        Some(format!(
            "camera `{name}` has a focal length of {focal} px at {width} px of width, a field of \
             view of {angle:.1} degrees: is it in mm? focal_px is in mm / pixel pitch in mm"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn doubts(change: impl Fn(&mut RigFile)) -> Vec<String> {
        let mut rig = RigFile::paper();
        change(&mut rig);
        rig.doubts()
    }

    fn scaled(by: f64) -> Vec<String> {
        doubts(|rig| {
            for camera in &mut rig.rig.cameras {
                camera.offset_mm = camera.offset_mm.map(|mm| mm * by);
            }
        })
    }

    #[test]
    fn plausible_rig_leaves_no_doubt() {
        assert_eq!(doubts(|_| ()), Vec::<String>::new());
        assert_eq!(scaled(0.15), Vec::<String>::new());
        assert_eq!(scaled(30.0), Vec::<String>::new());
    }

    #[test]
    fn wrong_offset_units_are_named() {
        for (by, unit) in [
            (1e-3, "metres"),
            (0.02, "centimetres"),
            (0.1, "centimetres"),
            (1e3, "micrometres"),
        ] {
            let doubts = scaled(by);
            assert_eq!(doubts.len(), 1, "{unit}: {doubts:?}");
            assert!(doubts[0].contains(&format!("in {unit}?")), "{doubts:?}");
        }
    }

    #[test]
    fn exchanged_cameras_are_named() {
        let doubts = doubts(|rig| {
            rig.names = ["left", "right"].map(String::from).to_vec();
            rig.rig.cameras = [rig.rig.cameras[2], rig.rig.cameras[0]]
                .into_iter()
                .collect();
        });
        assert_eq!(doubts.len(), 1, "{doubts:?}");
        assert!(doubts[0].contains("to the right of `right`"), "{doubts:?}");
    }

    #[test]
    fn exchanged_neighbours_are_named() {
        for (pair, said) in [
            ([0, 1], "`left` is 70.0 mm to the right of `middle`"),
            ([1, 2], "`middle` is 68.0 mm to the right of `right`"),
        ] {
            let [a, b] = pair;
            let doubts = doubts(|rig| rig.rig.cameras.swap(a, b));
            assert_eq!(doubts.len(), 1, "{doubts:?}");
            assert!(doubts[0].contains(said), "{doubts:?}");
        }
    }

    #[test]
    fn focal_length_in_mm_is_named() {
        let doubts = doubts(|rig| rig.rig.cameras[1].focal_px = [8.0, 8.0]);
        assert_eq!(doubts.len(), 1, "{doubts:?}");
        assert!(doubts[0].contains("is it in mm?"), "{doubts:?}");
    }
}
