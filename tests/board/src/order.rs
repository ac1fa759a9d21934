//! Orders of tests to the station.

use host::client::stage::{configuration, default_stage};
use host::rig_file::Driver;
use shared::frame::message::{Command, Config, Mounting};

/// Returns the default stage with these drivers, the cameras on it.
pub fn config(driver: Driver) -> Config {
    let mut stage = default_stage();
    stage.driver = driver;
    configuration(&stage, Mounting::OnStage).expect("the default fits")
}

/// Returns a move by `um` µm per axis.
pub fn jog(um: [i32; 3]) -> Command {
    Command::Jog { distance_um: um }
}
