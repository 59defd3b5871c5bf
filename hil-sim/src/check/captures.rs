//! Photos against tags.

use adit_protocol::tag::{CaptureState, CaptureTag};

use super::report::Violation;
use crate::flight::{Flight, Outcome};
use crate::world::Exposure;

/// A tag belongs to a photo if their times differ by no more than this.
const TAG_TIME_TOLERANCE_S: f64 = 0.25;
/// The last photos before a power loss may be without a tag within this time.
const POWER_LOSS_GRACE_S: f64 = 1.0;

/// Finds the photos' tags and returns both.
pub(super) fn check_captures<'t, 'f>(
    flight: &'f Flight,
    tags: &[&'t CaptureTag],
    found: &mut Vec<Violation>,
) -> Vec<(&'t CaptureTag, &'f Exposure)> {
    let mut pairs = Vec::new();
    for (tag, expected) in tags.iter().zip(1..) {
        if tag.capture != expected {
            found.push(Violation::CaptureNumber { found: tag.capture, expected });
            break;
        }
    }
    let mut claimed = vec![false; tags.len()];
    let power_lost = flight.outcome == Outcome::PowerLost;
    for (photo, exposure) in flight.exposures.iter().enumerate().filter(|(_, exposure)| !exposure.surplus) {
        let nearest = tags
            .iter()
            .enumerate()
            .filter(|(index, _)| !claimed[*index])
            .map(|(index, tag)| (index, (seconds(tag) - exposure.time_s).abs()))
            .min_by(|a, b| a.1.total_cmp(&b.1));
        match nearest {
            Some((index, apart_s)) if apart_s <= TAG_TIME_TOLERANCE_S => {
                claimed[index] = true;
                pairs.push((tags[index], exposure));
            }
            _ if power_lost && exposure.time_s > flight.duration_s() - POWER_LOSS_GRACE_S => {}
            _ => found.push(Violation::PhotoWithoutTag { photo, time_s: exposure.time_s }),
        }
    }
    for (tag, claimed) in tags.iter().zip(&claimed) {
        if tag.state == CaptureState::Confirmed && !claimed {
            found.push(Violation::ConfirmedWithoutPhoto { capture: tag.capture });
        }
    }
    pairs
}

pub(super) fn seconds(tag: &CaptureTag) -> f64 {
    tag.time_us as f64 * 1e-6
}
