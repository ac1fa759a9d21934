//! The list of commands in the help, by purpose.

/// Help template: clap's own, with [`COMMANDS`] in place of the list.
pub const TEMPLATE: &str = "\
{about-with-newline}
{usage-heading} {usage}

{before-help}Options:
{options}{after-help}
";

/// List of all commands, by purpose.
pub const COMMANDS: &str = "\
Measure:
  estimate         Estimate the target's displacement from matched points or from images
  track            Follow a target: simulated, recorded, a folder that grows, or live cameras

Set up:
  init             Write a commented rig file to begin with: cameras, board and stage
  calibrate        Calibrate cameras and rig from photographs of a chessboard
  convert          Convert calibrations of OpenCV and ROS to a rig file, or a rig file to theirs
  align            Correct a rig's principal points from images of any textured scene
  verify           Predict what a rig can measure, and name what limits it
  calibrate-stage  Measure how the cameras sit on the stage (also: hand-eye)

Station:
  ports            List the serial ports that a station may be on
  hello            Ask the station on a serial port for its board, firmware and last run
  status           Show the station's state, fault and position
  jog              Move the stage by a distance along its axes, in mm
  home             Find the home switches, and with them the position
  zero             Make the present position zero on all axes
  stop             Stop the stage on a ramp; it stays stopped until `reset`
  reset            Clear a stop, or a fault whose cause is gone
  motors           Switch the motors of the stage on or off
  diagnose         Explain states and faults, or find the problem of a station

Simulate:
  simulate         Run scenarios on the built-in twin: target motion, occlusions, faults
  tables           Print the paper's Tables 1, 2, 5 and 6, ours beside the printed values

For developers:
  bench            Measure the speed and accuracy of this program's image processing
  completions      Print completions for a shell
  man              Write the manual pages into a folder

`trinocular help COMMAND` explains a command.
";

#[cfg(test)]
mod tests {
    use super::super::Arguments;
    use super::COMMANDS;
    use clap::CommandFactory as _;

    #[test]
    fn every_command_is_listed_once() {
        let mut listed: Vec<&str> = COMMANDS
            .lines()
            .filter_map(|line| line.strip_prefix("  "))
            .filter_map(|line| line.split_whitespace().next())
            .collect();
        listed.sort_unstable();
        let arguments = Arguments::command();
        let mut known: Vec<&str> = arguments.get_subcommands().map(|c| c.get_name()).collect();
        known.sort_unstable();
        assert_eq!(listed, known);
        assert!(COMMANDS.lines().all(|line| line.len() <= 100));
    }
}
