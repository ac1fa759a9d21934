//! Motion of a scenario's target: a sequence of legs, each from the end of the one before.
//!
//! A leg's own clock may start and stop smoothly: with a ramp of length `R` its rate goes from 0 to
//! 1 as `3u² - 2u³`, `u = t/R`, so that the leg has passed `R (u³ - u⁴/2)` of its own time after
//! `uR`. A ramp costs half its length.

/// One leg of the target's path.
#[derive(Clone, Debug, PartialEq)]
pub struct Leg {
    /// Kind of motion.
    pub motion: Motion,
    /// Duration, s.
    pub seconds: f64,
    /// Ramps at its start and its end, s.
    pub ramps_s: [f64; 2],
}

/// Kinds of motion, mm as seen from the cameras at rest.
#[derive(Clone, Debug, PartialEq)]
pub enum Motion {
    /// No motion.
    Still,
    /// A jump at the leg's start.
    Step {
        /// Displacement of the jump.
        by_mm: [f64; 3],
    },
    /// A straight line.
    Line {
        /// Velocity of the target.
        velocity_mm_s: [f64; 3],
    },
    /// `amplitude sin(ratio ω t)` on each axis.
    Lissajous {
        /// Half the width of the figure.
        amplitude_mm: [f64; 3],
        /// Frequencies, relative to each other.
        ratio: [f64; 3],
        /// Greatest speed in space, which occurs at the start; sets `ω`.
        peak_mm_s: f64,
    },
}

impl Motion {
    /// Returns the displacement since the leg's start after `t` s of its own clock.
    fn after(&self, t: f64) -> [f64; 3] {
        match self {
            Self::Still => [0.0; 3],
            Self::Step { by_mm } => *by_mm,
            Self::Line { velocity_mm_s } => velocity_mm_s.map(|v| v * t),
            Self::Lissajous {
                amplitude_mm,
                ratio,
                peak_mm_s,
            } => {
                // All cosines are 1 at the start, where the speed is ω |amplitude ratio|.
                let unit = |i: usize| amplitude_mm[i] * ratio[i];
                let length = (0..3).map(|i| unit(i).powi(2)).sum::<f64>().sqrt();
                let omega = peak_mm_s / length;
                std::array::from_fn(|i| amplitude_mm[i] * (ratio[i] * omega * t).sin())
            }
        }
    }
}

impl Leg {
    /// Returns the leg's own clock, s, when `t` s have passed since its start.
    fn clock(&self, t: f64) -> f64 {
        let [up, down] = self.ramps_s;
        let ramped = |t: f64, ramp: f64| {
            let u = t / ramp;
            ramp * u.powi(3) * (1.0 - u / 2.0)
        };
        let t = t.clamp(0.0, self.seconds);
        if t < up {
            return ramped(t, up);
        }
        let left = self.seconds - t;
        let whole = self.seconds - (up + down) / 2.0;
        if left < down {
            return whole - ramped(left, down);
        }
        t - up / 2.0
    }

    fn after(&self, t: f64) -> [f64; 3] {
        self.motion.after(self.clock(t))
    }
}

/// A jump of the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jump {
    /// Instant of the jump, s.
    pub at_s: f64,
    /// Displacement, mm.
    pub by_mm: [f64; 3],
    /// Instant at which the target moves on or the scenario ends, s.
    pub until_s: f64,
}

/// Whole path of the target.
#[derive(Clone, Debug, PartialEq)]
pub struct Way {
    /// Start of each leg: time in s, position in mm.
    legs: Vec<(f64, [f64; 3], Leg)>,
    seconds: f64,
}

impl Way {
    /// Creates a path of these legs in their order, from zero.
    pub fn new(legs: &[Leg]) -> Self {
        let (mut at_s, mut from) = (0.0, [0.0; 3]);
        let mut placed = Vec::with_capacity(legs.len());
        for leg in legs {
            placed.push((at_s, from, leg.clone()));
            at_s += leg.seconds;
            from = sum(from, leg.after(leg.seconds));
        }
        Self {
            legs: placed,
            seconds: at_s,
        }
    }

    /// Returns the duration, s.
    pub fn seconds(&self) -> f64 {
        self.seconds
    }

    /// Returns the position of the target, mm from its start. It stands after the end of the last
    /// leg.
    pub fn at(&self, time_s: f64) -> [f64; 3] {
        let leg = self.legs.iter().rev().find(|(start, ..)| *start <= time_s);
        match leg {
            Some((start, from, leg)) => sum(*from, leg.after(time_s - start)),
            None => [0.0; 3],
        }
    }

    /// Returns all jumps, in order.
    pub fn jumps(&self) -> impl Iterator<Item = Jump> + '_ {
        self.legs.iter().filter_map(|(at_s, _, leg)| {
            let Motion::Step { by_mm } = leg.motion else {
                return None;
            };
            Some(Jump {
                at_s: *at_s,
                by_mm,
                until_s: at_s + leg.seconds,
            })
        })
    }
}

fn sum(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] + b[i])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn leg(motion: Motion, seconds: f64, ramps_s: [f64; 2]) -> Leg {
        Leg {
            motion,
            seconds,
            ramps_s,
        }
    }

    fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
        (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
    }

    #[test]
    fn legs_join_without_gap() {
        let way = Way::new(&[
            leg(Motion::Still, 1.0, [0.0; 2]),
            leg(
                Motion::Step {
                    by_mm: [4.0, 4.0, 1.0],
                },
                2.0,
                [0.0; 2],
            ),
            leg(
                Motion::Line {
                    velocity_mm_s: [10.0, 0.0, -5.0],
                },
                3.0,
                [1.0, 0.5],
            ),
            leg(Motion::Still, 1.0, [0.0; 2]),
        ]);
        assert_eq!(way.seconds(), 7.0);
        assert_eq!(way.at(-1.0), [0.0; 3]);
        assert_eq!(way.at(0.999), [0.0; 3]);
        assert_eq!(way.at(1.0), [4.0, 4.0, 1.0]);
        assert_eq!(way.at(2.999), [4.0, 4.0, 1.0]);
        // The ramps cost half their length: 3 - 0.75 s at full speed.
        let end = [4.0 + 22.5, 4.0, 1.0 - 11.25];
        assert!(distance(way.at(6.0), end) < 1e-12);
        assert!(distance(way.at(99.0), end) < 1e-12);
        let jumps: Vec<Jump> = way.jumps().collect();
        assert_eq!(jumps.len(), 1);
        assert_eq!((jumps[0].at_s, jumps[0].until_s), (1.0, 3.0));
    }

    #[test]
    fn ramps_reach_full_speed() {
        let velocity_mm_s = [30.0, -40.0, 0.0];
        let way = Way::new(&[leg(Motion::Line { velocity_mm_s }, 2.0, [0.5, 0.5])]);
        let speed = |t: f64| distance(way.at(t + 1e-4), way.at(t - 1e-4)) / 2e-4;
        assert!(speed(0.001) < 0.01 && speed(1.999) < 0.01);
        assert!((speed(0.25) - 25.0).abs() < 0.01);
        assert!((speed(0.6) - 50.0).abs() < 1e-6);
        // The velocity is continuous: its largest slope is 1.5 times the speed over the ramp.
        for k in 1..2_000 {
            let t = f64::from(k) * 1e-3;
            assert!((speed(t) - speed(t - 1e-3)).abs() <= 50.0 * 1.5 / 0.5 * 1e-3 + 1e-6);
        }
    }

    #[test]
    fn lissajous_has_width_and_peak() {
        let (amplitude_mm, ratio) = ([20.0, 20.0, 5.0], [1.0, 2.0, 3.0]);
        let figure = Motion::Lissajous {
            amplitude_mm,
            ratio,
            peak_mm_s: 20.0,
        };
        let way = Way::new(&[leg(figure, 15.0, [0.0; 2])]);
        let (mut widest, mut fastest) = ([0.0f64; 3], 0.0f64);
        for k in 0..14_999 {
            let (a, b) = (way.at(f64::from(k) * 1e-3), way.at(f64::from(k + 1) * 1e-3));
            fastest = fastest.max(distance(a, b) * 1e3);
            widest = std::array::from_fn(|i| widest[i].max(b[i].abs()));
        }
        assert!((fastest - 20.0).abs() < 1e-3, "{fastest}");
        for (found, amplitude) in widest.iter().zip(amplitude_mm) {
            assert!((found - amplitude).abs() < 1e-3, "{widest:?}");
        }
    }
}
