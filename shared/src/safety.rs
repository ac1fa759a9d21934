//! States, trust in the position, and numbered faults.

use serde::{Deserialize, Serialize};

/// What the station is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum State {
    /// No configuration yet: nothing moves.
    #[default]
    Unconfigured,
    /// At rest, ready.
    Idle,
    /// A setpoint or jog is under way.
    Moving,
    /// Following the target that flow frames describe.
    Following,
    /// Ramping down after a stop or a fault.
    Stopping,
    /// Stopped by command: nothing moves until a reset.
    Stopped,
    /// A fault is latched: nothing moves until a reset.
    Faulted,
    /// Axes are looking for their home switches.
    Homing,
}

impl State {
    /// Every state, at its number.
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

    /// The state's number.
    pub const fn number(self) -> u8 {
        self as u8
    }

    /// Whether the stage may be in motion.
    pub const fn is_moving(self) -> bool {
        self.is_commanded() || matches!(self, Self::Stopping)
    }

    /// Whether it moves because a host wants it to: the host must be heard meanwhile.
    pub const fn is_commanded(self) -> bool {
        matches!(self, Self::Moving | Self::Following | Self::Homing)
    }
}

/// How far the station's idea of its position can be trusted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Trust {
    /// Since power-up nobody said where it is: only slow jogs, near by.
    #[default]
    Unknown,
    /// Homed or zeroed.
    Homed,
    /// Homed once, but steps may have been lost since (abrupt stop): zero or home again. Treated as
    /// unknown.
    Degraded,
}

/// Why motion was stopped. The numbers are part of the protocol and never change their meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Fault {
    /// 0: no ping within the heartbeat time while moving. Ramped stop; the position is still good.
    Heartbeat,
    /// 1: the emergency stop is open. Abrupt stop; the position is degraded.
    EmergencyStop,
    /// 2: a limit switch was met. Abrupt stop; the position is degraded.
    Limit,
    /// 3: a driver reports a fault. Abrupt stop; the position is degraded.
    Driver,
    /// 4: the step engine fell behind or stopped: words were not emitted in time. Abrupt stop; the
    /// position is degraded.
    Underrun,
    /// 5: the target stayed farther away than allowed for longer than allowed. Ramped stop; the
    /// position is still good.
    FollowingError,
    /// 6: the cameras did not see the stage move as it was commanded to: steps are lost, or a motor
    /// is off. Ramped stop; the position is degraded.
    LostSteps,
    /// 7: no home switch within the search way. Ramped stop; where the axis is stays unknown.
    SwitchNotFound,
    /// 8: a home switch that does not release when backed off, or does not stay tripped. Ramped
    /// stop; where the axis is stays unknown.
    SwitchStuck,
    /// 9: the program restarted by itself: watchdog, brown-out, panic. Nothing moves until a reset;
    /// the position is unknown.
    Restart,
    /// 10: following is unstable: the stage makes the target's distance larger, or swings around
    /// it. Ramped stop; the position is still good.
    Unstable,
}

impl Fault {
    /// Every fault, at its number.
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

    /// Every fault, the worst first: those that forbid any motion, those after which steps may be
    /// missing, and those that leave the position good.
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

    /// The fault's number.
    pub const fn number(self) -> u8 {
        self as u8
    }

    /// Whether motion ends at once, without a ramp, which may lose steps.
    pub const fn is_abrupt(self) -> bool {
        matches!(
            self,
            Self::EmergencyStop | Self::Limit | Self::Driver | Self::Underrun
        )
    }

    /// Whether steps may be missing although the stop itself lost none.
    pub const fn loses_steps(self) -> bool {
        matches!(self, Self::LostSteps)
    }
}

/// A set of faults: bit `n` stands for the fault with number `n`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Faults(u16);

impl Faults {
    /// No fault.
    pub const NONE: Self = Self(0);

    /// Adds a fault.
    pub const fn insert(&mut self, fault: Fault) {
        self.0 |= Self::bit(fault);
    }

    /// Returns whether the fault is in the set.
    pub const fn contains(self, fault: Fault) -> bool {
        self.0 & Self::bit(fault) != 0
    }

    /// Returns whether there is no fault in the set.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Returns whether every fault of this set is in `other`, too.
    pub const fn is_within(self, other: Self) -> bool {
        self.0 & !other.0 == 0
    }

    /// The worst fault of the set, by [`Fault::RANKED`].
    pub fn worst(self) -> Option<Fault> {
        self.iter().next()
    }

    /// The faults of the set, the worst first.
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

/// The switches and what the step engine did, as sampled by the shell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Inputs {
    /// Per axis: limit switch at the negative end, at the positive end. `true` is tripped (contact
    /// open).
    pub limits: [[bool; 2]; 3],
    /// The emergency stop is open.
    pub emergency_stop: bool,
    /// A driver's fault line is active.
    pub driver_fault: bool,
    /// Port words emitted since the start.
    pub words_emitted: u64,
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
    fn worst_fault_of_a_set_comes_first() {
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
