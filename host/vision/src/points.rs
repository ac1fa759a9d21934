//! Reads matched points from a CSV file.
//!
//! ```csv
//! id,camera,x0,y0,x1,y1
//! 1,left,193.2,101.7,197.4,105.5
//! 1,middle,159.9,101.7,163.8,105.5
//! ```
//!
//! Each row is one point in one camera: its pixel at the keyframe (`x0`, `y0`) and its pixel now
//! (`x1`, `y1`). Pixels are raw, from the centre of the top left pixel; the rig file corrects for
//! principal point and lens distortion. Rows may come in any order; points keep the order of their
//! first rows, so that the same file always gives the same sums.
//!
//! A byte order mark, CRLF, blank lines and spaces around fields are accepted. Any other deviation
//! is refused with file, line and field before any row is used. Points that some camera has not
//! seen are left out and counted.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::path::Path;

use crate::flow::Correspondence;
use trinocular_rig::choice;
use trinocular_rig::error::InputError;
use trinocular_rig::input::{self, Limit};
use trinocular_rig::printable::printable_up_to;
use trinocular_rig::rig_file::RigFile;

/// Names of the columns, in this order.
pub const HEADER: [&str; 6] = ["id", "camera", "x0", "y0", "x1", "y1"];

/// Size limit of a file: each point of each camera takes some 60 bytes.
const LIMIT: Limit = Limit {
    what: "a CSV file of points",
    bytes: 32 << 20,
};
/// Largest number of points of one file.
const MOST_POINTS: usize = 500_000;
/// Longest row, bytes.
const LONGEST_ROW: usize = 4_096;
/// Largest number of columns read.
const MOST_COLUMNS: usize = 16;
/// Largest number of doubtful rows that are named.
const MOST_DOUBTS: usize = 20;
/// Longest quotation of a field in a message, characters.
const QUOTED: usize = 60;

/// The points of one file.
#[derive(Clone, Debug)]
pub struct Points {
    /// Rows that do not fit the others, each with its line and the size of the misfit.
    pub doubts: Vec<InputError>,
    /// Points that every camera has seen and that fit the rig.
    pub correspondences: Vec<Correspondence>,
    /// Number of points that some camera has not seen or that contradict the rig.
    pub rejected: usize,
    /// Description of the points that contradict the rig.
    pub contradiction: Option<String>,
    /// Inflation of the displacement's variance by points that fit the rig less than their noise
    /// explains.
    pub variance_inflation: f64,
}

impl Points {
    /// Returns sentences about rows that do not fit: each of the first with its line, or the number
    /// of all points that contradict the rig.
    pub fn warnings(&self) -> Vec<String> {
        // Rows that do not fit are named one by one; then their number says nothing new.
        if self.doubts.is_empty() {
            return self.contradiction.iter().cloned().collect();
        }
        let named = self.doubts.iter().take(MOST_DOUBTS);
        let mut warnings: Vec<String> = named.map(ToString::to_string).collect();
        match self.doubts.len().saturating_sub(MOST_DOUBTS) {
            0 => {}
            more => warnings.push(format!("{more} more rows do not fit the others")),
        }
        warnings
    }
}

/// Reads the CSV file at `path`, whose cameras are those of `rig`.
pub fn read(path: &Path, rig: &RigFile) -> Result<Points, InputError> {
    parse(path, &input::bytes(path, LIMIT)?, rig)
}

/// Reads the content of a CSV file; errors name `file`.
///
/// ```
/// use std::path::Path;
/// use trinocular_rig::rig_file::RigFile;
/// use trinocular_vision::points::parse;
///
/// let text = "id,camera,x0,y0,x1,y1
/// 1,left,193.2,101.7,197.4,105.5
/// 1,middle,159.9,101.7,163.8,105.5
/// 1,right,114.0,101.7,118.1,105.5
/// 2,left,10,20,30,40
/// ";
/// let points = parse(Path::new("points.csv"), text.as_bytes(), &RigFile::paper())?;
/// // Two cameras have not seen the second point.
/// assert_eq!((points.correspondences.len(), points.rejected), (1, 1));
/// # Ok::<(), trinocular_rig::error::InputError>(())
/// ```
pub fn parse(file: &Path, bytes: &[u8], rig: &RigFile) -> Result<Points, InputError> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    input::refuse_utf16(file, bytes)?;
    let text = std::str::from_utf8(bytes)
        .map_err(|error| not_utf8(file, bytes.get(..error.valid_up_to()).unwrap_or_default()))?;

    let mut points = Collector::new(rig);
    let mut header_seen = false;
    let mut lines = LineCounter::new(text);
    let mut rows = Rows::new(text);
    loop {
        let start = rows.start;
        let Some(row) = rows.next() else {
            break;
        };
        let line = lines.at(start);
        let fields = row.map_err(|reason| InputError::line(file, line, reason.to_string()))?;
        if fields == [""] {
            continue;
        }
        let refuse = |field: &str, reason: String| InputError::field(file, line, field, reason);
        if header_seen {
            points.row(line, &fields, &refuse)?;
        } else {
            header(&fields, &refuse)?;
            header_seen = true;
        }
    }
    if !header_seen {
        let expected = HEADER.join(",");
        return Err(InputError::line(
            file,
            1,
            format!("the file is empty; expected the header {expected}"),
        ));
    }
    points.finish(file, lines.current)
}

fn not_utf8(file: &Path, before: &[u8]) -> InputError {
    let line = 1 + before.iter().filter(|&&byte| byte == b'\n').count();
    let row = before.rsplit(|&byte| byte == b'\n').next();
    let commas = row.unwrap_or_default().iter().filter(|&&b| b == b',');
    let reason = "not UTF-8 text";
    match HEADER.get(commas.count()) {
        Some(field) => InputError::field(file, line, *field, reason),
        None => InputError::line(file, line, reason),
    }
}

/// Reason for a text that is not a row.
#[derive(Clone, Copy, Debug, thiserror::Error)]
enum LongRow {
    #[error("a row of more than {LONGEST_ROW} bytes")]
    Bytes,
    #[error("a row of more than {MOST_COLUMNS} columns")]
    Columns,
}

/// Iterator over the rows of a CSV text, in constant memory.
struct Rows<'a> {
    text: &'a [u8],
    /// Byte offset of the next row.
    start: usize,
    reader: csv_core::Reader,
    content: [u8; LONGEST_ROW],
    ends: [usize; MOST_COLUMNS],
}

impl<'a> Rows<'a> {
    fn new(text: &'a str) -> Self {
        Self {
            text: text.as_bytes(),
            start: 0,
            reader: csv_core::Reader::new(),
            content: [0; LONGEST_ROW],
            ends: [0; MOST_COLUMNS],
        }
    }

    /// Returns the next row's fields without the spaces around them, or the reason why it is not a
    /// row.
    fn next(&mut self) -> Option<Result<Vec<&str>, LongRow>> {
        use csv_core::ReadRecordResult as Outcome;
        let (mut length, mut count) = (0, 0);
        loop {
            let rest = self.text.get(self.start..).unwrap_or_default();
            let (content, ends) = (&mut self.content[length..], &mut self.ends[count..]);
            let (outcome, read, written, ended) = self.reader.read_record(rest, content, ends);
            self.start += read;
            length += written;
            count += ended;
            match outcome {
                // At the next call, the reader reports the end of the text.
                Outcome::InputEmpty => {}
                Outcome::OutputFull => {
                    return Some(Err(LongRow::Bytes));
                }
                Outcome::OutputEndsFull => {
                    return Some(Err(LongRow::Columns));
                }
                Outcome::Record => break,
                Outcome::End => return None,
            }
        }
        let mut from = 0;
        let fields = self.ends[..count].iter().map(|&end| {
            let field = self.content.get(from..end).unwrap_or_default();
            from = end;
            std::str::from_utf8(field).unwrap_or_default().trim()
        });
        Some(Ok(fields.collect()))
    }
}

/// Quotes a field for a message.
fn quoted(text: &str) -> String {
    printable_up_to(QUOTED, text)
}

/// Counts the lines of the text by byte offset. The CSV reader's own count excludes the blank lines
/// that it skips.
struct LineCounter<'a> {
    text: &'a [u8],
    offset: usize,
    current: usize,
}

impl<'a> LineCounter<'a> {
    fn new(text: &'a str) -> Self {
        Self {
            text: text.as_bytes(),
            offset: 0,
            current: 1,
        }
    }

    /// Returns the line of the first text at or after `start`; offsets must not decrease.
    fn at(&mut self, start: usize) -> usize {
        while let Some(&byte) = self.text.get(self.offset) {
            let blank = matches!(byte, b'\n' | b'\r');
            if self.offset >= start && !blank {
                break;
            }
            self.offset += 1;
            // CRLF counts once, by its line feed; a lone carriage return ends a line too.
            if byte == b'\n' || (byte == b'\r' && self.text.get(self.offset) != Some(&b'\n')) {
                self.current += 1;
            }
        }
        self.current
    }
}

/// Creates the error of the current line from a field's name and a reason.
type Refuse<'a> = dyn Fn(&str, String) -> InputError + 'a;

fn header(fields: &[&str], refuse: &Refuse<'_>) -> Result<(), InputError> {
    for (i, expected) in HEADER.iter().enumerate() {
        if fields.get(i) != Some(expected) {
            let found = match fields.get(i) {
                Some(found) => format!("found `{}`", quoted(found)),
                None => "found the end of the line".to_owned(),
            };
            let header = HEADER.join(",");
            let separator = match fields {
                [one] if one.contains(';') => "; the columns are separated by semicolons: ",
                [one] if one.contains('\t') => "; the columns are separated by tabs: ",
                _ => "",
            };
            let way_out = match separator {
                "" => "",
                _ => "save the file with commas between the columns and decimal points",
            };
            return Err(refuse(
                expected,
                format!("the header must be {header}, {found} instead{separator}{way_out}"),
            ));
        }
    }
    too_many(fields, refuse)
}

fn too_many(fields: &[&str], refuse: &Refuse<'_>) -> Result<(), InputError> {
    match fields.get(HEADER.len()) {
        None => Ok(()),
        Some(extra) => {
            // A coordinate with a decimal comma takes two columns.
            let mut coordinates = fields.iter().skip(2);
            let hint = match coordinates.all(|field| field.parse::<i64>().is_ok()) {
                true => " (decimal commas? write 193.2, not 193,2)",
                false => "",
            };
            Err(refuse(
                &format!("column {}", HEADER.len() + 1),
                format!("`{}` is one column too many{hint}", quoted(extra)),
            ))
        }
    }
}

/// One row: its line, and the pixels at the keyframe and now.
#[derive(Clone, Copy)]
struct Sighting {
    line: usize,
    pixels: [[f64; 2]; 2],
}

/// Points collected from the rows so far.
struct Collector<'a> {
    rig: &'a RigFile,
    /// Index in `seen` of each point by its id.
    places: HashMap<String, usize>,
    /// Rows per point, in order of first rows, and per camera.
    seen: Vec<Vec<Option<Sighting>>>,
}

impl<'a> Collector<'a> {
    fn new(rig: &'a RigFile) -> Self {
        Self {
            rig,
            places: HashMap::new(),
            seen: Vec::new(),
        }
    }

    fn row(&mut self, line: usize, fields: &[&str], refuse: &Refuse<'_>) -> Result<(), InputError> {
        too_many(fields, refuse)?;
        if let Some(missing) = HEADER.get(fields.len()) {
            let found = fields.len();
            let reason = format!("missing: {found} of {} columns found", HEADER.len());
            return Err(refuse(missing, reason));
        }
        let &[id, name, x0, y0, x1, y1] = fields else {
            return Err(refuse(HEADER[0], "wrong number of columns".to_owned()));
        };
        if id.is_empty() {
            return Err(refuse("id", "must not be empty".to_owned()));
        }
        let camera = self.rig.names.iter().position(|known| known == name);
        let camera = camera.ok_or_else(|| {
            let known: Vec<&str> = self.rig.names.iter().map(String::as_str).collect();
            refuse("camera", choice::unknown("camera", &quoted(name), &known))
        })?;
        let pixel = |i: usize, text: &str| {
            coordinate(text, self.rig.rig.image_size_px[i % 2])
                .map_err(|reason| refuse(HEADER[2 + i], reason.to_string()))
        };
        let pixels = [
            [pixel(0, x0)?, pixel(1, y0)?],
            [pixel(2, x1)?, pixel(3, y1)?],
        ];
        let place = match self.places.entry(id.to_owned()) {
            Entry::Occupied(entry) => *entry.get(),
            Entry::Vacant(_) if self.seen.len() == MOST_POINTS => {
                return Err(refuse("id", format!("more than {MOST_POINTS} points")));
            }
            Entry::Vacant(entry) => {
                self.seen.push(vec![None; self.rig.names.len()]);
                *entry.insert(self.seen.len() - 1)
            }
        };
        let slot = &mut self.seen[place][camera];
        if let Some(Sighting { line: first, .. }) = slot {
            let id = quoted(id);
            let reason = format!("point `{id}` of camera `{name}` stands in line {first} already");
            return Err(refuse("id", reason));
        }
        *slot = Some(Sighting { line, pixels });
        Ok(())
    }

    /// Returns the complete points. `last_line` is the last line with a row.
    fn finish(self, file: &Path, last_line: usize) -> Result<Points, InputError> {
        for (camera, name) in self.rig.names.iter().enumerate() {
            if self.seen.iter().all(|point| point[camera].is_none()) {
                return Err(InputError::field(
                    file,
                    last_line,
                    "camera",
                    format!("the file ends without any row of camera `{name}`"),
                ));
            }
        }
        let count = self.seen.len();
        let complete: Vec<Vec<Sighting>> = (self.seen.into_iter())
            .filter_map(|point| point.into_iter().collect())
            .collect();
        let correspondences = complete.iter().map(|point| {
            let pixels = point.iter().map(|seen| seen.pixels).collect::<Vec<_>>();
            Correspondence::from_pixels(&self.rig.rig, pixels)
        });
        let judged = contradiction::judge(&self.rig.rig, correspondences.collect());
        Ok(Points {
            doubts: misfit::doubts(file, self.rig, &complete),
            rejected: count - judged.kept.len(),
            correspondences: judged.kept,
            contradiction: judged.remark,
            variance_inflation: judged.variance_inflation,
        })
    }
}

/// Reason for a text that is not a coordinate of a point in an image.
#[derive(Clone, Debug, thiserror::Error)]
enum WrongCoordinate {
    #[error("must not be empty")]
    Empty,
    #[error("`{0}` is not a number")]
    NotANumber(String),
    #[error("`{0}` has a decimal comma; write a decimal point")]
    DecimalComma(String),
    #[error("`{0}` is not a finite number")]
    NotFinite(String),
    #[error("{text} is farther outside the image than its own size ({size_px} px)")]
    Outside { text: String, size_px: u32 },
}

/// Reads one coordinate, px. A point may lie outside the image by up to the image's own size.
fn coordinate(text: &str, size_px: u32) -> Result<f64, WrongCoordinate> {
    if text.is_empty() {
        return Err(WrongCoordinate::Empty);
    }
    let value: f64 = text
        .parse()
        .map_err(|_| match text.replacen(',', ".", 1).parse::<f64>() {
            Ok(_) => WrongCoordinate::DecimalComma(quoted(text)),
            Err(_) => WrongCoordinate::NotANumber(quoted(text)),
        })?;
    if !value.is_finite() {
        return Err(WrongCoordinate::NotFinite(quoted(text)));
    }
    let size = f64::from(size_px);
    if (-size..=2.0 * size).contains(&value) {
        Ok(value)
    } else {
        let text = quoted(text);
        Err(WrongCoordinate::Outside { text, size_px })
    }
}

mod contradiction;
mod misfit;
#[cfg(test)]
mod tests;
