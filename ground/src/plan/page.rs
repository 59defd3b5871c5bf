//! plan.html: what one looks at before a flight, in one file.

use minijinja::Environment;
use serde_json::json;

use super::curves::speed_svg;
use super::pixels::COLOURS;
use super::{OutputError, Plan};
use crate::report::wall_address;
use crate::texture::COVERAGE_COLOURS;

/// Longest side of the pictures.
const PICTURE_PX: usize = 1600;
/// So many holes are listed; all are in plan.json.
const LISTED_HOLES: usize = 10;

/// The whole page. `fingerprint` is that of the parameters for the board.
pub(super) fn page(plan: &Plan, fingerprint: u64) -> Result<String, OutputError> {
    let mut environment = Environment::new();
    // The name's ending turns HTML escaping on for every value.
    environment.add_template("plan.html", include_str!("plan.html"))?;
    let picture = |picture| wall_address(picture, PICTURE_PX);
    let figures = json!({
        "plan": plan,
        "flyable": plan.is_flyable(),
        "hash": format!("{fingerprint:016x}"),
        "speed_svg": speed_svg(plan),
        "coverage": plan.picture.as_ref().map(picture).transpose()?,
        "coverage_colours": COVERAGE_COLOURS,
        "holes": plan.coverage.iter().flat_map(|coverage| &coverage.holes).take(LISTED_HOLES).collect::<Vec<_>>(),
        "pixels": plan.pixel_map.as_ref().map(|map| picture(&map.picture)).transpose()?,
        "pixel_colours": COLOURS,
        "pixel_ends_mm": plan.pixel_map.as_ref().map(|map| map.ends_mm),
    });
    Ok(environment.get_template("plan.html")?.render(minijinja::value::Serde(&figures))?)
}
