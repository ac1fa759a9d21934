//! CDR, the encoding of ROS 2 messages (OMG DDS-XTypes, plain CDR of version 1).
//!
//! A message starts with four bytes: an encapsulation identifier (`00 01` for little-endian) and
//! two options. Every number is aligned to its own size, counted from behind these four bytes. A
//! string has its length in bytes, the closing zero included, in front of it; a sequence has its
//! number of elements.
//!
//! Written by hand, because pixels are copied as one block here and one by one in serde's way.

/// Bytes of the encapsulation header.
const HEADER: usize = 4;

/// Writer of one message, little-endian.
#[derive(Debug)]
pub struct Writer<'a> {
    bytes: &'a mut Vec<u8>,
}

impl<'a> Writer<'a> {
    /// Begins a message in `bytes`, whose content is replaced.
    pub fn new(bytes: &'a mut Vec<u8>) -> Self {
        bytes.clear();
        bytes.extend([0, 1, 0, 0]);
        Self { bytes }
    }

    fn align(&mut self, size: usize) {
        let place = self.bytes.len() - HEADER;
        let aligned = place.next_multiple_of(size);
        self.bytes.resize(HEADER + aligned, 0);
    }

    fn number<const N: usize>(&mut self, bytes: [u8; N]) {
        self.align(N);
        self.bytes.extend(bytes);
    }

    /// Writes a `uint8` or `bool`.
    pub fn u8(&mut self, value: u8) {
        self.bytes.push(value);
    }

    /// Writes an `int32`.
    pub fn i32(&mut self, value: i32) {
        self.number(value.to_le_bytes());
    }

    /// Writes a `uint32`.
    pub fn u32(&mut self, value: u32) {
        self.number(value.to_le_bytes());
    }

    /// Writes a `uint64`.
    pub fn u64(&mut self, value: u64) {
        self.number(value.to_le_bytes());
    }

    /// Writes a `float64`.
    pub fn f64(&mut self, value: f64) {
        self.number(value.to_le_bytes());
    }

    /// Writes a `string`. A text beyond 4 GB is cut.
    pub fn text(&mut self, text: &str) {
        let length = u32::try_from(text.len() + 1).unwrap_or(u32::MAX);
        self.u32(length);
        let kept = (length - 1) as usize;
        self.bytes.extend(&text.as_bytes()[..kept]);
        self.bytes.push(0);
    }

    /// Writes the length of a sequence, whose elements follow.
    pub fn length(&mut self, length: usize) {
        // Sequences of this program have at most some million elements.
        self.u32(u32::try_from(length).unwrap_or(u32::MAX));
    }

    /// Writes a `uint8[]`.
    pub fn block(&mut self, bytes: &[u8]) {
        self.length(bytes.len());
        self.bytes.extend(bytes);
    }

    /// Writes a `float64[]`.
    pub fn f64s(&mut self, values: &[f64]) {
        self.length(values.len());
        values.iter().for_each(|value| self.f64(*value));
    }

    /// Writes a fixed array of `float64`.
    pub fn f64_array(&mut self, values: &[f64]) {
        values.iter().for_each(|value| self.f64(*value));
    }

    /// Writes a fixed array of `int32`.
    pub fn i32_array(&mut self, values: &[i32]) {
        values.iter().for_each(|value| self.i32(*value));
    }

    /// Writes a `string[]`.
    pub fn texts(&mut self, texts: &[String]) {
        self.length(texts.len());
        texts.iter().for_each(|text| self.text(text));
    }
}

/// Reason for which bytes are not the expected message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CdrFault {
    /// The message ends within a field.
    #[error("it ends within a field")]
    Short,
    /// The encapsulation is not plain CDR.
    #[error("its encoding is not plain CDR (encapsulation {0:02x}{1:02x})")]
    Encapsulation(u8, u8),
    /// A string is not UTF-8 or lacks its closing zero.
    #[error("a string is not UTF-8 with a closing zero")]
    Text,
}

/// Reader of one message of either byte order. Every length is checked against the bytes that are
/// there, so that no claim costs memory.
#[derive(Clone, Debug)]
pub struct Reader<'a> {
    body: &'a [u8],
    place: usize,
    is_little: bool,
}

impl<'a> Reader<'a> {
    /// Begins to read a message.
    ///
    /// # Errors
    /// [`CdrFault`] if the encapsulation header is missing or names another encoding.
    pub fn new(bytes: &'a [u8]) -> Result<Self, CdrFault> {
        let (header, body) = bytes.split_first_chunk::<HEADER>().ok_or(CdrFault::Short)?;
        let is_little = match header {
            [0, 0, ..] => false,
            [0, 1, ..] => true,
            [a, b, ..] => return Err(CdrFault::Encapsulation(*a, *b)),
        };
        Ok(Self {
            body,
            place: 0,
            is_little,
        })
    }

    /// Returns true if no byte is left.
    pub fn is_at_end(&self) -> bool {
        self.place >= self.body.len()
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], CdrFault> {
        let end = self.place.checked_add(count).ok_or(CdrFault::Short)?;
        let bytes = self.body.get(self.place..end).ok_or(CdrFault::Short)?;
        self.place = end;
        Ok(bytes)
    }

    /// Returns a number's bytes, little-endian.
    fn number<const N: usize>(&mut self) -> Result<[u8; N], CdrFault> {
        self.place = self.place.next_multiple_of(N);
        let bytes = self.take(N)?;
        let mut number = [0; N];
        number.copy_from_slice(bytes);
        if !self.is_little {
            number.reverse();
        }
        Ok(number)
    }

    /// Reads a `uint8` or `bool`.
    ///
    /// # Errors
    /// [`CdrFault::Short`] at the end of the message, as all numbers.
    pub fn u8(&mut self) -> Result<u8, CdrFault> {
        Ok(u8::from_le_bytes(self.number()?))
    }

    /// Reads an `int32`.
    ///
    /// # Errors
    /// As [`Reader::u8`].
    pub fn i32(&mut self) -> Result<i32, CdrFault> {
        Ok(i32::from_le_bytes(self.number()?))
    }

    /// Reads a `uint32`.
    ///
    /// # Errors
    /// As [`Reader::u8`].
    pub fn u32(&mut self) -> Result<u32, CdrFault> {
        Ok(u32::from_le_bytes(self.number()?))
    }

    /// Reads a `uint64`.
    ///
    /// # Errors
    /// As [`Reader::u8`].
    pub fn u64(&mut self) -> Result<u64, CdrFault> {
        Ok(u64::from_le_bytes(self.number()?))
    }

    /// Reads a `float64`.
    ///
    /// # Errors
    /// As [`Reader::u8`].
    pub fn f64(&mut self) -> Result<f64, CdrFault> {
        Ok(f64::from_le_bytes(self.number()?))
    }

    /// Reads a `string`.
    ///
    /// # Errors
    /// [`CdrFault`] if the message ends within it or it is no text.
    pub fn text(&mut self) -> Result<&'a str, CdrFault> {
        match self.block()?.split_last() {
            Some((0, text)) => std::str::from_utf8(text).map_err(|_| CdrFault::Text),
            // Some writers give an empty string no closing zero.
            None => Ok(""),
            Some(_) => Err(CdrFault::Text),
        }
    }

    /// Reads a `uint8[]`.
    ///
    /// # Errors
    /// As [`Reader::u8`].
    pub fn block(&mut self) -> Result<&'a [u8], CdrFault> {
        let length = self.u32()? as usize;
        self.take(length)
    }

    /// Reads a sequence with `element`, which must take at least one byte of each element.
    ///
    /// # Errors
    /// The first of `element`.
    pub fn sequence<T>(
        &mut self,
        mut element: impl FnMut(&mut Self) -> Result<T, CdrFault>,
    ) -> Result<Vec<T>, CdrFault> {
        let length = self.u32()? as usize;
        if length > self.body.len() - self.place.min(self.body.len()) {
            return Err(CdrFault::Short);
        }
        (0..length).map(|_| element(self)).collect()
    }

    /// Reads a `float64[]`.
    ///
    /// # Errors
    /// As [`Reader::u8`].
    pub fn f64s(&mut self) -> Result<Vec<f64>, CdrFault> {
        self.sequence(Self::f64)
    }

    /// Reads a `string[]`.
    ///
    /// # Errors
    /// As [`Reader::text`].
    pub fn texts(&mut self) -> Result<Vec<String>, CdrFault> {
        self.sequence(|reader| reader.text().map(str::to_owned))
    }

    /// Reads a fixed array of `float64`.
    ///
    /// # Errors
    /// As [`Reader::u8`].
    pub fn array<const N: usize>(&mut self) -> Result<[f64; N], CdrFault> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Ok(values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn numbers_are_aligned_behind_header() {
        let mut bytes = Vec::new();
        let mut writer = Writer::new(&mut bytes);
        writer.u8(7);
        writer.u32(1);
        writer.text("ab");
        writer.f64(1.0);
        let mut expected = vec![0, 1, 0, 0, 7, 0, 0, 0, 1, 0, 0, 0, 3, 0, 0, 0];
        expected.extend(b"ab\0");
        expected.push(0);
        expected.extend(1.0f64.to_le_bytes());
        assert_eq!(bytes, expected);
        let mut reader = Reader::new(&bytes).unwrap();
        assert_eq!(reader.u8(), Ok(7));
        assert_eq!(reader.u32(), Ok(1));
        assert_eq!(reader.text(), Ok("ab"));
        assert_eq!(reader.f64(), Ok(1.0));
        assert_eq!(reader.u8(), Err(CdrFault::Short));
    }

    #[test]
    fn big_endian_message_is_read() {
        let bytes = [0, 0, 0, 0, 0, 0, 0, 3, b'a', b'b', 0, 0, 0, 0, 1, 2];
        let mut reader = Reader::new(&bytes).unwrap();
        assert_eq!(reader.text(), Ok("ab"));
        assert_eq!(reader.u32(), Ok(258));
    }

    #[test]
    fn foreign_encapsulation_is_named() {
        let fault = Reader::new(&[0, 7, 0, 0]).unwrap_err();
        assert_eq!(fault, CdrFault::Encapsulation(0, 7));
    }

    proptest! {
        #[test]
        fn sequences_survive_a_round_trip(values: Vec<f64>, texts: Vec<String>, block: Vec<u8>) {
            let mut bytes = Vec::new();
            let mut writer = Writer::new(&mut bytes);
            writer.block(&block);
            writer.f64s(&values);
            writer.texts(&texts);
            let mut reader = Reader::new(&bytes).unwrap();
            prop_assert_eq!(reader.block(), Ok(&block[..]));
            let bits = |values: &[f64]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            prop_assert_eq!(bits(&reader.f64s().unwrap()), bits(&values));
            // A zero within a text is part of it.
            prop_assert_eq!(reader.texts(), Ok(texts));
        }

        #[test]
        fn any_bytes_read_without_panic(bytes: Vec<u8>) {
            let bytes = [&[0, 1, 0, 0][..], &bytes].concat();
            let reader = Reader::new(&bytes).unwrap();
            let _ = reader.clone().texts();
            let _ = reader.clone().f64s();
            let _ = reader.clone().array::<9>();
        }
    }
}
