//! Conditions of the accuracy study as data: scene, disturbance, and required result.

use trinocular_core::rig::Rig;
use trinocular_vision::images::TextureKind;

/// Disturbance between the keyframe and the measured frame set, or during either.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Change {
    /// No disturbance: only the target moves.
    Nothing,
    /// Light multiplied by 0.7 to 1.4 and shifted by up to 20 grey levels, in all cameras alike or
    /// in each camera independently.
    Light {
        /// True if each camera has a light of its own.
        per_camera: bool,
    },
    /// The target moves while the shutter is open (motion blur).
    Smear {
        /// Largest motion during the exposure, px.
        px: f64,
    },
    /// A nearer object covers two fifths of every image.
    Cover {
        /// True if the object is a part of the target and moves with it; otherwise it moves
        /// differently.
        own: bool,
        /// Texture of the object.
        texture: TextureKind,
    },
    /// The target rotates about one of its own axes.
    Turn {
        /// Index of the rotation axis: 0 is x, 1 is y, 2 is z.
        axis: usize,
        /// Smallest and largest angle of the rotation in degrees; the sign is random.
        degrees: [f64; 2],
    },
    /// One camera takes its image later, by a share of the time in which the target moves.
    Late {
        /// Smallest and largest share.
        share: [f64; 2],
    },
    /// One camera fails after the keyframe.
    Fail(Failure),
    /// Another target takes the first one's place.
    Replaced,
}

impl Change {
    /// Returns true if a measurement must name the camera at fault.
    pub const fn is_of_one_camera(self) -> bool {
        matches!(self, Self::Late { .. } | Self::Fail(_))
    }
}

/// Failures of one camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failure {
    /// The camera gives no image.
    Missing,
    /// The camera gives an image of the inside of its lens cap.
    Dark,
    /// The camera repeats the image of the keyframe.
    Frozen,
}

/// Required result of a condition.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// Least and greatest share of trials that give a measurement.
    pub measured: [f64; 2],
    /// Names of the refusals that may occur ([`trinocular_vision::flow::FlowRefusal::name`]).
    pub refusals: &'static [&'static str],
}

/// One row of the table.
#[derive(Clone, Copy, Debug)]
pub struct Condition {
    /// Name on the command line and in the table.
    pub name: &'static str,
    /// Texture of the target.
    pub texture: TextureKind,
    /// Contrast of the texture; 1 is the texture as drawn, 0 an even grey.
    pub contrast: f64,
    /// The cameras.
    pub rig: fn() -> Rig,
    /// Smallest and largest distance of the target, mm.
    pub depth_mm: [f64; 2],
    /// Largest tilt of the poster in degrees, about a random axis in its plane.
    pub tilt_deg: f64,
    /// Smallest and largest lateral motion of the target in px, in a random direction.
    pub move_px: [f64; 2],
    /// Largest motion along z as a share of the depth, in either direction.
    pub away: f64,
    /// Sensor noise in grey levels; every value is tried.
    pub noise_grey: &'static [f64],
    /// Disturbance of the scene.
    pub change: Change,
    /// Required result.
    pub expected: Expected,
}

/// Result in which every trial gives a measurement.
const MEASURED: Expected = Expected {
    measured: [0.98, 1.0],
    refusals: &[],
};

/// Returns the result in which every trial is refused for one of these reasons.
const fn refused(refusals: &'static [&'static str]) -> Expected {
    Expected {
        measured: [0.0, 0.0],
        refusals,
    }
}

/// Returns the result in which at least the share `least` of the trials is measured and the others
/// are refused for one of these reasons.
const fn either(least: f64, refusals: &'static [&'static str]) -> Expected {
    Expected {
        measured: [least, 1.0],
        refusals,
    }
}

/// The paper's bench with rich texture, the base that every condition modifies.
const PLAIN: Condition = Condition {
    name: "plain",
    texture: TextureKind::Natural,
    contrast: 1.0,
    rig: Rig::paper,
    depth_mm: [750.0, 950.0],
    tilt_deg: 0.0,
    move_px: [0.0, 20.0],
    away: 0.01,
    // The largest is above the noise of usual sensors.
    noise_grey: &[0.5, 2.0, 5.0, 10.0],
    change: Change::Nothing,
    expected: MEASURED,
};

const FAINT: &[&str] = &["few corners", "few matches", "few tracks", "lost"];
const REPEATS: &[&str] = &["ambiguous depth", "ambiguous motion", "few matches"];
const TURNED: &[&str] = &["turned"];
const COVERED: &[&str] = &[
    "minority",
    "no agreement",
    "lost",
    "few tracks",
    "ambiguous motion",
    "turned",
];

/// All conditions, in the order of the table.
pub const ALL: &[Condition] = &[
    PLAIN,
    Condition {
        name: "still",
        move_px: [0.0, 0.0],
        away: 0.0,
        ..PLAIN
    },
    Condition {
        name: "notes",
        texture: TextureKind::Notes,
        ..PLAIN
    },
    Condition {
        name: "soft",
        texture: TextureKind::Blobs,
        ..PLAIN
    },
    Condition {
        name: "light",
        contrast: 0.5,
        change: Change::Light { per_camera: false },
        ..PLAIN
    },
    Condition {
        name: "light-per-camera",
        contrast: 0.5,
        change: Change::Light { per_camera: true },
        ..PLAIN
    },
    Condition {
        name: "motion-blur",
        change: Change::Smear { px: 6.0 },
        ..PLAIN
    },
    Condition {
        name: "bricks",
        texture: TextureKind::Bricks,
        expected: either(0.0, REPEATS),
        ..PLAIN
    },
    Condition {
        name: "grid",
        texture: TextureKind::Grid,
        expected: refused(REPEATS),
        ..PLAIN
    },
    Condition {
        name: "low-texture",
        contrast: 0.1,
        noise_grey: &[0.5, 1.0, 2.0],
        expected: either(0.5, FAINT),
        ..PLAIN
    },
    Condition {
        name: "no-texture",
        contrast: 0.0,
        noise_grey: &[0.5, 2.0],
        expected: refused(FAINT),
        ..PLAIN
    },
    Condition {
        name: "occluded",
        change: Change::Cover {
            own: false,
            texture: TextureKind::Natural,
        },
        expected: either(0.5, COVERED),
        ..PLAIN
    },
    Condition {
        name: "outshone",
        texture: TextureKind::Notes,
        change: Change::Cover {
            own: false,
            texture: TextureKind::Natural,
        },
        expected: either(0.0, COVERED),
        ..PLAIN
    },
    Condition {
        name: "relief",
        change: Change::Cover {
            own: true,
            texture: TextureKind::Natural,
        },
        ..PLAIN
    },
    Condition {
        name: "large-moves",
        move_px: [20.0, 60.0],
        away: 0.05,
        expected: either(0.9, &["lost", "few tracks"]),
        ..PLAIN
    },
    Condition {
        name: "unequal-focal",
        rig: unequal_focal,
        ..PLAIN
    },
    Condition {
        name: "tilted",
        tilt_deg: 30.0,
        ..PLAIN
    },
    Condition {
        name: "distorted",
        rig: distorted,
        ..PLAIN
    },
    Condition {
        name: "too-near",
        depth_mm: [180.0, 230.0],
        noise_grey: &[0.5, 2.0],
        expected: refused(&["few matches", "ambiguous depth"]),
        ..PLAIN
    },
    Condition {
        name: "300-mm",
        depth_mm: [300.0, 400.0],
        expected: either(
            0.1,
            &["few matches", "few tracks", "lost", "ambiguous depth"],
        ),
        ..PLAIN
    },
    Condition {
        name: "500-mm",
        depth_mm: [450.0, 600.0],
        ..PLAIN
    },
    Condition {
        name: "2000-mm",
        depth_mm: [1500.0, 2000.0],
        ..PLAIN
    },
    Condition {
        name: "replaced",
        change: Change::Replaced,
        expected: refused(&["lost", "few tracks", "no agreement"]),
        ..PLAIN
    },
    Condition {
        name: "turned-slightly",
        change: Change::Turn {
            axis: 1,
            degrees: [0.01, 0.1],
        },
        expected: either(0.0, TURNED),
        ..PLAIN
    },
    Condition {
        name: "pitched",
        change: Change::Turn {
            axis: 0,
            degrees: [0.2, 1.0],
        },
        expected: refused(TURNED),
        ..PLAIN
    },
    Condition {
        name: "yawed",
        change: Change::Turn {
            axis: 1,
            degrees: [0.2, 1.0],
        },
        expected: refused(TURNED),
        ..PLAIN
    },
    Condition {
        name: "rolled",
        change: Change::Turn {
            axis: 2,
            degrees: [0.2, 1.0],
        },
        expected: refused(TURNED),
        ..PLAIN
    },
    Condition {
        name: "camera-late",
        move_px: [5.0, 20.0],
        change: Change::Late { share: [0.03, 0.1] },
        ..PLAIN
    },
    Condition {
        name: "camera-missing",
        change: Change::Fail(Failure::Missing),
        ..PLAIN
    },
    Condition {
        name: "camera-dark",
        change: Change::Fail(Failure::Dark),
        ..PLAIN
    },
    Condition {
        name: "camera-frozen",
        change: Change::Fail(Failure::Frozen),
        ..PLAIN
    },
];

/// Returns the paper's rig with unequal focal lengths.
fn unequal_focal() -> Rig {
    let mut rig = Rig::paper();
    for (camera, focal_px) in rig.cameras.iter_mut().zip([470.0, 540.0, 610.0]) {
        camera.focal_px = [focal_px, 0.99 * focal_px];
    }
    rig
}

/// Returns the paper's rig with wide lenses, whose distortion is 12 px in the corners.
fn distorted() -> Rig {
    let mut rig = Rig::paper();
    for (camera, k1) in rig.cameras.iter_mut().zip([-0.30, -0.25, -0.28]) {
        camera.distortion = [k1, 0.08, 0.0008, -0.0006, 0.0];
    }
    rig
}
