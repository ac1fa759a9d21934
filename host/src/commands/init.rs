//! `trinocular init`: a commented rig file to begin with.

use std::io::{self, IsTerminal as _, Write};
use std::path::{Path, PathBuf};

use crate::commands::failure::Failure;
use clap::{Args, ValueEnum};
use questions::Questions;
use trinocular_rig::notice;
use trinocular_rig::output::{Output, Replace};
use trinocular_rig::rig_file::template::{self, StageTemplate, Template};
use trinocular_rig::rig_file::{Driver, RigFile};
use values::{Image, Names, Number, PerAxis, Travel, UnknownWord};

mod questions;
mod values;

/// Write a commented rig file to begin with: cameras, board and stage
///
/// Asks for the values that no option gives, if this is a terminal; Enter takes the value in
/// brackets. Without a terminal, or with --defaults, it asks nothing. The cameras' values are
/// guesses until `calibrate` has measured them.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  trinocular init                                      # asks, and writes rig.toml
  trinocular init lab.toml --board skr-2 --steps-per-mm 80,80,400
  trinocular init - --no-stage --cameras left,right    # to standard output

Next: `trinocular verify rig.toml`, then `trinocular calibrate`")]
pub struct InitOptions {
    /// The rig file; `-` is standard output
    #[arg(value_name = "RIG.toml", default_value = "rig.toml")]
    file: PathBuf,

    /// The board that drives the stage [default: olimex-h405]
    #[arg(long, value_enum)]
    board: Option<Board>,

    /// Cameras only: the rig measures and moves nothing
    #[arg(
        long,
        conflicts_with_all = ["board", "steps_per_mm", "speed", "acceleration", "travel", "driver"]
    )]
    no_stage: bool,

    /// Names of the cameras from left to right, 2 to 8 [default: left,middle,right]
    #[arg(long, value_name = "NAMES")]
    cameras: Option<Names>,

    /// Size of every camera's image, px [default: 640x480]
    #[arg(long, value_name = "WxH")]
    size: Option<Image>,

    /// Focal length of every camera, px: focal length in mm / pixel pitch in mm [default: the
    /// image's width]
    #[arg(long, value_name = "PX")]
    focal: Option<Number>,

    /// Distance between neighbouring cameras, mm [default: 30]
    #[arg(long, value_name = "MM")]
    baseline: Option<Number>,

    /// Steps per mm of X, Y, Z, micro steps included; one number is for all [default: 80]
    #[arg(long, value_name = "N[,N,N]")]
    steps_per_mm: Option<PerAxis>,

    /// Greatest speed of X, Y, Z, mm/s [default: 10, slow for the first motion]
    #[arg(long, value_name = "N[,N,N]")]
    speed: Option<PerAxis>,

    /// Greatest acceleration of X, Y, Z, mm/s² [default: 200]; the jerk is 25 times the number
    #[arg(long, value_name = "N[,N,N]")]
    acceleration: Option<PerAxis>,

    /// Soft limits of every axis from zero, mm [default: -60,60]
    #[arg(long, value_name = "LOW,HIGH", allow_hyphen_values = true)]
    travel: Option<Travel>,

    /// Step drivers: A4988 or TMC2209 [default: TMC2209]
    ///
    /// A DRV8825 needs longer pulses than the boards make.
    #[arg(long, value_name = "NAME", value_parser = driver)]
    driver: Option<Driver>,

    /// Ask nothing: use the defaults of all options that are not given
    #[arg(long)]
    defaults: bool,

    /// Replace a rig file that exists
    #[arg(long)]
    force: bool,
}

/// Boards with firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Board {
    /// Olimex STM32-H405
    OlimexH405,
    /// Adafruit Feather STM32F405 Express
    FeatherF405,
    /// BIGTREETECH SKR 2 with an STM32F407VG
    #[value(name = "skr-2")]
    Skr2,
}

impl Board {
    /// Returns the name that `firmware/build` uses.
    const fn name(self) -> &'static str {
        match self {
            Self::OlimexH405 => "olimex-h405",
            Self::FeatherF405 => "feather-f405",
            Self::Skr2 => "skr-2",
        }
    }
}

/// Parses the name of a driver.
fn driver(text: &str) -> Result<Driver, WrongDriver> {
    let known = Driver::ALL
        .into_iter()
        .find(|driver| driver.name().eq_ignore_ascii_case(text));
    match known {
        Some(Driver::Drv8825) => Err(WrongDriver::TooSlow),
        Some(driver) => Ok(driver),
        None => Err(WrongDriver::Unknown(UnknownWord {
            kind: "driver",
            given: text.to_owned(),
            known: &["A4988", "TMC2209"],
        })),
    }
}

/// Reason why a text names no driver for `init`.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
enum WrongDriver {
    #[error("a DRV8825 needs longer pulses than the boards make; known here: A4988, TMC2209")]
    TooSlow,
    #[error(transparent)]
    Unknown(UnknownWord),
}

/// Parses a board, or none for a rig without a stage.
fn board(text: &str) -> Result<Option<Board>, UnknownWord> {
    match text {
        "none" => Ok(None),
        _ => Board::from_str(text, true)
            .map(Some)
            .map_err(|_| UnknownWord {
                kind: "board",
                given: text.to_owned(),
                known: &["olimex-h405", "feather-f405", "skr-2", "none"],
            }),
    }
}

/// Runs the command.
pub fn run(options: &InitOptions, out: &mut impl Write) -> Result<(), Failure> {
    let to_output = options.file == Path::new("-");
    let file = if to_output {
        None
    } else {
        // Before any question.
        Some(Output::open(
            &options.file,
            Replace::Nothing.or_forced(options.force),
        )?)
    };
    let is_asked = !options.defaults && io::stdin().is_terminal() && io::stderr().is_terminal();
    let (mut answers, mut asked) = (io::stdin().lock(), io::stderr());
    let mut questions = match is_asked {
        true => Questions::on(&mut answers, &mut asked),
        false => Questions::none(),
    };
    let template = fill(options, &mut questions)?;
    let text = template::text(&template);
    RigFile::parse(&options.file, &text)?;
    match file {
        None => out.write_all(text.as_bytes())?,
        Some(file) => {
            file.write(&text)?;
            let path = options.file.display();
            notice!(
                "{path} written; its cameras' values are guesses until `calibrate` measures them"
            );
            writeln!(out, "next: trinocular verify {path}")?;
        }
    }
    Ok(())
}

/// Collects the values from options, answers and defaults.
fn fill(options: &InitOptions, ask: &mut Questions<'_>) -> Result<Template, Failure> {
    let cameras = ask.value(
        options.cameras.clone(),
        "Names of the cameras from left to right",
        "left,middle,right",
        str::parse::<Names>,
    )?;
    let image = ask.value(
        options.size,
        "Size of every camera's image, px",
        "640x480",
        str::parse::<Image>,
    )?;
    let focal = ask.value(
        options.focal,
        "Focal length, px (in mm / pixel pitch in mm; `calibrate` measures it)",
        &image.0[0].to_string(),
        str::parse::<Number>,
    )?;
    let baseline = ask.value(
        options.baseline,
        "Distance between neighbouring cameras, mm",
        "30",
        str::parse::<Number>,
    )?;
    Ok(Template {
        cameras: cameras.0,
        image_size_px: image.0,
        focal_px: focal.0,
        baseline_mm: baseline.0,
        stage: stage(options, ask)?,
    })
}

fn stage(options: &InitOptions, ask: &mut Questions<'_>) -> Result<Option<StageTemplate>, Failure> {
    if options.no_stage {
        return Ok(None);
    }
    let question = "Board that drives the stage (olimex-h405, feather-f405, skr-2; none)";
    let chosen = ask.value(options.board.map(Some), question, "olimex-h405", board)?;
    let Some(board) = chosen else {
        return Ok(None);
    };
    let per_axis = str::parse::<PerAxis>;
    let steps = "Steps per mm of X, Y, Z, micro steps included";
    let steps = ask.value(options.steps_per_mm, steps, "80", per_axis)?;
    let speed = "Greatest speed of X, Y, Z, mm/s";
    let speed = ask.value(options.speed, speed, "10", per_axis)?;
    let acceleration = "Greatest acceleration of X, Y, Z, mm/s²";
    let acceleration = ask.value(options.acceleration, acceleration, "200", per_axis)?;
    let travel = "Soft limits of every axis from zero, mm";
    let travel = ask.value(options.travel, travel, "-60,60", str::parse::<Travel>)?;
    let drivers = "Step drivers (A4988, TMC2209)";
    let driver = ask.value(options.driver, drivers, "TMC2209", driver)?;
    Ok(Some(StageTemplate {
        board: board.name().into(),
        steps_per_mm: steps.0,
        max_speed_mm_s: speed.0,
        max_acceleration_mm_s2: acceleration.0,
        travel_mm: travel.0,
        driver,
    }))
}
