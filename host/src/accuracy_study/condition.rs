//! What is photographed, what is wrong with it, and what must come out.

use crate::images::TextureKind;
use shared::rig::Rig;

/// What goes wrong between the reference instant and now, or during either.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Change {
    /// Nothing: the target moves, and that is all.
    Nothing,
    /// Light multiplied with 0.7 to 1.4 and shifted by up to 20 grey levels; for each camera its
    /// own if so said.
    Light {
        /// Whether each camera has its own.
        per_camera: bool,
    },
    /// The target moves by so many px while the shutter is open.
    Smear {
        /// At most.
        px: f64,
    },
    /// Something nearer covers two fifths of every view.
    Cover {
        /// Whether it is a part of the target and moves with it, or moves differently.
        own: bool,
        /// What it looks like.
        texture: TextureKind,
    },
    /// The target turns, about an axis of its own.
    Turn {
        /// Which: x, y, z.
        axis: usize,
        /// Between so many degrees, either way.
        degrees: [f64; 2],
    },
    /// One camera takes its picture later, by a share of the time in which the target moves.
    Late {
        /// Between these shares.
        share: [f64; 2],
    },
    /// One camera fails after the reference instant.
    Fail(Failure),
    /// Another target takes the first one's place.
    Replaced,
}

impl Change {
    /// Whether a measurement must name the camera at fault.
    pub const fn is_of_one_camera(self) -> bool {
        matches!(self, Self::Late { .. } | Self::Fail(_))
    }
}

/// How a camera fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failure {
    /// No picture comes.
    Missing,
    /// A picture of the inside of a lens cap comes.
    Dark,
    /// The picture of the reference instant comes again.
    Frozen,
}

/// What must come out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// Share of trials that are measured, at least and at most.
    pub measured: [f64; 2],
    /// Names of the refusals that may occur ([`crate::flow::FlowRefusal::name`]).
    pub refusals: &'static [&'static str],
}

/// One row of the table.
#[derive(Clone, Copy, Debug)]
pub struct Condition {
    /// On the command line and in the table.
    pub name: &'static str,
    /// What is photographed.
    pub texture: TextureKind,
    /// Its contrast, 1 as drawn: the rest is grey.
    pub contrast: f64,
    /// The cameras.
    pub rig: fn() -> Rig,
    /// Between these distances, mm.
    pub depth_mm: [f64; 2],
    /// Tilt of the poster, degrees, about a random axis in its plane, at most.
    pub tilt_deg: f64,
    /// Lateral motion of the target, px, between these, in a random direction.
    pub move_px: [f64; 2],
    /// Motion along z as a share of the depth, at most, either way.
    pub away: f64,
    /// Sensor noise, grey levels; each is tried.
    pub noise_grey: &'static [f64],
    /// What goes wrong.
    pub change: Change,
    /// What must come out.
    pub expected: Expected,
}

/// Everything is measured.
const MEASURED: Expected = Expected {
    measured: [0.98, 1.0],
    refusals: &[],
};

/// Nothing is measured, for one of these reasons.
const fn refused(refusals: &'static [&'static str]) -> Expected {
    Expected {
        measured: [0.0, 0.0],
        refusals,
    }
}

/// Some are measured, the others refused for one of these reasons.
const fn either(least: f64, refusals: &'static [&'static str]) -> Expected {
    Expected {
        measured: [least, 1.0],
        refusals,
    }
}

/// The paper's bench with rich texture: what every condition changes something about.
const PLAIN: Condition = Condition {
    name: "plain",
    texture: TextureKind::Natural,
    contrast: 1.0,
    rig: Rig::paper,
    depth_mm: [750.0, 950.0],
    tilt_deg: 0.0,
    move_px: [0.0, 20.0],
    away: 0.01,
    // Up to more than usual sensors have.
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

/// The whole table.
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

/// The paper's cameras with other lenses.
fn unequal_focal() -> Rig {
    let mut rig = Rig::paper();
    for (camera, focal_px) in rig.cameras.iter_mut().zip([470.0, 540.0, 610.0]) {
        camera.focal_px = [focal_px, 0.99 * focal_px];
    }
    rig
}

/// The paper's cameras with wide lenses: 12 px off in the corners.
fn distorted() -> Rig {
    let mut rig = Rig::paper();
    for (camera, k1) in rig.cameras.iter_mut().zip([-0.30, -0.25, -0.28]) {
        camera.distortion = [k1, 0.08, 0.0008, -0.0006, 0.0];
    }
    rig
}
