//! Invariants of centring, paper's form and general form.

mod common;

use std::f64::consts::TAU;

use adit_geometry::centring::general::{Beam, BeamSet, Centring, Fix, expected_range_m, locate};
use adit_geometry::centring::paper::{PaperRanges, solve};
use adit_geometry::profile::{Profile, ProfileSpec};
use adit_geometry::rig::{attitude, outward};
use adit_geometry::{Real, SectionVector};
use common::{KINDS, inside, profile};
use nalgebra::{Rotation2, UnitQuaternion, Vector2, Vector3};
use proptest::prelude::*;

const UP: f64 = 0.0;
const RIGHT: f64 = 0.25;
const DOWN: f64 = 0.5;
const LEFT: f64 = 0.75;

/// A beam at a share of a turn, with a lever of 10 cm along it, that reads what it should at `offset_m`.
fn beam<T: Real>(
    profile: &Profile<T>,
    turn: f64,
    tunnel_from_body: &UnitQuaternion<T>,
    offset_m: SectionVector<T>,
) -> Beam<T> {
    let direction_in_body = outward(T::of(turn * TAU));
    let mut beam = Beam {
        origin_in_body_m: direction_in_body * T::of(0.1) + Vector3::x() * T::of(0.05),
        direction_in_body,
        range_m: None,
        sigma_m: T::of(0.02),
    };
    beam.range_m = expected_range_m(profile, &beam, tunnel_from_body, offset_m);
    beam
}

fn beams<T: Real>(
    profile: &Profile<T>,
    turns: &[f64],
    tunnel_from_body: &UnitQuaternion<T>,
    offset_m: SectionVector<T>,
) -> Vec<Beam<T>> {
    turns.iter().map(|&turn| beam(profile, turn, tunnel_from_body, offset_m)).collect()
}

fn level<T: Real>() -> UnitQuaternion<T> {
    UnitQuaternion::identity()
}

fn sigma<T: Real>(fix: &Fix<T>) -> (f64, f64) {
    (fix.covariance_m2[(0, 0)].sqrt().to_f64(), fix.covariance_m2[(1, 1)].sqrt().to_f64())
}

fn paper_ranges(y: f64, z: f64, r: f64) -> PaperRanges<f64> {
    let half_chord = (r * r - z * z).sqrt();
    PaperRanges { right_m: half_chord - y, left_m: half_chord + y, up_m: (r * r - y * y).sqrt() + z }
}

/// Whether a beam from near `offset_m` ends near a joint of the profile.
fn meets_corner<T: Real>(
    profile: &Profile<T>,
    beams: &[Beam<T>],
    tunnel_from_body: &UnitQuaternion<T>,
    offset_m: SectionVector<T>,
) -> bool {
    beams.iter().any(|beam| {
        let origin = offset_m + (tunnel_from_body * beam.origin_in_body_m).yz();
        let hit = profile.ray_cast(origin, (tunnel_from_body * beam.direction_in_body).yz()).unwrap();
        let joints = profile.pieces().iter().map(|piece| profile.at(piece.start_s_m()).unwrap().point);
        joints.into_iter().any(|joint| (joint - hit.surface.point).norm().to_f64() < 0.1)
    })
}

/// The place is found from three or four exact beams, or reported as one of several, never silently wrong.
fn check_exact<T: Real>(kind: usize, at: (f64, f64), tilt: [f64; 3], tolerance_m: f64) {
    let profile: Profile<T> = profile(kind, 1.0);
    let truth = inside(&profile, at.0, at.1);
    let turned = attitude(T::of(tilt[0]), T::of(tilt[1]), T::of(tilt[2]));
    let beams = beams(&profile, &[UP, RIGHT, LEFT], &turned, truth);
    let near = |fix: &Fix<T>| {
        let error = fix.offset_m - truth;
        // At a kink (a beam into a corner) the descent may end early, but not far from the truth.
        let tolerance_m = if meets_corner(&profile, &beams, &turned, truth) { 0.06 } else { tolerance_m };
        error.norm().to_f64() < tolerance_m
    };
    match locate(&profile, &beams, &turned, None) {
        Centring::Solved(fix) => assert!(near(&fix), "{fix:?} instead of {truth:?}"),
        Centring::Ambiguous { fixes } => assert!(fixes.iter().any(near), "{fixes:?} instead of {truth:?}"),
        other => panic!("{other:?} at {truth:?}"),
    }
    let hint = truth + Vector2::new(T::of(0.05), T::of(-0.04));
    let hinted = locate(&profile, &beams, &turned, Some(hint));
    let fix = hinted.solved().unwrap_or_else(|| panic!("{hinted:?} with a hint at {truth:?}"));
    assert!(near(fix), "{fix:?} instead of {truth:?}");
    assert_eq!((fix.used, fix.rejected), (BeamSet(0b111), BeamSet(0)));
}

proptest! {
    #[test]
    fn exact_beams_give_the_place_back_in_every_profile(
        kind in 0..KINDS, phi in 0.0..TAU, share in 0.0f64..0.8,
        roll in -0.15f64..0.15, pitch in -0.15f64..0.15, yaw in -0.2f64..0.2,
    ) {
        check_exact::<f64>(kind, (phi, share), [roll, pitch, yaw], 1e-6);
        check_exact::<f32>(kind, (phi, share), [roll, pitch, yaw], 2e-3);
    }

    #[test]
    fn both_forms_agree_on_a_circle(r in 1.0f64..6.0, phi in 0.0..TAU, share in 0.0f64..0.8) {
        let offset = inside(&ProfileSpec::Circle { radius_m: r }.build().unwrap(), phi, share);
        // At the centre's height the paper's equations are singular off the centre line: see the next test.
        prop_assume!(offset.y.abs() > 0.02 * r);
        let ranges = paper_ranges(offset.x, offset.y, r);
        let paper = solve(r, &ranges).unwrap();
        let profile = ProfileSpec::Circle { radius_m: r }.build().unwrap();
        let bare = |turn: f64, range_m: f64| Beam {
            origin_in_body_m: Vector3::zeros(),
            direction_in_body: outward(turn * TAU),
            range_m: Some(range_m),
            sigma_m: 0.02,
        };
        let beams = [bare(RIGHT, ranges.right_m), bare(LEFT, ranges.left_m), bare(UP, ranges.up_m)];
        let general = locate(&profile, &beams, &level(), None);
        let fix = general.solved().unwrap();
        prop_assert!((fix.offset_m - paper.offset_m).norm() < 1e-6 * r, "{:?} {:?}", fix, paper);
        prop_assert!((fix.offset_m - offset).norm() < 1e-6 * r);
        let single = PaperRanges {
            right_m: ranges.right_m as f32, left_m: ranges.left_m as f32, up_m: ranges.up_m as f32,
        };
        let single = solve(r as f32, &single).unwrap();
        prop_assert!((single.offset_m.map(f64::from) - offset).norm() < 2e-3 * r, "{:?} {:?}", single, offset);
    }

    #[test]
    fn the_papers_form_stays_close_and_finite_at_the_height_of_the_centre(
        share_y in -0.8f64..0.8, share_z in -0.02f64..0.02, noise in prop::array::uniform3(-0.02f64..0.02),
    ) {
        let ranges = paper_ranges(3.0 * share_y, 3.0 * share_z, 3.0);
        let noisy = PaperRanges {
            right_m: ranges.right_m + noise[0], left_m: ranges.left_m + noise[1], up_m: ranges.up_m + noise[2],
        };
        let report = solve(3.0, &noisy).unwrap();
        let error = (report.offset_m - Vector2::new(3.0 * share_y, 3.0 * share_z)).norm();
        // The horizontal ranges say nothing about height here, and still the error stays a few times the noise.
        prop_assert!(error < 0.2, "{error} m: {report:?}");
    }

    #[test]
    fn a_turned_vehicle_in_a_circle_is_found_at_the_turned_place(
        phi in 0.0..TAU, share in 0.05f64..0.7, turn in 0.0..TAU, noise in prop::array::uniform3(-0.03f64..0.03),
    ) {
        let profile: Profile<f64> = profile(0, 1.0);
        let truth = inside(&profile, phi, share);
        let mut still = beams(&profile, &[UP, RIGHT, LEFT], &level(), truth);
        for (beam, noise) in still.iter_mut().zip(noise) {
            beam.range_m = beam.range_m.map(|range| range + noise);
        }
        let rotation = Rotation2::new(turn);
        let rolled = attitude(turn, 0.0, 0.0);
        let one = locate(&profile, &still, &level(), Some(truth));
        let other = locate(&profile, &still, &rolled, Some(rotation * truth));
        let (Some(one), Some(other)) = (one.solved(), other.solved()) else {
            prop_assert_eq!(one.solved().is_some(), other.solved().is_some());
            return Ok(());
        };
        prop_assert!((rotation * one.offset_m - other.offset_m).norm() < 1e-5);
        let turned = rotation * one.covariance_m2 * rotation.inverse();
        prop_assert!((turned - other.covariance_m2).norm() < 1e-5 * turned.norm());
    }

    #[test]
    fn a_tunnel_twice_as_large_gives_a_place_twice_as_far(
        kind in 0..KINDS, phi in 0.0..TAU, share in 0.0f64..0.7, scale in 0.3f64..4.0,
        noise in prop::array::uniform3(-0.02f64..0.02),
    ) {
        let (small, large): (Profile<f64>, Profile<f64>) = (profile(kind, 1.0), profile(kind, scale));
        let truth = inside(&small, phi, share);
        let mut one = beams(&small, &[UP, RIGHT, LEFT], &level(), truth);
        for (beam, noise) in one.iter_mut().zip(noise) {
            beam.range_m = beam.range_m.map(|range| range + noise);
        }
        let mut other = one.clone();
        for beam in &mut other {
            beam.range_m = beam.range_m.map(|range| range * scale);
            beam.sigma_m *= scale;
            beam.origin_in_body_m *= scale;
        }
        let one = locate(&small, &one, &level(), Some(truth));
        let other = locate(&large, &other, &level(), Some(truth * scale));
        if let (Some(one), Some(other)) = (one.solved(), other.solved()) {
            prop_assert!((one.offset_m * scale - other.offset_m).norm() < 1e-5 * scale);
            prop_assert!((one.covariance_m2 * scale * scale - other.covariance_m2).norm() < 1e-4 * scale * scale);
        }
    }

    #[test]
    fn one_more_exact_beam_never_raises_the_covariance(
        kind in 0..KINDS, phi in 0.0..TAU, share in 0.0f64..0.7, turn in 0.0f64..1.0,
    ) {
        let profile: Profile<f64> = profile(kind, 1.0);
        let truth = inside(&profile, phi, share);
        let mut all = beams(&profile, &[UP, RIGHT, LEFT], &level(), truth);
        let before = locate(&profile, &all, &level(), Some(truth));
        all.push(beam(&profile, turn, &level(), truth));
        let after = locate(&profile, &all, &level(), Some(truth));
        let (before, after) = (before.solved().unwrap(), after.solved().unwrap());
        let gain = before.covariance_m2 - after.covariance_m2;
        prop_assert!(gain.symmetric_eigenvalues().min() > -1e-9, "{gain:?}");
    }

    #[test]
    fn one_wrong_beam_of_four_is_found_out(
        kind in 0..KINDS, phi in 0.0..TAU, share in 0.0f64..0.5, wrong in 0..4usize, error in 0.4f64..0.9,
    ) {
        // A wall 40 to 90 cm nearer than it is: a pipe, a ladder, a person.
        let profile: Profile<f64> = profile(kind, 1.0);
        let truth = inside(&profile, phi, share);
        let mut all = beams(&profile, &[UP, RIGHT, DOWN, LEFT], &level(), truth);
        let range = all[wrong].range_m.unwrap();
        prop_assume!(range > 1.2);
        all[wrong].range_m = Some(range - error);
        let fix = locate(&profile, &all, &level(), Some(truth));
        if let Some(fix) = fix.solved() {
            let others = BeamSet(0b1111 & !(1 << wrong));
            if fix.used == others {
                prop_assert_eq!(fix.rejected, BeamSet(1 << wrong));
                prop_assert!((fix.offset_m - truth).norm() < 0.05, "{:?} instead of {:?}", fix, truth);
            } else {
                // Another beam may be blamed only where the remaining three agree as well.
                prop_assert!(fix.residual_sigmas < 3.0 && fix.used.len() >= 2, "{fix:?}");
            }
        }
    }

    #[test]
    fn any_bits_are_survived(
        kind in 0..KINDS,
        ranges in prop::array::uniform4(prop::option::of(proptest::num::f32::ANY)),
        sigma_m in proptest::num::f32::ANY,
        lever in proptest::num::f32::ANY,
        hint in prop::option::of((proptest::num::f32::ANY, proptest::num::f32::ANY)),
        roll in proptest::num::f32::ANY,
    ) {
        let profile: Profile<f32> = profile(kind, 1.0);
        let beams: Vec<_> = [UP, RIGHT, DOWN, LEFT]
            .iter()
            .zip(ranges)
            .map(|(&turn, range_m)| Beam {
                origin_in_body_m: Vector3::new(0.0, lever, 0.0),
                direction_in_body: outward((turn * TAU) as f32),
                range_m,
                sigma_m,
            })
            .collect();
        let outcome = locate(&profile, &beams, &attitude(roll, 0.0, 0.0), hint.map(|(y, z)| Vector2::new(y, z)));
        if let Some(fix) = outcome.solved() {
            prop_assert!(profile.contains(fix.offset_m));
            prop_assert!(fix.covariance_m2.iter().all(|c| c.is_finite()));
            prop_assert!(fix.used.len() >= 2);
        }
    }

    #[test]
    fn any_ranges_are_survived_by_the_papers_form(
        right_m in proptest::num::f32::ANY, left_m in proptest::num::f32::ANY, up_m in proptest::num::f32::ANY,
    ) {
        let _ = solve(3.0_f32, &PaperRanges { right_m, left_m, up_m });
        let clipped = |m: f32| if m.is_finite() { m.abs().clamp(0.2, 14.0) } else { 14.0 };
        let ranges = PaperRanges { right_m: clipped(right_m), left_m: clipped(left_m), up_m: clipped(up_m) };
        let report = solve(3.0_f32, &ranges).unwrap();
        prop_assert!(report.offset_m.iter().all(|m| m.is_finite()) && report.residual.is_finite(), "{report:?}");
    }
}

#[test]
fn two_horizontal_beams_leave_the_mirror_open_and_a_hint_closes_it() {
    let profile: Profile<f64> = profile(0, 1.0);
    let truth = Vector2::new(0.3, 1.2);
    let beams = beams(&profile, &[RIGHT, LEFT], &level(), truth);
    let outcome = locate(&profile, &beams, &level(), None);
    let Centring::Ambiguous { fixes } = outcome else { panic!("{outcome:?}") };
    assert!((fixes[0].offset_m.y + fixes[1].offset_m.y).abs() < 1e-6, "one is the other's mirror image");
    for z in [1.0, -1.0] {
        let hinted = locate(&profile, &beams, &level(), Some(Vector2::new(0.2, z)));
        let expected = Vector2::new(0.3, 1.2 * z);
        assert!((hinted.solved().unwrap().offset_m - expected).norm() < 1e-6, "{hinted:?}");
    }
}

#[test]
fn the_upward_beam_decides_the_mirror() {
    let profile: Profile<f64> = profile(0, 1.0);
    for z in [1.2, -1.2] {
        let truth = Vector2::new(0.3, z);
        let beams = beams(&profile, &[UP, RIGHT, LEFT], &level(), truth);
        // Even against a hint on the wrong side.
        let outcome = locate(&profile, &beams, &level(), Some(Vector2::new(0.3, -z)));
        assert!((outcome.solved().unwrap().offset_m - truth).norm() < 1e-6, "{outcome:?}");
    }
}

#[test]
fn between_vertical_walls_two_horizontal_beams_say_nothing_about_height() {
    let profile: Profile<f64> = profile(1, 1.0);
    let truth = Vector2::new(0.5, 0.2);
    let beams = beams(&profile, &[RIGHT, LEFT], &level(), truth);
    let outcome = locate(&profile, &beams, &level(), Some(Vector2::new(0.0, 0.4)));
    let Centring::Undetermined { fix, free_direction } = outcome else { panic!("{outcome:?}") };
    assert!(free_direction.x.abs() < 1e-6);
    assert!((fix.offset_m.x - 0.5).abs() < 1e-6, "the sideways place is known all the same");
    assert!((fix.offset_m.y - 0.4).abs() < 1e-3, "the height stays the hint's");
    assert!(sigma(&fix).0 < 0.02 && sigma(&fix).1 > 0.1);
}

#[test]
fn sensors_that_cannot_measure_are_left_out_by_name() {
    let profile: Profile<f64> = profile(2, 1.0);
    let truth = Vector2::new(0.5, -0.3);
    let mut beams = beams(&profile, &[UP, RIGHT, DOWN, LEFT], &level(), truth);
    beams[1].range_m = None;
    beams[2].range_m = None;
    let outcome = locate(&profile, &beams, &level(), None);
    let fix = outcome.solved().unwrap_or_else(|| panic!("{outcome:?}"));
    assert_eq!(fix.used, BeamSet(0b1001));
    assert!((fix.offset_m - truth).norm() < 1e-6);
    beams[0].range_m = None;
    let outcome = locate(&profile, &beams, &level(), None);
    assert_eq!(outcome, Centring::NotEnoughBeams { usable: BeamSet(0b1000) });
    beams[3].range_m = Some(f64::NAN);
    assert_eq!(locate(&profile, &beams, &level(), None), Centring::NotEnoughBeams { usable: BeamSet(0) });
}

#[test]
fn each_body_beam_has_its_sign() {
    let profile: Profile<f64> = profile(0, 1.0);
    let at = |y: f64, z: f64| Vector2::new(y, z);
    for truth in [at(0.5, 0.0), at(-0.5, 0.0), at(0.0, 0.5), at(0.0, -0.5)] {
        let beams = beams(&profile, &[UP, RIGHT, LEFT], &level(), truth);
        let fix = *locate(&profile, &beams, &level(), None).solved().unwrap();
        assert!((fix.offset_m - truth).norm() < 1e-6, "{fix:?} instead of {truth:?}");
    }
    // Nearer to the right wall: the right beam is the shorter one.
    let right = beams(&profile, &[RIGHT, LEFT], &level(), at(0.5, 0.0));
    assert!(right[0].range_m < right[1].range_m);
}

#[test]
fn attitude_and_levers_are_taken_out() {
    // Rolled right by 10 degrees, the upward beam points up-right and the levers turn with the body.
    let profile: Profile<f64> = profile(3, 1.0);
    let truth = Vector2::new(-0.4, 0.3);
    let turned = attitude(10f64.to_radians(), -0.1, 0.15);
    let beams = beams(&profile, &[UP, RIGHT, LEFT], &turned, truth);
    let with = *locate(&profile, &beams, &turned, Some(truth)).solved().unwrap();
    assert!((with.offset_m - truth).norm() < 1e-6);
    let without = locate(&profile, &beams, &level(), Some(truth));
    assert!(without.solved().is_none_or(|fix| (fix.offset_m - truth).norm() > 0.02), "{without:?}");
}

#[test]
fn the_covariance_is_that_of_many_noisy_solutions() {
    let profile: Profile<f64> = profile(0, 1.0);
    let truth = Vector2::new(0.4, 0.8);
    let exact = beams(&profile, &[UP, RIGHT, LEFT], &level(), truth);
    let claimed = sigma(locate(&profile, &exact, &level(), Some(truth)).solved().unwrap());
    // A small fixed generator: sums of twelve uniform numbers are close to normal.
    let mut state = 88_172_645_463_325_252_u64;
    let mut normal = || {
        (0..12).fold(-6.0, |sum, _| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            sum + (state >> 11) as f64 / (1u64 << 53) as f64
        })
    };
    let (mut sum, count) = (Vector2::zeros(), 2000);
    for _ in 0..count {
        let mut noisy = exact.clone();
        for beam in &mut noisy {
            beam.range_m = beam.range_m.map(|range| range + 0.02 * normal());
        }
        let fix = *locate(&profile, &noisy, &level(), Some(truth)).solved().unwrap();
        sum += (fix.offset_m - truth).map(|error| error * error);
    }
    let measured = (sum / f64::from(count)).map(f64::sqrt);
    // The robust loss costs up to 5 % of efficiency.
    assert!((measured.x / claimed.0 - 1.0).abs() < 0.15, "{measured:?} {claimed:?}");
    assert!((measured.y / claimed.1 - 1.0).abs() < 0.15, "{measured:?} {claimed:?}");
}
