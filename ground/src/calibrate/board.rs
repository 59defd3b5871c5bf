//! The boards that are photographed, and the corners found on them.

use adit_geometry::charuco::{Dictionary, MARKERS};
use nalgebra::{Vector2, Vector3};
use serde::Serialize;

/// What tells a board's corners apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pattern {
    /// Nothing but their places in the whole.
    Chessboard,
    /// A marker in each white square.
    Charuco(Dictionary),
}

/// A chessboard by its inner corners.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Board {
    /// Inner corners in a row: one fewer than squares.
    pub columns: usize,
    /// Rows of inner corners.
    pub rows: usize,
    /// Edge of a square. Only distances to the board depend on it.
    pub square_m: f64,
    /// What tells its corners apart.
    pub pattern: Pattern,
}

/// Why a board cannot be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BoardError {
    /// Not in the form of a board.
    #[error(
        "expected inner corners as COLUMNSxROWS, such as 8x6, each from 3 to 100, or charuco:COLUMNSxROWS:DICTIONARY, such as \
         charuco:8x6:4x4 (4x4, 5x5, 6x6, or OpenCV's names)"
    )]
    Form,
    /// More white squares than markers.
    #[error("such a board has {markers} markers; numbers up to {} are known", MARKERS - 1)]
    Markers {
        /// White squares.
        markers: usize,
    },
}

impl Board {
    /// The board of a text such as `8x6` or `charuco:8x6:4x4`, its squares of this size.
    ///
    /// # Errors
    /// [`BoardError`] if the text is none, or the board is larger than its dictionary.
    pub fn parse(text: &str, square_m: f64) -> Result<Self, BoardError> {
        let (corners, pattern) = match text.strip_prefix("charuco:") {
            None => (text, Pattern::Chessboard),
            Some(rest) => {
                let (corners, name) = rest.split_once(':').ok_or(BoardError::Form)?;
                (corners, Pattern::Charuco(Dictionary::named(name).ok_or(BoardError::Form)?))
            }
        };
        let (columns, rows) = corners.split_once('x').ok_or(BoardError::Form)?;
        let count = |text: &str| text.parse().ok().filter(|count| (3..=100).contains(count)).ok_or(BoardError::Form);
        let board = Self { columns: count(columns)?, rows: count(rows)?, square_m, pattern };
        let markers = (board.columns + 1) * (board.rows + 1) / 2;
        if pattern != Pattern::Chessboard && markers > MARKERS {
            return Err(BoardError::Markers { markers });
        }
        Ok(board)
    }

    /// Inner corners.
    pub fn corners(&self) -> usize {
        self.columns * self.rows
    }

    /// Where a corner lies, metres: x along rows, y down columns, z = 0; corners are numbered row by row.
    pub fn place(&self, corner: usize) -> Vector3<f64> {
        Vector3::new((corner % self.columns) as f64, (corner / self.columns) as f64, 0.0) * self.square_m
    }
}

/// A corner found in a photo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Which of the board's: row by row.
    pub number: usize,
    /// Its pixel.
    pub pixel: Vector2<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boards_are_read_from_their_texts() {
        let board = Board::parse("8x6", 0.025);
        assert_eq!(board, Ok(Board { columns: 8, rows: 6, square_m: 0.025, pattern: Pattern::Chessboard }));
        let board = Board::parse("charuco:6x4:DICT_5X5_100", 0.03);
        assert_eq!(board.map(|board| board.pattern), Ok(Pattern::Charuco(Dictionary::Side5)));
        for text in ["8", "2x6", "8x101", "charuco:8x6", "charuco:8x6:7x7", "chequers:8x6:4x4"] {
            assert_eq!(Board::parse(text, 0.025), Err(BoardError::Form), "{text}");
        }
        assert_eq!(Board::parse("charuco:14x13:4x4", 0.025), Err(BoardError::Markers { markers: 105 }));
    }
}
