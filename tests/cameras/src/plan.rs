//! Plan of a video device: a text file, and its images.
//!
//! `video90` in the folder is the plan of `/dev/video90`, one word and its numbers per line:
//!
//! ```text
//! size 320 240      # of its images, grey, one after another in video90.grey
//! period_us 33333
//! readout_us 9000   # from the stamp to the image's arrival, which is up to jitter_us later
//! jitter_us 6000
//! lose 5 9 10       # numbers of images that the driver loses
//! spoil 7           # numbers of images that are damaged and flagged
//! cut 8             # numbers of images of which half arrives, without a flag
//! unplug 40         # that never comes: from then on there is no such device
//! foreign_clock     # the stamps are on an unknown clock
//! at_start          # the stamps are of the exposure's start
//! start_error 28    # starting it fails with this error number
//! silent            # no image ever arrives
//! dark 20           # number of black images while it adjusts its exposure
//! grey_of 160 120   # size of its GREY images; those of `size` are YU12
//! ```

use std::path::PathBuf;

use crate::wire::Errno;

/// Behaviour of one video device.
#[derive(Default)]
pub struct Plan {
    pub size: [u32; 2],
    pub period_us: u64,
    pub readout_us: u64,
    pub jitter_us: u64,
    pub lose: Vec<u64>,
    pub spoil: Vec<u64>,
    pub cut: Vec<u64>,
    pub unplug: Option<u64>,
    pub start_error: Option<Errno>,
    pub foreign_clock: bool,
    pub at_start: bool,
    pub silent: bool,
    pub dark: u64,
    pub grey_of: Option<[u32; 2]>,
}

/// Reads the plan and images of the device `name`, for example `/dev/video90`, and returns the path
/// of its log with them; `None` if there is no plan.
pub fn read(name: &str) -> Option<(Plan, Vec<u8>, PathBuf)> {
    let folder = PathBuf::from(std::env::var_os("TRINOCULAR_CAMERAS")?);
    let file = folder.join(name.strip_prefix("/dev/")?);
    let text = std::fs::read_to_string(&file).ok()?;
    let pictures = std::fs::read(file.with_extension("grey")).ok()?;
    let mut plan = Plan::default();
    for line in text.lines() {
        let mut words = line.split_whitespace();
        let Some(word) = words.next() else {
            continue;
        };
        let numbers: Vec<u64> = words.map(str::parse).collect::<Result<_, _>>().ok()?;
        let first = || numbers.first().copied();
        match word {
            "size" => plan.size = [first()? as u32, *numbers.get(1)? as u32],
            "period_us" => plan.period_us = first()?,
            "readout_us" => plan.readout_us = first()?,
            "jitter_us" => plan.jitter_us = first()?,
            "lose" => plan.lose = numbers,
            "spoil" => plan.spoil = numbers,
            "cut" => plan.cut = numbers,
            "unplug" => plan.unplug = Some(first()?),
            "start_error" => plan.start_error = Some(first()? as Errno),
            "foreign_clock" => plan.foreign_clock = true,
            "at_start" => plan.at_start = true,
            "silent" => plan.silent = true,
            "dark" => plan.dark = first()?,
            "grey_of" => plan.grey_of = Some([first()? as u32, *numbers.get(1)? as u32]),
            _ => return None,
        }
    }
    let bytes: u64 = plan.size.iter().map(|side| u64::from(*side)).product();
    let is_whole = plan.period_us > 0 && bytes > 0 && pictures.len() as u64 >= bytes;
    is_whole.then(|| (plan, pictures, file.with_extension("log")))
}
