//! Warnings of badly exposed images, for the rows of `estimate` and `track`.

use std::collections::HashSet;
use std::mem::{Discriminant, discriminant};

use trinocular_rig::notice;
use trinocular_vision::images::FrameSet;
use trinocular_vision::images::exposure::{ExposureFault, faults};

/// Names of the cameras, and the warnings printed so far.
pub struct Exposures {
    names: Vec<String>,
    said: HashSet<(usize, Discriminant<ExposureFault>)>,
}

impl Exposures {
    /// Starts without any warning printed.
    pub fn new(names: &[String]) -> Self {
        Self {
            names: names.to_vec(),
            said: HashSet::new(),
        }
    }

    /// Returns a sentence for each badly exposed image of the frame set. Prints a warning for each
    /// camera and kind of fault once: exposures rarely mend themselves.
    pub fn note(&mut self, frame_set: &FrameSet) -> Vec<String> {
        let mut sentences = Vec::new();
        for (camera, fault) in faults(frame_set) {
            let sentence = fault.sentence(&self.names, camera);
            if self.said.insert((camera, discriminant(&fault))) {
                notice!("warning: {sentence}");
            }
            sentences.push(sentence);
        }
        sentences
    }
}
