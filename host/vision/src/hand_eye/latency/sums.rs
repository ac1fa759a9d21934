//! Least squares of the motion of a camera's points at one delay, by sums.

use super::Passage;

/// Sums over the passes along one axis, less the means of each pass: of products of the stage's
/// position `s`, its speed `v`, and the motion `u` along both axes of the image.
#[derive(Clone, Copy, Debug, Default)]
struct AxisSums {
    ss: f64,
    sv: f64,
    vv: f64,
    su: [f64; 2],
    vu: [f64; 2],
    uu: [f64; 2],
    is_there: bool,
}

impl AxisSums {
    fn add(&mut self, passage: &Passage<'_>, delay_s: f64) {
        let count = passage.looks.len() as f64;
        let row = |look: &super::Look| {
            let at_s = look.stamp_s - delay_s;
            let s = passage.path.at(at_s)[passage.axis];
            let v = passage.path.speed_mm_s(at_s)[passage.axis];
            [s, v, look.moved_px[0], look.moved_px[1]]
        };
        let rows: Vec<[f64; 4]> = passage.looks.iter().map(row).collect();
        let mean: [f64; 4] =
            std::array::from_fn(|i| rows.iter().map(|row| row[i]).sum::<f64>() / count);
        for row in &rows {
            let [s, v, x, y] = std::array::from_fn(|i| row[i] - mean[i]);
            self.ss += s * s;
            self.sv += s * v;
            self.vv += v * v;
            for (k, u) in [x, y].into_iter().enumerate() {
                self.su[k] += s * u;
                self.vu[k] += v * u;
                self.uu[k] += u * u;
            }
        }
        self.is_there = true;
    }

    /// Returns the motion per mm of the stage, px.
    fn scale(&self, k: usize) -> f64 {
        match self.ss > 0.0 {
            true => self.su[k] / self.ss,
            false => 0.0,
        }
    }

    /// Returns the part of `Σ v²` that is not explained by the position.
    fn speeds(&self) -> f64 {
        match self.ss > 0.0 {
            true => self.vv - self.sv * self.sv / self.ss,
            false => 0.0,
        }
    }
}

/// Least squares at one delay.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The delay, s.
    pub delay_s: f64,
    axes: [AxisSums; 3],
    looks: usize,
    passes: usize,
}

impl Fit {
    /// Fits scales and constants to the passes.
    pub fn at(passages: &[&Passage<'_>], delay_s: f64) -> Self {
        let mut axes = [AxisSums::default(); 3];
        for passage in passages {
            axes[passage.axis].add(passage, delay_s);
        }
        Self {
            delay_s,
            axes,
            looks: passages.iter().map(|passage| passage.looks.len()).sum(),
            passes: passages.len(),
        }
    }

    /// Returns the sum of `term` over the axes of stage and image.
    fn over(&self, term: impl Fn(&AxisSums, usize) -> f64) -> f64 {
        let axes = self.axes.iter();
        axes.map(|sums| term(sums, 0) + term(sums, 1)).sum()
    }

    /// Returns the sum of the squares of the residuals, px².
    pub fn squares(&self) -> f64 {
        self.over(|sums, k| sums.uu[k] - sums.scale(k) * sums.su[k])
            .max(0.0)
    }

    /// Returns the Gauss-Newton step of the delay, s.
    pub fn step_s(&self) -> f64 {
        let gradient = self.over(|sums, k| {
            let scale = sums.scale(k);
            scale * (sums.vu[k] - scale * sums.sv)
        });
        match self.information() {
            information if information > 0.0 => -gradient / information,
            _ => 0.0,
        }
    }

    /// Returns the information about the delay for noise of 1 px, 1/s².
    fn information(&self) -> f64 {
        self.over(|sums, k| sums.scale(k).powi(2) * sums.speeds())
    }

    /// Returns the root mean square of the motion that goes with the stage, px.
    pub fn motion_px(&self) -> f64 {
        let squares = self.over(|sums, k| sums.scale(k) * sums.su[k]);
        (squares / self.looks.max(1) as f64).max(0.0).sqrt()
    }

    /// Returns the standard deviation of the residuals, px.
    pub fn scatter_px(&self) -> f64 {
        let axes = self.axes.iter().filter(|sums| sums.is_there).count();
        // A constant per pass, a scale per axis, both for x and y, and the delay.
        let fitted = 2 * (self.passes + axes) + 1;
        let freedom = (2 * self.looks).saturating_sub(fitted).max(1);
        (self.squares() / freedom as f64).sqrt()
    }

    /// Returns the standard deviation of the delay by the residuals, or by noise of `noise_px` if
    /// that is larger, s.
    pub fn sigma_s(&self, noise_px: f64) -> f64 {
        self.scatter_px().max(noise_px) / self.information().max(f64::MIN_POSITIVE).sqrt()
    }
}
