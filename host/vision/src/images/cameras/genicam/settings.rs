//! Settings of a GenICam camera: the size of its images, and those of the rig file.

use std::path::Path;

use aravis::prelude::*;
use aravis::{AcquisitionMode, Auto, Camera, glib};

use super::refusal::{self, Refusal, setting};
use crate::images::cameras::mono::Mono;
use trinocular_rig::rig_file::Capture;
use trinocular_rig::rig_file::capture::PIXEL_FORMATS;

/// Names of the switch of PTP in GenICam's Standard Features Naming Convention, newest first.
const PTP: [&str; 2] = ["PtpEnable", "GevIEEE1588"];

/// Largest rate of data on the camera's line, bytes/s.
const LINK_LIMIT: &str = "DeviceLinkThroughputLimit";

/// Size of a packet on the network, bytes.
const PACKET_SIZE: &str = "GevSCPSPacketSize";

/// Sets the camera up; returns its pixel format.
pub fn apply(
    name: &Path,
    camera: &Camera,
    size_px: [u32; 2],
    frames_per_s: f64,
    capture: &Capture,
) -> Result<Mono, Refusal> {
    let cannot = |action: &str, cause: &glib::Error| refusal::cannot(name, action, cause);
    camera
        .set_acquisition_mode(AcquisitionMode::Continuous)
        .map_err(|cause| cannot("run without an end", &cause))?;
    let format = pixel_format(name, camera, capture)?;
    camera
        .set_pixel_format_from_string(format.name())
        .map_err(|cause| cannot("set its pixel format", &cause))?;
    region(name, camera, size_px)?;
    exposure_and_gain(camera, capture)?;
    trigger(camera, frames_per_s, capture)?;
    link(camera, capture)?;
    Ok(format)
}

fn pixel_format(name: &Path, camera: &Camera, capture: &Capture) -> Result<Mono, Refusal> {
    let offered = camera.dup_available_pixel_formats_as_strings();
    let offered = offered.map_err(|cause| refusal::cannot(name, "list its formats", &cause))?;
    let offered: Vec<String> = offered.iter().map(ToString::to_string).collect();
    let is_offered = |format: &Mono| offered.iter().any(|name| name == format.name());
    match &capture.pixel_format {
        Some(wanted) => Mono::named(wanted).filter(is_offered).ok_or_else(|| {
            let offered = offered.join(", ");
            setting(
                "pixel_format",
                format!("the camera has no {wanted}; it has {offered}"),
            )
        }),
        None => Mono::ALL
            .into_iter()
            .find(is_offered)
            .ok_or_else(|| refusal::no_format(name, &offered, &PIXEL_FORMATS).into()),
    }
}

/// Sets the size of the images. The part of the sensor stays where the camera has it.
fn region(name: &Path, camera: &Camera, size_px: [u32; 2]) -> Result<(), Refusal> {
    let cannot = |cause: glib::Error| refusal::cannot(name, "set the size of its images", &cause);
    let wanted = size_px.map(|side| i32::try_from(side).unwrap_or(i32::MAX));
    let (_, _, width, height) = camera.region().map_err(cannot)?;
    if [width, height] == wanted {
        return Ok(());
    }
    let [width, height] = wanted;
    let bounds = [camera.width_bounds(), camera.height_bounds()];
    let set = camera.set_region(-1, -1, width, height);
    let (_, _, width, height) = camera.region().map_err(cannot)?;
    match (set, bounds) {
        (Ok(()), _) if [width, height] == wanted => Ok(()),
        (_, [Ok((_, width)), Ok((_, height))]) => {
            Err(refusal::no_size(name, size_px, [width, height]).into())
        }
        (Err(cause), _) => Err(cannot(cause).into()),
        (Ok(()), _) => Err(refusal::no_size(name, size_px, [width, height]).into()),
    }
}

/// Sets a number after comparing it with the camera's range: Aravis itself sends any number.
fn number(
    field: &'static str,
    value: f64,
    unit: &str,
    bounds: Result<(f64, f64), glib::Error>,
    set: impl FnOnce() -> Result<(), glib::Error>,
) -> Result<(), Refusal> {
    let (low, high) = bounds.map_err(|cause| absent(field, &cause))?;
    if !(low..=high).contains(&value) {
        let reason = format!("{value} is out of the camera's range ({low} to {high}{unit})");
        return Err(setting(field, reason));
    }
    set().map_err(|cause| refused(field, &cause))
}

fn absent(field: &'static str, cause: &glib::Error) -> Refusal {
    setting(
        field,
        format!("the camera has no such setting: {}", cause.message()),
    )
}

fn refused(field: &'static str, cause: &glib::Error) -> Refusal {
    setting(field, format!("the camera refuses it: {}", cause.message()))
}

fn exposure_and_gain(camera: &Camera, capture: &Capture) -> Result<(), Refusal> {
    if let Some(exposure_us) = capture.exposure_us {
        if camera.is_exposure_auto_available() == Ok(true) {
            let off = camera.set_exposure_time_auto(Auto::Off);
            off.map_err(|cause| refused("exposure_us", &cause))?;
        }
        let bounds = camera.exposure_time_bounds();
        let set = || camera.set_exposure_time(exposure_us);
        number("exposure_us", exposure_us, " us", bounds, set)?;
    }
    if let Some(gain) = capture.gain {
        if camera.is_gain_auto_available() == Ok(true) {
            let off = camera.set_gain_auto(Auto::Off);
            off.map_err(|cause| refused("gain", &cause))?;
        }
        let set = || camera.set_gain(gain);
        number("gain", gain, "", camera.gain_bounds(), set)?;
    }
    Ok(())
}

/// Sets a feature to one of its words.
fn word(camera: &Camera, field: &'static str, feature: &str, value: &str) -> Result<(), Refusal> {
    let offered = camera.dup_available_enumerations_as_strings(feature);
    let offered = offered.map_err(|cause| absent(field, &cause))?;
    if !offered.iter().any(|word| word == value) {
        let offered: Vec<&str> = offered.iter().map(|word| word.as_str()).collect();
        let reason = format!("the camera has no `{value}`; it has {}", offered.join(", "));
        return Err(setting(field, reason));
    }
    let set = camera.set_string(feature, value);
    set.map_err(|cause| refused(field, &cause))
}

fn trigger(camera: &Camera, frames_per_s: f64, capture: &Capture) -> Result<(), Refusal> {
    if capture.trigger != Some(true) {
        // A camera without triggers has none to switch off, and one without this rate is used at its
        // own rate, because the images carry their times.
        let _ = camera.clear_triggers();
        let _ = camera.set_frame_rate(frames_per_s);
        return Ok(());
    }
    if camera.is_feature_available("TriggerSelector") == Ok(true) {
        word(camera, "trigger_mode", "TriggerSelector", "FrameStart")?;
    }
    if let Some(source) = &capture.trigger_source {
        word(camera, "trigger_source", "TriggerSource", source)?;
    }
    if let Some(activation) = &capture.trigger_activation {
        word(
            camera,
            "trigger_activation",
            "TriggerActivation",
            activation,
        )?;
    }
    word(camera, "trigger_mode", "TriggerMode", "On")
}

fn link(camera: &Camera, capture: &Capture) -> Result<(), Refusal> {
    let fields = [
        ("packet_size_bytes", capture.packet_size_bytes.is_some()),
        ("packet_delay_us", capture.packet_delay_us.is_some()),
        ("packet_resend", capture.packet_resend.is_some()),
    ];
    if let Some((field, _)) = fields.into_iter().find(|(_, is_set)| *is_set)
        && !camera.is_gv_device()
    {
        return Err(setting(field, "only GigE Vision cameras send packets"));
    }
    if let Some(bytes) = capture.packet_size_bytes {
        let bounds = camera.integer_bounds(PACKET_SIZE);
        let bounds = bounds.map(|(low, high)| (low as f64, high as f64));
        let set = || camera.gv_set_packet_size(bytes.cast_signed());
        number("packet_size_bytes", f64::from(bytes), " bytes", bounds, set)?;
    }
    if let Some(delay_us) = capture.packet_delay_us {
        let set = camera.gv_set_packet_delay((delay_us * 1e3).round() as i64);
        set.map_err(|cause| refused("packet_delay_us", &cause))?;
    }
    if let Some(limit_mb_s) = capture.bandwidth_mb_s {
        if camera.is_feature_available("DeviceLinkThroughputLimitMode") == Ok(true) {
            word(
                camera,
                "bandwidth_mb_s",
                "DeviceLinkThroughputLimitMode",
                "On",
            )?;
        }
        let bounds = camera.integer_bounds(LINK_LIMIT);
        let bounds = bounds.map(|(low, high)| (low as f64 * 1e-6, high as f64 * 1e-6));
        let set = || camera.set_integer(LINK_LIMIT, (limit_mb_s * 1e6).round() as i64);
        number("bandwidth_mb_s", limit_mb_s, " MB/s", bounds, set)?;
    }
    if let Some(ptp) = capture.ptp {
        let mut known = PTP.into_iter();
        match known.find(|feature| camera.is_feature_available(feature) == Ok(true)) {
            Some(feature) => {
                let set = camera.set_boolean(feature, ptp);
                set.map_err(|cause| refused("ptp", &cause))?;
            }
            None if ptp => return Err(setting("ptp", "the camera has no PTP (IEEE 1588)")),
            None => {}
        }
    }
    Ok(())
}
