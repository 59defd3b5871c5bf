//! What a page is sent: all figures each time, of section and strip only what it has not got yet.

use std::collections::BTreeMap;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

use crate::live::feed::Frame;
use crate::live::picture::Picture;
use crate::live::strip::{BLOCK_ROWS, Cell};
use crate::live::view::View;

/// What one page has got.
#[derive(Debug, Default)]
pub(super) struct Updates {
    outline_points: usize,
    revisions: BTreeMap<i64, u64>,
}

#[derive(Serialize)]
struct Update<'a> {
    view: &'a View,
    /// The section once around, closed, `[y, z]`; absent if it is as before.
    #[serde(skip_serializing_if = "Option::is_none")]
    outline_m: Option<&'a [[f64; 2]]>,
    strip: StripUpdate,
}

#[derive(Serialize)]
struct StripUpdate {
    cell_m: f64,
    /// Cells around.
    columns: usize,
    /// Rows of a stretch.
    rows: i64,
    /// Stretches that have changed: number and cells, a byte each, in base64.
    stretches: Vec<(i64, String)>,
}

impl Updates {
    /// The next message; `None` if a figure cannot be written, which none can but a map without text keys.
    pub(super) fn next(&mut self, frame: &Frame) -> Option<String> {
        let Frame { view, strip } = frame;
        let outline_m = (view.outline_m.len() != self.outline_points).then_some(&view.outline_m[..]);
        self.outline_points = view.outline_m.len();
        let update = Update {
            view,
            outline_m,
            strip: StripUpdate {
                cell_m: strip.cell_m,
                columns: strip.columns,
                rows: BLOCK_ROWS,
                stretches: self.changed(strip),
            },
        };
        serde_json::to_string(&update).ok()
    }

    fn changed(&mut self, strip: &Picture) -> Vec<(i64, String)> {
        let mut news = Vec::new();
        for (number, stretch) in &strip.stretches {
            if self.revisions.insert(*number, stretch.revision) != Some(stretch.revision) {
                news.push((*number, encoded(&stretch.cells)));
            }
        }
        news
    }
}

fn encoded(cells: &[Cell]) -> String {
    let bytes: Vec<u8> = cells
        .iter()
        .map(|cell| match cell {
            Cell::Ahead => 0,
            Cell::Gap => 1,
            Cell::Thin => 2,
            Cell::Begun => 3,
            Cell::Seen => 4,
        })
        .collect();
    STANDARD.encode(bytes)
}
