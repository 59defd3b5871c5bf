//! The accessory against a scripted camera, written from what is known of the protocol.

use proptest::prelude::*;

use super::*;

/// A camera that recognises accessories by their EEPROM, sends heartbeats, and takes photos.
#[expect(clippy::struct_excessive_bools, reason = "independent facts about a camera, each set by a test")]
struct Camera {
    accessory: HeroBus,
    now_us: u64,
    lines: Lines,
    /// Does it read when interrupted?
    reads: bool,
    /// Does it reply with its status, as the Omni firmware does?
    says_status: bool,
    boot_id: u8,
    button_us: u64,
    on: bool,
    recognised: bool,
    interrupted_us: Option<u64>,
    heartbeat_sent_us: Option<u64>,
    dropped: bool,
    busy_until_us: u64,
    photos: u32,
    heard: std::vec::Vec<std::vec::Vec<u8>>,
}

/// How long a photo keeps the camera busy.
const PHOTO_US: u64 = 800_000;
const HEARTBEAT_US: u64 = 1_000_000;

impl Camera {
    fn new() -> Self {
        Self {
            accessory: HeroBus::new(),
            now_us: 5_000_000,
            lines: Lines::default(),
            reads: true,
            says_status: true,
            boot_id: 0x42,
            button_us: 0,
            on: false,
            recognised: false,
            interrupted_us: None,
            heartbeat_sent_us: None,
            dropped: false,
            busy_until_us: 0,
            photos: 0,
            heard: std::vec::Vec::new(),
        }
    }

    /// A camera that is on, with the accessory attached and all greetings exchanged.
    fn connected() -> Self {
        let mut camera = Self { on: true, ..Self::new() };
        camera.accessory.attach();
        camera.run(500);
        assert!(camera.accessory.is_connected());
        camera
    }

    fn run(&mut self, milliseconds: u32) {
        for _ in 0..milliseconds {
            self.now_us += 1000;
            self.lines = self.accessory.step(self.now_us);
            self.step();
        }
    }

    fn step(&mut self) {
        self.button_us = if self.lines.power_button_low { self.button_us + 1000 } else { 0 };
        if self.button_us >= 400_000 {
            self.on = true;
        }
        if !self.on || !self.lines.backpack_ready_low {
            return;
        }
        if !self.recognised {
            self.recognised = true;
            self.accessory.written(0x50, &[0]);
            let eeprom = self.accessory.read(self.now_us, 0x50);
            assert_eq!(eeprom[..4], [0x05, 0x05, 0x01, 0x0B]);
            self.write(&[b'Z', b'Z', 0, 0x04, 0x01, 0x00]);
            self.heartbeat_sent_us = None;
        }
        let interrupted_us = *self.interrupted_us.get_or_insert(self.now_us);
        if !self.lines.interrupt_low {
            self.interrupted_us = None;
        } else if self.reads && self.now_us - interrupted_us >= 2000 {
            let frame = self.accessory.read(self.now_us, 0x60).to_vec();
            self.hear(frame);
        }
        if self.now_us.is_multiple_of(HEARTBEAT_US) {
            self.dropped |= self.heartbeat_sent_us.is_some();
            self.heartbeat_sent_us = Some(self.now_us);
            self.write(&[b'Z', b'Z', 0, 0x04, 0x00, 0x02, 0x00]);
        }
    }

    fn write(&mut self, content: &[u8]) {
        let mut frame = vec![content.len() as u8];
        frame.extend(content);
        self.accessory.written(0x60, &frame);
    }

    fn hear(&mut self, frame: std::vec::Vec<u8>) {
        assert_eq!(usize::from(frame[0]), frame.len() - 1, "a length that lies: {frame:x?}");
        match &frame[1..] {
            [0, 0, 0, 0x00, 0, 0, 0x00, 0x02, 0x00] => self.heartbeat_sent_us = None,
            [b'Y', b'Y', 0, 0x06, boot_id, group, command, 0, 0] => {
                if (*group, *command, *boot_id) == (0x03, 0x17, self.boot_id) && self.now_us >= self.busy_until_us {
                    self.busy_until_us = self.now_us + PHOTO_US;
                    self.photos += 1;
                }
                self.reply(*group, *command);
            }
            _ => {}
        }
        self.heard.push(frame);
    }

    fn reply(&mut self, group: u8, command: u8) {
        let status = if self.now_us < self.busy_until_us { 0x10 } else { 0x30 };
        if self.says_status {
            self.write(&[0, 0, 0, 0x02, 0, status, self.boot_id, group, command, 0, 0]);
        } else {
            self.write(&[0, 0, 0, 0x02, self.boot_id, group, command, 0, 0]);
        }
    }

    fn shutters(&self) -> usize {
        self.heard.iter().filter(|frame| frame[6..8] == [0x03, 0x17]).count()
    }
}

#[test]
fn the_power_button_is_held_for_half_a_second() {
    let mut camera = Camera::new();
    camera.accessory.power_on(camera.now_us);
    camera.run(499);
    assert!(camera.lines.power_button_low && camera.on);
    camera.run(1);
    assert!(!camera.lines.power_button_low);
}

#[test]
fn the_eeprom_is_read_from_its_pointer_round_and_round() {
    let mut bus = HeroBus::new();
    assert_eq!(bus.read(0, 0x50)[..5], [0x05, 0x05, 0x01, 0x0B, 0xFF]);
    bus.written(0x50, &[3]);
    let eeprom = bus.read(0, 0x50);
    assert_eq!((eeprom[0], eeprom[1], eeprom[13], eeprom[15]), (0x0B, 0xFF, 0x05, 0x01));
    assert_eq!(bus.read(0, 0x50)[0], 0x05, "without a pointer it begins at zero");
    bus.written(0x50, &[0xFF]);
    assert_eq!(bus.read(0, 0x50)[..2], [0xFF, 0x05]);
}

#[test]
fn the_camera_meets_its_accessory() {
    let mut camera = Camera::new();
    camera.run(100);
    assert_eq!(camera.lines, Lines::default(), "nothing is pulled before it is attached");
    assert_eq!(camera.accessory.shutter(), Err(HeroBusError::NotConnected { losses: 0 }));
    camera.accessory.attach();
    camera.accessory.power_on(camera.now_us);
    camera.run(1000);
    let expected: [&[u8]; 3] = [
        &[0x0B, 0, 0, 0, 0, 0, 0, 1, 3, 1, 0, 0],
        &[0x09, b'Z', b'Z', 0, 4, 0, 0, 1, 1, 0],
        &[0x09, b'Y', b'Y', 0, 6, 0, 1, 0, 0, 0],
    ];
    assert_eq!(camera.heard[..3], expected);
    assert!(camera.accessory.is_connected());
    assert_eq!(camera.accessory.status(), Some(Status::Idle));
}

#[test]
fn a_frame_waits_three_milliseconds_before_the_interrupt_and_the_line_rests_once_it_is_read() {
    let mut camera = Camera::connected();
    camera.reads = false;
    camera.accessory.shutter().unwrap();
    camera.run(3);
    assert!(!camera.lines.interrupt_low);
    assert_eq!(camera.accessory.read(camera.now_us, 0x60)[..], [0], "not on offer yet, so it cannot fire twice");
    camera.run(1);
    assert!(camera.lines.interrupt_low);
    let frame = camera.accessory.read(camera.now_us, 0x60);
    assert_eq!(frame[..], [0x09, 0x59, 0x59, 0x00, 0x06, 0x42, 0x03, 0x17, 0x00, 0x00], "with the camera's boot id");
    assert_eq!(camera.accessory.read(camera.now_us, 0x60), frame, "read again, it is the same");
    assert!(!camera.accessory.step(camera.now_us).interrupt_low);
}

#[test]
fn a_photo_is_busy_and_then_stored() {
    let mut camera = Camera::connected();
    for photo in 1..=3 {
        camera.accessory.shutter().unwrap();
        camera.run(300);
        assert_eq!(camera.accessory.camera_status(), CameraStatus { busy: true, photos_stored: photo - 1 });
        assert_eq!(camera.accessory.status(), Some(Status::Busy));
        camera.run(700);
        assert_eq!(camera.accessory.camera_status(), CameraStatus { busy: false, photos_stored: photo });
        assert_eq!((camera.photos, camera.shutters()), (photo, photo as usize));
    }
}

#[test]
fn without_a_shutter_nothing_counts_as_stored() {
    let mut camera = Camera::connected();
    camera.write(&[0, 0, 0, 0x02, 0, 0x10, 0x42, 0x01, 0x00]);
    assert!(camera.accessory.camera_status().busy);
    camera.write(&[0, 0, 0, 0x02, 0, 0x30, 0x42, 0x01, 0x00]);
    assert_eq!(camera.accessory.camera_status(), CameraStatus { busy: false, photos_stored: 0 });
}

#[test]
fn a_camera_that_does_not_say_its_status_takes_photos_that_are_never_counted() {
    let mut camera = Camera { on: true, says_status: false, ..Camera::new() };
    camera.accessory.attach();
    camera.run(500);
    camera.accessory.shutter().unwrap();
    camera.run(2000);
    assert_eq!(camera.photos, 1, "the boot id is found all the same");
    assert_eq!(camera.accessory.status(), None);
    assert_eq!(camera.accessory.camera_status(), CameraStatus::default());
}

#[test]
fn heartbeats_are_answered_for_as_long_as_they_come() {
    let mut camera = Camera::connected();
    for _ in 0..30 {
        camera.accessory.shutter().unwrap();
        camera.run(2000);
    }
    assert!(!camera.dropped);
    assert!(camera.heartbeat_sent_us.is_none_or(|sent_us| camera.now_us - sent_us < 20_000));
    assert_eq!(camera.accessory.camera_status().photos_stored, 30);
}

#[test]
fn every_system_command_of_the_camera_has_its_answer() {
    let rows: [(&[u8], &[u8]); 4] = [
        (&[0x02, 0x01], &[0x08, 0, 0, 0, 0, 0, 0, 2, 0]),
        (&[0x00, 0x02, 0x00], &[0x09, 0, 0, 0, 0, 0, 0, 0, 2, 0]),
        (&[0x00, 0x01, 0x01, 0x00], &[0x0A, 0, 0, 0, 0, 0, 0, 0, 1, 1, 0]),
        (&[0x00, 0x01, 0x01, 0x01], &[0x0A, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1]),
    ];
    for (command, answer) in rows {
        let mut camera = Camera::connected();
        camera.heard.clear();
        let mut content = vec![b'Z', b'Z', 0, 0x04];
        content.extend(command);
        camera.write(&content);
        camera.run(20);
        assert_eq!(camera.heard, [answer]);
    }
}

#[test]
fn a_camera_that_stops_reading_is_lost_and_an_old_shutter_never_fires() {
    let mut camera = Camera::connected();
    camera.reads = false;
    camera.accessory.shutter().unwrap();
    camera.run(1100);
    assert!(!camera.accessory.is_connected());
    assert_eq!(camera.accessory.status(), None);
    assert!(!camera.accessory.step(camera.now_us).interrupt_low);
    assert_eq!(camera.accessory.shutter(), Err(HeroBusError::NotConnected { losses: 1 }));
    // It comes back by its heartbeat.
    camera.reads = true;
    camera.run(3000);
    assert_eq!(camera.shutters(), 0);
    camera.accessory.shutter().unwrap();
    camera.run(1500);
    assert_eq!((camera.shutters(), camera.accessory.camera_status().photos_stored), (1, 1));
}

#[test]
fn too_many_shutters_are_refused_with_their_number() {
    let mut camera = Camera::connected();
    camera.reads = false;
    let refused = (0..20).find_map(|_| camera.accessory.shutter().err());
    assert_eq!(refused, Some(HeroBusError::QueueFull { waiting: 8 }));
}

#[test]
fn torn_frames_say_nothing() {
    let mut camera = Camera::connected();
    let busy = [0x09, 0, 0, 0, 0x02, 0, 0x10, 0x42, 0x01, 0x00];
    for kept in 0..busy.len() {
        camera.accessory.written(0x60, &busy[..kept]);
        assert_eq!(camera.accessory.status(), Some(Status::Idle), "{kept} bytes");
    }
    camera.accessory.written(0x60, &busy);
    assert_eq!(camera.accessory.status(), Some(Status::Busy));
}

#[derive(Clone, Debug)]
enum Deed {
    Write(u8, std::vec::Vec<u8>),
    Read(u8),
    Step(u64),
    Shutter,
}

fn any_deed() -> impl Strategy<Value = Deed> {
    let address = || prop_oneof![Just(0x50_u8), Just(0x60_u8), any::<u8>()];
    let byte = prop_oneof![any::<u8>(), 0_u8..12];
    prop_oneof![
        (address(), prop::collection::vec(byte, 0..24)).prop_map(|(address, bytes)| Deed::Write(address, bytes)),
        address().prop_map(Deed::Read),
        prop_oneof![0_u64..5_000, any::<u64>()].prop_map(Deed::Step),
        Just(Deed::Shutter),
    ]
}

proptest! {
    #[test]
    fn there_are_never_more_photos_than_shutters(deeds in prop::collection::vec(any_deed(), 0..60)) {
        let mut bus = HeroBus::new();
        bus.attach();
        let mut now_us = 0_u64;
        let mut shutters = 0;
        for deed in deeds {
            match deed {
                Deed::Write(address, bytes) => bus.written(address, &bytes),
                Deed::Read(address) => prop_assert!(!bus.read(now_us, address).is_empty(), "a slave answers something"),
                Deed::Step(later_us) => {
                    now_us = now_us.saturating_add(later_us);
                    bus.step(now_us);
                }
                Deed::Shutter => shutters += u32::from(bus.shutter().is_ok()),
            }
            prop_assert!(bus.camera_status().photos_stored <= shutters);
        }
    }
}
