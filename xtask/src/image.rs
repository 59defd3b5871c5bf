//! The flash image: built, measured, and put into the forms that loaders take.
//!
//! | file | for |
//! |---|---|
//! | `rotator.elf` | a debugger, and the emulator: code and symbols as linked |
//! | `rotator.bin` | the raw bytes from `0x0800_4000` on |
//! | `rotator.hex` | the same as Intel HEX, with addresses: a probe, `STM32CubeProgrammer` |
//! | `rotator.apj` | the board's PX4/ArduPilot bootloader by USB: QGroundControl, Mission Planner, `uploader.py` |
//!
//! In the last three the application descriptor is filled in, which newer ArduPilot bootloaders check (`ArduPilot`
//! `AP_CheckFirmware.h`: signature, CRC of what lies before, CRC of what lies behind, size, hash, version, board).

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use base64::Engine as _;
use crc::{Algorithm, Crc};
use object::read::elf::{ElfFile32, ProgramHeader as _};
use object::{Endianness, Object as _, ObjectSection as _, SectionFlags, elf};

use crate::shell::{output, run, top};
use crate::test::BOARD;

/// Where the image begins: behind the bootloader (memory.x).
const FLASH_START: u32 = 0x0800_4000;
/// Where flash ends.
const FLASH_END: u32 = 0x0820_0000;
/// The bootloader's number for this board (ArduPilot `board_types.txt`: PX4 FMU v4).
const BOARD_ID: u16 = 11;
/// Signature of an unsigned image's descriptor.
const SIGNATURE: [u8; 8] = [0x40, 0xA2, 0xE4, 0xF1, 0x64, 0x68, 0x91, 0x06];
/// CRC-32 as the bootloader computes it: neither preset nor inverted.
const BOOTLOADER_CRC: Crc<u32> = Crc::<u32>::new(&Algorithm {
    width: 32,
    poly: 0x04C1_1DB7,
    init: 0,
    refin: true,
    refout: true,
    xorout: 0,
    check: 0x2DFD_2D88,
    residue: 0,
});

/// Which image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Sensors on their pins.
    Flight,
    /// Inputs from a simulator over TELEM2.
    Hil,
}

impl Kind {
    /// The stem of its files.
    pub(crate) fn stem(self) -> &'static str {
        match self {
            Self::Flight => "rotator",
            Self::Hil => "rotator-hil",
        }
    }

    fn feature(self) -> &'static str {
        match self {
            Self::Flight => "board",
            Self::Hil => "hil",
        }
    }

    /// Its ELF file.
    pub(crate) fn elf(self) -> PathBuf {
        top().join("target/image").join(format!("{}.elf", self.stem()))
    }
}

/// How much the image takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Size {
    /// Code, constants and initial values.
    pub(crate) flash_bytes: u64,
    /// Statics, the stack left out.
    pub(crate) ram_bytes: u64,
}

/// Builds the image and returns its ELF file, `target/image/STEM.elf`; beside it `instructions.elf`, which measures costs.
pub(crate) fn build(kind: Kind) -> Result<PathBuf> {
    run(
        "cargo",
        &[
            "build",
            "--locked",
            "--profile",
            "flash",
            "--package",
            "adit-firmware",
            "--bin",
            "rotator",
            "--bin",
            "instructions",
            "--features",
            kind.feature(),
            "--target",
            BOARD,
        ],
    )?;
    let elf = kind.elf();
    keep("rotator", &elf)?;
    keep("instructions", &elf.with_file_name("instructions.elf"))?;
    Ok(elf)
}

/// Puts what was built where nothing else overwrites it.
fn keep(binary: &str, as_file: &Path) -> Result<()> {
    let built = top().join("target").join(BOARD).join("flash").join(binary);
    if let Some(folder) = as_file.parent() {
        fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
    fs::copy(&built, as_file).with_context(|| format!("cannot copy {} to {}", built.display(), as_file.display()))?;
    Ok(())
}

/// Measures an ELF file by its sections.
pub(crate) fn size(elf: &Path) -> Result<Size> {
    let bytes = fs::read(elf).with_context(|| format!("cannot read {}", elf.display()))?;
    let file = ElfFile32::<Endianness>::parse(&*bytes).with_context(|| format!("{} is no ELF file", elf.display()))?;
    let mut size = Size { flash_bytes: 0, ram_bytes: 0 };
    for section in file.sections() {
        let SectionFlags::Elf { sh_flags } = section.flags() else { continue };
        if sh_flags & u64::from(elf::SHF_ALLOC) == 0 {
            continue;
        }
        let in_flash = (u64::from(FLASH_START)..u64::from(FLASH_END)).contains(&section.address());
        // Initial values lie in flash and are copied to RAM.
        let is_data = section.name().is_ok_and(|name| name == ".data");
        size.flash_bytes += if in_flash || is_data { section.size() } else { 0 };
        size.ram_bytes += if in_flash { 0 } else { section.size() };
    }
    Ok(size)
}

/// Writes `.bin`, `.hex` and `.apj` beside the ELF file.
pub(crate) fn write_forms(elf: &Path) -> Result<()> {
    let bytes = fs::read(elf).with_context(|| format!("cannot read {}", elf.display()))?;
    let mut image = flat(&bytes).with_context(|| format!("{}", elf.display()))?;
    fill_descriptor(&mut image)?;
    write(&elf.with_extension("bin"), &image)?;
    write(&elf.with_extension("hex"), intel_hex(&image)?.as_bytes())?;
    write(&elf.with_extension("apj"), apj(&image)?.as_bytes())
}

fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    fs::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))
}

/// The bytes from the image's start to its end, gaps as erased flash.
fn flat(elf: &[u8]) -> Result<Vec<u8>> {
    let file = ElfFile32::<Endianness>::parse(elf).context("no ELF file")?;
    let mut image = Vec::new();
    for segment in file.elf_program_headers() {
        let data = segment.data(Endianness::Little, elf).ok().context("a segment lies outside the file")?;
        if segment.p_type(Endianness::Little) != elf::PT_LOAD || data.is_empty() {
            continue;
        }
        let address = segment.p_paddr(Endianness::Little);
        ensure!(
            (FLASH_START..FLASH_END).contains(&address),
            "a segment at {address:#010x}; the image lies from {FLASH_START:#010x} to {FLASH_END:#010x}"
        );
        let from = (address - FLASH_START) as usize;
        let to = from + data.len();
        image.resize(image.len().max(to), 0xFF);
        image[from..to].copy_from_slice(data);
    }
    // The bootloader programs words.
    image.resize(image.len().next_multiple_of(4), 0xFF);
    ensure!(!image.is_empty(), "no segment to load");
    Ok(image)
}

/// Fills the application descriptor in.
fn fill_descriptor(image: &mut [u8]) -> Result<()> {
    let places: Vec<usize> =
        (0..image.len().saturating_sub(36)).filter(|at| image[*at..].starts_with(&SIGNATURE)).collect();
    let [at] = places[..] else { bail!("{} application descriptors in the image, expected one", places.len()) };
    let hash = output("git", &["rev-parse", "--short=8", "HEAD"]).unwrap_or_default();
    let hash = u32::from_str_radix(hash.trim(), 16).unwrap_or(0);
    let before = BOOTLOADER_CRC.checksum(&image[..at + 8]);
    let behind = BOOTLOADER_CRC.checksum(&image[at + 24..]);
    let length = u32::try_from(image.len()).context("an image of 4 GiB")?;
    for (index, word) in [before, behind, length, hash].into_iter().enumerate() {
        let from = at + 8 + index * 4;
        image[from..from + 4].copy_from_slice(&word.to_le_bytes());
    }
    Ok(())
}

fn intel_hex(image: &[u8]) -> Result<String> {
    let mut records = Vec::new();
    for (index, chunk) in image.chunks(32).enumerate() {
        let address = FLASH_START + index as u32 * 32;
        if index == 0 || address.is_multiple_of(0x1_0000) {
            records.push(ihex::Record::ExtendedLinearAddress((address >> 16) as u16));
        }
        records.push(ihex::Record::Data { offset: address as u16, value: chunk.to_vec() });
    }
    records.push(ihex::Record::EndOfFile);
    ihex::create_object_file_representation(&records).context("cannot write Intel HEX")
}

/// The JSON file that PX4's and ArduPilot's uploaders take.
fn apj(image: &[u8]) -> Result<String> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    encoder.write_all(image)?;
    let packed = base64::engine::general_purpose::STANDARD.encode(encoder.finish()?);
    let json = serde_json::json!({
        "board_id": BOARD_ID,
        "magic": "APJFWv1",
        "description": "Adit rotator board firmware for the Pixracer",
        "image": packed,
        "image_size": image.len(),
        "extf_image": "",
        "extf_image_size": 0,
        "summary": "PIXRACER",
        "version": "0.1",
        "git_identity": output("git", &["rev-parse", "--short=8", "HEAD"]).unwrap_or_default().trim(),
        "board_revision": 0,
    });
    Ok(serde_json::to_string_pretty(&json)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bootloaders_crc_has_its_check_value() {
        assert_eq!(BOOTLOADER_CRC.checksum(b"123456789"), BOOTLOADER_CRC.algorithm.check);
    }

    #[test]
    fn a_descriptor_says_what_a_bootloader_will_find() {
        let mut image = vec![7_u8; 200];
        image[80..88].copy_from_slice(&SIGNATURE);
        fill_descriptor(&mut image).unwrap();
        let word = |at: usize| u32::from_le_bytes(image[at..at + 4].try_into().unwrap());
        assert_eq!(word(88), BOOTLOADER_CRC.checksum(&image[..88]));
        assert_eq!(word(92), BOOTLOADER_CRC.checksum(&image[104..]));
        assert_eq!(word(96), 200);
        assert!(fill_descriptor(&mut [0; 100]).is_err());
    }

    #[test]
    fn an_apj_unpacks_to_the_image() {
        use std::io::Read as _;
        let image: Vec<u8> = (0..=255).cycle().take(4000).collect();
        let json: serde_json::Value = serde_json::from_str(&apj(&image).unwrap()).unwrap();
        let packed = base64::engine::general_purpose::STANDARD.decode(json["image"].as_str().unwrap()).unwrap();
        let mut unpacked = Vec::new();
        flate2::read::ZlibDecoder::new(&*packed).read_to_end(&mut unpacked).unwrap();
        assert_eq!((unpacked, json["board_id"].as_u64(), json["image_size"].as_u64()), (image, Some(11), Some(4000)));
    }

    #[test]
    fn a_hex_file_reads_back_at_its_addresses() {
        let image: Vec<u8> = (0..70_000_u32).map(|index| index as u8).collect();
        let text = intel_hex(&image).unwrap();
        let (mut base, mut read) = (0_u32, Vec::new());
        for record in ihex::Reader::new(&text) {
            match record.unwrap() {
                ihex::Record::ExtendedLinearAddress(high) => base = u32::from(high) << 16,
                ihex::Record::Data { offset, value } => {
                    assert_eq!(base + u32::from(offset), FLASH_START + read.len() as u32);
                    read.extend(value);
                }
                _ => {}
            }
        }
        assert_eq!(read, image);
    }
}
