//! Range and labels of an axis.

/// Largest magnitude an axis shows. Larger values are left out like NaN.
const LARGEST: f64 = 1e12;

/// Returns true if a value can be placed on an axis.
pub(super) fn drawable(value: f64) -> bool {
    value.is_finite() && value.abs() <= LARGEST
}

/// One axis: its range and its labelled positions.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axis {
    pub low: f64,
    pub high: f64,
    pub ticks: Vec<f64>,
    decimals: usize,
}

impl Axis {
    /// Returns an axis around all drawable `values`, with a small margin and about `count` labels.
    /// Without any value it runs from 0 to 1.
    pub fn around(values: impl IntoIterator<Item = f64>, count: usize) -> Self {
        let drawable = values.into_iter().filter(|value| drawable(*value));
        let extremes = drawable.fold(None, |range: Option<(f64, f64)>, value| {
            let (low, high) = range.unwrap_or((value, value));
            Some((low.min(value), high.max(value)))
        });
        let Some((low, high)) = extremes else {
            return Self::spanning(0.0, 1.0, count);
        };
        // A constant needs a range that its own rounding cannot fill.
        let middle = 0.5 * (low + high);
        let least = (middle.abs() * 1e-6).max(1e-9);
        let span = high - low;
        if span < least {
            let half = if middle == 0.0 {
                1.0
            } else {
                0.5 * middle.abs().max(least)
            };
            return Self::spanning(middle - half, middle + half, count);
        }
        Self::spanning(low - 0.05 * span, high + 0.05 * span, count)
    }

    /// Returns an axis from `low` to `high` (`low < high`, both drawable), labelled at multiples of
    /// 1, 2 or 5 times a power of ten. It has at least two labels, because one gives no scale, and
    /// at most `count + 1` (or 5 if that is more).
    pub fn spanning(low: f64, high: f64, count: usize) -> Self {
        let count = count.clamp(1, 50);
        let rough = (high - low) / count as f64;
        let power = 10f64.powf(rough.log10().floor());
        let ladder = [0.2, 0.5, 1.0, 2.0, 5.0, 10.0].map(|rung| rung * power);
        let coarse = ladder
            .into_iter()
            .filter(|step| *step >= rough * (1.0 - 1e-9));
        let finer = ladder
            .into_iter()
            .rev()
            .filter(|step| *step < rough * (1.0 - 1e-9));
        let mut axis = Self {
            low,
            high,
            ticks: Vec::new(),
            decimals: 0,
        };
        for step in coarse.take(1).chain(finer) {
            axis.label_every(step);
            if axis.ticks.len() >= 2 {
                break;
            }
        }
        axis
    }

    fn label_every(&mut self, step: f64) {
        self.decimals = (-(step.log10() + 1e-9).floor()).clamp(0.0, 12.0) as usize;
        let first = (self.low / step - 1e-9).ceil();
        let high = self.high + 1e-9 * step;
        self.ticks = (0..60)
            .map(|i| (first + f64::from(i)) * step)
            .take_while(|tick| *tick <= high)
            .collect();
    }

    /// Returns the label of one tick.
    pub fn label(&self, tick: f64) -> String {
        let text = format!("{:.*}", self.decimals, tick.abs());
        if tick < 0.0 && text.bytes().any(|b| (b'1'..=b'9').contains(&b)) {
            format!("\u{2212}{text}")
        } else {
            text
        }
    }

    /// Returns the length of the longest label, characters.
    pub fn label_length(&self) -> usize {
        let labels = self.ticks.iter().map(|tick| self.label(*tick));
        labels.map(|label| label.chars().count()).max().unwrap_or(1)
    }

    /// Returns the position of a value: 0 at `low`, 1 at `high`.
    pub fn fraction(&self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_round_numbers() {
        let axis = Axis::spanning(-0.3, 1.1, 6);
        let labels: Vec<String> = axis.ticks.iter().map(|tick| axis.label(*tick)).collect();
        assert_eq!(labels, ["0.0", "0.5", "1.0"]);
        let axis = Axis::spanning(-21.0, 21.0, 9);
        let labels: Vec<String> = axis.ticks.iter().map(|tick| axis.label(*tick)).collect();
        assert_eq!(
            labels,
            [
                "\u{2212}20",
                "\u{2212}15",
                "\u{2212}10",
                "\u{2212}5",
                "0",
                "5",
                "10",
                "15",
                "20"
            ]
        );
    }

    #[test]
    fn every_range_has_inner_labels() {
        for exponent in -9..12 {
            for mantissa in [1.0, 1.7, 2.0, 3.3, 5.0, 9.99] {
                let span = mantissa * 10f64.powi(exponent);
                for count in [1, 3, 6, 10] {
                    for low in [0.0, -span / 3.0, span * 7.1] {
                        let axis = Axis::spanning(low, low + span, count);
                        let inside = |tick: &f64| {
                            axis.fraction(*tick) > -1e-6 && axis.fraction(*tick) < 1.0 + 1e-6
                        };
                        assert!(axis.ticks.iter().all(inside), "{axis:?}");
                        assert!(axis.ticks.len() <= (count + 1).max(5), "{axis:?}");
                        assert!(axis.ticks.len() >= 2, "{axis:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn nan_values_are_ignored() {
        let axis = Axis::around([f64::NAN, 1.0, f64::INFINITY, 3.0, 1e300], 5);
        assert_eq!((axis.low, axis.high), (0.9, 3.1));
        let empty = Axis::around([f64::NAN], 5);
        assert_eq!((empty.low, empty.high), (0.0, 1.0));
    }

    #[test]
    fn constant_is_centred() {
        for value in [0.0, 5.0, -1e-12, 1e12] {
            let axis = Axis::around([value, value], 5);
            assert!(axis.low < axis.high, "{value}");
            assert!((axis.fraction(value) - 0.5).abs() < 1e-6, "{value}");
        }
    }
}
