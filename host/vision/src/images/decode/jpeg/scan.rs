//! Count of the blocks of a JPEG file: an image whose data end before its last block is refused.
//!
//! Decoders fill missing data with grey without an error, and an end-of-image marker may follow any
//! rest of a file. This module therefore follows the Huffman codes of each scan, without the
//! transform, to the last block (ITU-T T.81, annexes F and G). A progressive image must also have
//! all of its scans: every coefficient to its last bit.

use super::super::Refusal;
use super::huffman::{Bits, Stop, Table};
use super::{next_marker, segment};

/// Number of coefficients of a block.
const COEFFICIENTS: usize = 64;

const CUT: Refusal = Refusal::CutOff("its compressed data end before the image does");

/// One component of an image.
struct Component {
    id: u8,
    /// Number of blocks of one unit (MCU), across and down.
    unit: [usize; 2],
    /// Number of blocks in a scan of this component alone, across and down.
    own: [usize; 2],
    /// Number of blocks across when all units are whole.
    stride: usize,
    /// Coefficients of each block that are known to differ from zero; only for progressive images.
    nonzero: Vec<u64>,
    /// Number of missing bits of each coefficient; `None` before its first scan.
    missing: [Option<u8>; COEFFICIENTS],
}

/// Properties of an image, from its frame header.
struct Frame {
    is_progressive: bool,
    /// Number of units across and down.
    units: [usize; 2],
    components: Vec<Component>,
}

/// Band of a scan's header: first and last coefficient, and missing bits before and after.
#[derive(Clone, Copy)]
struct Band {
    first: usize,
    last: usize,
    before: u8,
    after: u8,
}

/// Follows all scans of a file whose markers are known to be whole.
///
/// # Errors
/// [`Refusal`] if data are missing or are not Huffman codes. A file without tables, as live cameras
/// send it, is not checked.
pub(super) fn check(file: &[u8]) -> Result<(), Refusal> {
    let (mut frame, mut interval) = (None, 0);
    let mut tables: [[Option<Table>; 4]; 2] = Default::default();
    let mut rest = file.get(2..).unwrap_or_default();
    loop {
        let (skipped, marker) = next_marker(rest)?;
        rest = &rest[skipped + 2..];
        if matches!(marker, 0xD9) && frame.is_some() {
            break;
        }
        if matches!(marker, 0x01 | 0xD0..=0xD9) {
            continue;
        }
        let segment = segment(rest)?;
        rest = &rest[segment.len()..];
        let content = segment.get(2..).unwrap_or_default();
        match marker {
            0xC4 => read_tables(content, &mut tables)?,
            0xDD => interval = content.iter().fold(0, |all, b| all << 8 | usize::from(*b)),
            0xC0..=0xC2 => frame = Some(Frame::read(content, marker == 0xC2)?),
            0xDA => {
                let frame = frame.as_mut().ok_or(CUT)?;
                if !frame.follow(content, &tables, interval, rest)? {
                    return Ok(());
                }
            }
            _ => {}
        }
    }
    frame.map_or(Ok(()), |frame| frame.is_complete())
}

fn wrong(reason: &str) -> Refusal {
    Refusal::Malformed(reason.to_owned())
}

fn read_tables(mut content: &[u8], tables: &mut [[Option<Table>; 4]; 2]) -> Result<(), Refusal> {
    let malformed = || wrong("a Huffman table is malformed");
    while let Some((head, tail)) = content.split_first() {
        let counts = tail.get(..16).ok_or_else(malformed)?;
        let length: usize = counts.iter().map(|count| usize::from(*count)).sum();
        let values = tail.get(16..16 + length).ok_or_else(malformed)?;
        let table = Table::new(counts, values).ok_or_else(malformed)?;
        let slot = tables
            .get_mut(usize::from(head >> 4))
            .and_then(|class| class.get_mut(usize::from(head & 15)));
        *slot.ok_or_else(malformed)? = Some(table);
        content = &tail[16 + length..];
    }
    Ok(())
}

impl Frame {
    fn read(content: &[u8], is_progressive: bool) -> Result<Self, Refusal> {
        let malformed = || wrong("the frame's header is malformed");
        let &[_, h1, h0, w1, w0, _, ref listed @ ..] = content else {
            return Err(malformed());
        };
        let size = [[w1, w0], [h1, h0]].map(|pair| usize::from(u16::from_be_bytes(pair)));
        let sampling = |c: &[u8]| [c[1] >> 4, c[1] & 15].map(usize::from);
        let listed: Vec<&[u8]> = listed.chunks_exact(3).collect();
        if listed.is_empty() || listed.iter().any(|c| sampling(c).contains(&0)) {
            return Err(malformed());
        }
        let most = [0, 1].map(|side| listed.iter().map(|c| sampling(c)[side]).max().unwrap_or(1));
        let units: [usize; 2] = std::array::from_fn(|side| size[side].div_ceil(8 * most[side]));
        let component = |c: &&[u8]| {
            let unit = sampling(c);
            let own = std::array::from_fn(|side| {
                (size[side] * unit[side]).div_ceil(most[side]).div_ceil(8)
            });
            let [across, down] = [0, 1].map(|side| units[side] * unit[side]);
            let blocks = if is_progressive { across * down } else { 0 };
            Component {
                id: c[0],
                unit,
                own,
                stride: across,
                nonzero: vec![0; blocks],
                missing: [None; COEFFICIENTS],
            }
        };
        Ok(Self {
            is_progressive,
            units,
            components: listed.iter().map(component).collect(),
        })
    }

    /// Follows one scan; returns false if its tables are not in the file.
    fn follow(
        &mut self,
        header: &[u8],
        tables: &[[Option<Table>; 4]; 2],
        interval: usize,
        data: &[u8],
    ) -> Result<bool, Refusal> {
        let malformed = || wrong("a scan's header is malformed");
        let (count, listed) = header.split_first().ok_or_else(malformed)?;
        let (listed, band) = listed
            .split_at_checked(2 * usize::from(*count))
            .ok_or_else(malformed)?;
        let &[first, last, bits, ..] = band else {
            return Err(malformed());
        };
        let band = match self.is_progressive {
            true => Band {
                first: first.into(),
                last: last.into(),
                before: bits >> 4,
                after: bits & 15,
            },
            false => Band {
                first: 0,
                last: COEFFICIENTS - 1,
                before: 0,
                after: 0,
            },
        };
        if band.first > band.last || band.last >= COEFFICIENTS {
            return Err(malformed());
        }
        let mut chosen = Vec::new();
        for pair in listed.chunks_exact(2) {
            let index = self.components.iter().position(|c| c.id == pair[0]);
            let table = |class: usize, number: u8| {
                let slot = tables.get(class).and_then(|t| t.get(usize::from(number)));
                slot.and_then(Option::as_ref)
            };
            let (dc, ac) = (table(0, pair[1] >> 4), table(1, pair[1] & 15));
            let needs_dc = band.first == 0 && band.before == 0;
            let needs_ac = band.last > 0;
            if needs_dc && dc.is_none() || needs_ac && ac.is_none() {
                return Ok(false);
            }
            chosen.push((index.ok_or_else(malformed)?, dc, ac));
        }
        if chosen.is_empty() {
            return Err(malformed());
        }
        let is_alone = chosen.len() == 1;
        let [across, down] = match chosen[..] {
            [(index, ..)] => self.components[index].own,
            _ => self.units,
        };
        let mut walk = Walk {
            bits: Bits::new(data),
            band,
            is_progressive: self.is_progressive,
            end_run: 0,
        };
        let failed = |stop: Stop| match stop {
            Stop::Short => CUT,
            Stop::Wrong => wrong("its compressed data are damaged"),
        };
        for unit in 0..across * down {
            if interval > 0 && unit > 0 && unit.is_multiple_of(interval) {
                walk.bits.restart().map_err(failed)?;
                walk.end_run = 0;
            }
            let at = [unit % across, unit / across];
            for (index, dc, ac) in &chosen {
                let component = &mut self.components[*index];
                let [wide, high] = if is_alone { [1, 1] } else { component.unit };
                for block in 0..wide * high {
                    let column = at[0] * wide + block % wide;
                    let row = at[1] * high + block / wide;
                    let mut unused = 0;
                    let place = row * component.stride + column;
                    let nonzero = component.nonzero.get_mut(place).unwrap_or(&mut unused);
                    walk.block(*dc, *ac, nonzero).map_err(failed)?;
                }
            }
        }
        for (index, ..) in &chosen {
            self.components[*index].missing[band.first..=band.last].fill(Some(band.after));
        }
        Ok(true)
    }

    fn is_complete(&self) -> Result<(), Refusal> {
        let mut missing = self.components.iter().flat_map(|c| c.missing);
        match missing.all(|bits| bits == Some(0)) {
            true => Ok(()),
            false => Err(Refusal::CutOff("its last scans are missing")),
        }
    }
}

/// State while following one scan.
struct Walk<'a> {
    bits: Bits<'a>,
    band: Band,
    is_progressive: bool,
    /// Number of blocks whose band has ended already.
    end_run: u32,
}

impl Walk<'_> {
    fn block(
        &mut self,
        dc: Option<&Table>,
        ac: Option<&Table>,
        nonzero: &mut u64,
    ) -> Result<(), Stop> {
        let is_first = self.band.before == 0;
        let mut from = self.band.first;
        if from == 0 {
            if is_first {
                let length = self.bits.decode(dc.ok_or(Stop::Wrong)?)?;
                self.skip(length)?;
            } else {
                self.bits.take(1)?;
            }
            from = 1;
        }
        if self.band.last == 0 {
            return Ok(());
        }
        let ac = ac.ok_or(Stop::Wrong)?;
        match (self.is_progressive, is_first) {
            (false, _) => self.sequential(ac),
            (true, true) => self.first(ac, from, nonzero),
            (true, false) => self.refined(ac, from, nonzero),
        }
    }

    /// Skips the bits of a coefficient.
    fn skip(&mut self, length: u8) -> Result<(), Stop> {
        if length > 16 {
            return Err(Stop::Wrong);
        }
        self.bits.take(length.into()).map(drop)
    }

    fn sequential(&mut self, ac: &Table) -> Result<(), Stop> {
        let mut k = 1;
        while k < COEFFICIENTS {
            let symbol = self.bits.decode(ac)?;
            let (run, length) = (usize::from(symbol >> 4), symbol & 15);
            match (run, length) {
                (15, 0) => k += 16,
                (_, 0) => return Ok(()),
                _ => {
                    k += run + 1;
                    if k > COEFFICIENTS {
                        return Err(Stop::Wrong);
                    }
                    self.skip(length)?;
                }
            }
        }
        Ok(())
    }

    /// Returns the number of blocks whose bands end with a code of this run.
    fn end_of_band(&mut self, run: usize) -> Result<u32, Stop> {
        Ok((1 << run) + self.bits.take(run as u32)?)
    }

    /// Follows the first bits of a band (T.81, G.1.2.2).
    fn first(&mut self, ac: &Table, from: usize, nonzero: &mut u64) -> Result<(), Stop> {
        if self.end_run > 0 {
            self.end_run -= 1;
            return Ok(());
        }
        let mut k = from;
        while k <= self.band.last {
            let symbol = self.bits.decode(ac)?;
            let (run, length) = (usize::from(symbol >> 4), symbol & 15);
            match (run, length) {
                (15, 0) => k += 16,
                (_, 0) => {
                    self.end_run = self.end_of_band(run)? - 1;
                    return Ok(());
                }
                _ => {
                    k += run;
                    if k > self.band.last {
                        return Err(Stop::Wrong);
                    }
                    *nonzero |= 1 << k;
                    self.skip(length)?;
                    k += 1;
                }
            }
        }
        Ok(())
    }

    /// Follows one more bit of a band (T.81, G.1.2.3).
    fn refined(&mut self, ac: &Table, from: usize, nonzero: &mut u64) -> Result<(), Stop> {
        let mut k = from;
        while self.end_run == 0 && k <= self.band.last {
            let symbol = self.bits.decode(ac)?;
            let (mut zeros, length) = (usize::from(symbol >> 4), symbol & 15);
            if length == 0 && zeros < 15 {
                self.end_run = self.end_of_band(zeros)?;
                break;
            }
            if length > 0 {
                self.bits.take(1)?;
            }
            // Skips the run of zeros; each known nonzero coefficient has one bit.
            while k <= self.band.last {
                if *nonzero >> k & 1 == 1 {
                    self.bits.take(1)?;
                } else if zeros == 0 {
                    break;
                } else {
                    zeros -= 1;
                }
                k += 1;
            }
            if length > 0 && k <= self.band.last {
                *nonzero |= 1 << k;
            }
            k += 1;
        }
        if self.end_run > 0 {
            for k in k..=self.band.last {
                self.bits.take((*nonzero >> k & 1) as u32)?;
            }
            self.end_run -= 1;
        }
        Ok(())
    }
}
