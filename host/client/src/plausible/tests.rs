use super::*;
use trinocular_core::frame::message::Outcome;

const KNOWN: Known = Known {
    host_us: 5_000_000,
    station_us: Some(7_000_000),
    tick: Some(7_000),
};

fn field(report: &Report, known: Known) -> Option<&'static str> {
    check(report, known)
        .err()
        .map(|implausible| implausible.field)
}

fn pong(host_us: u64, received: u64, sent: u64) -> Report {
    Report::Pong {
        host_us,
        received: Instant::from_micros(received),
        sent: Instant::from_micros(sent),
    }
}

fn answer(tick: u32) -> Report {
    Report::Answer {
        sequence: 1,
        tick,
        outcome: Outcome::Accepted,
    }
}

#[test]
fn pong_must_follow_its_ping() {
    assert_eq!(field(&pong(5_000_000, 6_900_000, 6_900_010), KNOWN), None);
    assert_eq!(field(&pong(0, 0, 10_000_000), KNOWN), None);
    let future = pong(5_000_001, 6_900_000, 6_900_000);
    assert_eq!(field(&future, KNOWN), Some("pong.host_us"));
    let backwards = pong(4_000_000, 6_900_000, 6_899_999);
    assert_eq!(field(&backwards, KNOWN), Some("pong.sent"));
    let held = pong(4_000_000, 0, 10_000_001);
    assert_eq!(field(&held, KNOWN), Some("pong.sent"));
    let old = pong(0, LONGEST_UPTIME_US + 1, LONGEST_UPTIME_US + 1);
    assert_eq!(field(&old, KNOWN), Some("pong.received"));
}

#[test]
fn station_clock_cannot_jump_ahead() {
    let jumped = pong(5_000_000, 17_000_001, 17_000_001);
    assert_eq!(field(&jumped, KNOWN), Some("pong.sent"));
    let unknown = Known {
        station_us: None,
        ..KNOWN
    };
    assert_eq!(field(&jumped, unknown), None);
    assert_eq!(check_moment(6_000_000, 5_000_000), Ok(()));
    assert!(check_moment(6_000_001, 5_000_000).is_err());
}

#[test]
fn answer_is_near_the_latest_status() {
    for tick in [7_000 - 7_000, 7_001, 67_000, 7_000_u32.wrapping_sub(60_000)] {
        assert_eq!(field(&answer(tick), KNOWN), None, "{tick}");
    }
    for tick in [67_001, u32::MAX / 2, 7_000_u32.wrapping_sub(60_001)] {
        let named = Some("answer.tick minus status.tick");
        assert_eq!(field(&answer(tick), KNOWN), named, "{tick}");
    }
    let before = Known {
        tick: None,
        ..KNOWN
    };
    assert_eq!(field(&answer(u32::MAX / 2), before), None);
}

#[test]
fn message_names_value_and_range() {
    let implausible = check(&answer(67_001), KNOWN).unwrap_err().to_string();
    assert_eq!(
        implausible,
        "answer.tick minus status.tick from the station is 60001, must be -60000 to 60000: its \
         firmware is faulty or foreign"
    );
}
