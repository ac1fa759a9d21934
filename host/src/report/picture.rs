//! Pictures of what cameras saw, with the points that were followed.

use super::markup::escape;
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use std::fmt::Write as _;
use trinocular_vision::images::Image;

/// Largest side of a picture, px; larger images are reduced.
const LARGEST: usize = 320;
/// JPEG quality, 1 to 100.
const QUALITY: u8 = 50;
/// Most points that are drawn per picture.
const MOST_POINTS: usize = 150;

/// What one camera saw.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Name of the camera.
    pub camera: String,
    /// Width and height of the camera's image, px.
    size_px: [usize; 2],
    /// JPEG file of the reduced image; empty if the camera had no image.
    file: Vec<u8>,
    /// Points: x and y in the keyframe, x and y now, px.
    points: Vec<[f64; 4]>,
    /// Note under the picture.
    pub note: String,
}

impl View {
    /// Reduces and encodes an image with its points: x and y in the keyframe, x and y now, px.
    pub fn new(camera: &str, image: &Image, points: &[[f64; 4]]) -> Self {
        let is_drawn = |point: &&[f64; 4]| point.iter().all(|value| value.abs() < 1e5);
        let every = points.len().div_ceil(MOST_POINTS).max(1);
        let points = points.iter().step_by(every).filter(is_drawn);
        Self {
            camera: camera.to_owned(),
            size_px: [image.width, image.height],
            file: jpeg(&reduced(image)),
            points: points.copied().collect(),
            note: String::new(),
        }
    }

    /// Returns the view with a note under it.
    #[must_use]
    pub fn noted(self, note: impl Into<String>) -> Self {
        let note = note.into();
        Self { note, ..self }
    }

    /// Returns true if there is a picture.
    pub fn is_seen(&self) -> bool {
        !self.file.is_empty()
    }

    fn write(&self, html: &mut String) {
        let name = escape(&self.camera);
        let [width, height] = self.size_px;
        html.push_str("<div>");
        if self.is_seen() {
            let _ = write!(
                html,
                "<svg viewBox=\"0 0 {width} {height}\" role=\"img\" \
                 aria-label=\"image of {name}\"><image width=\"{width}\" height=\"{height}\" \
                 href=\"data:image/jpeg;base64,{}\" />",
                base64(&self.file)
            );
            let (mut flow, mut now) = (String::new(), String::new());
            // Pixels count from the centre of the first one, drawings from its corner.
            for [x0, y0, x1, y1] in self.points.iter().map(|point| point.map(|px| px + 0.5)) {
                let _ = write!(flow, "M{x0:.1} {y0:.1}L{x1:.1} {y1:.1}");
                let _ = write!(now, "M{x1:.1} {y1:.1}h0");
            }
            if !now.is_empty() {
                let _ = write!(
                    html,
                    "<path class=\"flow\" d=\"{flow}\" /><path class=\"now\" d=\"{now}\" />"
                );
            }
            html.push_str("</svg>");
        }
        let note = match self.note.is_empty() {
            true => String::new(),
            false => format!(": {}", escape(&self.note)),
        };
        let _ = writeln!(html, "{name}{note}</div>");
    }
}

/// One moment of a run: what its cameras saw.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moment {
    /// Text above the pictures.
    pub caption: String,
    /// One view per camera.
    pub views: Vec<View>,
}

impl Moment {
    /// Returns the moment as HTML.
    pub(super) fn to_html(&self) -> String {
        let mut html = format!(
            "<figure class=\"moment\"><figcaption>{}</figcaption><div class=\"views\">\n",
            escape(&self.caption)
        );
        self.views.iter().for_each(|view| view.write(&mut html));
        html.push_str("</div></figure>\n");
        html
    }
}

/// Returns the image with both sides at most [`LARGEST`]; each pixel is the mean of a block.
fn reduced(image: &Image) -> Image {
    let block = image.width.max(image.height).div_ceil(LARGEST).max(1);
    if block == 1 || image.is_missing() {
        return image.clone();
    }
    let (width, height) = ((image.width / block).max(1), (image.height / block).max(1));
    let mut grey = Vec::with_capacity(width * height);
    for y in 0..height {
        for x in 0..width {
            let rows = (0..block).filter_map(|row| {
                let start = (y * block + row) * image.width + x * block;
                image.grey.get(start..start + block)
            });
            let pixels = rows.flatten().map(|grey| u32::from(*grey));
            let (sum, count) = pixels.fold((0, 0), |(sum, n), grey| (sum + grey, n + 1));
            // The mean of bytes is a byte.
            grey.push((sum / count.max(1)) as u8);
        }
    }
    Image {
        width,
        height,
        grey,
    }
}

/// Returns the image as a JPEG file; nothing if there is no image.
fn jpeg(image: &Image) -> Vec<u8> {
    let mut file = Vec::new();
    if image.is_missing() {
        return file;
    }
    let (width, height) = (image.width as u32, image.height as u32);
    let mut encoder = JpegEncoder::new_with_quality(&mut file, QUALITY);
    match encoder.encode(&image.grey, width, height, ExtendedColorType::L8) {
        Ok(()) => file,
        Err(_) => Vec::new(),
    }
}

/// Encodes bytes for a data URI (RFC 4648, section 4).
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let at = |i: usize| u32::from(three.get(i).copied().unwrap_or(0));
        let word = at(0) << 16 | at(1) << 8 | at(2);
        for i in 0..4 {
            let six = word >> (18 - 6 * i) & 63;
            text.push(match i <= three.len() {
                true => char::from(LETTERS[six as usize]),
                false => '=',
            });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_follows_rfc_4648() {
        for (bytes, text) in [
            (&b""[..], ""),
            (b"f", "Zg=="),
            (b"fo", "Zm8="),
            (b"foo", "Zm9v"),
            (b"foobar", "Zm9vYmFy"),
            (&[0xff, 0xfe], "//4="),
        ] {
            assert_eq!(base64(bytes), text);
        }
    }

    #[test]
    fn large_image_is_reduced_to_its_means() {
        let (width, height) = (641, 100);
        let grey = (0..width * height).map(|i| if i % width < 6 { 200 } else { 10 });
        let image = Image {
            width,
            height,
            grey: grey.collect(),
        };
        let small = reduced(&image);
        assert_eq!([small.width, small.height], [213, 33]);
        assert_eq!(small.grey[..3], [200, 200, 10]);
    }

    #[test]
    fn missing_image_has_a_name_and_no_picture() {
        let view = View::new("<left>", &Image::missing(), &[]).noted("unplugged");
        let moment = Moment {
            caption: "now".to_owned(),
            views: vec![view],
        };
        let html = moment.to_html();
        assert!(
            html.contains("&lt;left&gt;: unplugged") && !html.contains("<image"),
            "{html}"
        );
    }
}
