//! The station's clock as seen from the host's, from pings and their replies.
//!
//! A ping leaves at `l` and its reply arrives at `r` (host's clock); the station had it from `a` to
//! `b` (its own). Wherever on the way the time `trip = (r - l) - (b - a)` was lost,
//!
//! ```text
//! offset at (l + r)/2  =  (a + b)/2 - (l + r)/2   ± trip/2
//! ```
//!
//! so pings with short trips say more. The shortest of each half second is kept, half a minute of
//! them, and a line is fitted: its height is the offset, its slope the difference of the two
//! crystals. The bound that is reported rests on the trips alone, not on the fit being good.
//!
//! Two pings that no drift of crystals reconciles have a jump of one of the clocks between them: a
//! computer that slept, or a simulated station that was suspended. The older one is forgotten.

use std::collections::VecDeque;

/// Period of the host's clock from which one ping is kept, µs.
const PERIOD_US: u64 = 500_000;

/// Number of pings kept: half a minute's worth.
const KEPT: usize = 64;

/// Shortest span of pings to fit a slope, µs; over less, the clocks count as equally fast.
const LEAST_SPAN_US: f64 = 5e6;

/// Largest difference of two crystals: 200 millionths.
const MOST_DRIFT: f64 = 200e-6;

/// Largest rounding of the two clocks in an offset, µs.
const ROUNDING_US: f64 = 2.0;

/// Clock offset from one ping.
#[derive(Clone, Copy, Debug)]
struct Pong {
    /// Midpoint between departure and arrival, on the host's clock, µs.
    middle_us: u64,
    /// Station time minus host time at the midpoint, µs.
    offset_us: i64,
    trip_us: u64,
}

impl Pong {
    /// Returns true if both offsets can be true of clocks that only drift.
    fn agrees_with(&self, other: &Self) -> bool {
        let apart = self.offset_us.abs_diff(other.offset_us) as f64;
        let trips = (self.trip_us as f64 + other.trip_us as f64) / 2.0;
        let drift = MOST_DRIFT * difference(self.middle_us, other.middle_us).abs();
        apart <= trips + drift + ROUNDING_US
    }
}

/// Offset and rate of the station's clock.
#[derive(Debug, Default)]
pub struct Clock {
    pongs: VecDeque<Pong>,
    jumps: u32,
}

/// Station time minus host time, µs, as a linear function of the host's time.
#[derive(Clone, Copy, Debug)]
struct ClockFit {
    origin_us: u64,
    offset_us: f64,
    slope: f64,
}

impl ClockFit {
    fn at(&self, host_us: u64) -> f64 {
        self.offset_us + self.slope * difference(host_us, self.origin_us)
    }
}

fn difference(a: u64, b: u64) -> f64 {
    a as f64 - b as f64
}

impl Clock {
    /// Adds a ping that left at `left` and whose reply arrived at `arrived` (host's clock, µs); the
    /// station had it from `received` to `sent` (station's clock, µs).
    pub(super) fn pong(&mut self, left: u64, received: u64, sent: u64, arrived: u64) {
        let away = arrived.saturating_sub(left);
        let there = sent.saturating_sub(received);
        let middle_us = left.saturating_add(arrived) / 2;
        let middle_there = received.saturating_add(sent) / 2;
        let pong = Pong {
            middle_us,
            offset_us: middle_there as i64 - middle_us as i64,
            trip_us: away.saturating_sub(there),
        };
        let known = self.pongs.len();
        self.pongs.retain(|old| old.agrees_with(&pong));
        if self.pongs.len() < known {
            self.jumps = self.jumps.saturating_add(1);
        }
        let same_period = |last: &&mut Pong| last.middle_us / PERIOD_US == middle_us / PERIOD_US;
        if let Some(last) = self.pongs.back_mut().filter(same_period) {
            if pong.trip_us < last.trip_us {
                *last = pong;
            }
            return;
        }
        if self.pongs.len() == KEPT {
            self.pongs.pop_front();
        }
        self.pongs.push_back(pong);
    }

    /// Returns how often one of the two clocks has jumped: station times before a jump and after it
    /// cannot be compared with the host's by one offset.
    pub const fn jumps(&self) -> u32 {
        self.jumps
    }

    /// Forgets all pings, because another station may be at the other end.
    pub(super) fn clear(&mut self) {
        self.pongs.clear();
    }

    /// Returns station time minus host time at a host instant, and the bound of its error, µs.
    /// `None` before the first reply.
    pub fn offset_us(&self, host_us: u64) -> Option<(i64, u64)> {
        let line = self.line()?;
        let value = line.at(host_us);
        // Each ping bounds the true offset at its own instant; from there on the bound grows by the
        // largest drift.
        let bound = |pong: &Pong| {
            pong.trip_us as f64 / 2.0
                + (line.at(pong.middle_us) - pong.offset_us as f64).abs()
                + (MOST_DRIFT + line.slope.abs()) * difference(host_us, pong.middle_us).abs()
        };
        let bound = self.pongs.iter().map(bound).min_by(f64::total_cmp)?;
        Some((value.round() as i64, bound.ceil() as u64))
    }

    /// Converts a host instant to station time, µs.
    pub fn station_us(&self, host_us: u64) -> Option<u64> {
        let (offset, _) = self.offset_us(host_us)?;
        host_us.checked_add_signed(offset)
    }

    /// Converts a station instant to host time, µs.
    pub fn host_us(&self, station_us: u64) -> Option<u64> {
        let line = self.line()?;
        // host + offset(host) = station, solved for host.
        let origin_there = line.origin_us as f64 + line.offset_us;
        let since = (station_us as f64 - origin_there) / (1.0 + line.slope);
        line.origin_us.checked_add_signed(since.round() as i64)
    }

    /// Fits the line by least squares. The standard deviation of a ping is half its trip, plus a
    /// microsecond for rounding.
    fn line(&self) -> Option<ClockFit> {
        let origin_us = self.pongs.back()?.middle_us;
        let span = difference(origin_us, self.pongs.front()?.middle_us);
        if span < LEAST_SPAN_US {
            let best = self.pongs.iter().min_by_key(|pong| pong.trip_us)?;
            return Some(ClockFit {
                origin_us,
                offset_us: best.offset_us as f64,
                slope: 0.0,
            });
        }
        // Offsets are taken from the newest one: station clocks may be 2^63 away, and f64 is exact
        // to 2^53.
        let base = self.pongs.back()?.offset_us;
        let (mut n, mut st, mut stt, mut so, mut sto) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for pong in &self.pongs {
            let weight = (pong.trip_us as f64 / 2.0 + 1.0).powi(-2);
            let t = difference(pong.middle_us, origin_us);
            let offset = pong.offset_us.saturating_sub(base) as f64;
            n += weight;
            st += weight * t;
            stt += weight * t * t;
            so += weight * offset;
            sto += weight * t * offset;
        }
        let spread = stt - st * st / n;
        let slope = ((sto - st * so / n) / spread).clamp(-MOST_DRIFT, MOST_DRIFT);
        let slope = if slope.is_finite() { slope } else { 0.0 };
        Some(ClockFit {
            origin_us,
            offset_us: base as f64 + (so - slope * st) / n,
            slope,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trinocular_rig::random::Random;

    #[test]
    fn shortest_round_trip_sets_clock() {
        let mut clock = Clock::default();
        assert_eq!(clock.offset_us(0), None);
        clock.pong(1_000, 51_900, 51_950, 2_050); // 1000 µs on the way
        clock.pong(3_000, 53_040, 53_060, 3_100); // 80 µs
        clock.pong(5_000, 55_900, 55_900, 5_950);
        assert_eq!(clock.offset_us(3_050), Some((50_000, 40)));
        assert_eq!(clock.station_us(7), Some(50_007));
        assert_eq!(clock.host_us(50_007), Some(7));
    }

    /// A station that was suspended for 700 ms, with and without a ping on its way meanwhile.
    #[test]
    fn clock_is_right_again_after_a_jump() {
        for on_its_way in [false, true] {
            let mut clock = Clock::default();
            let mut offset = 4_000_000_i64;
            let mut send = |left: u64, there: u64, offset: i64| {
                let station = (left + there).saturating_add_signed(offset);
                clock.pong(left, station, station, left + there + 70);
                (clock.offset_us(left + there + 70), clock.jumps())
            };
            for ping in 0..500 {
                let (found, jumps) = send(20_000 * ping, 60, offset);
                assert_eq!(
                    (found.map(|(offset, _)| offset), jumps),
                    (Some(3_999_995), 0)
                );
            }
            offset -= 700_000;
            if on_its_way {
                // It arrived when the station went on; its trip allows both offsets.
                let (_, jumps) = send(9_999_000, 700_100, offset);
                assert_eq!(jumps, 0);
            }
            let (found, jumps) = send(10_720_000, 60, offset);
            let (found, bound) = found.expect("a reply came");
            assert_eq!(jumps, 1);
            assert!(
                found.abs_diff(offset) <= bound && bound <= 100,
                "{found} {bound}"
            );
        }
    }

    /// Pings go every 20 ms for a minute over a line that delays some for milliseconds, one way
    /// only; the crystals are 120 millionths apart.
    #[test]
    fn drift_stays_within_bound() {
        let truth = |host_us: u64| 7_000_000 + (120e-6 * host_us as f64) as i64;
        let mut random = Random::seeded(5);
        let mut clock = Clock::default();
        let (mut worst, mut widest) = (0, 0);
        for ping in 0..3_000_u64 {
            let left = 20_000 * ping;
            let late = if random.below(8) == 0 { 0.0 } else { 9_000.0 };
            let there = left + 60 + random.between(0.0, 40.0 + late) as u64;
            let arrived = there + 60 + random.between(0.0, 40.0) as u64;
            let station = there.saturating_add_signed(truth(there));
            clock.pong(left, station, station, arrived);
            let (offset, bound) = clock.offset_us(arrived).expect("a reply came");
            let error = (offset - truth(arrived)).unsigned_abs();
            assert!(error <= bound, "ping {ping}: {error} us off, bound {bound}");
            if ping > 500 {
                (worst, widest) = (error.max(worst), bound.max(widest));
            }
            let back = clock.host_us(clock.station_us(arrived).expect("known"));
            assert!(back.expect("known").abs_diff(arrived) <= 1);
        }
        assert!(worst <= 20 && widest <= 500, "{worst} {widest}");
    }
}
