//! `trinocular cameras`: the cameras of this computer and its networks.

use std::io::Write;
use std::path::PathBuf;

use super::json;
use crate::commands::failure::Failure;
use clap::Args;
use serde::Serialize;
use trinocular_rig::printable::printable;

/// List the cameras that are there, with their serial numbers and formats
///
/// The first word of a line is the name for --cameras and for `device` in the rig file. It holds the
/// serial number where a camera has one, so that it does not depend on the order of plugging.
/// GenICam cameras (GigE Vision, USB3 Vision) are searched on all networks for a second; V4L2
/// cameras are those of Linux. Each camera is opened for a moment to read its formats.
#[derive(Debug, Args)]
pub struct CamerasOptions {
    /// Print one JSON object with all cameras
    #[arg(long)]
    json: bool,
}

/// A camera of any kind.
#[derive(Debug, Serialize)]
struct Row {
    device: PathBuf,
    kind: String,
    vendor: Option<String>,
    model: Option<String>,
    serial: Option<String>,
    address: String,
    formats: Vec<String>,
    problem: Option<String>,
}

/// All cameras.
#[derive(Debug, Serialize)]
struct Listing {
    cameras: Vec<Row>,
    /// Kinds of cameras that the program was built without.
    without: Vec<&'static str>,
}

/// Runs the command.
pub fn run(options: &CamerasOptions, out: &mut impl Write) -> Result<(), Failure> {
    let (mut cameras, mut without) = (Vec::new(), Vec::new());
    for (kind, rows) in [("GenICam", genicam()), ("V4L2", v4l2())] {
        match rows {
            Some(rows) => cameras.extend(rows),
            None => without.push(kind),
        }
    }
    if options.json {
        json::line(out, &Listing { cameras, without })?;
        return Ok(());
    }
    if cameras.is_empty() {
        writeln!(out, "no cameras")?;
    }
    for camera in &cameras {
        writeln!(out, "{}", line(camera))?;
    }
    for kind in without {
        writeln!(
            out,
            "not searched: {kind} cameras (this program was built without them)"
        )?;
    }
    Ok(())
}

fn line(camera: &Row) -> String {
    let about = [
        Some(camera.kind.clone()),
        camera.vendor.clone(),
        camera.model.clone(),
        Some(camera.address.clone()),
        Some(camera.formats.join(", ")),
        camera.problem.clone(),
    ];
    let about = about.into_iter().flatten().filter(|text| !text.is_empty());
    let about = about.collect::<Vec<_>>().join("  ");
    // What a camera says about itself is foreign text.
    let about = printable(about);
    format!("{:<20} {about}", printable(camera.device.display()))
}

#[cfg(feature = "genicam")]
fn genicam() -> Option<Vec<Row>> {
    use trinocular_rig::rig_file::capture::GENICAM;
    use trinocular_vision::images::cameras::genicam::list;

    let rows = list().into_iter().map(|camera| Row {
        device: format!("{GENICAM}{}", camera.serial).into(),
        kind: camera.protocol,
        vendor: Some(camera.vendor),
        model: Some(camera.model),
        serial: Some(camera.serial),
        address: camera.address,
        formats: camera.formats,
        problem: camera.problem,
    });
    Some(rows.collect())
}

#[cfg(not(feature = "genicam"))]
fn genicam() -> Option<Vec<Row>> {
    None
}

#[cfg(all(feature = "camera", target_os = "linux"))]
fn v4l2() -> Option<Vec<Row>> {
    use trinocular_vision::images::cameras::device::list;

    let rows = list().into_iter().map(|camera| Row {
        device: camera.device,
        kind: "V4L2".to_owned(),
        vendor: None,
        model: camera.model,
        serial: camera.serial,
        address: camera.path.display().to_string(),
        formats: camera.formats,
        problem: camera.problem,
    });
    Some(rows.collect())
}

#[cfg(not(all(feature = "camera", target_os = "linux")))]
fn v4l2() -> Option<Vec<Row>> {
    None
}
