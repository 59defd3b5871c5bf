//! Cost of what the board computes in flight, in single precision, and of the ray-cast that the ground uses everywhere.
//!
//! `cargo bench -p adit-geometry`. The yardstick is one `atan2` and one square root of the same scalar.

use adit_geometry::centring::general::{Beam, expected_range_m, locate};
use adit_geometry::centring::paper::{PaperRanges, solve};
use adit_geometry::coverage::{Footprint, Scene, max_step};
use adit_geometry::profile::{Profile, ProfileSpec};
use adit_geometry::rig::{ImageUp, Rig, outward};
use adit_geometry::speed::FieldOfView;
use adit_geometry::{Real, SectionVector};
use divan::{Bencher, black_box};
use nalgebra::{UnitQuaternion, Vector3};

fn main() {
    divan::main();
}

const SECTIONS: [&str; 4] = ["circle", "rectangle", "underpass", "horseshoe"];

fn profile<T: Real>(name: &str) -> Profile<T> {
    let of = T::of;
    let spec = match name {
        "circle" => ProfileSpec::Circle { radius_m: of(3.0) },
        "rectangle" => ProfileSpec::Rectangle { width_m: of(4.0), height_m: of(3.0), axis_height_m: of(1.5) },
        "underpass" => {
            ProfileSpec::Underpass { width_m: of(4.0), wall_m: of(2.5), rise_m: of(1.0), axis_height_m: of(1.4) }
        }
        _ => ProfileSpec::Horseshoe { width_m: of(5.0), wall_m: of(2.0), axis_height_m: of(1.9) },
    };
    spec.build().expect("a valid profile")
}

fn beams(profile: &Profile<f32>, offset_m: SectionVector<f32>) -> [Beam<f32>; 3] {
    [0.0, 0.25, 0.75].map(|turn| {
        let direction_in_body = outward(turn * core::f32::consts::TAU);
        let mut beam = Beam { origin_in_body_m: Vector3::zeros(), direction_in_body, range_m: None, sigma_m: 0.02 };
        beam.range_m = expected_range_m(profile, &beam, &UnitQuaternion::identity(), offset_m).map(|m| m + 0.01);
        beam
    })
}

#[divan::bench(types = [f32, f64])]
fn yardstick<T: Real>(bencher: Bencher<'_, '_>) {
    bencher.bench(|| black_box(T::of(0.3)).atan2(black_box(T::of(0.7))) + black_box(T::of(2.0)).sqrt());
}

#[divan::bench(types = [f32, f64], args = SECTIONS)]
fn ray_cast<T: Real>(bencher: Bencher<'_, '_>, section: &str) {
    let profile: Profile<T> = profile(section);
    let origin = SectionVector::new(T::of(0.3), T::of(-0.2));
    let direction = SectionVector::new(T::of(0.6), T::of(-0.8));
    bencher.bench(|| profile.ray_cast(black_box(origin), black_box(direction)));
}

#[divan::bench]
fn centring_paper_f32(bencher: Bencher<'_, '_>) {
    let ranges = PaperRanges { right_m: 2.5_f32, left_m: 3.3, up_m: 3.6 };
    bencher.bench(|| solve(black_box(3.0), black_box(&ranges)));
}

#[divan::bench(args = SECTIONS)]
fn centring_general_f32_with_hint(bencher: Bencher<'_, '_>, section: &str) {
    let profile: Profile<f32> = profile(section);
    let beams = beams(&profile, SectionVector::new(0.4, -0.3));
    let hint = Some(SectionVector::new(0.35, -0.25));
    bencher.bench(|| locate(&profile, black_box(&beams), &UnitQuaternion::identity(), hint));
}

#[divan::bench(args = SECTIONS)]
fn centring_general_f32_from_nothing(bencher: Bencher<'_, '_>, section: &str) {
    let profile: Profile<f32> = profile(section);
    let beams = beams(&profile, SectionVector::new(0.4, -0.3));
    bencher.bench(|| locate(&profile, black_box(&beams), &UnitQuaternion::identity(), None));
}

#[divan::bench(args = SECTIONS, consts = [1, 2])]
fn max_step_f32<const VIEWS: u8>(bencher: Bencher<'_, '_>, section: &str) {
    let profile: Profile<f32> = profile(section);
    let footprint = Footprint::rectangular(FieldOfView::paper()).expect("valid");
    let rig = Rig {
        images_per_turn: 12,
        image_up: ImageUp::Forward,
        lever_radial_m: 0.06,
        lever_forward_m: 0.0,
        mount_rotvec_rad: [0.0; 3],
    };
    bencher.bench(|| {
        let offset_m = black_box(SectionVector::new(0.4, -0.3));
        let scene = Scene::new(&profile, &footprint, &rig, offset_m, 0.0).expect("valid");
        max_step(&scene, VIEWS)
    });
}
