//! Search of a folder for the images of each camera.

use std::collections::{BTreeMap, HashSet};
use std::fs;
use std::path::{Path, PathBuf};

use super::pipe::STANDARD_INPUT;
use super::{Images, Series, Still, stack};
use crate::images::folder::{self, Listing};
use trinocular_rig::error::InputError;

/// Series of all cameras, and warnings.
#[derive(Clone, Debug, Default)]
pub struct Found {
    /// Images of each camera.
    pub series: Vec<Series>,
    /// Folders with images that are not read or belong to no camera, with a message.
    pub unread: Vec<(PathBuf, String)>,
}

impl Found {
    fn note(&mut self, place: &Path, listing: &Listing) {
        let remark = listing.remark();
        self.unread
            .extend(remark.map(|remark| (place.to_owned(), remark)));
    }

    /// Notes images beside those of the cameras.
    fn note_strangers(&mut self, place: &Path, strangers: &[String], why: &str) {
        if let [first, ..] = strangers {
            let (images, belong) = match strangers.len() {
                1 => ("image", "belongs"),
                _ => ("images", "belong"),
            };
            let count = strangers.len();
            let said = format!("{count} {images} {belong} to no camera, first {first}: {why}");
            self.unread.push((place.to_owned(), said));
        }
    }
}

/// Finds the images of the cameras `names`, in this order.
///
/// # Errors
/// [`InputError`] if a camera has none, or a stack or video cannot be opened.
pub fn of_cameras(dir: &Path, names: &[String]) -> Result<Found, InputError> {
    if !dir.is_dir() {
        return Err(InputError::file(dir, "no such folder"));
    }
    let mut found = Found::default();
    let files = file_names(dir)?;
    for name in names {
        let own = dir.join(name);
        if own.is_dir() {
            let listing = folder::listing(&own)?;
            found.note(&own, &listing);
            found.series.push(in_folder(name, &own, listing)?);
            continue;
        }
        let path = |ending: &str| {
            let is_own = |file: &&String| {
                let (stem, end) = split_ending(file);
                stem == name && end.eq_ignore_ascii_case(ending)
            };
            files.iter().find(is_own).map(|file| dir.join(file))
        };
        if let Some(video) = path("y4m") {
            found.series.push(Series::video(name, &video)?);
        } else if let Some(stack) = path("tif").or_else(|| path("tiff")) {
            found.series.push(Series::stack(name, &stack)?);
        } else {
            let flat = with_prefix(dir, name, names)?;
            if flat.is_empty() {
                let reason = format!(
                    "no such folder; every camera of the rig needs one of its name, or a stack \
                     {name}.tif, a video {name}.y4m, or images {name}1.png, {name}2.png"
                );
                return Err(InputError::file(&own, reason));
            }
            found.series.push(Series {
                name: name.clone(),
                place: dir.to_owned(),
                images: Images::Stills(flat),
            });
        }
    }
    let files = |one: &Series| -> Vec<PathBuf> {
        let stills = one.stills().iter().map(|still| still.file.clone());
        stills.chain([one.place.clone()]).collect()
    };
    let used: HashSet<PathBuf> = found.series.iter().flat_map(files).collect();
    let mut strangers: Vec<String> = folder::listing(dir)?.files.into_iter().collect();
    strangers.retain(|file| !used.contains(&dir.join(file)));
    let why = format!(
        "not used; names begin with a camera's ({}) and a number",
        names.join(", ")
    );
    found.note_strangers(dir, &strangers, &why);
    Ok(found)
}

/// Returns the longest of the cameras' names that a name begins with, before a number or separator.
fn owner<'n>(stem: &str, names: &'n [String]) -> Option<&'n String> {
    let fits = |name: &&String| {
        let rest = stem.strip_prefix(name.as_str());
        let next = rest.and_then(|rest| rest.chars().next());
        next.is_some_and(|next| next.is_ascii_digit() || SEPARATORS.contains(&next))
    };
    names.iter().filter(fits).max_by_key(|name| name.len())
}

/// Finds the images of all cameras in a folder, or in one stack or video, whose names are the
/// cameras'.
///
/// # Errors
/// [`InputError`] if the folder cannot be listed, or a stack or video cannot be opened.
pub fn of_all(input: &Path) -> Result<Found, InputError> {
    if !input.is_dir() {
        return of_file(input).map(|series| Found {
            series: vec![series],
            unread: Vec::new(),
        });
    }
    let mut found = Found::default();
    let io = |cause| InputError::io(input, "list", &cause);
    for entry in fs::read_dir(input).map_err(io)? {
        let path = entry.map_err(io)?.path();
        let name = path.file_name().unwrap_or_default();
        let name = name.to_string_lossy().into_owned();
        if path.is_dir() && !name.starts_with('.') {
            let listing = folder::listing(&path)?;
            found.note(&path, &listing);
            let series = in_folder(&name, &path, listing)?;
            if series.is_numbered() || !series.stills().is_empty() {
                found.series.push(series);
            }
        }
    }
    if !found.series.is_empty() {
        let strangers: Vec<String> = folder::listing(input)?.files.into_iter().collect();
        let why = "not used, because the images of cameras are in folders beside them";
        found.note_strangers(input, &strangers, why);
        return Ok(found);
    }
    for file in file_names(input)? {
        let (stem, ending) = split_ending(&file);
        if ending.eq_ignore_ascii_case("y4m") {
            found.series.push(Series::video(stem, &input.join(&file))?);
        }
    }
    let listing = folder::listing(input)?;
    found.note(input, &listing);
    let (stacks, images): (Vec<_>, Vec<_>) = listing
        .files
        .into_iter()
        .partition(|file| is_stack(&input.join(file)));
    for file in stacks {
        let (stem, _) = split_ending(&file);
        found.series.push(Series::stack(stem, &input.join(&file))?);
    }
    found.series.extend(by_prefix(input, images));
    Ok(found)
}

fn of_file(path: &Path) -> Result<Series, InputError> {
    if path == Path::new(STANDARD_INPUT) {
        return Series::video("camera", path);
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let (stem, ending) = split_ending(&name);
    if !path.exists() {
        return Err(InputError::file(path, "no such folder"));
    }
    match ending.to_ascii_lowercase().as_str() {
        "y4m" => Series::video(stem, path),
        "tif" | "tiff" => Series::stack(stem, path),
        _ => {
            let reason = "is neither a folder of images nor a TIFF stack (.tif) nor a Y4M video \
                          (.y4m)";
            Err(InputError::file(path, reason))
        }
    }
}

/// Lists the images of one camera's folder. A single stack or video in it is the series.
fn in_folder(name: &str, dir: &Path, listing: Listing) -> Result<Series, InputError> {
    let mut videos = file_names(dir)?;
    videos.retain(|file| split_ending(file).1.eq_ignore_ascii_case("y4m"));
    let files: Vec<&String> = listing.files.iter().collect();
    match (files.as_slice(), videos.as_slice()) {
        ([], [video]) => return Series::video(name, &dir.join(video)),
        ([only], []) if is_stack(&dir.join(only)) => return Series::stack(name, &dir.join(only)),
        _ => {}
    }
    let stills = listing.files.iter();
    let stills = stills.map(|file| Still::file(file, dir.join(file)));
    Ok(Series {
        name: name.to_owned(),
        place: dir.to_owned(),
        images: Images::Stills(stills.collect()),
    })
}

/// Returns a stack or video among the cameras' images in `dir`: one file with several images of a
/// camera.
///
/// # Errors
/// [`InputError`] if a folder cannot be listed.
pub fn stack_or_video(dir: &Path, names: &[String]) -> Result<Option<PathBuf>, InputError> {
    let is_video = |file: &str| split_ending(file).1.eq_ignore_ascii_case("y4m");
    for file in file_names(dir)? {
        let (stem, ending) = split_ending(&file);
        let is_tiff = ["tif", "tiff"]
            .iter()
            .any(|end| ending.eq_ignore_ascii_case(end));
        let is_camera = names.iter().any(|name| name == stem) && !dir.join(stem).is_dir();
        if is_camera && (is_tiff || is_video(&file)) {
            return Ok(Some(dir.join(file)));
        }
    }
    for own in names.iter().map(|name| dir.join(name)) {
        if own.is_dir() {
            let files = file_names(&own)?;
            let mut files = files.iter().map(|file| own.join(file));
            let is_one = |path: &PathBuf| is_video(&path.to_string_lossy()) || is_stack(path);
            if let Some(file) = files.find(is_one) {
                return Ok(Some(file));
            }
        }
    }
    Ok(None)
}

/// Returns true for a TIFF file of several pages.
pub fn is_stack(path: &Path) -> bool {
    let ending = path.extension().unwrap_or_default();
    let is_tiff = ["tif", "tiff"]
        .iter()
        .any(|tiff| ending.eq_ignore_ascii_case(tiff));
    is_tiff && stack::pages(path).is_ok_and(|pages| pages.count() > 1)
}

/// Returns the names of a folder's files, in order; hidden ones are left out.
fn file_names(dir: &Path) -> Result<Vec<String>, InputError> {
    let io = |cause| InputError::io(dir, "list", &cause);
    let mut names = Vec::new();
    for entry in fs::read_dir(dir).map_err(io)? {
        let entry = entry.map_err(io)?;
        if !entry.path().is_dir()
            && let Ok(name) = entry.file_name().into_string()
            && !name.starts_with('.')
        {
            names.push(name);
        }
    }
    names.sort();
    Ok(names)
}

/// Splits a file's name before its ending.
pub fn split_ending(name: &str) -> (&str, &str) {
    name.rsplit_once('.').unwrap_or((name, ""))
}

const SEPARATORS: [char; 4] = ['_', '-', ' ', '.'];

/// Lists the images in `dir` whose name begins with a camera's: `left1.png`, `left_1.png`. Of all
/// cameras' names that a file begins with, the longest is its camera's.
fn with_prefix(dir: &Path, name: &str, names: &[String]) -> Result<Vec<Still>, InputError> {
    let listing = folder::listing(dir)?;
    let files = listing.files.iter().filter_map(|file| {
        let (stem, _) = split_ending(file);
        let owner = owner(stem, names)?;
        let rest = file.strip_prefix(name).filter(|_| owner == name)?;
        let instant = rest.trim_start_matches(SEPARATORS);
        Some(Still::file(instant, dir.join(file)))
    });
    Ok(files.collect())
}

/// Returns true if the part of a name before its last number holds a date or a time: two or more
/// numbers, or one of six digits or more.
fn has_time_stamp(camera: &str) -> bool {
    let numbers = camera.split(|c: char| !c.is_ascii_digit());
    let lengths: Vec<usize> = numbers.map(str::len).filter(|length| *length > 0).collect();
    lengths.len() >= 2 || lengths.iter().any(|length| *length >= 6)
}

/// Groups the images of several cameras in one folder. Names that do not all end in numbers, or that
/// hold a time stamp, belong to one camera.
fn by_prefix(dir: &Path, files: Vec<String>) -> Vec<Series> {
    if files.is_empty() {
        return Vec::new();
    }
    let split = |file: &str| {
        let (stem, _) = split_ending(file);
        let camera = stem.trim_end_matches(|c: char| c.is_ascii_digit());
        let instant = stem[camera.len()..].to_owned();
        (camera.trim_end_matches(SEPARATORS).to_owned(), instant)
    };
    let series = |name: String, stills| Series {
        name,
        place: dir.to_owned(),
        images: Images::Stills(stills),
    };
    let is_of_cameras = files.iter().all(|file| {
        let (camera, instant) = split(file);
        !camera.is_empty() && !instant.is_empty() && !has_time_stamp(&camera)
    });
    if !is_of_cameras {
        let full = fs::canonicalize(dir).unwrap_or_else(|_| dir.to_owned());
        let name = full
            .file_name()
            .map(|name| name.to_string_lossy().into_owned());
        let stills = files.iter().map(|file| Still::file(file, dir.join(file)));
        return vec![series(
            name.unwrap_or("camera".to_owned()),
            stills.collect(),
        )];
    }
    let mut cameras: BTreeMap<String, Vec<Still>> = BTreeMap::new();
    for file in &files {
        let (camera, instant) = split(file);
        let stills = cameras.entry(camera).or_default();
        stills.push(Still::file(&instant, dir.join(file)));
    }
    let cameras = cameras.into_iter();
    cameras.map(|(name, stills)| series(name, stills)).collect()
}
