//! Brick lining: stretchers along the tunnel in half bond, every brick fired a little differently, or all alike.

use super::lattice::{Octave, Octaves, around, cell, even_count, hash, share_in_joint, signed, smooth_step, unit};
use super::{Paint, Patch, Rgb, blend, linear_of_srgb, mean, scale};

/// Length of a brick with its joint (215 + 10 mm, the British standard format).
const BRICK_PITCH_M: f64 = 0.225;
/// Height of a course with its joint (65 + 10 mm).
const COURSE_PITCH_M: f64 = 0.075;
/// Mortar joint.
const JOINT_M: f32 = 0.010;
/// How far hand-laid edges stray.
const WOBBLE_M: f32 = 0.0025;

pub(super) struct Brick {
    seed: u32,
    /// Whether bricks, grain and joints differ; if not, only the largest stains are left.
    varied: bool,
    courses: i32,
    course_pitch_m: f64,
    wobble: [Octave; 2],
    grain: Octaves<4>,
    stain: Octaves<3>,
    bloom: Octave,
    damp: Octave,
    fired: [Rgb; 5],
    mortar: Rgb,
    lime: Rgb,
}

impl Brick {
    pub(super) fn new(perimeter_m: f64, seed: u64) -> Self {
        let (courses, course_pitch_m) = even_count(perimeter_m, COURSE_PITCH_M);
        let octave = |stream, cell_m| Octave::new(seed, stream, perimeter_m, cell_m);
        Self {
            seed: seed as u32,
            varied: true,
            courses,
            course_pitch_m,
            wobble: [octave(1, 0.05), octave(2, 0.05)],
            grain: Octaves([
                (octave(3, 0.004), 0.16),
                (octave(4, 0.010), 0.15),
                (octave(5, 0.024), 0.13),
                (octave(6, 0.06), 0.10),
            ]),
            stain: Octaves([(octave(7, 0.21), 0.12), (octave(8, 0.7), 0.14), (octave(9, 2.3), 0.16)]),
            bloom: octave(10, 0.55),
            damp: Octave::stretched(seed, 11, perimeter_m, 1.4, 0.35),
            fired: [[150, 82, 62], [134, 66, 52], [168, 104, 76], [112, 58, 50], [178, 122, 92]].map(linear_of_srgb),
            mortar: linear_of_srgb([172, 164, 150]),
            lime: linear_of_srgb([205, 200, 190]),
        }
    }

    /// Bricks laid to the millimetre, all of one colour, without grain; a stain here and there.
    pub(super) fn identical(perimeter_m: f64, seed: u64) -> Self {
        Self { varied: false, ..Self::new(perimeter_m, seed) }
    }

    /// Tone of a stained place: 1 where there is no stain.
    fn stain_tone(&self, whole: &Patch) -> f32 {
        let damp = self.damp.at(whole);
        if !self.varied {
            // About one place in twenty.
            return 1.0 - 0.35 * smooth_step(0.6, 0.8, damp);
        }
        let stain = self.stain.coarse(whole) + self.stain.fine(whole, whole);
        (1.0 + stain) * (1.0 - 0.35 * smooth_step(0.2, 0.7, damp))
    }

    /// The wall where all bricks are alike.
    fn mean_identical(&self, whole: &Patch, samples: &[Patch]) -> Rgb {
        let tone = self.stain_tone(whole);
        mean(samples, |sample| {
            let (_, _, mortar) = self.bond(sample, [0.0; 2]);
            scale(blend(self.fired[0], self.mortar, mortar), tone)
        })
    }

    /// Course, column and share of mortar of a sample, its edges displaced by `wobble_m` (around, along).
    fn bond(&self, sample: &Patch, wobble_m: [f64; 2]) -> (i32, i32, f32) {
        let (course, from_course_m) = cell(sample.s_m + wobble_m[0], self.course_pitch_m);
        let course = around(course, self.courses);
        let bond_m = if course % 2 == 0 { 0.0 } else { 0.5 * BRICK_PITCH_M };
        let (column, from_middle_m) = cell(sample.x_m + wobble_m[1] + bond_m, BRICK_PITCH_M);
        let bed = share_in_joint(from_course_m, sample.size_s_m, self.course_pitch_m as f32, JOINT_M);
        let head = share_in_joint(from_middle_m, sample.size_x_m, BRICK_PITCH_M as f32, JOINT_M);
        (course, column, 1.0 - (1.0 - bed) * (1.0 - head))
    }

    /// Colour of one brick.
    fn brick_colour(&self, course: i32, column: i32) -> Rgb {
        let bits = hash(self.seed, course, column);
        let kind = bits % 16;
        let base = match kind {
            0..=5 => self.fired[0],
            6..=9 => self.fired[1],
            10..=12 => self.fired[2],
            13..=14 => self.fired[3],
            _ => self.fired[4],
        };
        let second = hash(self.seed ^ 0x51ed, course, column);
        // About one in fourteen is an over-burnt, nearly black one.
        let burnt = if unit(second) < 0.07 { 0.38 } else { 1.0 };
        scale(base, burnt * (1.0 + 0.30 * signed(second.rotate_left(11))))
    }
}

impl Paint for Brick {
    fn mean_albedo(&self, whole: &Patch, samples: &[Patch]) -> Rgb {
        if !self.varied {
            return self.mean_identical(whole, samples);
        }
        let wobble_m = [0, 1].map(|axis| f64::from(WOBBLE_M * self.wobble[axis].at(whole)));
        let coarse_grain = self.grain.coarse(whole);
        let bloom = self.bloom.at(whole);
        let tone = self.stain_tone(whole);
        mean(samples, |sample| {
            let (course, column, mortar) = self.bond(sample, wobble_m);
            let grain = coarse_grain + self.grain.fine(whole, sample);
            let brick = scale(self.brick_colour(course, column), 1.0 + 1.5 * grain);
            let joint = scale(self.mortar, 1.0 + grain);
            let lime = 0.45 * smooth_step(0.25, 0.8, bloom + grain);
            scale(blend(blend(brick, joint, mortar), self.lime, lime), tone)
        })
    }
}
