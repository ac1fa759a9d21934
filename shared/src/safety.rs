//! States of the station, trust in its position, and numbered faults.

use serde::{Deserialize, Serialize};

/// Activity of the station.
///
/// ```
/// use trinocular_core::safety::State;
///
/// assert!(State::Stopping.is_moving() && !State::Stopping.is_commanded());
/// assert_eq!(State::ALL[State::Homing.number() as usize], State::Homing);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum State {
    /// The station has no configuration: nothing moves.
    #[default]
    Unconfigured,
    /// The stage is at rest and ready.
    Idle,
    /// A setpoint or jog is under way.
    Moving,
    /// The stage follows the target that the flow frames describe.
    Following,
    /// The stage ramps down after a stop or a fault.
    Stopping,
    /// Stopped by command: nothing moves until a reset.
    Stopped,
    /// A fault is latched: nothing moves until a reset.
    Faulted,
    /// Axes search their home switches.
    Homing,
}

impl State {
    /// All states, ordered by number.
    pub const ALL: [Self; 8] = [
        Self::Unconfigured,
        Self::Idle,
        Self::Moving,
        Self::Following,
        Self::Stopping,
        Self::Stopped,
        Self::Faulted,
        Self::Homing,
    ];

    /// Returns the number of the state.
    pub const fn number(self) -> u8 {
        self as u8
    }

    /// Returns true if the stage may be in motion.
    pub const fn is_moving(self) -> bool {
        self.is_commanded() || matches!(self, Self::Stopping)
    }

    /// Returns true if the stage moves at a host's command, so that the host must send heartbeats
    /// meanwhile.
    pub const fn is_commanded(self) -> bool {
        matches!(self, Self::Moving | Self::Following | Self::Homing)
    }
}

/// Trust in the station's position.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Trust {
    /// The position was never defined since power-up: only slow jogs within the window are
    /// possible.
    #[default]
    Unknown,
    /// The stage is homed or zeroed.
    Homed,
    /// The stage was homed, but an abrupt stop or a fault may have lost steps since: zero or home
    /// again. Treated as unknown.
    Degraded,
}

/// Cause of a stop. The numbers are part of the protocol and never change their meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Fault {
    /// 0: no ping within the heartbeat timeout while moving. Ramped stop; the position stays valid.
    Heartbeat,
    /// 1: the emergency stop is open. Abrupt stop; the position is degraded.
    EmergencyStop,
    /// 2: a limit switch tripped. Abrupt stop; the position is degraded.
    Limit,
    /// 3: a driver reports a fault. Abrupt stop; the position is degraded.
    Driver,
    /// 4: the step engine fell behind or stopped, so that words were not emitted in time. Abrupt
    /// stop; the position is degraded.
    Underrun,
    /// 5: the distance to the target stayed above its limit for longer than allowed. Ramped stop;
    /// the position stays valid.
    FollowingError,
    /// 6: the cameras did not see the stage move as commanded: steps are lost, or a motor is off.
    /// Ramped stop; the position is degraded.
    LostSteps,
    /// 7: no home switch within the search distance. Ramped stop; the position of the axis stays
    /// unknown.
    SwitchNotFound,
    /// 8: a home switch does not release after backing off, or does not stay tripped. Ramped stop;
    /// the position of the axis stays unknown.
    SwitchStuck,
    /// 9: the program restarted by itself: watchdog, brown-out, panic. Nothing moves until a reset;
    /// the position is unknown.
    Restart,
    /// 10: following is unstable: the stage increases the target's distance, or oscillates around
    /// the target. Ramped stop; the position stays valid.
    Unstable,
}

impl Fault {
    /// All faults, ordered by number.
    pub const ALL: [Self; 11] = [
        Self::Heartbeat,
        Self::EmergencyStop,
        Self::Limit,
        Self::Driver,
        Self::Underrun,
        Self::FollowingError,
        Self::LostSteps,
        Self::SwitchNotFound,
        Self::SwitchStuck,
        Self::Restart,
        Self::Unstable,
    ];

    /// All faults, the worst first: those that forbid any motion, those after which steps may be
    /// missing, and those that leave the position valid.
    pub const RANKED: [Self; 11] = [
        Self::EmergencyStop,
        Self::Driver,
        Self::Limit,
        Self::Underrun,
        Self::Restart,
        Self::LostSteps,
        Self::SwitchStuck,
        Self::SwitchNotFound,
        Self::Unstable,
        Self::FollowingError,
        Self::Heartbeat,
    ];

    /// Returns the number of the fault.
    pub const fn number(self) -> u8 {
        self as u8
    }

    /// Returns true if motion ends at once, without a ramp, which may lose steps.
    pub const fn is_abrupt(self) -> bool {
        matches!(
            self,
            Self::EmergencyStop | Self::Limit | Self::Driver | Self::Underrun
        )
    }

    /// Returns true if steps may be missing although the stop itself lost none.
    pub const fn loses_steps(self) -> bool {
        matches!(self, Self::LostSteps)
    }
}

/// A set of faults: bit `n` stands for the fault with number `n`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Faults(u16);

impl Faults {
    /// Empty set.
    pub const NONE: Self = Self(0);

    /// Adds a fault to the set.
    pub const fn insert(&mut self, fault: Fault) {
        self.0 |= Self::bit(fault);
    }

    /// Returns true if the fault is in the set.
    pub const fn contains(self, fault: Fault) -> bool {
        self.0 & Self::bit(fault) != 0
    }

    /// Returns true if the set is empty.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Returns true if every fault of this set is also in `other`.
    pub const fn is_within(self, other: Self) -> bool {
        self.0 & !other.0 == 0
    }

    /// Returns the worst fault of the set, by [`Fault::RANKED`].
    pub fn worst(self) -> Option<Fault> {
        self.iter().next()
    }

    /// Returns the faults of the set, the worst first.
    pub fn iter(self) -> impl Iterator<Item = Fault> {
        let all = Fault::RANKED.into_iter();
        all.filter(move |fault| self.contains(*fault))
    }

    const fn bit(fault: Fault) -> u16 {
        1 << fault.number()
    }
}

impl FromIterator<Fault> for Faults {
    fn from_iter<I: IntoIterator<Item = Fault>>(faults: I) -> Self {
        let mut set = Self::NONE;
        for fault in faults {
            set.insert(fault);
        }
        set
    }
}

/// Switches and progress of the step engine, as sampled by the shell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Inputs {
    /// Limit switches of each axis, negative end first; true is tripped (contact open).
    pub limits: [[bool; 2]; 3],
    /// True while the emergency stop is open.
    pub emergency_stop: bool,
    /// True while a driver's fault line is active.
    pub driver_fault: bool,
    /// Number of port words emitted since the start.
    pub words_emitted: u64,
    /// Number of times that the step engine could not give the cameras what was planned, modulo
    /// 2^32: it was late, or its timer stopped. All triggers on their way then count as lost.
    pub trigger_losses: u32,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_is_ranked_once() {
        let ranked: Faults = Fault::RANKED.into_iter().collect();
        assert!(Fault::ALL.into_iter().all(|fault| ranked.contains(fault)));
        for (number, fault) in (0..).zip(Fault::ALL) {
            assert_eq!(fault.number(), number);
        }
    }

    #[test]
    fn worst_fault_comes_first() {
        let set: Faults = [Fault::Heartbeat, Fault::EmergencyStop, Fault::Limit]
            .into_iter()
            .collect();
        assert_eq!(set.worst(), Some(Fault::EmergencyStop));
        assert!(
            set.iter()
                .eq([Fault::EmergencyStop, Fault::Limit, Fault::Heartbeat])
        );
        assert_eq!(Faults::NONE.worst(), None);
        assert!(Faults::NONE.is_within(set) && !set.is_within(Faults::NONE));
    }
}
