//! What users really hand in: each gets an error that names file, line or key, or goes on with a named loss.

use std::fs;
use std::path::Path;

use super::programs::{FLOWN, errors, figures, run, text};

/// Spoils a copy of the survey, expects exit code 2 and every `named` text in the error.
fn refused(spoil: impl FnOnce(&Path), named: &[&str]) {
    let survey = FLOWN.copy();
    spoil(survey.path());
    let output = run("adit", &["reconstruct", text(survey.path()), "--stop-after", "prior"]);
    let said = errors(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    for text in named {
        assert!(said.contains(text), "`{text}` is not in: {said}");
    }
}

/// Spoils a copy of the survey, expects that it goes on and names the loss.
fn goes_on(spoil: impl FnOnce(&Path), named: &[&str]) {
    let survey = FLOWN.copy();
    spoil(survey.path());
    let summary = figures("adit", &["reconstruct", text(survey.path()), "--stop-after", "adjust"]);
    let losses = summary["losses"].to_string();
    for text in named {
        assert!(losses.contains(text), "`{text}` is not in: {losses}");
    }
    assert!(summary["registered"].as_u64().is_some_and(|registered| registered > 5), "{summary:#}");
}

fn edit(file: &Path, change: impl FnOnce(String) -> String) {
    let content = fs::read_to_string(file).expect("the file is read");
    fs::write(file, change(content)).expect("the file is written");
}

/// Path of the n-th photo by name.
fn photo(survey: &Path, n: usize) -> std::path::PathBuf {
    let mut found = Vec::new();
    let mut folders = vec![survey.join("photos")];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("the folder is read") {
            let path = entry.expect("the entry is read").path();
            if path.is_dir() { folders.push(path) } else { found.push(path) }
        }
    }
    found.sort();
    found.swap_remove(n)
}

fn name(path: &Path) -> String {
    path.file_name().expect("a photo has a name").to_string_lossy().into_owned()
}

#[test]
fn a_truncated_photo_is_a_named_loss() {
    let lost = name(&photo(&FLOWN.survey(), 7));
    goes_on(
        |survey| {
            let path = photo(survey, 7);
            let content = fs::read(&path).expect("the photo is read");
            fs::write(&path, &content[..content.len() / 2]).expect("the photo is written");
        },
        &[&lost, "truncated"],
    );
}

#[test]
fn a_missing_photo_is_a_named_loss() {
    let lost = name(&photo(&FLOWN.survey(), 4));
    goes_on(|survey| fs::remove_file(photo(survey, 4)).expect("the photo is removed"), &[&lost]);
}

#[test]
fn a_surplus_photo_is_a_named_loss() {
    goes_on(
        |survey| {
            let one = photo(survey, 3);
            fs::copy(&one, one.with_file_name("GOPR9000.JPG")).expect("the photo is copied");
        },
        &["GOPR9000.JPG"],
    );
}

#[test]
fn shuffled_tags_are_put_in_order() {
    goes_on(
        |survey| {
            edit(&survey.join("tags.csv"), |content| {
                let mut lines: Vec<&str> = content.lines().collect();
                lines[1..].reverse();
                lines.join("\n") + "\n"
            });
        },
        &["tags.csv"],
    );
}

#[test]
fn empty_tags_are_refused() {
    refused(|survey| edit(&survey.join("tags.csv"), |_| String::new()), &["tags.csv"]);
    refused(
        |survey| edit(&survey.join("tags.csv"), |content| content.lines().next().unwrap_or_default().to_owned() + "\n"),
        &["tags.csv"],
    );
}

#[test]
fn a_damaged_tag_names_line_and_column() {
    refused(
        |survey| edit(&survey.join("tags.csv"), |content| content.replacen(",confirmed,", ",maybe,", 1)),
        &["tags.csv", "maybe", "confirmed"],
    );
}

#[test]
fn an_unknown_key_names_itself_and_its_line() {
    refused(
        |survey| edit(&survey.join("survey.toml"), |content| content.replacen("radius_m", "radius", 1)),
        &["survey.toml", "radius_m"],
    );
}

#[test]
fn a_wrong_unit_is_recognised() {
    refused(
        |survey| {
            edit(&survey.join("survey.toml"), |content| {
                let line = content.lines().find(|line| line.starts_with("radius_m")).expect("a circle").to_owned();
                content.replacen(&line, "radius_m = 1000.0", 1)
            });
        },
        &["survey.toml", "radius_m", "1000", "millimetres"],
    );
}

#[test]
fn a_mask_of_the_wrong_size_names_both_sizes() {
    let mask = FLOWN.survey().join("masks");
    assert!(!mask.exists(), "this mission has no masks of its own");
    refused(
        |survey| {
            let folder = survey.join("masks");
            fs::create_dir_all(&folder).expect("the folder is made");
            // The smallest grey PNG: one black pixel.
            let png: &[u8] = include_bytes!("one-pixel.png");
            fs::write(folder.join("mask.png"), png).expect("the mask is written");
        },
        &["mask.png", "1 x 1", "400 x 300"],
    );
}

#[test]
fn an_output_folder_that_cannot_be_written_is_named() {
    let survey = FLOWN.copy();
    // Not even root can make a folder below a file.
    let out = survey.path().join("survey.toml/out");
    let output = run("adit", &["reconstruct", text(survey.path()), "--out", text(&out)]);
    assert_eq!(output.status.code(), Some(2));
    assert!(errors(&output).contains("survey.toml/out"), "{}", errors(&output));
}

#[test]
fn a_survey_folder_that_is_not_there_is_named() {
    let output = run("adit", &["reconstruct", "/no/such/survey"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(errors(&output).contains("/no/such/survey"), "{}", errors(&output));
}
