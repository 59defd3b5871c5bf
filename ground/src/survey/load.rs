//! Reading a survey folder.

use std::fs;
use std::path::{Path, PathBuf};

use adit_protocol::mission::SurveyConfig;
use rayon::prelude::*;

use super::masks::{Masks, check_mask};
use super::photos::{FoundPhoto, Lookup, PhotoIndex, find_files, find_photos};
use super::tags::{Claim, read_names};
use super::{Loss, Photo, PhotoError, Size, Survey, SurveyError, TagColumn, TagFault, TagRow, TagsError};
use super::{probe, read_tags};

/// Reads and checks a survey folder (survey.toml, tags.csv, photos/, masks/), without decoding any photo.
///
/// Photos come in order of capture: that of tags.csv. Where there is no tags.csv, or one that names photos and measures
/// nothing, they come untagged, in order of their names or of the rows. Rows out of order, tags without photo, photos without tag, photos that are missing,
/// truncated or no JPEG end up in [`Survey::losses`].
///
/// # Errors
/// [`SurveyError`] if survey.toml or tags.csv is wrong, if no photo is left, or if a photo or a mask contradicts the
/// image size in survey.toml.
pub fn load(folder: &Path) -> Result<Survey, SurveyError> {
    let config = load_config(&folder.join("survey.toml"))?;
    let tags_path = folder.join("tags.csv");
    let mut losses = Vec::new();
    let photos_folder = folder.join("photos");
    let photos = if let Ok(false) = fs::exists(&tags_path) {
        untagged(&photos_folder)?
    } else if let Some(claims) = read_names(&tags_path)? {
        pair(claims, &photos_folder, &tags_path, &mut losses)?
    } else {
        let mut rows = read_tags(&tags_path)?;
        sort_rows(&mut rows, &mut losses);
        pair(rows.into_iter().map(Claim::from).collect(), &photos_folder, &tags_path, &mut losses)?
    };
    let size = Size { width_px: config.camera.camera.width_px, height_px: config.camera.camera.height_px };
    let tags = photos.len();
    let photos = keep_whole(photos, size, &mut losses)?;
    if photos.is_empty() {
        let first = losses.first().cloned().unwrap_or_else(|| Loss::new("photos", "none named"));
        return Err(SurveyError::NoUsablePhoto {
            folder: photos_folder,
            tags,
            first_what: first.what,
            first_why: first.why,
        });
    }
    let photos = add_masks(photos, folder, size, &mut losses)?;
    Ok(Survey { folder: folder.to_owned(), config, photos, losses })
}

/// Every photo, in order of its name, which is a camera's order of capture.
fn untagged(photos_folder: &Path) -> Result<Vec<Photo>, SurveyError> {
    let found =
        find_photos(photos_folder).map_err(|source| SurveyError::Io { path: photos_folder.to_owned(), source })?;
    if found.is_empty() {
        return Err(SurveyError::NoPhotos { folder: photos_folder.to_owned() });
    }
    Ok(found.into_iter().map(|photo| Photo { name: photo.name, path: photo.path, mask: None, tag: None }).collect())
}

fn load_config(path: &Path) -> Result<SurveyConfig, SurveyError> {
    let text = fs::read_to_string(path).map_err(|source| SurveyError::Io { path: path.to_owned(), source })?;
    SurveyConfig::from_toml(&text).map_err(|source| SurveyError::Config { path: path.to_owned(), source })
}

/// Puts rows in order of capture and says so if they were not.
fn sort_rows(rows: &mut [TagRow], losses: &mut Vec<Loss>) {
    if let Some(pair) = rows.windows(2).find(|pair| pair[0].tag.capture > pair[1].tag.capture) {
        let what = format!("tags.csv:{}", pair[1].line);
        let why = format!(
            "capture {} stands after capture {}: the rows were put in order of capture",
            pair[1].tag.capture, pair[0].tag.capture
        );
        losses.push(Loss::new(what, why));
        rows.sort_by_key(|row| row.tag.capture);
    }
    for pair in rows.windows(2) {
        if pair[0].tag.time_us > pair[1].tag.time_us {
            losses.push(Loss::new(
                format!("tags.csv:{}", pair[1].line),
                format!("capture {} has an earlier time than capture {}", pair[1].tag.capture, pair[0].tag.capture),
            ));
        }
    }
}

/// Gives every row its photo.
fn pair(
    rows: Vec<Claim>,
    photos_folder: &Path,
    tags_path: &Path,
    losses: &mut Vec<Loss>,
) -> Result<Vec<Photo>, SurveyError> {
    if rows.iter().all(|row| row.photo.is_none()) {
        return Err(SurveyError::NotIngested { path: tags_path.to_owned(), rows: rows.len() });
    }
    let found =
        find_photos(photos_folder).map_err(|source| SurveyError::Io { path: photos_folder.to_owned(), source })?;
    let mut index = PhotoIndex::new(found);
    let (mut photos, mut faults) = (Vec::new(), Vec::new());
    for row in rows {
        let capture = row.capture;
        let Some(name) = row.photo else {
            losses.push(Loss::new(format!("tags.csv:{}", row.line), format!("capture {capture} has no photo")));
            continue;
        };
        let mut fault = |expected| {
            faults.push(TagFault { line: row.line, column: TagColumn::Photo.name(), found: name.clone(), expected });
        };
        match index.take(&name) {
            Lookup::Found(i) => {
                let photo = index.photo(i).clone();
                photos.push(Photo { name: photo.name, path: photo.path, mask: None, tag: row.tag });
            }
            Lookup::Missing => losses.push(Loss::new(
                format!("photos/{name}"),
                format!("the file is missing; tags.csv:{} names it for capture {capture}", row.line),
            )),
            Lookup::Ambiguous => fault("a photo with its folder, because several folders hold one of this name"),
            Lookup::Taken => fault("a photo that no other row has"),
        }
    }
    if !faults.is_empty() {
        return Err(TagsError::Faults { path: tags_path.to_owned(), faults }.into());
    }
    add_untagged(&mut photos, &index, losses);
    Ok(photos)
}

/// Puts photos without a tag where they were taken: between the two photos that their names lie between. Others may be
/// of anything, and are left out.
fn add_untagged(photos: &mut Vec<Photo>, index: &PhotoIndex, losses: &mut Vec<Loss>) {
    for (photo, [before, after]) in index.left_over() {
        let place_of = |other: &FoundPhoto| photos.iter().position(|photo| photo.name == other.name);
        let between = before.and_then(place_of).zip(after.and_then(place_of));
        // Untagged photos that were put in earlier stand after `before`.
        let place = between
            .filter(|&(before, after)| {
                before < after && photos[before + 1..after].iter().all(|photo| photo.tag.is_none())
            })
            .map(|(_, after)| after);
        let (name, path) = (photo.name.clone(), photo.path.clone());
        match place {
            Some(place) => photos.insert(place, Photo { name, path, mask: None, tag: None }),
            None => losses.push(Loss::new(
                format!("photos/{name}"),
                "no row of tags.csv names this photo, nor is it between two that are named",
            )),
        }
    }
}

/// Leaves out photos that are truncated or no JPEG; a whole photo of another size is an error.
fn keep_whole(photos: Vec<Photo>, expected: Size, losses: &mut Vec<Loss>) -> Result<Vec<Photo>, SurveyError> {
    let probed: Vec<Result<Size, PhotoError>> = photos.par_iter().map(|photo| probe(&photo.path)).collect();
    let mut kept = Vec::with_capacity(photos.len());
    for (photo, probed) in photos.into_iter().zip(probed) {
        match probed {
            Ok(found) if found == expected => kept.push(photo),
            Ok(found) => return Err(SurveyError::PhotoSize { path: photo.path, found, expected }),
            Err(error) => losses.push(Loss::new(format!("photos/{}", photo.name), error.reason())),
        }
    }
    Ok(kept)
}

fn add_masks(
    mut photos: Vec<Photo>,
    folder: &Path,
    size: Size,
    losses: &mut Vec<Loss>,
) -> Result<Vec<Photo>, SurveyError> {
    let masks_folder = folder.join("masks");
    if !masks_folder.is_dir() {
        return Ok(photos);
    }
    let files =
        find_files(&masks_folder, &["png"]).map_err(|source| SurveyError::Io { path: masks_folder.clone(), source })?;
    let masks = Masks::new(files);
    for photo in &mut photos {
        photo.mask = masks.of(&photo.name).map(Path::to_owned);
    }
    let mut used: Vec<&PathBuf> = photos.iter().filter_map(|photo| photo.mask.as_ref()).collect();
    used.sort();
    used.dedup();
    used.par_iter().try_for_each(|path| check_mask(path, size))?;
    let names: Vec<&str> = photos.iter().map(|photo| photo.name.as_str()).collect();
    let lost: Vec<String> =
        losses.iter().filter_map(|loss| loss.what.strip_prefix("photos/")).map(str::to_owned).collect();
    let known: Vec<&str> = names.into_iter().chain(lost.iter().map(String::as_str)).collect();
    for orphan in masks.orphans(&known) {
        losses.push(Loss::new(format!("masks/{orphan}"), "belongs to no photo"));
    }
    Ok(photos)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SURVEY_TOML: &str = r#"format = 1
[tunnel]
profile = "circle"
radius_m = 3.0
[camera]
model = "brown-conrady"
width_px = 32
height_px = 24
fx_px = 15.0
fy_px = 15.0
cx_px = 16.0
cy_px = 12.0
distortion = [0.0, 0.0, 0.0, 0.0, 0.0]
refine = false
rolling_shutter_s = 0.0
[rig]
images_per_turn = 10
image_up = "forward"
lever_radial_m = 0.06
lever_forward_m = 0.0
mount_rotvec_deg = [0.0, 0.0, 0.0]
[sigma]
shaft_deg = 1.0
range_m = 0.02
odometer_m_per_m = 0.02
attitude_deg = 1.5
mount_deg = 1.0
"#;

    fn jpeg(width: u16, height: u16) -> Vec<u8> {
        let pixels: Vec<u8> = (0..usize::from(width) * usize::from(height)).map(|i| (i * 37 % 251) as u8).collect();
        let mut bytes = Vec::new();
        jpeg_encoder::Encoder::new(&mut bytes, 90)
            .encode(&pixels, width, height, jpeg_encoder::ColorType::Luma)
            .unwrap();
        bytes
    }

    fn grey_png(path: &Path, width: u32, height: u32) {
        let mut encoder = png::Encoder::new(fs::File::create(path).unwrap(), width, height);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.write_header().unwrap().write_image_data(&vec![255; (width * height) as usize]).unwrap();
    }

    fn row(capture: u32, photo: &str) -> String {
        format!("{capture},{photo},confirmed,{}.0,{}.0,3.0,3.0,,3.0,,{},,,,,,,,\n", capture, capture * 36, capture)
    }

    /// A survey of four photos, G1.JPG to G4.JPG.
    struct Folder(tempfile::TempDir);

    impl Folder {
        fn new() -> Self {
            let folder = Self(tempfile::tempdir().unwrap());
            fs::create_dir_all(folder.path("photos")).unwrap();
            fs::create_dir_all(folder.path("masks")).unwrap();
            folder.write("survey.toml", SURVEY_TOML.as_bytes());
            folder.tags(&(1..=4).map(|i| row(i, &format!("G{i}.JPG"))).collect::<String>());
            for i in 1..=4 {
                folder.write(&format!("photos/G{i}.JPG"), &jpeg(32, 24));
            }
            folder
        }

        fn path(&self, name: &str) -> PathBuf {
            self.0.path().join(name)
        }

        fn write(&self, name: &str, bytes: &[u8]) {
            fs::write(self.path(name), bytes).unwrap();
        }

        fn tags(&self, rows: &str) {
            self.write("tags.csv", format!("{}\n{rows}", TagColumn::NAMES.join(",")).as_bytes());
        }

        fn load(&self) -> Survey {
            load(self.0.path()).unwrap()
        }

        fn names(&self) -> Vec<String> {
            self.load().photos.into_iter().map(|photo| photo.name).collect()
        }

        fn losses(&self) -> Vec<String> {
            self.load().losses.into_iter().map(|loss| format!("{}: {}", loss.what, loss.why)).collect()
        }

        /// The message with that of its source.
        fn error(&self) -> String {
            let error = load(self.0.path()).unwrap_err();
            let source = std::error::Error::source(&error).map(ToString::to_string).unwrap_or_default();
            format!("{error}: {source}")
        }
    }

    #[test]
    fn a_whole_survey_loads_without_a_loss() {
        let folder = Folder::new();
        assert_eq!(folder.names(), ["G1.JPG", "G2.JPG", "G3.JPG", "G4.JPG"]);
        assert_eq!(folder.losses(), Vec::<String>::new());
    }

    #[test]
    fn a_truncated_photo_is_left_out_by_name() {
        let folder = Folder::new();
        let whole = jpeg(32, 24);
        folder.write("photos/G2.JPG", &whole[..whole.len() - 40]);
        assert_eq!(folder.names(), ["G1.JPG", "G3.JPG", "G4.JPG"]);
        assert!(folder.losses()[0].starts_with("photos/G2.JPG: truncated"), "{:?}", folder.losses());
    }

    #[test]
    fn a_missing_photo_is_left_out_by_name_with_the_line_that_wants_it() {
        let folder = Folder::new();
        fs::remove_file(folder.path("photos/G3.JPG")).unwrap();
        assert_eq!(folder.names(), ["G1.JPG", "G2.JPG", "G4.JPG"]);
        assert_eq!(folder.losses(), ["photos/G3.JPG: the file is missing; tags.csv:4 names it for capture 3"]);
    }

    #[test]
    fn a_surplus_photo_is_named_and_not_used() {
        let folder = Folder::new();
        folder.write("photos/G9.JPG", &jpeg(32, 24));
        assert_eq!(folder.names().len(), 4);
        assert_eq!(
            folder.losses(),
            ["photos/G9.JPG: no row of tags.csv names this photo, nor is it between two that are named"]
        );
    }

    #[test]
    fn photos_without_a_tag_take_part_between_those_that_have_one() {
        let folder = Folder::new();
        folder.tags(&[row(1, "G1.JPG"), row(4, "G4.JPG")].concat());
        let photos = folder.load().photos;
        let tagged: Vec<(&str, bool)> = photos.iter().map(|photo| (&*photo.name, photo.tag.is_some())).collect();
        assert_eq!(tagged, [("G1.JPG", true), ("G2.JPG", false), ("G3.JPG", false), ("G4.JPG", true)]);
        assert!(folder.losses().is_empty(), "{:?}", folder.losses());
    }

    #[test]
    fn shuffled_rows_are_put_in_order_of_capture_and_said_so() {
        let folder = Folder::new();
        folder.tags(&[3, 1, 4, 2].map(|i| row(i, &format!("G{i}.JPG"))).concat());
        assert_eq!(folder.names(), ["G1.JPG", "G2.JPG", "G3.JPG", "G4.JPG"]);
        assert_eq!(
            folder.losses(),
            ["tags.csv:3: capture 1 stands after capture 3: the rows were put in order of capture"]
        );
    }

    #[test]
    fn an_empty_tags_file_is_an_error_that_names_it() {
        let folder = Folder::new();
        folder.write("tags.csv", b"");
        assert!(folder.error().contains("tags.csv: no captures"), "{}", folder.error());
        folder.tags("");
        assert!(folder.error().contains("tags.csv: no captures"), "{}", folder.error());
    }

    #[test]
    fn without_tags_csv_every_photo_takes_part_untagged_in_order_of_its_name() {
        let folder = Folder::new();
        fs::remove_file(folder.path("tags.csv")).unwrap();
        folder.write("photos/G10.JPG", b"no photo");
        let photos = folder.load().photos;
        let tagged: Vec<(&str, bool)> = photos.iter().map(|photo| (&*photo.name, photo.tag.is_some())).collect();
        assert_eq!(tagged, [("G1.JPG", false), ("G2.JPG", false), ("G3.JPG", false), ("G4.JPG", false)]);
        assert!(folder.losses()[0].starts_with("photos/G10.JPG: not a JPEG"), "{:?}", folder.losses());
    }

    #[test]
    fn rows_that_only_name_photos_keep_their_order_and_leave_the_photos_untagged() {
        let folder = Folder::new();
        let bare = |capture: u32, photo: &str| format!("{capture},{photo}{}\n", ",".repeat(17));
        folder.tags(&[bare(1, "G3.JPG"), bare(2, "G1.JPG")].concat());
        let photos = folder.load().photos;
        let tagged: Vec<(&str, bool)> = photos.iter().map(|photo| (&*photo.name, photo.tag.is_some())).collect();
        assert_eq!(&tagged[..2], [("G3.JPG", false), ("G1.JPG", false)]);
        // Beside rows that measure something, a row without a shaft angle is a fault as ever.
        folder.tags(&[row(1, "G3.JPG"), bare(2, "G1.JPG")].concat());
        assert!(folder.error().contains("tags.csv:3: column `state`"), "{}", folder.error());
    }

    #[test]
    fn a_survey_with_neither_tags_nor_photos_is_an_error_that_names_the_folder() {
        let folder = Folder::new();
        fs::remove_file(folder.path("tags.csv")).unwrap();
        for i in 1..=4 {
            fs::remove_file(folder.path(&format!("photos/G{i}.JPG"))).unwrap();
        }
        assert!(folder.error().contains("photos: no JPEG"), "{}", folder.error());
    }

    #[test]
    fn a_survey_without_any_photo_name_has_not_been_ingested() {
        let folder = Folder::new();
        folder.tags(&(1..=4).map(|i| row(i, "")).collect::<String>());
        assert!(folder.error().contains("adit ingest"), "{}", folder.error());
    }

    #[test]
    fn a_single_tag_without_photo_is_a_loss() {
        let folder = Folder::new();
        folder.tags(
            &(1..=4)
                .map(|i| row(i, if i == 2 { "" } else { ["G1.JPG", "", "G3.JPG", "G4.JPG"][i as usize - 1] }))
                .collect::<String>(),
        );
        assert_eq!(folder.losses(), ["tags.csv:3: capture 2 has no photo"]);
    }

    #[test]
    fn a_photo_claimed_by_two_captures_is_an_error_with_the_line() {
        let folder = Folder::new();
        folder.tags(&[row(1, "G1.JPG"), row(2, "G1.JPG")].concat());
        assert!(folder.error().contains("tags.csv:3: column `photo`: found `G1.JPG`"), "{}", folder.error());
    }

    #[test]
    fn an_unknown_key_or_a_wrong_unit_in_survey_toml_is_named() {
        let folder = Folder::new();
        folder.write("survey.toml", SURVEY_TOML.replace("radius_m = 3.0", "radius_mm = 3000.0").as_bytes());
        assert!(folder.error().contains("survey.toml") && folder.error().contains("radius_mm"), "{}", folder.error());
        folder.write("survey.toml", SURVEY_TOML.replace("refine = false", "refine = false\nfocus = 3").as_bytes());
        assert!(folder.error().contains("survey.toml") && folder.error().contains("focus"), "{}", folder.error());
    }

    #[test]
    fn a_photo_of_another_size_is_an_error_naming_both_sizes() {
        let folder = Folder::new();
        folder.write("photos/G2.JPG", &jpeg(40, 30));
        let error = folder.error();
        assert!(error.contains("G2.JPG") && error.contains("40 x 30") && error.contains("32 x 24"), "{error}");
    }

    #[test]
    fn a_mask_of_another_size_is_an_error_naming_both_sizes() {
        let folder = Folder::new();
        grey_png(&folder.path("masks/G2.JPG.png"), 24, 32);
        let error = folder.error();
        assert!(error.contains("G2.JPG.png") && error.contains("24 x 32") && error.contains("32 x 24"), "{error}");
    }

    #[test]
    fn the_common_mask_holds_for_all_and_an_orphan_is_named() {
        let folder = Folder::new();
        grey_png(&folder.path("masks/mask.png"), 32, 24);
        grey_png(&folder.path("masks/G7.JPG.png"), 1, 1);
        assert!(folder.load().photos.iter().all(|photo| photo.mask.as_deref() == Some(&folder.path("masks/mask.png"))));
        assert_eq!(folder.losses(), ["masks/G7.JPG.png: belongs to no photo"]);
    }

    #[test]
    fn a_survey_with_no_usable_photo_is_an_error() {
        let folder = Folder::new();
        for i in 1..=4 {
            folder.write(&format!("photos/G{i}.JPG"), b"nothing");
        }
        assert!(folder.error().contains("none of the 4 photos"), "{}", folder.error());
    }

    #[test]
    fn the_samples_load_without_a_loss() {
        let Some(samples) = crate::samples_folder() else {
            eprintln!("skipped: no shared/samples above this crate");
            return;
        };
        for name in ["cylinder-brick-spiral", "cylinder-concrete-spiral", "underpass-spiral"] {
            let survey = load(&samples.join(name)).unwrap();
            assert_eq!((survey.photos.len(), survey.losses.len()), (50, 0), "{name}");
            assert!(survey.photos.iter().all(|photo| photo.mask.is_some()), "{name}");
        }
    }
}
