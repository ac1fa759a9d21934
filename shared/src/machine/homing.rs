//! Homing: axes search their home switches, which define the position.
//!
//! One axis moves after the other, Z first, because that moves the cameras away from the target:
//!
//! 1. *Look*: if the switch is tripped already, continue with 3.
//! 2. *Search*: move towards the switch at the first speed, at most five quarters of the axis's
//!    travel plus the back-off; ramp to rest when it trips.
//! 3. *Release*: back off from where it tripped. It must have released by then.
//! 4. *Approach*: move onto it again at the second speed, at most two back-offs. The stage's
//!    position when it trips is the home position.
//! 5. *Leave*: back off again; it must have released. Then the axis's origin is set.
//!
//! Soft limits do not apply meanwhile, and the switch searched for is no fault; every other switch
//! is. Nothing stops abruptly, so a search that ends by a stop or a heartbeat timeout leaves the
//! position as good as it was.
//!
//! *Bounce:* a switch counts as tripped or released when it has been so for [`STEADY`] consecutive
//! ticks; the place is that of the first of these. A switch that is not steady within [`PATIENCE`]
//! ticks at rest is stuck.

use super::Machine;
use crate::fixed::{shift_right_rounded, times};
use crate::frame::message::{Denial, HomeSwitch, Side};
use crate::motion::Limits;
use crate::safety::{Fault, State, Trust};
use crate::steps::Position;

/// Ticks for which a contact must be steady.
const STEADY: u16 = 5;

/// Ticks for which a stage at rest waits for a steady contact.
const PATIENCE: u16 = 100;

/// Order in which the axes are homed.
const ORDER: [usize; 3] = [2, 0, 1];

/// State of a search.
#[derive(Clone, Copy, Debug)]
pub(super) struct Homing {
    /// Axes that are still to be homed, the present one included.
    axes: [bool; 3],
    axis: usize,
    home: HomeSwitch,
    phase: Phase,
    contact: Contact,
    /// Ticks at rest in this phase.
    rested: u16,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Look,
    Search,
    /// Place at which the switch tripped, 2⁻³² steps; true once the axis is under way there.
    Release(i64, bool),
    Approach,
    Leave(i64, bool),
}

/// Recent samples of a switch.
#[derive(Clone, Copy, Debug, Default)]
struct Contact {
    tripped: bool,
    /// Number of ticks with this level.
    ticks: u16,
    /// Position of the axis at the first of these ticks, 2⁻³² steps.
    at: i64,
}

impl Contact {
    fn see(&mut self, tripped: bool, at: i64) {
        if self.tripped != tripped || self.ticks == 0 {
            *self = Self {
                tripped,
                ticks: 0,
                at,
            };
        }
        self.ticks = self.ticks.saturating_add(1);
    }

    fn steady(&self) -> Option<bool> {
        (self.ticks >= STEADY).then_some(self.tripped)
    }
}

/// Action that the machine must take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Action {
    Wait,
    /// Stop on a ramp.
    Halt,
    /// Move to this place, 2⁻³² steps; true for the second speed.
    Go(i64, bool),
    /// Homing of the axis is complete: its switch tripped at this place.
    Done(i64),
    Fail(Fault),
}

impl Homing {
    fn new(axes: [bool; 3], homes: &[Option<HomeSwitch>; 3]) -> Option<Self> {
        let wanted = |axis: &usize| axes.get(*axis) == Some(&true);
        let axis = ORDER.into_iter().find(wanted)?;
        Some(Self {
            axes,
            axis,
            home: (*homes.get(axis)?)?,
            phase: Phase::Look,
            contact: Contact::default(),
            rested: 0,
        })
    }

    /// Returns the switch searched for.
    fn switch(&self) -> (usize, usize) {
        (self.axis, self.home.side as usize)
    }

    /// Returns the distance `way`, signed towards the switch.
    fn towards(&self, distance: i64) -> i64 {
        match self.home.side {
            Side::Negative => distance.saturating_neg(),
            Side::Positive => distance,
        }
    }

    fn enter(&mut self, phase: Phase) {
        self.phase = phase;
        self.rested = 0;
    }

    /// Executes one tick. `at` is the position of the axis, `stands` is true at rest; `search` and
    /// `back_off` are distances, all 2⁻³² steps.
    fn tick(&mut self, at: i64, stands: bool, search: i64, back_off: i64) -> Action {
        if stands {
            self.rested = self.rested.saturating_add(1);
        }
        let undecided = match self.rested > PATIENCE {
            true => Action::Fail(Fault::SwitchStuck),
            false => Action::Wait,
        };
        let steady = self.contact.steady();
        let place = self.contact.at;
        match self.phase {
            Phase::Look => match steady {
                None => undecided,
                Some(true) => {
                    self.enter(Phase::Release(at, false));
                    Action::Wait
                }
                Some(false) => {
                    self.enter(Phase::Search);
                    Action::Go(at.saturating_add(self.towards(search)), false)
                }
            },
            Phase::Search | Phase::Approach if steady == Some(true) => {
                self.enter(match self.phase {
                    Phase::Search => Phase::Release(place, false),
                    _ => Phase::Leave(place, false),
                });
                Action::Halt
            }
            Phase::Search | Phase::Approach => match stands {
                true => Action::Fail(Fault::SwitchNotFound),
                false => Action::Wait,
            },
            _ if !stands => Action::Wait,
            Phase::Release(place, false) | Phase::Leave(place, false) => {
                self.enter(match self.phase {
                    Phase::Release(..) => Phase::Release(place, true),
                    _ => Phase::Leave(place, true),
                });
                Action::Go(place.saturating_sub(self.towards(back_off)), false)
            }
            // The contact must be steady at rest.
            _ if self.rested < STEADY => Action::Wait,
            Phase::Release(place, true) => match steady {
                None => undecided,
                Some(true) => Action::Fail(Fault::SwitchStuck),
                Some(false) => {
                    self.enter(Phase::Approach);
                    Action::Go(place.saturating_add(self.towards(back_off)), true)
                }
            },
            Phase::Leave(place, true) => match steady {
                None => undecided,
                Some(true) => Action::Fail(Fault::SwitchStuck),
                Some(false) => Action::Done(place),
            },
        }
    }
}

impl Machine {
    /// Starts the search for the home switches of these axes.
    pub(super) fn home(&mut self, axes: [bool; 3]) -> Result<(), Denial> {
        self.require_ready()?;
        self.require_rest()?;
        let active = self.active.as_ref().ok_or(Denial::Unconfigured)?;
        let homes = &active.config.stage.home;
        let lacks = |(wanted, home): (bool, &Option<_>)| wanted && home.is_none();
        if axes.into_iter().zip(homes).any(lacks) {
            return Err(Denial::NoHomeSwitch);
        }
        let homing = Homing::new(axes, homes).ok_or(Denial::NoHomeSwitch)?;
        self.homing = Some(homing);
        self.state = State::Homing;
        self.tracker.reset();
        Ok(())
    }

    /// Ends the search; the stage continues its motion. The switch searched for is no fault until
    /// the stage is at rest, so that a stop on the way onto it keeps the position.
    pub(super) fn give_up_homing(&mut self) {
        if let Some(homing) = self.homing.take() {
            self.abandoned_switch = Some(homing.switch());
        }
    }

    /// Returns the limit switches without the one searched for.
    pub(super) fn switches_to_obey(&self) -> [[bool; 2]; 3] {
        let mut limits = self.inputs.limits;
        let searched = self
            .homing
            .as_ref()
            .map(Homing::switch)
            .or(self.abandoned_switch);
        let searched = searched.and_then(|(axis, side)| limits.get_mut(axis)?.get_mut(side));
        if let Some(switch) = searched {
            *switch = false;
        }
        limits
    }

    /// Executes one tick of the search.
    pub(super) fn go_on_homing(&mut self) {
        let (Some(mut homing), Some(active)) = (self.homing, self.active.as_ref()) else {
            return;
        };
        let (axis, side) = homing.switch();
        let on_axis = |values: [i64; 3]| values.get(axis).copied().unwrap_or_default();
        let stage = &active.config.stage;
        let travel_um = active.config.axes.get(axis).map_or(0, |axis| {
            let [low, high] = axis.travel_um;
            i64::from(high) - i64::from(low)
        });
        let back_off_um = i64::from(stage.back_off_um);
        let fine = |um: i64| on_axis(active.fine([times(um, 1_000); 3]));
        let (search, back_off) = (fine(travel_um * 5 / 4 + back_off_um), fine(back_off_um));
        let position_um = i64::from(homing.home.position_um);
        let (home, limits) = (fine(position_um), active.home);
        let homes = stage.home;
        // The recent samples of the switch belong to where the pins were; the plan is a little
        // ahead.
        let now = self.now();
        let at = on_axis(self.history.at(now).unwrap_or(self.position()));
        let tripped = self.inputs.limits.get(axis).and_then(|ends| ends.get(side));
        homing.contact.see(tripped == Some(&true), at);
        let deed = homing.tick(on_axis(self.position()), self.stands(), search, back_off);
        self.homing = Some(homing);
        match deed {
            Action::Wait => {}
            Action::Halt => {
                if let Some(planner) = &mut self.planner {
                    planner.stop();
                }
            }
            Action::Go(place, second) => {
                let [fast, slow] = limits;
                self.send_axis(axis, place, if second { slow } else { fast });
                if self.runs_onto_a_switch() {
                    self.fail(Fault::Limit);
                }
            }
            Action::Fail(fault) => self.fail(fault),
            Action::Done(place) => {
                let mut by = [0; 3];
                if let Some(by) = by.get_mut(axis) {
                    *by = shift_right_rounded(home.saturating_sub(place), 32);
                }
                self.move_origin(by);
                self.window.found(axis, on_axis(self.position()));
                self.found(axis);
                if let Some(done) = homing.axes.get_mut(axis) {
                    *done = false;
                }
                self.homing = Homing::new(homing.axes, &homes);
                if self.homing.is_none() {
                    self.use_limits();
                    self.state = State::Idle;
                }
            }
        }
    }

    fn found(&mut self, axis: usize) {
        if let Some(known) = self.referenced.get_mut(axis) {
            *known = true;
        }
        if self.referenced == [true; 3] {
            self.trust = Trust::Homed;
        }
    }

    /// Sends one axis to `place`, 2⁻³² steps, with these limits; requires rest.
    fn send_axis(&mut self, axis: usize, place: i64, limits: Limits) {
        self.limit_to(limits);
        let Some(planner) = &mut self.planner else {
            return;
        };
        let mut targets = [None; 3];
        if let Some(target) = targets.get_mut(axis) {
            *target = Some(Position::nearest_rest(place));
        }
        planner.set_targets_of(targets);
    }
}

#[cfg(test)]
#[cfg(not(miri))]
mod tests;
