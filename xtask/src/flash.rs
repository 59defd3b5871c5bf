//! `cargo xtask flash` and `size`.

use std::fs;

use anyhow::{Context, Result, bail};

use crate::image::{self, Kind, Size};
use crate::shell::{output, run, top};
use crate::test::setup;

/// The committed budget: what the image may take.
const BUDGET: &str = "firmware/budget.toml";
/// The probe tool's name for the chip.
const CHIP: &str = "STM32F427VI";

/// Builds the image, writes its files and loads it if a probe is there.
pub(crate) fn flash(kind: Kind, build_only: bool) -> Result<()> {
    setup()?;
    let elf = image::build(kind)?;
    image::write_forms(&elf)?;
    let files = ["elf", "bin", "hex", "apj"].map(|ending| elf.with_extension(ending));
    for file in &files {
        println!("{}", file.strip_prefix(top()).unwrap_or(file).display());
    }
    if build_only {
        return Ok(());
    }
    let probes = output("probe-rs", &["list"]).filter(|list| list.contains("[0]"));
    let hex = files[2].to_string_lossy().into_owned();
    if probes.is_some() {
        run("probe-rs", &["download", "--chip", CHIP, "--binary-format", "hex", "--verify", &hex])?;
        return run("probe-rs", &["reset", "--chip", CHIP]);
    }
    println!();
    println!("No probe found (probe-rs list). To load the image:");
    println!(
        "- by USB through the board's bootloader: QGroundControl, Firmware, custom firmware file, choose the .apj;"
    );
    println!("  or Mission Planner, Install Firmware, Load custom firmware; or: uploader.py {}", files[3].display());
    println!("- by a probe on the debug connector: cargo install probe-rs-tools, then this command again;");
    println!("  or: STM32_Programmer_CLI -c port=SWD -w {hex} -rst");
    Ok(())
}

/// Compares the image with its budget and fails if it is over.
pub(crate) fn size() -> Result<()> {
    let path = top().join(BUDGET);
    let text = fs::read_to_string(&path).with_context(|| format!("cannot read {BUDGET}"))?;
    let elf = image::build(Kind::Flight)?;
    let Size { flash_bytes, ram_bytes } = image::size(&elf)?;
    let mut over = false;
    println!("{:24} {:>9} {:>9}", "", "bytes", "budget");
    for (key, bytes) in [("flash_bytes", flash_bytes), ("static_ram_bytes", ram_bytes)] {
        let budget = budget(&text, key)?;
        over |= bytes > budget;
        println!("{key:24} {bytes:>9} {budget:>9}{}", if bytes > budget { "  over" } else { "" });
    }
    if over {
        bail!("the image is over its budget in {BUDGET}; make it smaller, or raise the budget and say why");
    }
    Ok(())
}

/// `key = number` of the budget file.
fn budget(text: &str, key: &str) -> Result<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(key)?.trim_start().strip_prefix('='));
    let number = line.and_then(|rest| rest.split('#').next()).map(|number| number.trim().replace('_', ""));
    let number = number.with_context(|| format!("{BUDGET} has no {key}"))?;
    number.parse().with_context(|| format!("{BUDGET}: {key} = {number}, expected a whole number"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_budget_is_a_number_with_separators_and_a_reason() {
        assert_eq!(budget("# all\nflash_bytes = 262_144 # 256 KiB\n", "flash_bytes").unwrap(), 262_144);
        assert!(budget("flash_bytes = many", "flash_bytes").is_err());
        assert!(budget("", "flash_bytes").is_err());
    }
}
