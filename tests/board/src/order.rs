//! Orders of tests to the station.

use trinocular_client::stage::{configuration, default_stage};
use trinocular_core::frame::message::{Command, Config, Mounting};
use trinocular_rig::rig_file::Driver;

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
