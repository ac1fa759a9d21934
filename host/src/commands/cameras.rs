//! Live cameras by their names on the command line or in the rig file: V4L2 devices, GenICam
//! cameras, GStreamer pipelines, or those that `trinocular twin` simulates.

mod genicam;
mod gstreamer;

use crate::commands::failure::Failure;
use crate::commands::range;
use std::path::{Path, PathBuf};
use trinocular_client::ports;
use trinocular_live::DropSource;
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::rig_file::{Capture, RigFile};
use trinocular_vision::images::cameras::live::{Camera, LiveCameras, Tally};

/// Stands on the command line for the devices that the rig file names.
const RIG: &str = "rig";

/// Begins the name of the cameras of a simulated station that has its own link.
const TWIN_ON: &str = "twin:";

/// Returns one device for each camera of the rig file, in its order. `twin` stands for all cameras
/// of a simulated station: of the one on `port`, if that has any. `rig` stands for the devices that
/// the rig file names.
pub fn per_camera(
    devices: &[PathBuf],
    port: Option<&str>,
    (rig, rig_path): (&RigFile, &Path),
) -> Result<Vec<PathBuf>, Failure> {
    let names = &rig.names;
    let is_simulated = |device: &PathBuf| simulated_station(device).is_some();
    let devices = match devices {
        [one] if one.as_os_str() == ports::TWIN => vec![twin_beside(port); names.len()],
        [one] if is_simulated(one) => vec![one.clone(); names.len()],
        [one] if one.as_os_str() == RIG => named_by_rig(rig, rig_path)?,
        _ => devices.to_vec(),
    };
    if devices.len() != names.len() {
        return Err(Failure::Usage(format!(
            "--cameras names {} devices, but {} has {} cameras: {}, in this order",
            devices.len(),
            rig_path.display(),
            names.len(),
            names.join(", ")
        )));
    }
    if !devices.iter().all(is_simulated) {
        refuse_doubles(&devices, names)?;
    }
    Ok(devices)
}

/// Returns the name of the simulated cameras beside the station on `port`.
fn twin_beside(port: Option<&str>) -> PathBuf {
    #[cfg(unix)]
    if let Some(link) = port
        && crate::commands::twin::lab::cameras_of(Path::new(link)).exists()
    {
        return format!("{TWIN_ON}{link}").into();
    }
    // Other systems have no simulated cameras, and say so.
    let _ = port;
    ports::TWIN.into()
}

fn named_by_rig(rig: &RigFile, rig_path: &Path) -> Result<Vec<PathBuf>, Failure> {
    let devices = rig.names.iter().enumerate().map(|(index, name)| {
        let device = rig.capture.get(index).and_then(|it| it.device.as_ref());
        let device = device.map(PathBuf::from);
        device.ok_or_else(|| {
            let reason = "missing, but --cameras rig needs it; for example `device = \
                          \"genicam:SERIAL\"` (`trinocular cameras` lists the devices)";
            genicam::fault(rig_path, name, "device", reason)
        })
    });
    devices.collect()
}

/// Refuses one device for two cameras, even if different names or links lead to it.
fn refuse_doubles(devices: &[PathBuf], names: &[String]) -> Result<(), Failure> {
    let real = |device: &PathBuf| device.canonicalize().unwrap_or_else(|_| device.clone());
    let real: Vec<PathBuf> = devices.iter().map(real).collect();
    for (later, device) in real.iter().enumerate() {
        if let Some(first) = real[..later].iter().position(|before| before == device) {
            return Err(Failure::Usage(format!(
                "--cameras names one device twice: {} for {} and {} for {}",
                devices[first].display(),
                names[first],
                devices[later].display(),
                names[later]
            )));
        }
    }
    Ok(())
}

/// Returns true if a camera stamps its images by a clock of its own, which is compared with the
/// computer's.
pub fn have_own_clock(devices: &[PathBuf]) -> bool {
    devices.iter().any(|device| genicam::is_one(device))
}

/// Returns the delay of each camera's time stamps, µs: `delay_ms`, or else that of the rig file.
pub fn delays_us(delay_ms: Option<f64>, rig: &RigFile) -> Vec<i64> {
    let cameras = 0..rig.names.len();
    let delays_ms = cameras.map(|index| delay_ms.unwrap_or_else(|| delay_ms_of(rig, index)));
    delays_ms.map(|ms| (ms * 1e3).round() as i64).collect()
}

/// Returns the delay of a camera's time stamps in the rig file, ms; 0 if it states none.
fn delay_ms_of(rig: &RigFile, index: usize) -> f64 {
    let capture = rig.capture.get(index);
    capture.and_then(|capture| capture.delay_ms).unwrap_or(0.0)
}

/// Returns the delay of each simulated camera's time stamps, ms: one for all, one of each, or else
/// those of the rig file.
pub fn per_camera_delays_ms(given_ms: Option<&[f64]>, rig: &RigFile) -> Result<Vec<f64>, Failure> {
    let count = rig.names.len();
    for delay_ms in given_ms.unwrap_or_default() {
        range::check_delay("camera-delay", *delay_ms)?;
    }
    match given_ms {
        None => Ok((0..count).map(|index| delay_ms_of(rig, index)).collect()),
        Some([all_ms]) => Ok(vec![*all_ms; count]),
        Some(each_ms) if each_ms.len() == count => Ok(each_ms.to_vec()),
        Some(other_ms) => Err(Failure::Usage(format!(
            "--camera-delay has {} values, must have one, or one for each of the {count} cameras: \
             {}",
            other_ms.len(),
            rig.names.join(", ")
        ))),
    }
}

/// Opens the cameras, in the rig's order, and then prints the formats of real cameras.
///
/// `fps` is the rate that real cameras without a trigger are set to.
pub fn open(
    devices: &[PathBuf],
    (rig, rig_path): (&RigFile, &Path),
    fps: f64,
) -> Result<Vec<Box<dyn Camera>>, Failure> {
    let size_px = rig.rig.image_size_px;
    let default = Capture::default();
    let capture = |index: usize| rig.capture.get(index).unwrap_or(&default);
    for (index, (device, name)) in devices.iter().zip(&rig.names).enumerate() {
        // A rig file serves its real cameras and their simulation.
        if simulated_station(device).is_none() && !genicam::is_one(device) {
            genicam::refuse_settings(capture(index), name, rig_path)?;
        }
    }
    let opened = devices.iter().zip(&rig.names).enumerate();
    let opened = opened.map(|(index, (device, name))| {
        let (camera, format) = match simulated_station(device) {
            Some(link) => return Ok((simulated(&link, device, index, size_px)?, None)),
            None if genicam::is_one(device) => {
                let settings = (capture(index), rig_path);
                genicam::open(fps, device, name, settings, size_px)?
            }
            None if gstreamer::is_one(device) => gstreamer::open(device, name, size_px)?,
            None => real(fps, device, name, size_px)?,
        };
        Ok((camera, Some(format)))
    });
    let opened: Vec<_> = opened.collect::<Result<_, Failure>>()?;
    let mut cameras = Vec::new();
    for ((camera, format), (device, name)) in opened.into_iter().zip(devices.iter().zip(&rig.names))
    {
        if let Some(format) = format {
            notice!("{name} is {}, {format}", device.display());
        }
        cameras.push(camera);
    }
    Ok(cameras)
}

/// Returns the link of the simulated station whose cameras `device` stands for.
fn simulated_station(device: &Path) -> Option<PathBuf> {
    match device.to_str()? {
        ports::TWIN => ports::twin_link().ok(),
        other => other.strip_prefix(TWIN_ON).map(PathBuf::from),
    }
}

#[cfg(unix)]
fn simulated(
    link: &Path,
    device: &Path,
    index: usize,
    size_px: [u32; 2],
) -> Result<Box<dyn Camera>, Failure> {
    use crate::commands::twin::lab::{cameras_of, monotonic};
    use std::io::Write as _;
    use std::os::unix::net::UnixStream;
    use std::time::Duration;
    use trinocular_vision::images::cameras::stream::StreamCamera;

    let connect = || {
        let mut stream = UnixStream::connect(cameras_of(link))?;
        stream.set_read_timeout(Some(Duration::from_millis(100)))?;
        writeln!(stream, "camera {index}")?;
        Ok::<_, std::io::Error>(stream)
    };
    let stream = connect().map_err(|_| {
        let reason = "no cameras are simulated there now: run `trinocular twin --with-target` in \
                      another terminal first";
        InputError::file(device, reason)
    })?;
    let path = PathBuf::from(format!("{} camera {index}", device.display()));
    Ok(Box::new(StreamCamera::new(
        path, stream, size_px, monotonic,
    )))
}

#[cfg(not(unix))]
fn simulated(_: &Path, device: &Path, _: usize, _: [u32; 2]) -> Result<Box<dyn Camera>, Failure> {
    let reason = "this system has no local sockets, which simulated cameras need";
    Err(InputError::file(device, reason).into())
}

/// Returns the receiver of the source of a camera's time stamps, which prints it.
#[cfg(any(
    feature = "genicam",
    feature = "gstreamer",
    all(feature = "camera", target_os = "linux")
))]
fn tell_source(
    name: &str,
    device: &Path,
) -> impl FnMut(trinocular_vision::images::cameras::stamp::Source) + Send + 'static {
    use trinocular_vision::images::cameras::stamp::Source;

    let who = format!("{name} ({})", device.display());
    move |source| match source {
        Source::Driver(_) | Source::Device => notice!("{who}: {source}"),
        Source::Arrival(_) => notice!("warning: {who}: {source}"),
    }
}

/// Opens a V4L2 camera; returns it with its format.
#[cfg(all(feature = "camera", target_os = "linux"))]
fn real(
    fps: f64,
    device: &Path,
    name: &str,
    size_px: [u32; 2],
) -> Result<(Box<dyn Camera>, String), Failure> {
    use trinocular_vision::images::cameras::device::V4l2;

    let notice = Box::new(tell_source(name, device));
    let camera = V4l2::open(device, size_px, fps, notice)?;
    let format = format!("{:?}", camera.format());
    Ok((Box::new(camera), format))
}

#[cfg(not(all(feature = "camera", target_os = "linux")))]
fn real(_: f64, device: &Path, _: &str, _: [u32; 2]) -> Result<(Box<dyn Camera>, String), Failure> {
    let reason = "this program was built without V4L2 cameras: build it on Linux with \
                  `cargo build --release --features trinocular/camera`";
    Err(InputError::file(device, reason).into())
}

/// Makes the source of the counts of images that never come to the loop, for a live page.
pub fn drop_source(live: &LiveCameras) -> DropSource {
    let count = live.counter();
    DropSource::new(move || count().iter().map(Tally::drops).collect())
}
