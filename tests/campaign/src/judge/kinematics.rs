//! Speed, acceleration and jerk by differences of counted steps.
//!
//! Where an axis is at control ticks is known to a whole step. For a window of `w` ticks, with
//! limits per tick,
//!
//! ```text
//! |p1 - p0| <= v w + 1      |p2 - 2 p1 + p0| <= a w² + 2      |p3 - 3 p2 + 3 p1 - p0| <= j w³ + 4
//! ```
//!
//! where the last terms are what whole steps can be off.

use std::collections::VecDeque;

/// Window lengths of the differences, ticks.
const WINDOWS: [usize; 5] = [1, 3, 9, 27, 81];

/// Number of ticks remembered.
const KEPT: usize = 3 * 81 + 1;

/// Limits of an axis, in steps and ticks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bounds {
    /// Speed, steps per tick.
    pub speed: f64,
    /// Acceleration, steps per tick².
    pub acceleration: f64,
    /// Jerk, steps per tick³.
    pub jerk: f64,
}

impl Bounds {
    /// Returns the bounds as the station rounds them: each down to a multiple of `quantum`.
    pub fn on_grid(&self, quantum: f64) -> Self {
        let down = |bound: f64| ((bound / quantum).floor() * quantum).max(quantum);
        Self {
            speed: self.speed,
            acceleration: down(self.acceleration),
            jerk: down(self.jerk),
        }
    }

    /// Returns the largest number of ticks that a ramp to rest takes from a speed of at most
    /// `speed` and an acceleration of at most `rising`.
    pub fn stop_ticks(&self, speed: f64, rising: f64) -> f64 {
        let (a, j) = (self.acceleration, self.jerk);
        let top = speed + rising * rising / (2.0 * j);
        let falling = a.min((top * j).sqrt());
        let ramp = match falling > 0.0 {
            true => top / falling + falling / j,
            false => 0.0,
        };
        rising / j + ramp
    }
}

/// Bound that was exceeded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Excess {
    /// The speed.
    Speed,
    /// The acceleration.
    Acceleration,
    /// The jerk.
    Jerk,
}

/// Positions of one axis at the last control ticks.
#[derive(Clone, Debug, Default)]
pub struct Trail {
    /// Position, steps, and the bounds that held at each tick; the newest is last.
    places: VecDeque<(i64, Bounds)>,
    /// Ticks since the axis last moved.
    rested: usize,
    /// Number of comparisons made.
    pub compared: u64,
}

impl Trail {
    /// Forgets all positions, so that differences start anew.
    pub fn cut(&mut self) {
        self.places.clear();
    }

    /// Adds the position at the end of one more tick in which `bounds` held. Returns the first
    /// bound exceeded.
    pub fn push(&mut self, place: i64, bounds: Bounds) -> Option<(Excess, String)> {
        let moved = self.places.back().is_some_and(|(last, _)| *last != place);
        self.rested = if moved { 0 } else { self.rested + 1 };
        if self.places.len() == KEPT {
            self.places.pop_front();
        }
        self.places.push_back((place, bounds));
        if self.rested >= KEPT {
            return None;
        }
        let newest = self.places.len() - 1;
        let at = |back: usize| self.places[newest - back].0 as f64;
        let cap = |w: usize| {
            let recent = self.places.iter().rev().take(w);
            recent.map(|place| place.1.speed).fold(0.0, f64::max)
        };
        for w in WINDOWS.into_iter().take_while(|w| *w <= newest) {
            let n = w as f64;
            self.compared += 1;
            let way = (at(0) - at(w)).abs();
            // Distances are rarely longer than the present speed allows; only then look up the
            // bounds that held.
            if way > bounds.speed * n + 1.0 {
                let most = cap(w) * n + 1.0 + 1e-6;
                if way > most {
                    return Some((Excess::Speed, format!("{way} > {most:.2} in {w} ms")));
                }
            }
            if 2 * w > newest {
                break;
            }
            self.compared += 1;
            let change = (at(0) - 2.0 * at(w) + at(2 * w)).abs();
            let most = bounds.acceleration * n * n + 2.0 + 1e-6;
            if change > most {
                let text = format!("{change} > {most:.2} in 2 x {w} ms");
                return Some((Excess::Acceleration, text));
            }
            if 3 * w > newest {
                break;
            }
            self.compared += 1;
            let bend = (at(0) - 3.0 * at(w) + 3.0 * at(2 * w) - at(3 * w)).abs();
            let most = bounds.jerk * n * n * n + 4.0 + 1e-6;
            if bend > most {
                return Some((Excess::Jerk, format!("{bend} > {most:.2} in 3 x {w} ms")));
            }
        }
        None
    }

    /// Returns the highest speed that the axis can have now, steps per tick. It exceeds the mean
    /// speed over any window by at most the change that the acceleration allows within the window.
    pub fn speed(&self, bounds: &Bounds) -> f64 {
        let Some(&(newest, _)) = self.places.back() else {
            return bounds.speed;
        };
        let last = self.places.len() - 1;
        let windows = WINDOWS.into_iter().filter(|w| *w <= last);
        let speeds = windows.map(|w| {
            let way = (newest - self.places[last - w].0).unsigned_abs() as f64;
            (way + 1.0) / w as f64 + bounds.acceleration * w as f64
        });
        speeds.fold(bounds.speed, f64::min)
    }

    /// Returns the highest acceleration that the axis can have now, steps per tick²: 0 after a long
    /// rest, unbounded in the middle of a turn.
    pub fn acceleration(&self, bounds: &Bounds) -> f64 {
        let rested = match self.rested >= KEPT {
            true => (2.0 * self.speed(bounds) * bounds.jerk).sqrt(),
            false => f64::INFINITY,
        };
        bounds.acceleration.min(rested)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOUNDS: Bounds = Bounds {
        speed: 8.0,
        acceleration: 0.5,
        jerk: 0.05,
    };

    /// Moves a trail with one acceleration per tick and returns the first bound exceeded.
    fn excess(accelerations: impl IntoIterator<Item = f64>) -> Option<Excess> {
        let mut trail = Trail::default();
        let (mut place, mut speed) = (0.5, 0.0);
        for acceleration in accelerations {
            place += speed + acceleration / 2.0;
            speed += acceleration;
            if let Some((excess, _)) = trail.push(f64::floor(place) as i64, BOUNDS) {
                return Some(excess);
            }
        }
        None
    }

    fn ramp(peak: f64, jerk: f64, hold: usize) -> Vec<f64> {
        let up = (1..).map(|n| n as f64 * jerk).take_while(|a| *a < peak);
        let up: Vec<f64> = up.collect();
        let down = up.iter().rev().copied();
        let flat = std::iter::repeat_n(peak, hold);
        up.iter().copied().chain(flat).chain(down).collect()
    }

    #[test]
    fn motion_within_bounds_passes() {
        let mut all = ramp(0.5, 0.05, 6);
        let back = all.clone();
        all.extend(std::iter::repeat_n(0.0, 200));
        all.extend(back.iter().map(|a| -a));
        assert_eq!(excess(all), None);
    }

    #[test]
    fn each_exceeded_bound_is_noticed() {
        let still = || std::iter::repeat_n(0.0, 300);
        assert_eq!(
            excess(ramp(0.5, 0.05, 12).into_iter().chain(still())),
            Some(Excess::Speed)
        );
        assert_eq!(excess(ramp(0.7, 0.05, 1)), Some(Excess::Acceleration));
        let jerky = std::iter::repeat_n(0.5, 12).chain(std::iter::repeat_n(-0.5, 12));
        assert_eq!(excess(jerky), Some(Excess::Jerk));
    }

    #[test]
    fn stop_lasts_at_most_as_stated() {
        // From 8 steps/tick without acceleration: 10 ticks to 0.5, 16 - 10 there, 10 back.
        let ticks = BOUNDS.stop_ticks(7.9, 0.0);
        assert!((25.0..30.0).contains(&ticks), "{ticks}");
        assert_eq!(BOUNDS.stop_ticks(0.0, 0.0), 0.0);
        // In the middle of a turn: ten ticks remove the acceleration, then the axis brakes from 2.5
        // steps per tick.
        let ticks = BOUNDS.stop_ticks(0.0, 0.5);
        assert!((20.0..30.0).contains(&ticks), "{ticks}");
    }
}
