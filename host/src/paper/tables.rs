//! All tables of the paper, as printed by `trinocular tables`.

use super::tracking::{self, Run, Stop};
use super::validation::Validation;
use super::validation::recovery;
use super::{moves, present};
use crate::report::{Page, Table};
use crate::servo::ServoError;
use crate::servo::station_link::StationPlace;
use serde_json::{Value, json};
use trinocular_client::stage::default_stage;
use trinocular_core::estimate::Refusal;
use trinocular_vision::images::{SceneSettings, TextureKind};
use trinocular_vision::sums::Estimator;

/// Reason for tables that cannot be computed.
#[derive(Debug, thiserror::Error)]
pub enum TablesError {
    /// An estimator refused a set of points.
    #[error(transparent)]
    Estimate(#[from] Refusal),
    /// A scene cannot be rendered, or a station refused.
    #[error(transparent)]
    Servo(#[from] ServoError),
}

/// The paper's Tables 1, 2, 5 and 6, and the comparison of the estimators with the Cramér-Rao
/// bound.
#[derive(Clone, Debug)]
pub struct PaperTables {
    settings: tracking::Settings,
    validation: Validation,
    moves: Vec<moves::Row>,
    midpoint: Run,
    closed_form: Run,
}

impl PaperTables {
    /// Computes all tables. Calls `progress` with the share of the tracking that is done, 0 to 1.
    ///
    /// # Errors
    /// If the scene cannot be rendered, or a twin or an estimator refuses.
    pub fn run(
        texture: TextureKind,
        seed: u64,
        scene: SceneSettings,
        mut progress: impl FnMut(f64),
    ) -> Result<Self, TablesError> {
        let validation = Validation::run()?;
        let moves = moves::run(texture, seed, scene)?;
        let settings = tracking::Settings {
            texture,
            seed,
            scene,
            ..tracking::Settings::default()
        };
        // Least squares does not run on the station; it equals the closed form to a nanometre in
        // every table.
        let stage = default_stage();
        let midpoint = tracking::run(&settings, &stage, StationPlace::Twin, |share| {
            progress(0.5 * share);
        })?;
        let with_closed_form = tracking::Settings {
            estimator: Estimator::ClosedForm,
            ..settings
        };
        let closed_form = tracking::run(&with_closed_form, &stage, StationPlace::Twin, |share| {
            progress(0.5 + 0.5 * share);
        })?;
        Ok(Self {
            settings,
            validation,
            moves,
            midpoint,
            closed_form,
        })
    }

    /// Returns Tables 1 and 2 and the comparison with the bound.
    pub fn simulated(&self) -> [Table; 3] {
        self.validation.tables()
    }

    /// Returns Table 5.
    pub fn single_moves(&self) -> Table {
        present::moves(&self.moves)
    }

    /// Returns the refused moves of Table 5, mm, each with the reason.
    pub fn refused_moves(&self) -> impl Iterator<Item = ([f64; 3], &str)> {
        let rows = self.moves.iter();
        rows.filter_map(|row| Some((row.true_mm, row.refused.as_deref()?)))
    }

    /// Returns Table 6 with the midpoint, and with the closed form.
    pub fn stops(&self) -> [Table; 2] {
        [
            present::stops("midpoint", &self.midpoint.stops),
            present::stops("closed form", &self.closed_form.stops),
        ]
    }

    /// Returns the tables and figures as a page.
    pub fn page(&self) -> Page {
        let subtitle =
            "every table and figure of the paper that has numbers, ours beside the printed ones";
        let page = Page::new("Trinocular: the paper's tables", subtitle);
        let page = self.validation.add_to(page).section(
            "Single moves (section 4.2)",
            "Rendered images, the whole vision path.",
        );
        let [midpoint, closed_form] = self.stops();
        page.table(self.single_moves())
            .section("Tracking (section 4.3)", "In closed loop on the twin.")
            .table(midpoint)
            .table(closed_form)
            .facts(&present::facts(&self.settings, &self.midpoint))
            .plots([
                present::path(&self.midpoint, Some(&self.closed_form)).into(),
                present::laser(&self.midpoint).into(),
            ])
    }

    /// Returns the tables as one JSON object, in mm.
    pub fn to_json(&self) -> Value {
        let of = |table: u8| -> Vec<Value> {
            let rows = self.validation.recovery.rows.iter();
            rows.filter(|row| row.printed.table == table)
                .map(recovered)
                .collect()
        };
        let (settings, scene) = (&self.settings, &self.settings.scene);
        let pulses = &self.midpoint.pulses;
        json!({
            "table1": of(1),
            "table2": of(2),
            "table5": self.moves,
            "table6": stops(&self.midpoint.stops, &self.closed_form.stops),
            "cramer_rao": self.validation.noise,
            "settings": {
                "table1_sets": self.validation.recovery.sets,
                "texture": settings.texture.name(),
                "seed": settings.seed,
                "depth_mm": scene.depth_mm,
                "tilt_rad": scene.tilt_rad,
                "blur_px": scene.blur_px,
                "noise_grey": scene.noise_grey,
                "frames_per_s": settings.timing.frames_per_s,
                "latency_ms": settings.timing.latency_us as f64 * 1e-3,
                "pulses_commanded": pulses.map(|pulses| pulses.commanded),
                "pulses_counted": pulses.map(|pulses| pulses.counted),
            },
        })
    }
}

/// Returns Table 6 as JSON: positions of B with the midpoint, and with the closed form.
fn stops(midpoint: &[Stop], closed_form: &[Stop]) -> Vec<Value> {
    let rows = midpoint.iter().zip(closed_form);
    rows.map(|(stop, other)| {
        json!({
            "true": stop.true_mm,
            "paper": stop.paper_mm,
            "tracked": stop.tracked_mm,
            "tracked_closed_form": other.tracked_mm,
        })
    })
    .collect()
}

/// Returns a row of Tables 1 and 2 as JSON: means over the point sets, and the closed form's
/// spread.
fn recovered(row: &recovery::Row) -> Value {
    let [closed_form, least_squares, midpoint] = &row.recovered;
    json!({
        "true": row.printed.true_mm,
        "paper": row.printed.paper_mm,
        "closed_form": closed_form.mean_mm,
        "least_squares": least_squares.mean_mm,
        "midpoint": midpoint.mean_mm,
        "closed_form_deviation": closed_form.deviation_mm,
        "midpoint_worst_error": midpoint.worst_error_mm,
    })
}
