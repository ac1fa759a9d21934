//! ELF file of the firmware, as it would be flashed.

use object::{Object as _, ObjectSegment as _, ObjectSymbol as _};
use std::path::{Path, PathBuf};

/// Address of flash.
pub const FLASH_BASE: u32 = 0x0800_0000;

/// Length of the flash of an STM32F405RG, bytes.
pub const FLASH_LEN: usize = 1024 * 1024;

/// Program in flash.
#[derive(Clone)]
pub struct Image {
    /// Content of all of flash; erased bytes are 0xff.
    pub flash: Vec<u8>,
    /// Name, address, size.
    symbols: Vec<(String, u32, u32)>,
}

impl Image {
    /// Returns the image that `firmware/build` made.
    ///
    /// # Panics
    /// If there is none, or it is no ELF for this chip's flash.
    pub fn firmware() -> Self {
        let path = Self::path();
        let bytes = std::fs::read(&path).unwrap_or_else(|cause| {
            panic!("{}: {cause}: run firmware/build first", path.display())
        });
        Self::from_elf(&bytes)
    }

    fn path() -> PathBuf {
        let here = Path::new(env!("CARGO_MANIFEST_DIR"));
        here.join("../../firmware/target/thumbv7em-none-eabihf/release/station-b")
    }

    /// Converts an ELF to the flash that a programmer would write: each segment at its load
    /// address, from the file's program headers.
    ///
    /// # Panics
    /// If it is no ELF, or has bytes outside flash.
    pub fn from_elf(bytes: &[u8]) -> Self {
        type Elf<'a> = object::read::elf::ElfFile32<'a>;
        let elf = Elf::parse(bytes).expect("a 32-bit ELF");
        let endian = elf.endian();
        let mut flash = vec![0xff; FLASH_LEN];
        for segment in elf.segments() {
            let data = segment.data().expect("the segment lies in the file");
            if data.is_empty() {
                continue;
            }
            let header = segment.elf_program_header();
            let at = header.p_paddr.get(endian).wrapping_sub(FLASH_BASE) as usize;
            flash
                .get_mut(at..at + data.len())
                .expect("loaded bytes lie in flash")
                .copy_from_slice(data);
        }
        let symbols = elf
            .symbols()
            .filter_map(|symbol| {
                let name = symbol.name().ok()?.to_owned();
                Some((name, symbol.address() as u32, symbol.size() as u32))
            })
            .collect();
        Self { flash, symbols }
    }

    /// Returns the address of the one symbol whose name contains `part`.
    ///
    /// # Panics
    /// If no name or several names contain `part`.
    pub fn symbol(&self, part: &str) -> u32 {
        self.find(part).0
    }

    /// Returns the size of the one symbol whose name contains `part`, bytes.
    ///
    /// # Panics
    /// If no name or several names contain `part`.
    pub fn size(&self, part: &str) -> u32 {
        self.find(part).1
    }

    fn find(&self, part: &str) -> (u32, u32) {
        let found: Vec<_> = (self.symbols.iter())
            .filter(|(name, ..)| name.contains(part))
            .collect();
        match found[..] {
            [(_, address, size)] => (*address, *size),
            _ => panic!("{} symbols contain `{part}`: {found:?}", found.len()),
        }
    }
}
