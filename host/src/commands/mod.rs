//! Commands of `trinocular`: one file per command, each with its options and its `run`.

use std::io::Write;

use clap::{Parser, Subcommand};
use failure::Failure;
use trinocular_client::serial::{self, Ending};

mod align;
mod bench;
mod bench_pose;
mod by_hand;
mod calibrate;
mod calibrate_stage;
mod cameras;
pub mod commas;
mod completions;
mod convert;
mod csv_rows;
mod destination;
mod diagnose;
mod driven;
mod estimate;
mod experiment;
mod export;
mod exposures;
pub mod failure;
mod folder_input;
mod frames;
mod groups;
mod hello;
mod home;
mod init;
mod jog;
mod json;
mod latency;
mod list_cameras;
mod live_cameras;
mod live_page;
mod man;
mod motors;
pub mod numbers;
mod port;
mod ports;
mod progress;
mod range;
mod record;
mod reference;
mod reference_view;
mod region;
mod replay;
mod report;
mod report_option;
mod reset;
mod robustness;
mod scene;
mod serve;
mod simulate;
mod stage_model;
mod status;
mod stop;
mod tables;
mod track;
mod turning;
mod twin;
mod verify;
mod version;
mod warnings;
mod zenoh;
mod zero;

/// Visual servo for three-dimensional motion: parallel cameras watch a target, a stage follows it.
///
/// All lengths are millimetres, all image positions pixels. Axes are those of ordinary images: x
/// right, y down, z away from the cameras. A displacement is the target's, seen from the cameras.
///
/// The station is the board that drives the stage; the twin is the same code inside this program,
/// with a simulated stage. A rig file (TOML) describes the cameras, and the stage if there is one:
/// `init` writes one to begin with, `calibrate` and `convert` one that is measured.
///
/// Without a command it runs the paper's tracking experiment in closed loop on the built-in twin,
/// prints its Table 6 beside the paper's, and writes an HTML report. No hardware is needed.
#[derive(Debug, Parser)]
#[command(
    name = "trinocular",
    version,
    long_version = version::long(),
    help_template = groups::TEMPLATE,
    before_help = groups::commands(),
    max_term_width = 100,
    args_conflicts_with_subcommands = true,
    after_help = EXIT_CODES
)]
pub struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,

    #[command(flatten)]
    experiment: experiment::ExperimentOptions,
}

const EXIT_CODES: &str = "\
From a new rig to a target that is followed:
  trinocular init rig.toml
  trinocular calibrate boards/ --board 9x6 --square 25 --out rig.toml --force
  trinocular align captures/ --rig rig.toml --out aligned.toml
  trinocular verify aligned.toml
  trinocular track --images captures/ --rig aligned.toml

Exit codes:
  0  done
  1  the input was bad (the message names file, line and field), frame sets were refused,
     or an expectation was missed
  2  the command line was wrong
  3  the station refused, faulted or is in use, or a signal ended a run that moves a stage
  130, 143  Ctrl-C (SIGINT) or SIGTERM ended a run without a real stage";

#[derive(Debug, Subcommand)]
enum Command {
    Align(align::AlignOptions),
    Bench(bench::BenchOptions),
    Calibrate(calibrate::CalibrateOptions),
    CalibrateStage(calibrate_stage::CalibrateStageOptions),
    Cameras(list_cameras::CamerasOptions),
    Completions(completions::CompletionsOptions),
    Convert(convert::ConvertOptions),
    Diagnose(diagnose::DiagnoseOptions),
    Estimate(estimate::EstimateOptions),
    Export(export::ExportOptions),
    Hello(hello::HelloOptions),
    Home(home::HomeOptions),
    Init(init::InitOptions),
    Jog(jog::JogOptions),
    Latency(latency::LatencyOptions),
    Man(man::ManOptions),
    Motors(motors::MotorsOptions),
    Ports(ports::PortsOptions),
    Reference(reference::ReferenceOptions),
    Replay(replay::ReplayOptions),
    Report(report::ReportOptions),
    Reset(reset::ResetOptions),
    Serve(serve::ServeOptions),
    Simulate(simulate::SimulateOptions),
    Status(status::StatusOptions),
    Stop(stop::StopOptions),
    Tables(tables::TablesOptions),
    Track(Box<track::TrackOptions>),
    Twin(twin::TwinOptions),
    Verify(verify::VerifyOptions),
    Zero(zero::ZeroOptions),
}

/// Runs the command; results go to `out`, one line at a time.
pub fn run(arguments: Arguments, out: &mut impl Write) -> Result<(), Failure> {
    use Command::{CalibrateStage, Home, Jog, Latency};
    let waits_for_rest = matches!(
        arguments.command,
        Some(Jog(_) | Home(_) | CalibrateStage(_) | Latency(_))
    );
    let outcome = run_any(arguments, out);
    let is_done = outcome.as_ref().err().is_none_or(Failure::is_closed_output);
    let reason = match serial::ending() {
        Ending::Unknown => "it is not known that the stage stands: look at it",
        Ending::Stopped if waits_for_rest => "the run ended in motion; the stage was stopped",
        Ending::Stopped | Ending::Quiet => return outcome,
    };
    match is_done {
        true => Err(Failure::Station(reason.to_owned().into())),
        false => outcome,
    }
}

fn run_any(arguments: Arguments, out: &mut impl Write) -> Result<(), Failure> {
    match arguments.command {
        None => experiment::run(&arguments.experiment, out),
        Some(Command::Align(options)) => align::run(&options, out),
        Some(Command::Calibrate(options)) => calibrate::run(&options, out),
        Some(Command::CalibrateStage(options)) => calibrate_stage::run(&options, out),
        Some(Command::Cameras(options)) => list_cameras::run(&options, out),
        Some(Command::Completions(options)) => completions::run(&options, out),
        Some(Command::Convert(options)) => convert::run(&options, out),
        Some(Command::Bench(options)) => bench::run(&options, out),
        Some(Command::Diagnose(options)) => diagnose::run(&options, out),
        Some(Command::Estimate(options)) => estimate::run(&options, out),
        Some(Command::Export(options)) => export::run(&options, out),
        Some(Command::Hello(options)) => hello::run(&options, out),
        Some(Command::Home(options)) => home::run(&options, out),
        Some(Command::Init(options)) => init::run(&options, out),
        Some(Command::Jog(options)) => jog::run(&options, out),
        Some(Command::Latency(options)) => latency::run(&options, out),
        Some(Command::Man(options)) => man::run(&options, out),
        Some(Command::Motors(options)) => motors::run(&options, out),
        Some(Command::Ports(options)) => ports::run(&options, out),
        Some(Command::Reference(options)) => reference::run(&options, out),
        Some(Command::Replay(options)) => replay::run(&options, out),
        Some(Command::Report(options)) => report::run(&options, out),
        Some(Command::Reset(options)) => reset::run(&options, out),
        Some(Command::Serve(options)) => serve::run(&options, out),
        Some(Command::Simulate(options)) => simulate::run(&options, out),
        Some(Command::Status(options)) => status::run(&options, out),
        Some(Command::Stop(options)) => stop::run(&options, out),
        Some(Command::Tables(options)) => tables::run(&options, out),
        Some(Command::Track(options)) => track::run(&options, out),
        Some(Command::Twin(options)) => twin::run(&options, out),
        Some(Command::Verify(options)) => verify::run(&options, out),
        Some(Command::Zero(options)) => zero::run(&options, out),
    }
}
