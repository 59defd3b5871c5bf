//! The command from outside.

use std::process::{Command, Output};

fn run(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_adit-emulator")).args(arguments).output().expect("the program")
}

#[test]
fn the_help_says_what_can_be_asked() {
    let output = run(&["fly", "--help"]);
    assert!(output.status.success());
    insta::assert_snapshot!(String::from_utf8_lossy(&output.stdout));
}

#[test]
fn a_missing_image_is_named_with_the_command_that_builds_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let mission = concat!(env!("CARGO_MANIFEST_DIR"), "/../missions/underpass.toml");
    let output = run(&["fly", mission, "--out", &out.to_string_lossy(), "--image", "no/such/image"]);
    assert_eq!(output.status.code(), Some(2));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("no/such/image") && said.contains("cargo xtask flash --build-only"), "{said}");
    assert!(!out.exists(), "nothing is left behind");
}
