//! `--report`: the page of a run of `track`.

use crate::commands::failure::Failure;
use crate::commands::record::{Opened, Origin};
use clap::Args;
use std::cell::RefCell;
use std::path::PathBuf;
use std::sync::Arc;
use trinocular::run_report::page::page;
use trinocular::run_report::{HandEye, Provenance, StoryTaker};
use trinocular::servo::observer::ServoObserver;
use trinocular::servo::recording::{FrameSetTaker, observers_of};
use trinocular_core::rig::Rig;
use trinocular_rig::notice;
use trinocular_rig::output::{Output, OwnFile, Replace};

/// Page of the run.
#[derive(Debug, Args)]
pub struct TrackReport {
    /// Write an HTML page of the run at its end: plots, events, pictures and data
    ///
    /// It replaces an earlier report of this program, but no other file without --force.
    /// `trinocular report` writes such a page from a recording, with more events.
    #[arg(long, value_name = "FILE.html", help_heading = "Recording")]
    report: Option<PathBuf>,

    #[arg(skip)]
    run: RefCell<Option<Box<Run>>>,
}

/// Report under way.
#[derive(Debug)]
struct Run {
    output: Output,
    story: Arc<StoryTaker>,
    provenance: Provenance,
}

impl TrackReport {
    /// Returns true if a page was requested.
    pub fn is_given(&self) -> bool {
        self.report.is_some()
    }

    /// Opens the file, before anything moves. It must not be that of `recording`.
    pub fn begin(&self, origin: &Origin, recording: &Opened, force: bool) -> Result<(), Failure> {
        let Some(path) = &self.report else {
            return Ok(());
        };
        let output = Output::open(path, Replace::Own(OwnFile::Report).or_forced(force))?;
        if recording.is_same_file(&output) {
            let reason = "--report and --record must be different files";
            return Err(Failure::Usage(reason.to_owned()));
        }
        self.run.replace(Some(Box::new(Run {
            output,
            story: StoryTaker::new(&origin.rig.names, HandEye::default()),
            provenance: origin.provenance(),
        })));
        Ok(())
    }

    /// Returns the observers of the loop: one if a page was requested.
    pub fn observers(&self, rig: &Rig, hand_eye: HandEye) -> Vec<Box<dyn ServoObserver>> {
        let run = self.run.borrow();
        let story = run.as_ref().map(|run| Arc::clone(&run.story));
        if let Some(story) = &story {
            story.with(|story| story.hand_eye = hand_eye);
        }
        observers_of(story.map(|story| story as Arc<dyn FrameSetTaker>), rig)
    }

    /// Writes the page of what there is, also after a failure: the run's own failure comes first.
    pub fn close<T>(&self, run: Result<T, Failure>) -> Result<T, Failure> {
        let Some(report) = self.run.take() else {
            return run;
        };
        let Run {
            output,
            story,
            provenance,
        } = *report;
        let story = story.with(std::mem::take);
        if story.turns.is_empty() {
            notice!("no page is written, because no frame set came");
            return run;
        }
        let note = match &run {
            // Refused frame sets end no run.
            Ok(_) | Err(Failure::Refused { .. }) => String::new(),
            Err(failure) => format!("The run ended early: {}.", failure.chain()),
        };
        let (page, _) = page("Trinocular: track", &story, &note, &provenance);
        let written = page.write(output);
        let value = run?;
        written?;
        Ok(value)
    }
}
