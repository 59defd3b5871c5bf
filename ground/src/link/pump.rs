//! The task behind a session: frames in and out, the heartbeat, signatures, the record.

use std::sync::Arc;
use std::time::{Duration, SystemTime};

use adit_protocol::mavlink::{FrameDecoder, Incoming, Key, OutFrame, RawFrame, Sender, Signer};
use tokio::sync::{broadcast, mpsc, watch};
use tokio::time::{Instant, MissedTickBehavior, interval_at, sleep};
use tracing::{info, warn};

use super::error::LinkError;
use super::key::KeyFile;
use super::record::Recorder;
use super::session::{Heard, LinkState, Peer, Summary};
use super::transport::{Line, LineEvent};
use super::trust::{Trust, Verifier};

/// Time between two heartbeats: peers that hear none for some seconds take us for gone.
const HEARTBEAT: Duration = Duration::from_secs(1);
/// Heartbeats between two keepings of what must outlive the session; well within the lease of the key's file.
const KEEP_BEATS: u32 = 5;
/// A frame that has begun and does not go on for this long will not end.
const SILENCE: Duration = Duration::from_millis(250);

/// Makes a frame.
pub(super) type Build = Box<dyn FnOnce(&mut Sender) -> OutFrame + Send>;

/// The task's state.
pub(super) struct Pump {
    line: Line,
    decoder: FrameDecoder,
    sender: Sender,
    key: Option<KeyFile>,
    verifier: Verifier,
    recorder: Option<Recorder>,
    failed: Option<LinkError>,
    heard: broadcast::Sender<Arc<Heard>>,
    state: watch::Sender<LinkState>,
    beats: u32,
}

/// Where a session's task tells what it hears.
pub(super) struct Outlets {
    pub(super) heard: broadcast::Sender<Arc<Heard>>,
    pub(super) state: watch::Sender<LinkState>,
}

impl Pump {
    pub(super) fn new(
        line: Line,
        sender: Sender,
        key: Option<KeyFile>,
        recorder: Option<Recorder>,
        outlets: Outlets,
    ) -> Self {
        let mut sender = sender;
        sender.signer = key.as_ref().map(|file| Signer { key: file.key, link: 0, time: file.time(SystemTime::now()) });
        let verifier = key.as_ref().map(|file| file.heard().clone()).unwrap_or_default();
        let Outlets { heard, state } = outlets;
        let decoder = FrameDecoder::default();
        Self { line, decoder, sender, key, verifier, recorder, failed: None, heard, state, beats: 0 }
    }

    /// Goes on until nobody sends requests any more.
    pub(super) async fn run(mut self, mut requests: mpsc::Receiver<Build>) -> Result<Summary, LinkError> {
        // The first goes out when the line is up.
        let mut heartbeat = interval_at(Instant::now() + HEARTBEAT, HEARTBEAT);
        heartbeat.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                event = self.line.next() => match event {
                    Some(event) => self.take(event),
                    None => break,
                },
                request = requests.recv() => match request {
                    Some(build) => self.send(build),
                    None => break,
                },
                _ = heartbeat.tick() => self.beat(),
                () = sleep(SILENCE), if self.decoder.pending_bytes() > 0 => self.resynchronise(),
            }
        }
        self.finish().await
    }

    fn take(&mut self, event: LineEvent) {
        match event {
            LineEvent::Bytes(bytes) => {
                for byte in bytes {
                    if let Some(frame) = self.decoder.push(byte) {
                        self.hear(frame);
                    }
                }
            }
            LineEvent::Up { peer } => {
                info!("the line to {peer} is up");
                self.state.send_modify(|state| state.line = Ok(peer));
                // Peers that wait to be spoken to must not wait for the next second.
                self.send(Box::new(Sender::ground_heartbeat));
            }
            LineEvent::Down { why } => {
                warn!("the line is down: {why}");
                self.decoder = FrameDecoder::default();
                self.state.send_modify(|state| state.line = Err(why));
            }
        }
    }

    fn resynchronise(&mut self) {
        while let Some(frame) = self.decoder.resynchronise() {
            self.hear(frame);
        }
    }

    fn hear(&mut self, frame: RawFrame) {
        let at = SystemTime::now();
        self.record(at, frame.wire());
        let trust = self.verifier.judge(self.signing_key().as_ref(), &frame);
        let incoming = Incoming::read(&frame);
        if let Some(Incoming::Text { text, .. }) = &incoming {
            info!("{}/{} says: {text}", frame.system, frame.component);
        }
        let counters = self.decoder.counters();
        self.state.send_if_modified(|state| {
            state.counters = counters;
            match &incoming {
                Some(Incoming::Heartbeat { kind, autopilot, custom_mode, .. }) => {
                    let (system, component) = (frame.system, frame.component);
                    let (kind, autopilot, mode) = (*kind, *autopilot, *custom_mode);
                    state.note(Peer { system, component, kind, autopilot, mode, trust });
                    true
                }
                _ => false,
            }
        });
        // Nobody may be listening.
        let _ = self.heard.send(Arc::new(Heard { at, frame, incoming, trust }));
    }

    fn signing_key(&self) -> Option<Key> {
        self.key.as_ref().map(|file| file.key)
    }

    fn send(&mut self, build: Build) {
        let at = SystemTime::now();
        if let (Some(signer), Some(file)) = (&mut self.sender.signer, &self.key) {
            signer.set_time(file.time(at));
        }
        let frame = build(&mut self.sender);
        self.record(at, &frame);
        self.line.send(frame.to_vec());
    }

    /// Records a frame. A record that cannot go on is told, and ends the record, not the session: the view of a flight is
    /// worth more than its recording.
    fn record(&mut self, at: SystemTime, frame: &[u8]) {
        let Some(recorder) = &mut self.recorder else { return };
        if let Err(error) = recorder.add(at, frame) {
            warn!("{error}; nothing more is recorded");
            self.failed = Some(error);
            self.recorder = None;
            self.state.send_modify(|state| state.record_failed = true);
        }
    }

    fn beat(&mut self) {
        self.send(Box::new(Sender::ground_heartbeat));
        // Without a single frame nobody else tells.
        let counters = self.decoder.counters();
        self.state.send_if_modified(|state| std::mem::replace(&mut state.counters, counters) != counters);
        self.beats = self.beats.wrapping_add(1);
        if self.beats.is_multiple_of(KEEP_BEATS)
            && let Err(error) = self.keep(true)
        {
            // It worked when the session was opened, and is tried again when it ends.
            warn!("{error}");
        }
    }

    fn keep(&self, goes_on: bool) -> Result<(), LinkError> {
        if let (Some(signer), Some(file)) = (&self.sender.signer, &self.key) {
            file.keep(signer.time, &self.verifier, goes_on)?;
        }
        Ok(())
    }

    async fn finish(self) -> Result<Summary, LinkError> {
        let kept = self.keep(false);
        let recorded = self.recorder.as_ref().map_or(0, Recorder::frames);
        let counters = self.decoder.counters();
        self.line.close().await;
        kept?;
        self.failed.map_or(Ok(Summary { recorded, counters }), Err)
    }
}

impl LinkState {
    fn note(&mut self, peer: Peer) {
        let same = |other: &&mut Peer| (other.system, other.component) == (peer.system, peer.component);
        match self.peers.iter_mut().find(same) {
            // A stranger who speaks for somebody else does not take his place.
            Some(known) if known.trust == Trust::Verified && !peer.trust.is_believed() => {}
            Some(known) => *known = peer,
            None => self.peers.push(peer),
        }
    }
}
