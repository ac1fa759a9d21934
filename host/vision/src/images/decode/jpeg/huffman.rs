//! Bits of a scan and Huffman codes (ITU-T T.81, annexes C and F).

/// Largest length of codes that are looked up in one step, bits.
const FAST: u32 = 9;

/// Longest code, bits.
const LONGEST: usize = 16;

/// Reason why decoding of a scan stops.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stop {
    /// The data of the scan, or of its restart interval, end before its blocks do.
    Short,
    /// The data hold an unknown code, or a coefficient after the last.
    Wrong,
}

/// Huffman code.
#[derive(Clone, Debug)]
pub(super) struct Table {
    /// Length and value by the next [`FAST`] bits; length 0 for longer codes.
    fast: Vec<(u8, u8)>,
    /// One more than the last code of each length, shifted to 16 bits.
    ends: [u32; LONGEST + 1],
    /// Value of the first code of each length, minus that code.
    offsets: [i32; LONGEST + 1],
    values: Vec<u8>,
}

impl Table {
    /// Creates the table of these counts of codes by length, and values; `None` if there are too
    /// many.
    pub fn new(counts: &[u8], values: &[u8]) -> Option<Self> {
        let mut table = Self {
            fast: vec![(0, 0); 1 << FAST],
            ends: [0; LONGEST + 1],
            offsets: [0; LONGEST + 1],
            values: values.to_vec(),
        };
        let (mut code, mut index) = (0_u32, 0_usize);
        for (length, count) in (1..).zip(counts).take(LONGEST) {
            table.offsets[length] = index as i32 - code as i32;
            for _ in 0..*count {
                if code >= 1 << length {
                    return None;
                }
                if length as u32 <= FAST {
                    let spare = FAST - length as u32;
                    let first = (code << spare) as usize;
                    let value = *values.get(index)?;
                    table.fast[first..first + (1 << spare)].fill((length as u8, value));
                }
                code += 1;
                index += 1;
            }
            table.ends[length] = code << (LONGEST - length);
            code <<= 1;
        }
        (index <= values.len()).then_some(table)
    }
}

/// Bits of a scan up to the next marker.
#[derive(Clone, Debug)]
pub(super) struct Bits<'a> {
    data: &'a [u8],
    at: usize,
    buffer: u64,
    count: u32,
}

impl<'a> Bits<'a> {
    /// Starts at the first byte.
    pub fn new(data: &'a [u8]) -> Self {
        Self {
            data,
            at: 0,
            buffer: 0,
            count: 0,
        }
    }

    fn fill(&mut self) {
        while self.count <= 56 {
            let byte = match (self.data.get(self.at), self.data.get(self.at + 1)) {
                (Some(0xFF), Some(0)) => {
                    self.at += 2;
                    0xFF
                }
                // A marker follows, perhaps after padding.
                (Some(0xFF), _) | (None, _) => return,
                (Some(byte), _) => {
                    self.at += 1;
                    *byte
                }
            };
            self.buffer = self.buffer << 8 | u64::from(byte);
            self.count += 8;
        }
    }

    /// Takes `count` bits, at most 16.
    pub fn take(&mut self, count: u32) -> Result<u32, Stop> {
        if self.count < count {
            self.fill();
        }
        self.count = self.count.checked_sub(count).ok_or(Stop::Short)?;
        Ok((self.buffer >> self.count) as u32 & ((1 << count) - 1))
    }

    /// Takes a code and returns its value.
    pub fn decode(&mut self, table: &Table) -> Result<u8, Stop> {
        if self.count < LONGEST as u32 {
            self.fill();
        }
        // Zeros follow the end; codes made of them are refused as too short.
        let next = match self.count.checked_sub(LONGEST as u32) {
            Some(spare) => (self.buffer >> spare) as u32 & 0xFFFF,
            None => ((self.buffer << (LONGEST as u32 - self.count)) & 0xFFFF) as u32,
        };
        let (length, value) = table.fast[(next >> (LONGEST as u32 - FAST)) as usize];
        if length > 0 {
            self.take(length.into())?;
            return Ok(value);
        }
        let length = (1..=LONGEST).find(|length| next < table.ends[*length]);
        let Some(length) = length else {
            let is_end = self.count < LONGEST as u32;
            return Err(if is_end { Stop::Short } else { Stop::Wrong });
        };
        self.take(length as u32)?;
        let code = next >> (LONGEST - length);
        let index = table.offsets[length] + code as i32;
        let value = usize::try_from(index)
            .ok()
            .and_then(|i| table.values.get(i));
        value.copied().ok_or(Stop::Wrong)
    }

    /// Continues after the next restart marker.
    pub fn restart(&mut self) -> Result<(), Stop> {
        (self.buffer, self.count) = (0, 0);
        let rest = self.data.get(self.at..).unwrap_or_default();
        let is_marker = |pair: &[u8]| pair[0] == 0xFF && !matches!(pair[1], 0 | 0xFF);
        let next = rest.windows(2).position(is_marker).ok_or(Stop::Short)?;
        match rest[next + 1] {
            0xD0..=0xD7 => {
                self.at += next + 2;
                Ok(())
            }
            _ => Err(Stop::Short),
        }
    }
}
