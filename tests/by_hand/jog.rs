//! `jog`: distances, limits, and what ends it early.

use super::{CONFIGURE, Desk, moving};
use serde_json::json;
use trinocular_client::serial::{Access, Serial};
use trinocular_client::stage::{configuration_at, default_stage};
use trinocular_core::frame::message::{Command as StationCommand, Mounting};
use trinocular_tests::binary::interrupt;
use trinocular_tests::far_end::station;

#[test]
fn jog_takes_units_of_length() {
    let end = station();
    let desk = Desk::new(&end.path);
    desk.run(&format!("zero {CONFIGURE}")).ended(0, &[]);
    let jog = desk.run(&format!("jog x=2mm y=500um z=-0.1cm {CONFIGURE} --json"));
    let jog = jog.ended(0, &[]).json();
    assert_eq!(jog["asked_mm"], json!([2.0, 0.5, -1.0]));
    assert_eq!(jog["moved_mm"], json!([2.0, 0.5, -1.0]));
    assert_eq!(jog["shortened"], json!([]));
    assert_eq!(end.steps(), [160, 40, -80]);
    // Without the rig file, mm and soft limits are unknown, which is reported.
    let jog = desk.run("jog x=100");
    assert!(jog.err.contains("with --rig RIG.toml"), "{}", jog.err);
    assert_eq!(end.steps(), [4_800, 40, -80]);
}

#[test]
fn reset_does_not_wait_for_the_end_of_a_jog() {
    let end = station();
    let desk = Desk::new(&end.path);
    let mut stage = default_stage();
    stage.max_speed_mm_s = [5.0; 3];
    let config = configuration_at(&stage, Mounting::OnStage, 10_000).expect("it fits");
    let mut owner = Serial::start_as(&end.path, config).expect("the station starts");
    owner.set_access(Access::Open).expect("opening never fails");
    let distance_um = [50_000, 0, 0];
    let jog = StationCommand::Jog { distance_um };
    owner.command("jog", jog).expect("it is allowed");
    desk.run("reset").ended(3, &["the stage is moving"]);
    desk.run("stop").ended(0, &["stopped"]);
    assert_eq!(desk.status()["state"], "stopped");
    desk.run("reset").ended(0, &["idle"]);
}

#[test]
fn jog_beyond_soft_limit_is_shortened() {
    let end = station();
    let desk = Desk::new(&end.path);
    desk.run(&format!("zero {CONFIGURE}")).ended(0, &[]);
    let jog = desk.run(&format!("jog y=-80 {CONFIGURE}"));
    let jog = jog.ended(0, &["0.0000 -60.0000 0.0000 mm"]);
    assert!(
        jog.err
            .contains("y was shortened to -60.0000 mm of -80 mm by the soft limits"),
        "{}",
        jog.err
    );
    assert_eq!(end.steps(), [0, -4_800, 0]);
}

#[test]
fn interrupted_jog_stops_on_ramp() {
    let end = station();
    let desk = Desk::new(&end.path);
    // At 5 mm/s the jog takes ten seconds unless it is interrupted.
    let jog = desk.start("jog x=50 --rig wide.toml --heartbeat 5000");
    moving(&end);
    interrupt(&jog);
    let done = jog.wait_with_output().expect("it ends");
    let (out, err) = (
        String::from_utf8_lossy(&done.stdout),
        String::from_utf8_lossy(&done.stderr),
    );
    assert_eq!(done.status.code(), Some(3), "{err}");
    assert!(
        err.contains("interrupted") && err.contains("`reset`"),
        "{err}"
    );
    let stood = end.steps();
    assert!(
        stood[0] < 4_000 && out.contains(&format!("({} 0 0 steps)", stood[0])),
        "{out}"
    );
    assert_eq!(desk.status()["state"], "stopped");
    assert_eq!(end.standing(), stood);
}

#[test]
fn killed_jog_leaves_clearable_fault() {
    let end = station();
    let desk = Desk::new(&end.path);
    let mut jog = desk.start("jog x=50 --rig wide.toml --heartbeat 1000");
    moving(&end);
    jog.kill().expect("it runs");
    jog.wait().expect("it ends");
    let stood = end.standing();
    assert!(stood[0] < 4_000, "{stood:?}");
    let status = desk.run("status").ended(3, &["fault 0", &end.path]);
    assert!(
        status.out.contains("the host fell silent"),
        "{}",
        status.out
    );
    assert_eq!(
        desk.status()["fault"],
        json!({"number": 0, "name": "heartbeat"})
    );
    desk.run("diagnose")
        .ended(0, &["States", "faulted", "`reset`"]);
    desk.run("jog x=1")
        .ended(3, &["a fault is latched", "trinocular reset"]);
    desk.run("reset")
        .ended(0, &["cleared fault 0", "idle", "next"]);
    assert_eq!(end.steps(), stood);
}

#[test]
fn jog_below_a_step_is_refused() {
    let end = station();
    let desk = Desk::new(&end.path);
    let parts = ["x=0.001", "less than half a step", "0.0125 mm"];
    // Before the port is opened, and as a whole.
    let refused = desk.run("jog y=1 x=0.001 --rig rig.toml");
    refused.ended(2, &parts);
    assert_eq!(desk.status()["state"], "unconfigured");
    desk.run(&format!("jog x=0.0070 y=-0.007 {CONFIGURE}"))
        .ended(0, &["(1 -1 0 steps)"]);
    // Without the stage only the station knows its steps.
    let unknown = desk.run("jog x=0.001 y=1");
    assert!(
        unknown.err.contains("x did not move") && !unknown.err.contains("y did not"),
        "{}",
        unknown.err
    );
    unknown.ended(0, &["moved by  0 80 0 steps"]);
}
