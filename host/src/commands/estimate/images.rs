//! Displacements from images.

use super::measurer::Measurer;
use super::printer::Printer;
use super::{EstimateOptions, Reference};
use crate::commands::exposures::Exposures;
use crate::commands::failure::Failure;
use crate::commands::reference_view::ReferenceView;
use std::io::Write;
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::estimation::Rule;
use trinocular_vision::flow::camera_shift::CameraShift;
use trinocular_vision::flow::remarks as camera_remarks;
use trinocular_vision::images::FrameSet;

/// Estimates a displacement for each frame set but the one from which it counts.
pub(super) fn run<W: Write>(
    options: &EstimateOptions,
    (rig, view): (&RigFile, Option<ReferenceView>),
    rule: Rule,
    captures: impl Iterator<Item = Result<FrameSet, InputError>>,
    mut printer: Printer<'_, W>,
) -> Result<(), Failure> {
    let rig_path = options.rig.as_ref().unwrap_or(&options.input);
    let mut regions = options.region.regions(rig)?;
    let mut captures = captures.peekable();
    let has_view = view.is_some();
    let first = match view {
        Some(view) => {
            regions = view.regions_or(regions);
            view.check(rig, rig_path, &regions)?;
            Some(Ok(view.frame_set))
        }
        None => captures.next(),
    };
    // The reason why it cannot be read is also why there is no second one.
    if let Some(Err(error)) = &first {
        return Err(error.clone().into());
    }
    let (Some(first), Some(_)) = (first.as_ref(), captures.peek()) else {
        let reason = match (&options.reference, &first) {
            (Reference::View(_), _) => "no frame set",
            (_, None) => "no frame set; a displacement takes at least two",
            (_, Some(_)) => "one frame set; a displacement takes at least two",
        };
        return Err(InputError::file(&options.input, reason).into());
    };
    let first = first.as_ref().map_err(InputError::clone)?;
    let mut measurer = Measurer::new((rig, rig_path), rule, regions)?;
    let labels = measurer.labels();
    printer.targets = labels.len();
    let mut exposures = Exposures::new(&rig.names);
    // A badly exposed keyframe spoils every row; the first one names it.
    let mut of_keyframe = exposures.note(first);
    measurer.refer_to(first);
    for capture in captures {
        let capture = match capture {
            Ok(capture) => capture,
            Err(error) => {
                for label in &labels {
                    printer.label = label.clone();
                    printer.refusal(error.to_string())?;
                }
                if options.reference == Reference::Previous {
                    measurer.refer_to_nothing();
                }
                continue;
            }
        };
        printer.exposure = std::mem::take(&mut of_keyframe);
        printer.exposure.extend(exposures.note(&capture));
        for (label, seen) in labels.iter().zip(measurer.measure(&capture)) {
            printer.label = label.clone();
            match seen {
                Ok(seen) => {
                    let remarks = camera_remarks(&seen.refused_cameras, &rig.names);
                    printer.warnings.extend(remarks);
                    if has_view {
                        let (cameras, points) = (&seen.cameras, &seen.correspondences);
                        let shift = CameraShift::find(&rig.rig, cameras, points);
                        let warning = shift.map(|shift| shift.warning(&rig.names));
                        printer.warnings.extend(warning);
                    }
                    let absent = seen.refused_cameras.iter();
                    let names = absent.filter_map(|(k, _)| rig.names.get(*k).cloned());
                    printer.absent = names.collect();
                    let count = seen.correspondences.len();
                    printer.solution(seen.solution, count, seen.rejected)?;
                }
                Err(reason) => printer.refusal(reason)?,
            }
        }
        if options.reference == Reference::Previous {
            measurer.refer_to(&capture);
        }
    }
    printer.finish()
}
