//! How far found positions are from the true ones.

/// Of end points, against one true vector each.
#[derive(Clone, Copy, Debug, Default)]
pub struct Accuracy {
    /// More than 1 px off.
    pub wrong: usize,
    /// Of the others, so many are well inside all images.
    right: usize,
    squares: f64,
}

impl Accuracy {
    /// `inside`: as far from the border of all images as the windows reach. Near it some programs
    /// look through a part of the window only.
    pub fn add(&mut self, found: [f64; 2], truth: [f64; 2], inside: bool) {
        let square = (found[0] - truth[0]).powi(2) + (found[1] - truth[1]).powi(2);
        if !(square < 1.0) {
            self.wrong += 1;
        } else if inside {
            self.right += 1;
            self.squares += square;
        }
    }

    /// Adds what another program found: how many are wrong, how many of the others are well inside,
    /// and the root mean square distance of these.
    pub fn extend(&mut self, wrong: usize, right: usize, rms_px: f64) {
        self.wrong += wrong;
        self.right += right;
        self.squares += rms_px * rms_px * right as f64;
    }

    /// Root mean square distance of those that are well inside and not wrong, px.
    pub fn rms_px(&self) -> f64 {
        (self.squares / self.right as f64).sqrt()
    }
}

/// What one way of doing the frame set found.
#[derive(Clone, Copy, Debug, Default)]
pub struct Quality {
    pub temporal: Accuracy,
    pub spatial: Accuracy,
}
