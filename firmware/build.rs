//! Links the flash image: the board's memory from `memory.x` at the top of the checkout, and the linker scripts of the
//! runtime and of defmt. The library alone needs none of it.

use std::path::PathBuf;
use std::{env, fs};

fn main() {
    let memory = PathBuf::from("../memory.x");
    println!("cargo:rerun-if-changed={}", memory.display());
    println!("cargo:rerun-if-changed=build.rs");
    if env::var_os("CARGO_FEATURE_BOARD").is_none() {
        return;
    }
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::copy(&memory, out.join("memory.x")).expect("memory.x lies at the top of the checkout");
    println!("cargo:rustc-link-search={}", out.display());
    for argument in ["--nmagic", "-Tlink.x", "-Tdefmt.x"] {
        println!("cargo:rustc-link-arg-bins={argument}");
    }
}
