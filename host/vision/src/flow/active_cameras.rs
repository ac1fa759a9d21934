//! Active cameras: those cameras of a rig that take part in a measurement.

use crate::matching::geometry::RigGeometry;
use trinocular_core::rig::Rig;

/// Cameras that take part, in the rig's order.
#[derive(Clone, Debug)]
pub struct ActiveCameras {
    /// Indices into the rig's cameras.
    pub cameras: Vec<usize>,
    /// Geometry of these cameras alone.
    pub geometry: RigGeometry,
}

impl ActiveCameras {
    /// Selects the cameras of `rig` for which `is_active` returns true. Returns `None` unless two
    /// of them are in different places.
    pub fn of(rig: &Rig, is_active: impl Fn(usize) -> bool) -> Option<Self> {
        let cameras: Vec<usize> = (0..rig.cameras.len()).filter(|k| is_active(*k)).collect();
        let geometry = RigGeometry::new(&subset(rig, &cameras))?;
        Some(Self { cameras, geometry })
    }

    /// Returns the index in the rig of the reference camera.
    pub fn reference_camera(&self) -> Option<usize> {
        self.cameras.get(self.geometry.reference).copied()
    }

    /// Selects the active cameras' elements of `all`, which has one per camera of the rig.
    pub fn select<'a, T>(&self, all: &'a [T]) -> Vec<&'a T> {
        self.cameras.iter().filter_map(|k| all.get(*k)).collect()
    }
}

/// Returns the rig of some cameras of `rig`, given by their indices.
pub fn subset(rig: &Rig, cameras: &[usize]) -> Rig {
    Rig {
        image_size_px: rig.image_size_px,
        cameras: (cameras.iter())
            .filter_map(|k| rig.cameras.get(*k).copied())
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn active_cameras_need_a_baseline() {
        let rig = Rig::paper();
        let active = ActiveCameras::of(&rig, |k| k != 1).unwrap();
        assert_eq!(active.cameras, [0, 2]);
        assert_eq!(
            active.select(&["left", "middle", "right"]),
            [&"left", &"right"]
        );
        assert!(ActiveCameras::of(&rig, |k| k == 1).is_none());
    }
}
