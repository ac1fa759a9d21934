//! Fields of a record.

/// Longest topic, bytes.
const LONGEST_TOPIC: usize = 1_000;

/// Content of a record or chunk, with checks of every length.
pub(super) struct Fields<'a>(pub &'a [u8]);

/// Reason for which a field cannot be read.
#[derive(Debug)]
pub(super) struct Unfit(pub &'static str);

impl<'a> Fields<'a> {
    pub fn take(&mut self, count: usize, what: &'static str) -> Result<&'a [u8], Unfit> {
        let (taken, rest) = self.0.split_at_checked(count).ok_or(Unfit(what))?;
        self.0 = rest;
        Ok(taken)
    }

    pub fn number<const N: usize>(&mut self, what: &'static str) -> Result<[u8; N], Unfit> {
        let (taken, rest) = self.0.split_first_chunk::<N>().ok_or(Unfit(what))?;
        self.0 = rest;
        Ok(*taken)
    }

    pub fn u16(&mut self, what: &'static str) -> Result<u16, Unfit> {
        self.number(what).map(u16::from_le_bytes)
    }

    pub fn u32(&mut self, what: &'static str) -> Result<u32, Unfit> {
        self.number(what).map(u32::from_le_bytes)
    }

    pub fn u64(&mut self, what: &'static str) -> Result<u64, Unfit> {
        self.number(what).map(u64::from_le_bytes)
    }

    pub fn block(&mut self, what: &'static str) -> Result<&'a [u8], Unfit> {
        let length = self.u32(what)? as usize;
        self.take(length, what)
    }

    pub fn long_block(&mut self, what: &'static str) -> Result<&'a [u8], Unfit> {
        let length = usize::try_from(self.u64(what)?).map_err(|_| Unfit(what))?;
        self.take(length, what)
    }

    pub fn topic(&mut self) -> Result<String, Unfit> {
        let topic = self.text("a channel's topic")?;
        match topic.len() <= LONGEST_TOPIC {
            true => Ok(topic),
            false => Err(Unfit("a channel with a topic of more than 1000 bytes")),
        }
    }

    pub fn text(&mut self, what: &'static str) -> Result<String, Unfit> {
        let text = self.block(what)?;
        Ok(String::from_utf8_lossy(text).into_owned())
    }
}
