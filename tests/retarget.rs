//! Delay from a new setpoint to the first port word that it changes, in the step generator's own
//! time.

use trinocular_client::stage::{configuration, default_stage};
use trinocular_client::twin::Twin;
use trinocular_core::frame::message::{Command, Mounting};
use trinocular_core::replay::Record;
use trinocular_core::time::Instant;
use trinocular_rig::random::Random;

/// Largest delay, µs, that users of a stage may rely on.
const MOST_US: u64 = 2_000;

const MOMENTS: usize = 200;

/// Returns a twin on its way to 50 mm on all axes, `after_us` after the setpoint was sent.
fn on_its_way(after_us: u64) -> Twin {
    let stage = default_stage();
    let mut twin = Twin::power_on_recorded(&stage, "retarget").unwrap();
    let config = configuration(&stage, Mounting::OnStage).unwrap();
    twin.command("config", Command::Config(config)).unwrap();
    twin.zero().unwrap();
    twin.send(Command::Setpoint {
        position_um: [50_000; 3],
    });
    twin.advance(twin.now().plus_micros(after_us));
    twin
}

/// Returns the plan of every segment, and the instant at which it was given out.
fn plans(twin: &Twin) -> impl Iterator<Item = (Instant, u32)> {
    let records = twin.tape().expect("it was recorded").records().iter();
    records.filter_map(|record| match record {
        Record::Digest(at, digest) => Some((*at, digest.plan)),
        Record::Sent(..) => None,
    })
}

/// Two twins are identical until one of them gets a new setpoint; the first segment in which they
/// differ shows the delay. Before the end of the move every setpoint has an immediate effect,
/// because the axes accelerate, cruise or brake.
#[test]
fn new_setpoint_moves_pins_within_2_ms() {
    let mut random = Random::seeded(11);
    let (mut least_us, mut most_us) = (u64::MAX, 0);
    for _ in 0..MOMENTS {
        let after_us = 5_000 + random.below(400_000) as u64;
        let (mut one, mut other) = (on_its_way(after_us), on_its_way(after_us));
        let sent = one.now();
        one.send(Command::Setpoint {
            position_um: [-40_000; 3],
        });
        let delay_us = u64::from(one.client().hello().expect("it said hello").delay_us);
        for twin in [&mut one, &mut other] {
            twin.advance(sent.plus_micros(10_000));
        }
        let (changed, _) = plans(&one)
            .zip(plans(&other))
            .find(|(a, b)| a != b)
            .map(|(a, _)| a)
            .expect("it turns round");
        let took_us = changed.plus_micros(delay_us).since(sent);
        (least_us, most_us) = (least_us.min(took_us), most_us.max(took_us));
    }
    println!(
        "{MOMENTS} moments: the first changed word {least_us} to {most_us} us after the setpoint"
    );
    assert!(most_us <= MOST_US, "{most_us} us");
}
