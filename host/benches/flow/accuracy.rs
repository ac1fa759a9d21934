//! Errors of found positions against the true ones.

/// Accuracy of end points, each against one true vector.
#[derive(Clone, Copy, Debug, Default)]
pub struct Accuracy {
    /// Number of end points more than 1 px off.
    pub wrong: usize,
    /// Number of the other end points that are well inside all images.
    right: usize,
    squares: f64,
}

impl Accuracy {
    /// Adds a found position. `inside` is true for points as far from the border of all images as
    /// the windows reach; near the border, some programs use only a part of the window.
    pub fn add(&mut self, found: [f64; 2], truth: [f64; 2], inside: bool) {
        let square = (found[0] - truth[0]).powi(2) + (found[1] - truth[1]).powi(2);
        if !(square < 1.0) {
            self.wrong += 1;
        } else if inside {
            self.right += 1;
            self.squares += square;
        }
    }

    /// Adds the results of another program: the number of wrong points, the number of the others
    /// that are well inside, and the root mean square distance of the latter.
    pub fn extend(&mut self, wrong: usize, right: usize, rms_px: f64) {
        self.wrong += wrong;
        self.right += right;
        self.squares += rms_px * rms_px * right as f64;
    }

    /// Returns the root mean square distance of the points that are well inside and not wrong, px.
    pub fn rms_px(&self) -> f64 {
        (self.squares / self.right as f64).sqrt()
    }
}

/// Accuracy of one program on a frame set.
#[derive(Clone, Copy, Debug, Default)]
pub struct Quality {
    pub temporal: Accuracy,
    pub spatial: Accuracy,
}
