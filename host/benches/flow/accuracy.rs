//! How far found positions are from the true ones.

/// Of end points, against one true vector each.
#[derive(Clone, Copy, Debug, Default)]
pub struct Accuracy {
    pub count: usize,
    /// More than 1 px off.
    pub wrong: usize,
    squares: f64,
}

impl Accuracy {
    pub fn add(&mut self, found: [f64; 2], truth: [f64; 2]) {
        let square = (found[0] - truth[0]).powi(2) + (found[1] - truth[1]).powi(2);
        self.count += 1;
        if square < 1.0 {
            self.squares += square;
        } else {
            self.wrong += 1;
        }
    }

    /// Adds what another program found: so many, of which so many wrong, and the root mean square distance of the rest.
    pub fn extend(&mut self, count: usize, wrong: usize, rms_px: f64) {
        self.count += count;
        self.wrong += wrong;
        self.squares += rms_px * rms_px * (count - wrong) as f64;
    }

    /// Root mean square distance of those that are not wrong, px.
    pub fn rms_px(&self) -> f64 {
        (self.squares / (self.count - self.wrong) as f64).sqrt()
    }
}

/// What one way of doing the frame set found.
#[derive(Clone, Copy, Debug, Default)]
pub struct Quality {
    pub temporal: Accuracy,
    pub spatial: Accuracy,
}
