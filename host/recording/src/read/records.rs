//! Records of an MCAP file in the order of the file, those within chunks included.
//!
//! The reader of the `mcap` crate (0.26) panics on two kinds of malformed record: an attachment
//! shorter than its fields, and a record that is longer than its chunk. The framing is read here,
//! because every file may be damaged or foreign. Limits: a record or an unpacked chunk has at most
//! [`LARGEST`] bytes, and memory grows with the bytes that are there, not with those that are
//! claimed.

use super::fields::{Fields, Unfit};
use std::io::{self, Read};
use trinocular_vision::images::decode::caught;

/// Largest record, and largest unpacked chunk, bytes.
pub const LARGEST: u64 = 256 << 20;

/// Longest search for the end of a file without the right beginning, bytes. An endless file is
/// refused soon.
const FARTHEST_END: u64 = 1 << 30;

/// Bytes of a record's opcode and length.
const HEAD: usize = 9;

mod op {
    pub const FOOTER: u8 = 0x02;
    pub const SCHEMA: u8 = 0x03;
    pub const CHANNEL: u8 = 0x04;
    pub const MESSAGE: u8 = 0x05;
    pub const CHUNK: u8 = 0x06;
    pub const ATTACHMENT: u8 = 0x09;
    pub const METADATA: u8 = 0x0c;
    pub const DATA_END: u8 = 0x0f;
}

/// One record of the data section. Headers, indexes and unknown records are skipped.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Record {
    /// Schema of messages.
    Schema {
        /// Number, not zero.
        id: u16,
        /// Name of the message.
        name: String,
        /// Language of the definition, such as `ros2msg`.
        encoding: String,
    },
    /// Channel of messages.
    Channel {
        /// Number.
        id: u16,
        /// Number of its schema; zero for none.
        schema: u16,
        /// Topic.
        topic: String,
        /// Encoding of its messages, such as `cdr`.
        encoding: String,
    },
    /// Message.
    Message {
        /// Number of its channel.
        channel: u16,
        /// Sequence number.
        sequence: u32,
        /// Instant of recording, ns.
        log_time: u64,
        /// Encoded message.
        data: Vec<u8>,
    },
    /// File within the file.
    Attachment {
        /// Name.
        name: String,
        /// Content.
        data: Vec<u8>,
    },
    /// Named texts.
    Metadata {
        /// Name.
        name: String,
        /// Texts by name.
        texts: Vec<(String, String)>,
    },
    /// End of the data section.
    End,
}

/// Reason for which a file cannot be read on.
#[derive(Debug, thiserror::Error)]
pub enum Damage {
    /// The file does not start as an MCAP file does.
    #[error("is no MCAP file: it does not start with the MCAP magic bytes")]
    Foreign,
    /// The file ends as an MCAP file does, but does not start as one.
    #[error(
        "has lost its beginning: it ends as an MCAP file does, but does not start as one. Cameras, \
         rig and keyframe stood there; copy the whole file again from where it was recorded"
    )]
    Headless,
    /// The file ends within a record.
    #[error("is cut off at byte {0}: what stands before was read")]
    CutOff(u64),
    /// A record contradicts the format.
    #[error(
        "is damaged at byte {at}: {what}; to read what stands before, cut it off there: \
         head -c {at} FILE > PART.mcap"
    )]
    Malformed {
        /// Place of the record in the file.
        at: u64,
        /// The contradiction.
        what: String,
    },
    /// A chunk is compressed in a way that is not read.
    #[error(
        "has chunks with {0:?} compression, which is not read; convert it first: \
         mcap compress --compression none IN -o OUT"
    )]
    Compression(String),
    /// The file cannot be read.
    #[error("cannot be read: {0}")]
    Io(#[from] io::Error),
}

/// Parses the content of a record; `None` if the record says nothing here.
fn parse(opcode: u8, content: &[u8]) -> Result<Option<Record>, Unfit> {
    let mut fields = Fields(content);
    Ok(Some(match opcode {
        op::SCHEMA => Record::Schema {
            id: fields.u16("a schema's number")?,
            name: fields.text("a schema's name")?,
            encoding: fields.text("a schema's encoding")?,
        },
        op::CHANNEL => Record::Channel {
            id: fields.u16("a channel's number")?,
            schema: fields.u16("a channel's schema")?,
            topic: fields.topic()?,
            encoding: fields.text("a channel's encoding")?,
        },
        op::MESSAGE => {
            let channel = fields.u16("a message's channel")?;
            let sequence = fields.u32("a message's number")?;
            let log_time = fields.u64("a message's time")?;
            fields.u64("a message's time")?;
            let data = fields.0.to_vec();
            Record::Message {
                channel,
                sequence,
                log_time,
                data,
            }
        }
        op::ATTACHMENT => {
            fields.take(16, "an attachment's times")?;
            let name = fields.text("an attachment's name")?;
            fields.text("an attachment's type")?;
            let data = fields.long_block("an attachment's content")?.to_vec();
            let summed = content.len() - fields.0.len();
            let checksum = fields.u32("an attachment's checksum")?;
            if checksum != 0 && crc32fast::hash(&content[..summed]) != checksum {
                return Err(Unfit("an attachment, by its checksum,"));
            }
            Record::Attachment { name, data }
        }
        op::METADATA => {
            let name = fields.text("a metadata's name")?;
            let mut inner = Fields(fields.block("metadata")?);
            let mut texts = Vec::new();
            while !inner.0.is_empty() {
                texts.push((inner.text("metadata")?, inner.text("metadata")?));
            }
            Record::Metadata { name, texts }
        }
        op::DATA_END | op::FOOTER => Record::End,
        _ => return Ok(None),
    }))
}

/// Header and packed records of a chunk.
struct Chunk<'a> {
    unpacked: u64,
    checksum: u32,
    compression: String,
    packed: &'a [u8],
}

impl<'a> Chunk<'a> {
    fn parse(content: &'a [u8]) -> Result<Self, Unfit> {
        let mut fields = Fields(content);
        fields.take(16, "a chunk's times")?;
        Ok(Self {
            unpacked: fields.u64("a chunk's size")?,
            checksum: fields.u32("a chunk's checksum")?,
            compression: fields.text("a chunk's compression")?,
            packed: fields.long_block("a chunk's records")?,
        })
    }
}

/// Runs a decoder of foreign bytes; a panic becomes an error.
fn decoded(decode: impl FnOnce() -> io::Result<usize>) -> io::Result<usize> {
    caught(decode).unwrap_or_else(|| Err(io::Error::other("its content confuses the decoder")))
}

/// Reads to the end, at most [`FARTHEST_END`] bytes; returns true if the last bytes are those of an
/// MCAP file.
fn ends_as_mcap(source: impl Read, mut last: Vec<u8>) -> io::Result<bool> {
    let mut source = source.take(FARTHEST_END);
    let mut block = vec![0; 1 << 16];
    loop {
        match source.read(&mut block)? {
            0 => return Ok(last.ends_with(mcap::MAGIC)),
            count => {
                last.extend_from_slice(&block[..count]);
                last.drain(..last.len().saturating_sub(mcap::MAGIC.len()));
            }
        }
    }
}

/// Reader of the records of a file.
pub struct Records<R> {
    source: R,
    /// Place of the next record in the file.
    place: u64,
    /// Records of the present chunk, and how far they are read.
    chunk: Vec<u8>,
    read: usize,
    /// Place of the chunk in the file.
    chunk_place: u64,
    is_over: bool,
}

impl<R: Read> Records<R> {
    /// Begins to read a file.
    ///
    /// # Errors
    /// [`Damage::Foreign`] if it is no MCAP file, [`Damage::Headless`] if only its beginning is
    /// missing.
    pub fn new(mut source: R) -> Result<Self, Damage> {
        let mut magic = Vec::new();
        let length = mcap::MAGIC.len() as u64;
        (&mut source).take(length).read_to_end(&mut magic)?;
        if magic != mcap::MAGIC {
            return Err(match ends_as_mcap(source, magic)? {
                true => Damage::Headless,
                false => Damage::Foreign,
            });
        }
        Ok(Self {
            source,
            place: length,
            chunk: Vec::new(),
            read: 0,
            chunk_place: 0,
            is_over: false,
        })
    }

    /// Reads the next record of the file into `content`; `None` at the end of the file.
    fn next_in_file(&mut self, content: &mut Vec<u8>) -> Result<Option<u8>, Damage> {
        let mut head = Vec::with_capacity(HEAD);
        (&mut self.source)
            .take(HEAD as u64)
            .read_to_end(&mut head)?;
        let Some((&opcode, length)) = head.split_first() else {
            return Ok(None);
        };
        let Ok(length) = length.try_into().map(u64::from_le_bytes) else {
            return Err(Damage::CutOff(self.place));
        };
        if length > LARGEST {
            let most = LARGEST >> 20;
            return Err(self.malformed(&format!(
                "a record claims {length} bytes, more than {most} MB"
            )));
        }
        content.clear();
        // Grows with what comes: a claim alone costs no memory.
        let came = (&mut self.source).take(length).read_to_end(content)?;
        if (came as u64) < length {
            return Err(Damage::CutOff(self.place));
        }
        self.place += HEAD as u64 + length;
        Ok(Some(opcode))
    }

    /// Returns the place of the present record in the file.
    pub fn place(&self) -> u64 {
        match self.read < self.chunk.len() {
            true => self.chunk_place,
            false => self.place,
        }
    }

    fn malformed(&self, what: &str) -> Damage {
        Damage::Malformed {
            at: self.place(),
            what: what.to_owned(),
        }
    }

    fn unpack(&mut self, content: &[u8], at: u64) -> Result<(), Damage> {
        let malformed = |what: String| Damage::Malformed { at, what };
        let chunk = Chunk::parse(content);
        let chunk = chunk.map_err(|Unfit(what)| malformed(format!("{what} is malformed")))?;
        if chunk.unpacked > LARGEST {
            let most = LARGEST >> 20;
            return Err(malformed(format!(
                "a chunk claims {} bytes, more than {most} MB",
                chunk.unpacked
            )));
        }
        self.chunk.clear();
        self.read = 0;
        self.chunk_place = at;
        // One byte more shows a chunk that is longer than it claims.
        let most = chunk.unpacked + 1;
        let records = &mut self.chunk;
        let unpacked = match chunk.compression.as_str() {
            "" => chunk.packed.take(most).read_to_end(records),
            "lz4" => decoded(|| {
                let decoder = lz4_flex::frame::FrameDecoder::new(chunk.packed);
                decoder.take(most).read_to_end(records)
            }),
            "zstd" => decoded(|| {
                let decoder = ruzstd::decoding::StreamingDecoder::new(chunk.packed);
                let decoder = decoder.map_err(|error| io::Error::other(error.to_string()))?;
                decoder.take(most).read_to_end(records)
            }),
            other => return Err(Damage::Compression(other.to_owned())),
        };
        let outcome = match unpacked {
            Err(error) => Err(format!("a chunk cannot be unpacked: {error}")),
            Ok(length) if length as u64 != chunk.unpacked => {
                Err("a chunk has another size than it claims".to_owned())
            }
            Ok(_) if chunk.checksum != 0 && crc32fast::hash(&self.chunk) != chunk.checksum => {
                Err("the checksum of a chunk is wrong".to_owned())
            }
            Ok(_) => Ok(()),
        };
        outcome.map_err(|what| {
            self.chunk.clear();
            malformed(what)
        })
    }

    fn next_record(&mut self) -> Result<Option<Record>, Damage> {
        let mut content = Vec::new();
        loop {
            while self.read < self.chunk.len() {
                let at = self.chunk_place;
                let malformed = |what: String| Damage::Malformed { at, what };
                let mut rest = Fields(self.chunk.get(self.read..).unwrap_or_default());
                let before = rest.0.len();
                let parsed = rest
                    .number("a record")
                    .and_then(|[opcode]| Ok((opcode, rest.long_block("a record")?)))
                    .and_then(|(opcode, content)| parse(opcode, content));
                self.read += before - rest.0.len();
                let parsed =
                    parsed.map_err(|Unfit(what)| malformed(format!("{what} is malformed")))?;
                // Only these may stand in a chunk.
                if let Some(
                    record @ (Record::Schema { .. }
                    | Record::Channel { .. }
                    | Record::Message { .. }),
                ) = parsed
                {
                    return Ok(Some(record));
                }
            }
            let at = self.place;
            let Some(opcode) = self.next_in_file(&mut content)? else {
                return Err(Damage::CutOff(self.place));
            };
            if opcode == op::CHUNK {
                self.unpack(&content, at)?;
                continue;
            }
            let parsed = parse(opcode, &content).map_err(|Unfit(what)| Damage::Malformed {
                at,
                what: format!("{what} is malformed"),
            })?;
            match parsed {
                Some(Record::End) => return Ok(None),
                Some(record) => return Ok(Some(record)),
                None => {}
            }
        }
    }
}

/// Ends after the data section or the first error.
impl<R: Read> Iterator for Records<R> {
    type Item = Result<Record, Damage>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.is_over {
            return None;
        }
        let next = self.next_record().transpose();
        self.is_over = !matches!(next, Some(Ok(_)));
        next
    }
}
