//! `ChArUco` boards: a chessboard with a square marker in each of its white squares, which says which square it is.
//!
//! Markers are black frames of one cell around `n` x `n` cells. Codes are rows from the top, the first cell of a row highest, 1 for
//! white. They are the predefined dictionaries of `OpenCV` (objdetect, `predefined_dictionaries.hpp`; Garrido-Jurado et al.,
//! "Automatic generation and detection of highly reliable fiducial markers under occlusion", 2014), read off the markers that
//! `OpenCV` 5.0.0 draws. Its dictionaries of 50, 100, 250 and 1000 markers of one size begin with the same ones, so the size says all.

/// Markers known of each dictionary: a board of 14 x 14 squares has 98.
pub const MARKERS: usize = 100;

/// A set of markers, by the cells of their sides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub enum Dictionary {
    /// `DICT_4X4_50` and larger ones.
    #[cfg_attr(feature = "serde", serde(rename = "4x4"))]
    Side4,
    /// `DICT_5X5_50` and larger ones.
    #[cfg_attr(feature = "serde", serde(rename = "5x5"))]
    Side5,
    /// `DICT_6X6_50` and larger ones.
    #[cfg_attr(feature = "serde", serde(rename = "6x6"))]
    Side6,
}

impl Dictionary {
    /// The dictionary of a name such as `4x4`, `5X5_100` or `DICT_6X6_250`.
    pub fn named(name: &str) -> Option<Self> {
        let name = name.strip_prefix("DICT_").unwrap_or(name);
        match name.split('_').next().unwrap_or(name) {
            "4x4" | "4X4" => Some(Self::Side4),
            "5x5" | "5X5" => Some(Self::Side5),
            "6x6" | "6X6" => Some(Self::Side6),
            _ => None,
        }
    }

    /// Cells of a side without the black frame.
    pub const fn side(self) -> usize {
        match self {
            Self::Side4 => 4,
            Self::Side5 => 5,
            Self::Side6 => 6,
        }
    }

    /// The cells of a marker; `None` of a number beyond [`MARKERS`].
    pub fn code(self, marker: usize) -> Option<u64> {
        match self {
            Self::Side4 => SIDE_4.get(marker).map(|code| u64::from(*code)),
            Self::Side5 => SIDE_5.get(marker).map(|code| u64::from(*code)),
            Self::Side6 => SIDE_6.get(marker).copied(),
        }
    }

    /// The marker that looks like `code` after so many quarter turns clockwise, and their number.
    ///
    /// No cell may be wrong: a board has many markers, and one misread would count for a wrong place of the whole board.
    pub fn find(self, code: u64) -> Option<(usize, u8)> {
        let mut upright = code;
        for turns in 0..4 {
            if let Some(marker) = (0..MARKERS).find(|marker| self.code(*marker) == Some(upright)) {
                return Some((marker, turns));
            }
            upright = turned_back(upright, self.side());
        }
        None
    }
}

/// A code's cells turned by a quarter counterclockwise.
fn turned_back(code: u64, side: usize) -> u64 {
    let mut turned = 0;
    for row in 0..side {
        for column in 0..side {
            // What is now here was in the row `column`, so far from its end.
            let from = column * side + (side - 1 - row);
            turned = turned << 1 | (code >> (side * side - 1 - from) & 1);
        }
    }
    turned
}

/// The marker in a square of a board `columns` squares wide (column and row from 0, upper left): `None` in the black ones. The
/// upper left square is black, markers are numbered row by row (`OpenCV` since 4.6.0; its older boards of an even number of
/// rows are numbered otherwise).
pub const fn marker_in(column: usize, row: usize, columns: usize) -> Option<usize> {
    if (column + row).is_multiple_of(2) {
        return None;
    }
    let above = (row / 2) * columns + if row % 2 == 1 { columns / 2 } else { 0 };
    Some(above + column / 2)
}

#[rustfmt::skip]
const SIDE_4: [u16; MARKERS] = [
    0xb532, 0x0f9a, 0x332d, 0x9946, 0x549e, 0x79cd, 0x9e2e, 0xc4f2, 0xfeda, 0xcf56, 0xf991, 0x11a7, 0x0eb7, 0x2a0f, 0x24b1, 0x263e,
    0x4665, 0x6600, 0x6c5e, 0x76af, 0x868b, 0xb02b, 0xccd5, 0xdd82, 0xfe47, 0x9471, 0xace4, 0xa554, 0x2123, 0x346f, 0x4415, 0x57b2,
    0x9ecf, 0xf0cb, 0x08ae, 0x0929, 0x1875, 0x04ff, 0x0df6, 0x1c5a, 0x1718, 0x2a28, 0x328c, 0x38b2, 0x24e8, 0x2eeb, 0x2d3f, 0x4b64,
    0x502e, 0x5013, 0x5194, 0x5568, 0x5d41, 0x5f97, 0x6801, 0x6867, 0x6124, 0x61e9, 0x6b12, 0x6fe5, 0x67df, 0x7e1b, 0x80a0, 0x8344,
    0x8ba2, 0x937a, 0x846c, 0x852a, 0x859c, 0x9c89, 0x9fa1, 0xbb7c, 0xbc04, 0xb65b, 0xbfc8, 0xb7ab, 0xca1f, 0xc962, 0xd958, 0xd3d5,
    0xcc98, 0xc7a0, 0xc537, 0xe95d, 0xf925, 0xfbbb, 0xee2a, 0xf74d, 0x3575, 0x8aad, 0x7617, 0x0acf, 0x064b, 0x2dc1, 0x49d8, 0x43f4,
    0x4f36, 0x4fd3, 0x69e4, 0x70c7,
];

#[rustfmt::skip]
const SIDE_5: [u32; MARKERS] = [
    0x145b2bc, 0x01c06e6, 0x1af0edd, 0x10395f7, 0x1aeb524, 0x1d4082d, 0x0d3d7ec, 0x0e2146b, 0x10d6132, 0x1313fa5, 0x13cee03, 0x1a2dac0,
    0x1e62b11, 0x05e7166, 0x1fcfca8, 0x051e37f, 0x097a758, 0x0bea26f, 0x0f64dc4, 0x1061de8, 0x12dda75, 0x150e440, 0x16b0ca1, 0x0ba12de,
    0x19cd023, 0x1a59972, 0x1c3ce8b, 0x0224246, 0x03b9672, 0x024223b, 0x027376e, 0x0368873, 0x040d0ce, 0x04aaac8, 0x04643ba, 0x07a6fea,
    0x0998aac, 0x082d101, 0x09aad1d, 0x0863c72, 0x0ad2825, 0x0a52f9e, 0x0d849f7, 0x0c309d9, 0x0da7e31, 0x0e9627a, 0x0e9b997, 0x0f94806,
    0x0f59125, 0x0f6b7d7, 0x11b58e4, 0x11ad279, 0x11e380b, 0x1169445, 0x12ffb4a, 0x158cb8d, 0x15987f0, 0x1422fdf, 0x14e1227, 0x156df22,
    0x173dbf1, 0x164c93c, 0x17cbb86, 0x1880a87, 0x19147dd, 0x184eb8a, 0x18d85ad, 0x1b2cda9, 0x1babd73, 0x1e9d432, 0x1e76528, 0x0f5740a,
    0x1b11a53, 0x018ce65, 0x02ab219, 0x098e981, 0x0a8061c, 0x141a158, 0x185314c, 0x196d12c, 0x1fad3a2, 0x00922b5, 0x019bce0, 0x00b547c,
    0x002c76f, 0x0132289, 0x012d2a7, 0x00c4b43, 0x0067bc5, 0x00faa0d, 0x01f1f54, 0x038e879, 0x0323b23, 0x02c3647, 0x02da51b, 0x02e9d8d,
    0x027c562, 0x03efdf5, 0x0521ee0, 0x0448efd,
];

#[rustfmt::skip]
const SIDE_6: [u64; MARKERS] = [
    0x1e3dd82a6, 0x0efba3891, 0x15907eacd, 0xc91b3069e, 0xd607d6e15, 0xd8e8e0e68, 0x4268b41f5, 0x88a50f29a, 0x307d524fd, 0x3c2f34b3c,
    0x45dfc74e3, 0x48d85b257, 0x710558fc6, 0x86dcfad07, 0x8d72a93f6, 0xa2b89dcde, 0x09fd1e9c4, 0x154dbd18f, 0x300a310e2, 0x4807efafd,
    0x56df11db6, 0x66883274c, 0x76e8cb781, 0x9a53d9cf3, 0xa9cb84024, 0xc67549490, 0xc1d288941, 0xe7480852b, 0xea2fca848, 0xe963b77b1,
    0xfa36652af, 0x065bff7bd, 0x0541d72d6, 0x0cf7246a2, 0x1338a39eb, 0x15a893e74, 0x3a417ee9e, 0x4f11e26c0, 0x530db6d20, 0x589bfae34,
    0x6409e8a0b, 0x60537a891, 0x6159069ba, 0x6bff78d7b, 0x70ad96a4f, 0x75846f71a, 0x7a95192fc, 0x8609760aa, 0x8a2d44c3f, 0x93eb78b14,
    0x988da84d4, 0x9ede2b3c8, 0xa529e07b8, 0xb593b855f, 0xb7f8e426f, 0xbc205225e, 0xc04487765, 0xc4c324259, 0xc5a91bd8d, 0xce73e6b2c,
    0xcd0ca6272, 0xc9435d44d, 0xcfbe80f34, 0xe57d15877, 0xefc6858e9, 0xf77ef3772, 0x2ce43f254, 0x2bdcff4b3, 0x37c7ddbda, 0xa1a254e0f,
    0xa982c1bb5, 0xd81b49b08, 0x035829f86, 0x07c4095fc, 0x0fe26617b, 0x144836441, 0x10ad5ffb7, 0x12829553f, 0x16e13184c, 0x187a496b0,
    0x1ae886112, 0x1913ae0a1, 0x1b67b5a17, 0x25dc95f0b, 0x288961f76, 0x3354146aa, 0x31c16c1f7, 0x33cb18c66, 0x3ecfe490f, 0x464518a3f,
    0x44ba70b67, 0x419c623e8, 0x48d1914a1, 0x54f499f6d, 0x575a9c813, 0x558355b2c, 0x57b77610f, 0x5c3436fe4, 0x5c48fc77e, 0x5e6eef402,
];

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Dictionary; 3] = [Dictionary::Side4, Dictionary::Side5, Dictionary::Side6];

    #[test]
    fn a_marker_is_known_whichever_way_it_is_turned_and_taken_for_no_other() {
        for dictionary in ALL {
            for marker in 0..MARKERS {
                let mut code = dictionary.code(marker).unwrap();
                // Three quarters back are one forth.
                for turns in [0, 3, 2, 1] {
                    assert_eq!(dictionary.find(code), Some((marker, turns)));
                    code = turned_back(code, dictionary.side());
                }
            }
        }
    }

    #[test]
    fn no_marker_with_a_wrong_cell_is_taken_for_one() {
        for dictionary in ALL {
            let cells = dictionary.side() * dictionary.side();
            let wrong = |cell: usize| dictionary.code(7).unwrap() ^ 1 << cell;
            assert!((0..cells).all(|cell| dictionary.find(wrong(cell)).is_none()));
        }
    }

    #[test]
    fn a_quarter_turn_moves_the_upper_left_cell_to_the_upper_right() {
        // Looked at after a quarter clockwise, turned back it is the first cell again.
        assert_eq!(turned_back(0b0001_0000_0000_0000, 4), 0b1000_0000_0000_0000);
    }

    #[test]
    fn markers_are_counted_through_the_white_squares_row_by_row() {
        for columns in [6, 7] {
            let squares = (0..5).flat_map(|row| (0..columns).map(move |column| (column, row)));
            let found: Vec<usize> = squares.filter_map(|(column, row)| marker_in(column, row, columns)).collect();
            assert_eq!(found, (0..5 * columns / 2).collect::<Vec<_>>());
        }
        assert_eq!([marker_in(0, 0, 9), marker_in(1, 0, 9), marker_in(0, 1, 9)], [None, Some(0), Some(4)]);
    }

    #[test]
    fn dictionaries_go_by_opencv_s_names_too() {
        assert_eq!(Dictionary::named("DICT_4X4_50"), Some(Dictionary::Side4));
        assert_eq!(Dictionary::named("5x5"), Some(Dictionary::Side5));
        assert_eq!(Dictionary::named("6X6_250"), Some(Dictionary::Side6));
        assert_eq!(Dictionary::named("7x7"), None);
    }
}
