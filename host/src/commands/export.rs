//! `trinocular export`: tables and images of a recording.

use super::frames::{RecordingInput, Rigged};
use super::progress::Count;
use crate::commands::failure::Failure;
use clap::Args;
use std::io::Write;
use std::path::PathBuf;
use trinocular_recording::export::{self, Table};
use trinocular_recording::read::Source;
use trinocular_rig::error::InputError;
use trinocular_rig::interruption;
use trinocular_rig::notice;
use trinocular_rig::output::{NewFolders, Output, Replace, write_all};
use trinocular_rig::printable::printable;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::images::folder;

/// Write the measurements of a recording as a table, or its images as a folder
///
/// The table has one row per frame set. The folder has the form that `estimate` and `track
/// --images` read; images of other people's recordings can be written, too.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
#[group(id = "what", required = true, multiple = true, args = ["csv", "parquet", "images"])]
pub struct ExportOptions {
    /// The recording: an MCAP file, or the folder of a ROS 2 bag
    #[arg(value_name = "RUN.mcap")]
    input: PathBuf,

    /// Write the measurements as CSV; recordings of this program only
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,

    /// Write the measurements as Parquet, with the same columns; recordings of this program only
    #[arg(long, value_name = "FILE.parquet")]
    parquet: Option<PathBuf>,

    /// Write the frame sets as PNG files into this folder, which must be new or empty
    #[arg(long, value_name = "DIR")]
    images: Option<PathBuf>,

    /// The rig file, for recordings that hold none: names and image size of the cameras
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,

    #[command(flatten)]
    recording: RecordingInput,

    /// Overwrite the files of --csv and --parquet if they exist
    #[arg(long)]
    force: bool,
}

const EXAMPLES: &str = "\
Examples:
  trinocular export run.mcap --csv run.csv
  trinocular export run.mcap --parquet run.parquet
  trinocular export run.mcap --images captures/
  trinocular export bag/ --rig rig.toml --topic left=/cam0/image_raw --images captures/";

/// Runs the command.
pub fn run(options: &ExportOptions, out: &mut impl Write) -> Result<(), Failure> {
    let source = Source::open(&options.input)?;
    let replace = Replace::Nothing.or_forced(options.force);
    let open = |path: &PathBuf| Output::open(path, replace);
    let csv = options.csv.as_ref().map(open).transpose()?;
    let parquet = options.parquet.as_ref().map(open).transpose()?;
    if let (Some(csv), Some(parquet)) = (&csv, &parquet)
        && csv.is_same_file(parquet)
    {
        let reason = "--csv and --parquet name the same file; name two";
        return Err(Failure::Usage(reason.to_owned()));
    }
    if csv.is_some() || parquet.is_some() {
        tables(&source, csv, parquet, out)?;
    }
    if let Some(dir) = &options.images {
        images(options, dir, out)?;
    }
    Ok(())
}

/// Writes the measurements, both files or none.
fn tables(
    source: &Source,
    csv: Option<Output>,
    parquet: Option<Output>,
    out: &mut impl Write,
) -> Result<(), Failure> {
    let table = Table::read(source)?;
    if let Some(cut) = &table.cut {
        notice!("warning: {cut}");
    }
    let mut outputs = Vec::new();
    if let Some(output) = csv {
        outputs.push((output, export::csv(&table.rows).into_bytes()));
    }
    if let Some(output) = parquet {
        let bytes = table.parquet().map_err(|cause| {
            InputError::file(output.path(), format!("cannot be encoded: {cause}"))
        })?;
        outputs.push((output, bytes));
    }
    let paths: Vec<PathBuf> = outputs
        .iter()
        .map(|(output, _)| output.path().to_owned())
        .collect();
    write_all(outputs)?;
    for path in paths {
        writeln!(
            out,
            "{} rows in {}",
            table.rows.len(),
            printable(path.display())
        )?;
    }
    Ok(())
}

fn images(options: &ExportOptions, dir: &PathBuf, out: &mut impl Write) -> Result<(), Failure> {
    let is_empty = |dir: &PathBuf| dir.read_dir().is_ok_and(|mut dir| dir.next().is_none());
    if dir.exists() && !is_empty(dir) {
        return Err(InputError::file(dir, "exists and is no empty folder; name a new one").into());
    }
    let rig = options.rig.as_deref().map(RigFile::read).transpose()?;
    if let (Some(path), Some(rig)) = (&options.rig, &rig) {
        super::warnings::rig(path, rig);
    }
    let Rigged { frames, rig } = options.recording.open(&options.input, rig)?;
    // A limit of the file size is an error of the write then, and a signal ends between two files.
    interruption::watch().map_err(Failure::Signals)?;
    let mut folders = NewFolders::default();
    folders.make(dir)?;
    let mut count = Count::new("frame sets written");
    let mut written = 0;
    for set in frames.frame_sets() {
        if let Some(signal) = interruption::signal() {
            return Err(Failure::Interrupted(signal));
        }
        let mut set = set?;
        let mut names = rig.names.clone();
        // A camera without an image has no file.
        let mut is_there = set.images.iter().map(|image| !image.is_missing());
        names.retain(|_| is_there.next().unwrap_or(false));
        set.images.retain(|image| !image.is_missing());
        folder::save(dir, &names, written, &set)?;
        written += 1;
        count.at(written);
    }
    drop(count);
    writeln!(out, "{written} frame sets in {}", dir.display())?;
    Ok(())
}
