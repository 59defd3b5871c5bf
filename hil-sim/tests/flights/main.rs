//! Whole flights: rules that must hold, figures on record, bytes on the card.

mod autopilots;
mod bytes;
mod common;
mod scenarios;
mod swarm;
