//! Y4M video (YUV4MPEG2): a header line, then uncompressed frames. ffmpeg writes it from anything
//! that it opens: `ffmpeg -i left.mp4 -pix_fmt gray left.y4m`.
//!
//! ```text
//! YUV4MPEG2 W640 H480 F30:1 Ip C420jpeg\n
//! FRAME\n<luma><chroma> FRAME\n<luma><chroma> ...
//! ```
//!
//! The luma is the image. Values of more than 8 bits have two bytes, the lower one first.

use std::io::{self, BufRead, Read, Seek, SeekFrom};

use super::super::Image;
use super::super::decode::{MOST_PIXELS, Picture};
use trinocular_rig::input::stand_in;

/// Largest number of frames of a file.
const MOST_FRAMES: usize = 1_000_000;
/// Largest length of a header line, bytes.
const LONGEST_LINE: u64 = 4_096;

/// Content of the header line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Header {
    /// Width and height, px.
    pub size_px: [u32; 2],
    /// Frames per second, as a fraction; `None` if the header has no rate.
    pub rate: Option<[u32; 2]>,
    /// Bits per value, 8 to 16.
    pub bits: u32,
    /// Length of the chroma and alpha planes, values.
    chroma: u64,
}

impl Header {
    /// Reads the header line.
    ///
    /// # Errors
    /// Reason why the video cannot be read, in words.
    pub fn read(reader: &mut impl BufRead) -> Result<Self, String> {
        let start = reader.fill_buf().map_err(|cause| cause.to_string())?;
        if let Some(reason) = stand_in(start) {
            return Err(reason.to_owned());
        }
        let line = line(reader)?.ok_or("the file is empty")?;
        Self::parse(&line)
    }

    fn parse(line: &str) -> Result<Self, String> {
        let mut fields = line.split(' ');
        if fields.next() != Some("YUV4MPEG2") {
            return Err("not a Y4M video: it does not begin with YUV4MPEG2".to_owned());
        }
        let (mut size_px, mut rate, mut colours) = ([0; 2], None, "420jpeg");
        for field in fields {
            let mut letters = field.chars();
            let kind = letters.next();
            let value = letters.as_str();
            let number = |text: &str| {
                let number = text.parse::<u32>();
                number.map_err(|_| format!("`{field}` in its header is not a number"))
            };
            match kind {
                Some('W') => size_px[0] = number(value)?,
                Some('H') => size_px[1] = number(value)?,
                Some('F') => {
                    let (above, below) = value.split_once(':').unwrap_or((value, "1"));
                    rate = Some([number(above)?, number(below)?]);
                }
                Some('C') => colours = value,
                Some('I') if !matches!(value, "p" | "?" | "") => {
                    let reason = "its frames are interlaced, so that a frame shows two instants; \
                                  deinterlace it, for instance with ffmpeg -vf bwdif";
                    return Err(reason.to_owned());
                }
                _ => {}
            }
        }
        let [width, height] = size_px.map(u64::from);
        if width == 0 || height == 0 || width * height > MOST_PIXELS {
            return Err(format!(
                "{width} x {height} px is no size of an image; it has 1 to {MOST_PIXELS} pixels"
            ));
        }
        let (bits, chroma) = planes(colours, [width, height]).ok_or_else(|| {
            format!(
                "its colours C{colours} are not known; convert with ffmpeg \
                                    -pix_fmt gray, gray10le or gray12le"
            )
        })?;
        let rate = rate.filter(|[above, below]| *above > 0 && *below > 0);
        Ok(Self {
            size_px,
            rate,
            bits,
            chroma,
        })
    }

    fn bytes_of(&self, values: u64) -> u64 {
        values * if self.bits > 8 { 2 } else { 1 }
    }

    fn luma_bytes(&self) -> u64 {
        self.bytes_of(u64::from(self.size_px[0]) * u64::from(self.size_px[1]))
    }

    /// Returns the memory of a frame's image, bytes.
    pub fn picture_bytes(&self) -> u64 {
        self.luma_bytes().max(1)
    }

    /// Returns the offset of every frame's luma, from the first frame's header line at `at`.
    ///
    /// # Errors
    /// Reason why the frames cannot be found, in words. A last frame that is cut off is listed, too;
    /// one that is cut off in its luma fails when it is read.
    pub fn frames(&self, reader: &mut (impl BufRead + Seek)) -> Result<Vec<u64>, String> {
        let mut offsets = Vec::new();
        let words = |cause: io::Error| cause.to_string();
        let end = {
            let here = reader.stream_position().map_err(words)?;
            let end = reader.seek(SeekFrom::End(0)).map_err(words)?;
            reader.seek(SeekFrom::Start(here)).map_err(words)?;
            end
        };
        while start_frame(reader, offsets.len())? {
            if offsets.len() == MOST_FRAMES {
                return Err(format!("more than {MOST_FRAMES} frames; cut it into parts"));
            }
            let at = reader.stream_position().map_err(words)?;
            offsets.push(at);
            let next = at + self.luma_bytes() + self.bytes_of(self.chroma);
            if next >= end {
                break;
            }
            reader.seek(SeekFrom::Start(next)).map_err(words)?;
        }
        Ok(offsets)
    }

    /// Reads the luma of a frame.
    ///
    /// # Errors
    /// If the frame is cut off.
    pub fn luma(&self, reader: &mut impl Read) -> Result<Picture, String> {
        let mut bytes = Vec::new();
        let wanted = self.luma_bytes();
        let words = |cause: io::Error| cause.to_string();
        reader.take(wanted).read_to_end(&mut bytes).map_err(words)?;
        if bytes.len() as u64 != wanted {
            return Err("the frame is cut off".to_owned());
        }
        let [width, height] = self.size_px.map(|side| side as usize);
        if self.bits == 8 {
            return Ok(Picture::Eight(Image {
                width,
                height,
                grey: bytes,
            }));
        }
        let levels = bytes.chunks_exact(2);
        let levels = levels.map(|pair| u16::from_le_bytes([pair[0], pair[1]]));
        Ok(Picture::Sixteen {
            width,
            height,
            levels: levels.collect(),
        })
    }

    /// Reads the next frame of a stream; `None` at its end. `index` is the frame's number from 0.
    ///
    /// # Errors
    /// Reason why the frame cannot be read, in words.
    pub fn next(&self, reader: &mut impl BufRead, index: usize) -> Result<Option<Picture>, String> {
        if !start_frame(reader, index)? {
            return Ok(None);
        }
        let picture = self.luma(reader)?;
        let chroma = self.bytes_of(self.chroma);
        let skipped = io::copy(&mut reader.take(chroma), &mut io::sink());
        match skipped {
            Ok(skipped) if skipped == chroma => Ok(Some(picture)),
            Ok(_) => Err("the frame is cut off".to_owned()),
            Err(cause) => Err(cause.to_string()),
        }
    }
}

/// Returns bits per value and the number of values beside the luma.
fn planes(colours: &str, [width, height]: [u64; 2]) -> Option<(u32, u64)> {
    if let Some(bits) = colours.strip_prefix("mono") {
        let bits = if bits.is_empty() {
            8
        } else {
            bits.parse().ok()?
        };
        return (8..=16).contains(&bits).then_some((bits, 0));
    }
    let (base, bits) = match colours.rsplit_once('p') {
        Some((base, bits)) if bits.bytes().all(|b| b.is_ascii_digit()) && !bits.is_empty() => {
            (base, bits.parse().ok()?)
        }
        _ => (colours, 8),
    };
    let half = width.div_ceil(2);
    let chroma = match base {
        "420" | "420jpeg" | "420mpeg2" | "420paldv" => 2 * half * height.div_ceil(2),
        "411" => 2 * width.div_ceil(4) * height,
        "422" => 2 * half * height,
        "444" => 2 * width * height,
        "444alpha" => 3 * width * height,
        _ => return None,
    };
    (8..=16).contains(&bits).then_some((bits, chroma))
}

/// Reads the line before a frame; returns false at the end of the video.
fn start_frame(reader: &mut impl BufRead, index: usize) -> Result<bool, String> {
    let Some(line) = line(reader)? else {
        return Ok(false);
    };
    match line == "FRAME" || line.starts_with("FRAME ") {
        true => Ok(true),
        false => Err(format!("no FRAME where frame {} should begin", index + 1)),
    }
}

/// Reads a line; `None` at the end of the file.
fn line(reader: &mut impl BufRead) -> Result<Option<String>, String> {
    let mut line = Vec::new();
    let mut limited = reader.take(LONGEST_LINE);
    let count = limited.read_until(b'\n', &mut line);
    match count {
        Ok(0) => Ok(None),
        Ok(_) => match (line.pop(), String::from_utf8(line)) {
            (Some(b'\n'), Ok(line)) => Ok(Some(line)),
            _ => Err("not a Y4M video, or cut off within a header line".to_owned()),
        },
        Err(cause) => Err(cause.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    #[test]
    fn luma_of_every_colour_space_is_read() {
        for (colours, bits, chroma) in [
            ("", 8, 4),
            (" C420jpeg", 8, 4),
            (" C420paldv", 8, 4),
            (" C422", 8, 8),
            (" C444", 8, 12),
            (" C444alpha", 8, 18),
            (" C411", 8, 4),
            (" Cmono", 8, 0),
            (" Cmono12", 12, 0),
            (" C420p10 XYSCSS=420P10", 10, 8),
            (" C444p16", 16, 24),
        ] {
            let mut file = format!("YUV4MPEG2 W3 H2 F30000:1001 Ip{colours}\n").into_bytes();
            let width = if bits > 8 { 2 } else { 1 };
            for frame in 1..=2_u8 {
                file.extend(b"FRAME\n");
                for value in 0..6 {
                    file.extend(&[frame * 10 + value, 3][..width]);
                }
                file.extend(vec![200; chroma]);
            }
            let mut reader = Cursor::new(&file);
            let header = Header::read(&mut reader).unwrap();
            assert_eq!(
                (header.bits, header.rate),
                (bits, Some([30_000, 1001])),
                "{colours}"
            );
            let offsets = header.frames(&mut reader).unwrap();
            assert_eq!(offsets.len(), 2, "{colours}");
            let mut stream = Cursor::new(&file);
            Header::read(&mut stream).unwrap();
            for (index, at) in offsets.iter().enumerate() {
                let picture = header.luma(&mut &file[*at as usize..]).unwrap();
                let first = 10 * (index as u16 + 1);
                match &picture {
                    Picture::Eight(image) => assert_eq!(u16::from(image.grey[0]), first),
                    Picture::Sixteen { levels, .. } => assert_eq!(levels[0], 0x300 + first),
                }
                assert_eq!(
                    header.next(&mut stream, index),
                    Ok(Some(picture)),
                    "{colours}"
                );
            }
            assert_eq!(header.next(&mut stream, 2), Ok(None), "{colours}");
        }
    }

    #[test]
    fn unreadable_video_is_refused() {
        for (text, reason) in [
            ("", "empty"),
            ("RIFF\n", "does not begin with YUV4MPEG2"),
            ("YUV4MPEG2 W3 H2 Cfoo\n", "Cfoo are not known"),
            ("YUV4MPEG2 W3 H2 It\n", "interlaced"),
            ("YUV4MPEG2 W3\n", "3 x 0 px"),
            ("YUV4MPEG2 Wx H2\n", "`Wx`"),
            ("YUV4MPEG2 W3 H2", "cut off"),
        ] {
            let said = Header::read(&mut text.as_bytes()).unwrap_err();
            assert!(said.contains(reason), "{text}: {said}");
        }
        let header = Header::parse("YUV4MPEG2 W3 H2 Cmono").unwrap();
        let cut = header.next(&mut &b"FRAME\n12345"[..], 0).unwrap_err();
        assert!(cut.contains("cut off"), "{cut}");
        let wrong = header.next(&mut &b"FLAME\n123456"[..], 4).unwrap_err();
        assert!(wrong.contains("frame 5"), "{wrong}");
    }
}
