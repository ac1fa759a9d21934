//! JSON of a calibration: one object per camera, then one of the rig.

use super::folder::{Calibration, CameraResult};
use super::intrinsics::Verdict;
use super::rejection::InstantRejection;
use super::rig::RigSolution;
use serde_json::{Value, json};

/// Returns the objects that `calibrate --json` prints. `warnings` are those of the rig.
pub fn objects(result: &Calibration, warnings: &[String]) -> Vec<Value> {
    let mut objects: Vec<Value> = result.cameras.iter().map(camera_json).collect();
    let rig = result.rig.as_ref();
    objects.extend(rig.map(|rig| rig_json(result, rig, warnings)));
    objects
}

fn camera_json(camera: &CameraResult) -> Value {
    let intrinsics = &camera.intrinsics;
    let (value, sigma) = (intrinsics.lens.0, intrinsics.sigma());
    let image = |(file, verdict): (&String, &Verdict)| match verdict {
        Verdict::Used { rms_px } => json!({ "file": file, "rms_px": rms_px }),
        Verdict::Rejected(reason) => json!({ "file": file, "rejected": reason.to_string() }),
    };
    let images: Vec<Value> = camera
        .files
        .iter()
        .zip(&intrinsics.verdicts)
        .map(image)
        .collect();
    json!({
        "camera": camera.name,
        "image_size_px": camera.image_size_px,
        "focal_px": value[..2],
        "focal_sigma_px": sigma[..2],
        "principal_px": value[2..4],
        "principal_sigma_px": sigma[2..4],
        "distortion": value[4..],
        "distortion_sigma": sigma[4..],
        "rms_px": intrinsics.rms_px,
        "images": images,
    })
}

fn rig_json(result: &Calibration, rig: &RigSolution, warnings: &[String]) -> Value {
    let cameras: Vec<Value> = result
        .cameras
        .iter()
        .zip(rig.stands.iter().zip(&rig.sigma))
        .enumerate()
        .map(|(k, (camera, (stand, sigma)))| {
            let (length, length_sigma) = rig.baseline_mm(k);
            json!({
                "name": camera.name,
                "baseline_mm": length,
                "baseline_sigma_mm": length_sigma,
                "offset_mm": stand.offset_mm,
                "offset_sigma_mm": sigma.offset_mm,
                "rotation_deg": stand.rotation_deg,
                "rotation_sigma_deg": sigma.rotation_deg,
            })
        })
        .collect();
    let instant = |(name, verdict): (&String, &Result<f64, InstantRejection>)| match verdict {
        Ok(rms_px) => json!({ "name": name, "rms_px": rms_px }),
        Err(reason) => json!({ "name": name, "left_out": reason.to_string() }),
    };
    let instants: Vec<Value> = result
        .instants
        .iter()
        .zip(&rig.instants)
        .map(instant)
        .collect();
    json!({
        "rig": {
            "origin": result.cameras[rig.reference].name,
            "cameras": cameras,
            "axes_sigma_deg": rig.axes_sigma_deg,
            "rms_px": rig.rms_px,
            "instants": instants,
            "warnings": warnings,
        }
    })
}
