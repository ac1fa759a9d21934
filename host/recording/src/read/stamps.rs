//! Order of the stamps of images, so that what is wrong with them is named.

/// Stamps of all images so far.
#[derive(Debug, Default)]
pub(super) struct Stamps {
    first_ns: Option<u64>,
    /// True if two stamps differ.
    has_others: bool,
    /// Last stamp of each camera, in the order of the file.
    last_ns: Vec<Option<u64>>,
    images: usize,
    /// Images after another one of their camera, and those of them with an earlier stamp than it.
    followers: usize,
    backwards: usize,
}

impl Stamps {
    /// Begins without an image of `cameras` cameras.
    pub fn new(cameras: usize) -> Self {
        Self {
            last_ns: vec![None; cameras],
            ..Self::default()
        }
    }

    /// Takes in the stamp of the next image in the file.
    pub fn take(&mut self, camera: usize, stamp_ns: u64) {
        self.images += 1;
        self.has_others |= *self.first_ns.get_or_insert(stamp_ns) != stamp_ns;
        let last_ns = self.last_ns.get_mut(camera);
        if let Some(last_ns) = last_ns.and_then(|last_ns| last_ns.replace(stamp_ns)) {
            self.followers += 1;
            self.backwards += usize::from(stamp_ns < last_ns);
        }
    }

    /// Describes stamps by which no order of the images is known; `None` for others.
    pub fn doubt(&self) -> Option<String> {
        if self.followers == 0 {
            return None;
        }
        if !self.has_others {
            let seconds = self.first_ns.unwrap_or(0) as f64 * 1e-9;
            return Some(format!(
                "all {} images have the stamp {seconds} s: what recorded them set no stamps",
                self.images
            ));
        }
        let (backwards, followers) = (self.backwards, self.followers);
        (2 * backwards > followers).then(|| {
            format!(
                "the stamps run backwards: {backwards} of {followers} are before their last one"
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn doubt(stamps_ns: &[u64]) -> String {
        let mut stamps = Stamps::new(2);
        for stamp_ns in stamps_ns {
            stamps.take(0, *stamp_ns);
            stamps.take(1, *stamp_ns);
        }
        stamps.doubt().unwrap_or_default()
    }

    #[test]
    fn stamps_without_an_order_are_named() {
        assert_eq!(doubt(&[]), "");
        assert_eq!(doubt(&[0]), "");
        assert_eq!(doubt(&[1, 2, 3, 5, 4, 6]), "");
        assert!(doubt(&[0; 4]).starts_with("all 8 images have the stamp 0 s"));
        assert!(doubt(&[4, 3, 2]).contains("run backwards: 4 of 4"));
    }
}
