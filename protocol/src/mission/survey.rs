//! The tables `[tunnel]`, `[camera]`, `[rig]` and `[sigma]`.

use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::profile::{ChainVertex, MAX_PIECES, ProfileError, ProfileSpec};
use adit_geometry::rig::{ImageUp, Rig};

use super::quantity::{Quantity, Unit};
use super::reader::Section;
use super::{CameraConfig, Sigma, SurveyConfig};

/// From a drain to a cavern.
const SIZE: Quantity = Quantity::new(Unit::Metre, 0.1, 60.0);
/// Coordinates of a chain's vertices.
const COORDINATE: Quantity = Quantity::new(Unit::Metre, -60.0, 60.0);
/// `tan(sweep / 4)`: 1 is a half circle, 10 nearly a full one.
const BULGE: Quantity = Quantity::new(Unit::Plain, -10.0, 10.0);
/// Lever arms on a vehicle that fits a tunnel.
const LEVER: Quantity = Quantity::new(Unit::Metre, -3.0, 3.0);
/// Mounting errors; more is another [`ImageUp`].
const SMALL_ANGLE: Quantity = Quantity::new(Unit::Degree, -45.0, 45.0);
/// Standard deviations of angles, from a good encoder to "unknown".
const ANGLE_SIGMA: Quantity = Quantity::new(Unit::Degree, 0.01, 90.0);

/// Reads the four tables. `None` if anything that is needed is missing or wrong; then it has been reported.
pub(super) fn read(root: &mut Section<'_>) -> Option<SurveyConfig> {
    let tunnel = root.section("tunnel", true).and_then(tunnel);
    let camera = root.section("camera", true).and_then(camera);
    let rig = root.section("rig", true).and_then(|section| rig(section, tunnel.as_ref()));
    let sigma = sigma(root.section_or_empty("sigma"));
    Some(SurveyConfig { profile: tunnel?, camera: camera?, rig: rig?, sigma })
}

#[derive(Clone, Copy)]
enum Shape {
    Circle,
    Rectangle,
    Underpass,
    Horseshoe,
    Chain,
}

fn tunnel(mut section: Section<'_>) -> Option<ProfileSpec<f64>> {
    let shapes = [
        ("circle", Shape::Circle),
        ("rectangle", Shape::Rectangle),
        ("underpass", Shape::Underpass),
        ("horseshoe", Shape::Horseshoe),
        ("chain", Shape::Chain),
    ];
    let shape = section.choice("profile", &shapes)?;
    let spec = match shape {
        Shape::Circle => section.number("radius_m", SIZE).map(|radius_m| ProfileSpec::Circle { radius_m }),
        Shape::Rectangle => {
            let (width, height) = (section.number("width_m", SIZE), section.number("height_m", SIZE));
            let axis = section.maybe_number("axis_height_m", SIZE);
            width.zip(height).map(|(width_m, height_m)| ProfileSpec::Rectangle {
                width_m,
                height_m,
                axis_height_m: axis.unwrap_or(height_m / 2.0),
            })
        }
        Shape::Underpass => {
            let (width, wall) = (section.number("width_m", SIZE), section.number("wall_m", SIZE));
            let rise = section.number("rise_m", Quantity::new(Unit::Metre, 0.01, 60.0));
            let axis = section.maybe_number("axis_height_m", SIZE);
            width.zip(wall).zip(rise).map(|((width_m, wall_m), rise_m)| ProfileSpec::Underpass {
                width_m,
                wall_m,
                rise_m,
                axis_height_m: axis.unwrap_or(f64::midpoint(wall_m, rise_m)),
            })
        }
        Shape::Horseshoe => {
            let (width, wall) = (section.number("width_m", SIZE), section.number("wall_m", SIZE));
            let axis = section.maybe_number("axis_height_m", SIZE);
            width.zip(wall).map(|(width_m, wall_m)| ProfileSpec::Horseshoe {
                width_m,
                wall_m,
                axis_height_m: axis.unwrap_or(f64::midpoint(wall_m, width_m / 2.0)),
            })
        }
        Shape::Chain => chain(&mut section),
    };
    let built = spec.and_then(|spec| match spec.build() {
        Ok(_) => Some(spec),
        Err(error) => {
            complain_of_profile(&section, shape, error);
            None
        }
    });
    section.finish();
    built
}

fn chain(section: &mut Section<'_>) -> Option<ProfileSpec<f64>> {
    let points = section.pairs("points", COORDINATE);
    let count = points.as_ref().map(Vec::len);
    let bulges = section.numbers("bulges", BULGE, count);
    let points = points?;
    // The piece at the crown is cut in two.
    if points.len() < 2 || points.len() >= MAX_PIECES {
        section.complain("points", format!("{} points", points.len()), format!("2 to {} points", MAX_PIECES - 1));
        return None;
    }
    let bulges = bulges.unwrap_or_else(|| vec![0.0; points.len()]);
    let vertices = points.iter().zip(bulges).map(|(&[y_m, z_m], bulge)| ChainVertex { y_m, z_m, bulge });
    Some(ProfileSpec::Chain { vertices: vertices.collect() })
}

fn complain_of_profile(section: &Section<'_>, shape: Shape, error: ProfileError) {
    match error {
        ProfileError::NotPositive { name, value } => section.complain(name, value.to_string(), "a positive length"),
        ProfileError::AxisOutside if !matches!(shape, Shape::Chain) => {
            section.complain("axis_height_m", "an axis outside the profile", "an axis between floor and ceiling");
        }
        other => section.complain("points", other.to_string(), "a closed chain around the axis, clockwise"),
    }
}

fn camera(mut section: Section<'_>) -> Option<CameraConfig> {
    let model = section.choice("model", &[("brown-conrady", 5), ("kannala-brandt", 4)]);
    let width = section.integer("width_px", 16, 65_000);
    let height = section.integer("height_px", 16, 65_000);
    let share_of = |size: Option<u32>, low: f64, high: f64| match size.map(f64::from) {
        Some(size) => Quantity::new(Unit::Pixel, size * low, size * high),
        None => Quantity::new(Unit::Pixel, 0.0, 1e6),
    };
    // From a fisheye to a long telephoto lens; a focal length in millimetres or as a share lies far below.
    let focal = |size| share_of(size, 0.1, 20.0);
    let centre = |size| share_of(size, 0.25, 0.75);
    let fx = section.number("fx_px", focal(width));
    let fy = section.number("fy_px", focal(height));
    let cx = section.number("cx_px", centre(width));
    let cy = section.number("cy_px", centre(height));
    let coefficient = Quantity::new(Unit::Plain, -10.0, 10.0);
    let absent = vec![0.0; model.unwrap_or(0)];
    let distortion = section.numbers("distortion", coefficient, model).unwrap_or(absent);
    let refine = section.flag_or("refine", false);
    let rolling_shutter_s = section.number_or("rolling_shutter_s", Quantity::new(Unit::Second, 0.0, 0.5), 0.0);
    section.finish();
    let distortion = match <[f64; 5]>::try_from(distortion) {
        Ok(brown) => Distortion::BrownConrady(brown),
        Err(other) => Distortion::KannalaBrandt(<[f64; 4]>::try_from(other).ok()?),
    };
    let camera =
        Camera { width_px: width?, height_px: height?, focal_px: [fx?, fy?], centre_px: [cx?, cy?], distortion };
    Some(CameraConfig { camera, refine, rolling_shutter_s })
}

fn rig(mut section: Section<'_>, tunnel: Option<&ProfileSpec<f64>>) -> Option<Rig<f64>> {
    let images_per_turn = section.integer("images_per_turn", 2, 360);
    let ups = [
        ("forward", ImageUp::Forward),
        ("backward", ImageUp::Backward),
        ("clockwise", ImageUp::Clockwise),
        ("counterclockwise", ImageUp::Counterclockwise),
    ];
    let image_up = section.choice("image_up", &ups);
    let lever_radial_m = section.number_or("lever_radial_m", LEVER, 0.0);
    let lever_forward_m = section.number_or("lever_forward_m", LEVER, 0.0);
    let mount = section.numbers("mount_rotvec_deg", SMALL_ANGLE, Some(3)).unwrap_or_else(|| vec![0.0; 3]);
    if let Some(clearance_m) = tunnel.and_then(clearance_m).filter(|clearance_m| lever_radial_m >= *clearance_m) {
        let expected = format!("less than the {clearance_m:.3} m from the axis to the nearest wall");
        section.complain("lever_radial_m", lever_radial_m.to_string(), expected);
    }
    section.finish();
    Some(Rig {
        images_per_turn: u16::try_from(images_per_turn?).ok()?,
        image_up: image_up?,
        lever_radial_m,
        lever_forward_m,
        mount_rotvec_rad: <[f64; 3]>::try_from(mount).ok()?.map(f64::to_radians),
    })
}

/// From the axis to the nearest wall.
pub(super) fn clearance_m(spec: &ProfileSpec<f64>) -> Option<f64> {
    Some(spec.build().ok()?.nearest(nalgebra::Vector2::zeros())?.clearance_m)
}

fn sigma(mut section: Section<'_>) -> Sigma {
    let default = Sigma::default();
    let mut angle = |key, default_rad: f64| section.maybe_number(key, ANGLE_SIGMA).map_or(default_rad, f64::to_radians);
    let shaft_rad = angle("shaft_deg", default.shaft_rad);
    let attitude_rad = angle("attitude_deg", default.attitude_rad);
    let mount_rad = angle("mount_deg", default.mount_rad);
    let range_m = section.number_or("range_m", Quantity::new(Unit::Metre, 0.0005, 1.0), default.range_m);
    let ratio = Quantity::new(Unit::Ratio, 0.0001, 1.0);
    let odometer_m_per_m = section.number_or("odometer_m_per_m", ratio, default.odometer_m_per_m);
    section.finish();
    Sigma { shaft_rad, range_m, odometer_m_per_m, attitude_rad, mount_rad }
}
