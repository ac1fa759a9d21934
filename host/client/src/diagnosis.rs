//! Meaning of the station's states, faults and denials for the operator: one table, which
//! `trinocular diagnose` prints and every message quotes.

use trinocular_core::frame::message::{
    ConfigField, Denial, End, Hello, LastRun, ResetCause, Setting, Status,
};
use trinocular_core::safety::{Fault, State, Trust};
use trinocular_core::track::pursuit::Sight;

/// Row of the table of states.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StateText {
    /// Name in JSON and in the protocol's `schema.txt`.
    pub name: &'static str,
    /// Behaviour of the stage.
    pub meaning: &'static str,
    /// Action for the operator.
    pub action: &'static str,
}

/// Row of the table of faults.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultText {
    /// Name in JSON and in the protocol's `schema.txt`.
    pub name: &'static str,
    /// Cause of the fault.
    pub cause: &'static str,
    /// Action for the operator.
    pub action: &'static str,
    /// Quality of the position after the fault.
    pub position: &'static str,
}

/// Returns the row of a state.
pub const fn state(state: State) -> StateText {
    let (name, meaning, action) = match state {
        State::Unconfigured => (
            "unconfigured",
            "it knows nothing of its stage since it started: nothing moves",
            "give it the stage: `zero` or `jog` with --rig, or a run of `track`",
        ),
        State::Idle => ("idle", "at rest and ready", "nothing"),
        State::Moving => (
            "moving",
            "a jog or a move to a position is under way",
            "wait, or `stop`",
        ),
        State::Following => (
            "following",
            "it follows the target that a host describes",
            "end that program, or `stop`",
        ),
        State::Stopping => (
            "stopping",
            "it ramps down after a stop or a fault",
            "wait until it stands",
        ),
        State::Stopped => (
            "stopped",
            "a stop was commanded: nothing moves until a reset",
            "`reset`",
        ),
        State::Faulted => (
            "faulted",
            "a fault is latched: nothing moves until a reset",
            "see the fault; remove its cause, then `reset`",
        ),
        State::Homing => (
            "homing",
            "axes are looking for their home switches",
            "wait, or `stop`",
        ),
    };
    StateText {
        name,
        meaning,
        action,
    }
}

/// Returns the row of a fault.
pub const fn fault(fault: Fault) -> FaultText {
    let (name, cause, action) = match fault {
        Fault::Heartbeat => (
            "heartbeat",
            "the host fell silent while the stage moved; it stopped on a ramp",
            "see that program and line are well, then `reset`; on a busy computer a longer \
             --heartbeat",
        ),
        Fault::EmergencyStop => (
            "emergency_stop",
            "the emergency stop was pressed, or its wire is broken",
            "release it, `reset`, then `home` or `zero`",
        ),
        Fault::Limit => (
            "limit",
            "a limit switch was met, or its wire is broken",
            "`reset`, `jog` off the switch, then `home` or `zero`",
        ),
        Fault::Driver => (
            "driver",
            "a motor driver reports a fault",
            "check wiring, current and temperature, `reset`, then `home` or `zero`",
        ),
        Fault::Underrun => (
            "underrun",
            "the step engine fell behind or stopped: pulses were not made in time",
            "`reset`, `zero` or `home`; if it recurs, report `hello` and `status`",
        ),
        Fault::FollowingError => (
            "following_error",
            "the target stayed farther away than largest_error_mm for longer than \
             longest_error_s",
            "see that the stage is fast enough for the target and its matrix right \
             (`calibrate-stage`), then `reset`",
        ),
        Fault::LostSteps => (
            "lost_steps",
            "the stage went largest_unseen_mm towards the target, and the cameras did not see it \
             come nearer: a motor stalls or is off, or the matrix is wrong",
            "look for what blocks the stage, `reset`, then `home` or `zero`",
        ),
        Fault::SwitchNotFound => (
            "switch_not_found",
            "no home switch within the search way: it is at the other end, not wired, or the motor \
             does not move",
            "`reset`, see to the switch and home_switch in the rig file, then `home`",
        ),
        Fault::SwitchStuck => (
            "switch_stuck",
            "a home switch did not release when backed off, or bounces without end",
            "`reset`, `jog` off the switch or see to its wire, then `home`; a larger back_off_mm \
             if it has a long way",
        ),
        Fault::Restart => (
            "restart",
            "the station's program started anew by itself: watchdog, brown-out or crash",
            "`hello` tells what is known; see that the stage stands right, then `reset`, and \
             `home` or `zero`",
        ),
        Fault::Unstable => (
            "unstable_following",
            "the stage drives the target away or swings around it: the matrix, the steps per mm or \
             the delay of the cameras is wrong",
            "measure them with `calibrate-stage` (matrix and --delay), then `reset`",
        ),
    };
    let position = match fault {
        Fault::Heartbeat | Fault::FollowingError | Fault::Unstable => "good",
        Fault::LostSteps => "degraded: steps are lost",
        Fault::SwitchNotFound | Fault::SwitchStuck => {
            "as it was before `home`; unknown for an axis that never was homed"
        }
        Fault::Restart => "unknown: it begins anew at 0",
        Fault::EmergencyStop | Fault::Limit | Fault::Driver | Fault::Underrun => {
            "degraded if it moved: steps may be lost"
        }
    };
    FaultText {
        name,
        cause,
        action,
        position,
    }
}

/// Returns the table of every state and fault with its number, as `trinocular diagnose --list`
/// prints it and `FAULTS.md` holds it.
pub fn table() -> String {
    let lines = |number: u8, name: &str, first: &str, others: &[(&str, &str)]| {
        let mut lines = format!("  {number} {name:<18}  {first}\n");
        for (label, value) in others {
            lines.push_str(&format!("{:24}{label}: {value}\n", ""));
        }
        lines
    };
    let states = State::ALL.map(|each| {
        let text = state(each);
        lines(
            each.number(),
            text.name,
            text.meaning,
            &[("do", text.action)],
        )
    });
    let faults = Fault::ALL.map(|each| {
        let text = fault(each);
        let others = [("do", text.action), ("position", text.position)];
        lines(each.number(), text.name, text.cause, &others)
    });
    format!("States\n{}\nFaults\n{}", states.concat(), faults.concat())
}

/// Returns cause and action of a fault in one sentence.
///
/// ```
/// use trinocular_client::diagnosis::{explain, fault};
/// use trinocular_core::safety::Fault;
///
/// assert_eq!(fault(Fault::Heartbeat).position, "good");
/// assert!(explain(Fault::Heartbeat).contains(fault(Fault::Heartbeat).action));
/// ```
pub fn explain(latched: Fault) -> String {
    let FaultText { cause, action, .. } = fault(latched);
    format!("{cause}: {action}")
}

/// Returns the quality of a position in words. A position is known from `home` or `zero`; the
/// station does not report from which.
pub const fn position(trust: Trust) -> &'static str {
    match trust {
        Trust::Unknown => "unknown",
        Trust::Homed => "known",
        Trust::Degraded => "degraded",
    }
}

/// Returns the name of a trust in JSON and in the protocol's `schema.txt`.
pub const fn trust(trust: Trust) -> &'static str {
    match trust {
        Trust::Unknown => "unknown",
        Trust::Homed => "homed",
        Trust::Degraded => "degraded",
    }
}

/// Returns the name of a sight in JSON, in scenarios and in the protocol's `schema.txt`.
pub const fn sight(sight: Sight) -> &'static str {
    match sight {
        Sight::None => "none",
        Sight::Tracking => "tracking",
        Sight::Coasting => "coasting",
        Sight::Lost => "lost",
    }
}

/// Returns the remedy for a denial, if there is one.
pub const fn remedy(denial: Denial) -> Option<&'static str> {
    Some(match denial {
        Denial::Unconfigured => {
            "it forgets its configuration when it restarts; give it one with --rig RIG.toml"
        }
        Denial::Moving => "wait until it stands, or stop it with `trinocular stop`",
        Denial::PositionUnknown => {
            "`trinocular home` finds it, `trinocular zero` makes the present position zero"
        }
        Denial::OutsideWindow => {
            "unknown_window_mm in the rig file says how far it may go until then"
        }
        Denial::NoHomeSwitch => "home_switch in the rig file says where an axis has one",
        Denial::Stopped => "`trinocular reset` lets it move again",
        Denial::Faulted => {
            "`trinocular status` names the fault; remove its cause, then `trinocular reset`"
        }
        Denial::CauseRemains => "release the emergency stop, or see to the driver, then again",
        Denial::Config(ConfigField::Value {
            setting: Setting::TriggerRate | Setting::TriggerPulse | Setting::TriggerQuiet,
            ..
        }) => "correct the [trigger] of the rig file",
        Denial::Config(_) => "correct the [stage] of the rig file",
        Denial::LimitSwitch => "move the other way, off the switch",
        Denial::Dropped => "`trinocular reset` lets it move again, then send it anew",
        Denial::OutsideTravel { .. } => {
            "`jog` that axis back into travel_mm; or correct travel_mm in the rig file"
        }
        Denial::NoHeartbeat => "send pings before and during a motion",
        Denial::FaultUnread => {
            "`trinocular status` names the fault; remove its cause, then `trinocular reset`"
        }
        Denial::MotorsOff => "`trinocular motors on` switches them on",
        Denial::NoCameraPin => {
            "remove [trigger] from the rig file, and let the cameras run freely; or use a board \
             with a camera pin"
        }
        Denial::Estimate(_)
        | Denial::CaptureInFuture
        | Denial::CaptureTooOld
        | Denial::CaptureOutOfOrder
        | Denial::UnknownReference
        | Denial::Outlier => return None,
    })
}

/// Returns the operator's next action for a station in this condition; `None` if it is ready for
/// any command.
pub fn next_step(status: &Status) -> Option<String> {
    if let Some(latched) = status.fault {
        return Some(fault(latched).action.to_owned());
    }
    if status.state != State::Idle {
        return Some(state(status.state).action.to_owned());
    }
    if !status.motors {
        return Some("`motors on`, then `home` or `zero`".to_owned());
    }
    match status.trust {
        Trust::Homed => None,
        Trust::Unknown => Some(
            "`home`; or `jog` to where zero is to be (slowly, near by, without soft limits), then \
             `zero`"
                .to_owned(),
        ),
        Trust::Degraded => Some(
            "steps may be lost: `home`; or see where the stage stands, `jog` it to its zero, then \
             `zero`"
                .to_owned(),
        ),
    }
}

/// Returns the end of the station's last run in words; `None` if the station was switched on or
/// reset from outside without a fault.
pub fn last_run(hello: &Hello, last: &LastRun) -> Option<String> {
    let end = match last.end {
        End::Panic => Some("its program panicked"),
        End::HardFault => Some("its processor faulted"),
        End::Outside if hello.reset_cause == ResetCause::Watchdog => {
            Some("its program hung, so that the watchdog reset it")
        }
        End::Outside => None,
    };
    let latched = last.fault.map(|latched| {
        format!(
            "fault {} ({}) was latched",
            latched.number(),
            fault(latched).name
        )
    });
    let parts: Vec<String> = end.map(str::to_owned).into_iter().chain(latched).collect();
    (!parts.is_empty()).then(|| parts.join("; "))
}

/// Returns the addresses of a crash, to be looked up in the program. A return address lies behind
/// the call, and its lowest bit marks Thumb code; both are corrected.
pub fn places(last: &LastRun) -> Vec<u32> {
    let even = |(index, place): (usize, &u32)| match index {
        0 => *place,
        _ => (place & !1).saturating_sub(2),
    };
    let known = last.places.iter().enumerate().filter(|(_, p)| **p != 0);
    known.map(even).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use trinocular_core::frame::SCHEMA;
    use trinocular_core::frame::message::PLACES;

    /// Names of states, faults and sights are those of the protocol.
    #[test]
    fn names_match_the_schema() {
        let line = |kind: &str| {
            let line = SCHEMA.lines().find(|line| line.starts_with(kind));
            line.expect("the schema has it").to_owned()
        };
        let states = State::ALL.map(|s| format!(" {} {}", s.number(), state(s).name));
        assert_eq!(line("state "), format!("state{}", states.concat()));
        let faults = Fault::ALL.map(|f| format!(" {} {}", f.number(), fault(f).name));
        assert_eq!(line("fault "), format!("fault{}", faults.concat()));
        let sights = [Sight::None, Sight::Tracking, Sight::Coasting, Sight::Lost];
        let sights = sights.map(|s| format!(" {} {}", s as u8, sight(s)));
        assert_eq!(line("sight "), format!("sight{}", sights.concat()));
    }

    /// The table agrees with the behaviour of the machine: see `shared/src/machine/fault.rs`.
    #[test]
    fn step_losing_faults_degrade_position() {
        for each in Fault::ALL {
            let good = fault(each).position == "good";
            assert!(
                !good || !(each.is_abrupt() || each.loses_steps()),
                "{each:?}"
            );
        }
    }

    #[test]
    fn crash_report_points_into_calls() {
        let hello = |reset_cause| Hello {
            protocol: 1,
            schema: 0,
            version: [0, 1, 0],
            board: Default::default(),
            word_rate_hz: 1_000_000,
            delay_us: 1,
            session: 1,
            reset_cause,
        };
        let mut places_kept = [0; PLACES];
        places_kept[..2].copy_from_slice(&[0x0800_1234, 0x0800_5679]);
        let crashed = LastRun {
            starts: 2,
            fault: Some(Fault::Underrun),
            end: End::Panic,
            places: places_kept,
        };
        let watchdog = hello(ResetCause::Watchdog);
        let text = last_run(&watchdog, &crashed).expect("a crash");
        assert!(
            text.contains("panicked") && text.contains("fault 4 (underrun)"),
            "{text}"
        );
        assert_eq!(places(&crashed), [0x0800_1234, 0x0800_5676]);
        let hung = last_run(&watchdog, &LastRun::UNKNOWN).expect("a hang");
        assert!(hung.contains("hung"), "{hung}");
        assert_eq!(last_run(&hello(ResetCause::Pin), &LastRun::UNKNOWN), None);
    }
}
