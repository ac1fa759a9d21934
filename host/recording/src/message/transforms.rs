//! Frames of target and stage, as viewers and nodes of ROS 2 have them.

use super::{CAMERAS, Measurement, Outcome, STAGE, header, quaternion};
use crate::cdr::Writer;

/// Frame of the target: at the keyframe that of the cameras.
const TARGET: &str = "target";

/// Frame of what the stage carries.
const CARRIAGE: &str = "carriage";

/// Encodes `tf2_msgs/msg/TFMessage`: `cameras` to `target` by the displacement and rotation, if they
/// were measured, and `stage` to `carriage` by the position of the stage, in m. Returns false, with
/// nothing to send, for a keyframe, at which neither is known.
pub fn transforms(bytes: &mut Vec<u8>, measurement: &Measurement) -> bool {
    let Measurement {
        stamp_us, stage_mm, ..
    } = *measurement;
    if measurement.outcome == Outcome::Keyframe {
        return false;
    }
    let turn = measurement.turn.unwrap_or_default();
    let target = Transform {
        frames: [CAMERAS, TARGET],
        translation_mm: measurement.displacement_mm,
        rotation_deg: turn.rotation_deg,
    };
    let stage = Transform {
        frames: [STAGE, CARRIAGE],
        translation_mm: stage_mm,
        rotation_deg: [0.0; 3],
    };
    let mut writer = Writer::new(bytes);
    let is_measured = !measurement.cameras.is_empty();
    let transforms = [is_measured.then_some(target), Some(stage)];
    writer.length(transforms.iter().flatten().count());
    for transform in transforms.iter().flatten() {
        transform.encode(&mut writer, stamp_us);
    }
    true
}

/// One `geometry_msgs/msg/TransformStamped`.
struct Transform {
    frames: [&'static str; 2],
    translation_mm: [f64; 3],
    rotation_deg: [f64; 3],
}

impl Transform {
    fn encode(&self, writer: &mut Writer<'_>, stamp_us: u64) {
        let [parent, child] = self.frames;
        header(writer, stamp_us, parent);
        writer.text(child);
        writer.f64_array(&self.translation_mm.map(|mm| mm * 1e-3));
        writer.f64_array(&quaternion(self.rotation_deg));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cdr::Reader;
    use crate::message::read_header;

    #[test]
    fn unmeasured_frame_set_has_stage_only() {
        let mut message = Measurement {
            outcome: Outcome::Refused,
            stamp_us: 1_500_000,
            stage_mm: [1.0, 2.0, 3.0],
            ..Measurement::default()
        };
        let mut bytes = Vec::new();
        assert!(transforms(&mut bytes, &message));
        let mut reader = Reader::new(&bytes).unwrap();
        assert_eq!(reader.u32(), Ok(1));
        assert_eq!(read_header(&mut reader), Ok(1_500_000_000));
        assert_eq!(reader.text(), Ok("carriage"));
        assert_eq!(reader.array(), Ok([0.001, 0.002, 0.003]));
        assert_eq!(reader.array(), Ok([0.0, 0.0, 0.0, 1.0]));
        assert!(reader.is_at_end());
        message.cameras = vec![0, 1, 2];
        assert!(transforms(&mut bytes, &message));
        assert_eq!(Reader::new(&bytes).unwrap().u32(), Ok(2));
        message.outcome = Outcome::Keyframe;
        assert!(!transforms(&mut bytes, &message));
    }
}
