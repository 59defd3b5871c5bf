//! The ground's side. Before and during a flight: the plan, the link to the board. After it: photos and tags become camera
//! poses, a panorama, a textured model and a report.
//!
//! Stages after the flight, each with its own module, its own typed output on disk and its own part of the report:
//! ingest -> prior -> matching -> adjust -> surface -> texture -> model -> report.
#![forbid(unsafe_code)]

pub mod ablation;
pub mod adjust;
pub mod change;
pub mod comparison;
pub mod correspond;
pub mod evaluate;
pub mod export;
pub mod features;
mod files;
pub mod findings;
pub mod ingest;
pub mod link;
pub mod matching;
pub mod model;
pub mod pipeline;
pub mod plan;
pub mod poses;
pub mod prior;
pub mod raster;
pub mod report;
pub mod surface;
pub mod survey;
pub mod texture;
pub mod two_view;
pub mod untagged;
mod vectors;
pub mod view;

/// Returns the folder of sample surveys that lies beside the checkout, where there is one.
#[cfg(test)]
pub(crate) fn samples_folder() -> Option<std::path::PathBuf> {
    let start = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    start.ancestors().map(|folder| folder.join("shared/samples")).find(|folder| folder.is_dir())
}
