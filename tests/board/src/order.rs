//! What tests order the station to do.

use host::rig_file::Driver;
use host::client::stage::{configuration, default_stage};
use shared::frame::message::{Command, Config, Mounting};

/// The default stage with these drivers, the cameras on it.
pub fn config(driver: Driver) -> Config {
    let mut stage = default_stage();
    stage.driver = driver;
    configuration(&stage, Mounting::OnStage).expect("the default fits")
}

/// A move by so many µm.
pub fn jog(um: [i32; 3]) -> Command {
    Command::Jog { distance_um: um }
}
