//! The fuzzer's only source of chance: a stream that a seed decides, with a taste for values at which programs break.

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Numbers that arithmetic trips over.
const ODD: [f32; 12] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::MAX,
    f32::MIN,
    f32::MIN_POSITIVE,
    1e-42,
    -0.0,
    -1.0,
    16_777_217.0,
    4_294_967_296.0,
    1e9,
];

/// Chance.
pub(crate) struct Dice(ChaCha8Rng);

impl Dice {
    /// The stream of a seed.
    pub(crate) fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    /// Any number.
    pub(crate) fn word(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// Any byte.
    pub(crate) fn byte(&mut self) -> u8 {
        self.0.next_u32() as u8
    }

    /// Below `end`, which is not zero.
    pub(crate) fn below(&mut self, end: usize) -> usize {
        self.0.random_range(0..end)
    }

    /// True in so many of a hundred throws.
    pub(crate) fn percent(&mut self, percent: usize) -> bool {
        self.below(100) < percent
    }

    /// One of these.
    pub(crate) fn pick<T: Copy>(&mut self, among: &[T]) -> T {
        among[self.below(among.len())]
    }

    /// Some bytes, fewer than `end`.
    pub(crate) fn bytes(&mut self, end: usize) -> Vec<u8> {
        let mut bytes = vec![0; self.below(end)];
        self.0.fill_bytes(&mut bytes);
        bytes
    }

    /// A number between `least` and `most`, seldom a strange one.
    pub(crate) fn real(&mut self, least: f32, most: f32) -> f32 {
        match self.below(16) {
            0 => self.pick(&ODD),
            1 => f32::from_bits(self.0.next_u32()),
            2 => self.pick(&[least, most, 0.0, 1.0]),
            _ => self.0.random_range(least..=most),
        }
    }

    /// A whole number with a taste for both ends.
    pub(crate) fn whole(&mut self) -> u32 {
        match self.below(4) {
            0 => self.below(4) as u32,
            1 => u32::MAX - self.below(1000) as u32,
            2 => self.below(100_000) as u32,
            _ => self.0.next_u32(),
        }
    }
}
