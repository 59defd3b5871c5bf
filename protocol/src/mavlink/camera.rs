//! What the board says as a camera: ground stations find a component of that kind, ask what it is, and show its captures.

use mavlink::dialects::common::{
    CAMERA_CAPTURE_STATUS_DATA, CAMERA_IMAGE_CAPTURED_DATA, CAMERA_INFORMATION_DATA, CAMERA_SETTINGS_DATA,
    CAMERA_TRIGGER_DATA, CameraCapFlags, CameraMode, HEARTBEAT_DATA, MavAutopilot, MavBool, MavModeFlag, MavState,
    MavType, STORAGE_INFORMATION_DATA, StorageStatus,
};

use super::board::MAVLINK_VERSION;
use super::{OutFrame, Sender};

/// What the camera is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraReport {
    /// Columns and rows.
    pub size_px: [u16; 2],
    /// Focal length by the camera's own columns, in pixels; its pixels count as a micrometre and a half.
    pub focal_px: f32,
}

/// One capture, as ground stations want it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CaptureReport {
    /// Counts from 0.
    pub index: i32,
    /// Middle of the exposure since the board's start.
    pub time_ms: u32,
    /// Attitude of the camera in the autopilot's world, w first; zeros if unknown.
    pub rotation: [f32; 4],
    /// Is a photo known or believed to be there?
    pub taken: bool,
}

/// Pixel pitch of a HERO4: 4000 columns on 6.17 mm (1/2.3 inch).
const PIXEL_MM: f32 = 0.00154;

impl Sender {
    /// The camera lives.
    pub fn camera_heartbeat(&mut self, active: bool) -> OutFrame {
        self.frame(&HEARTBEAT_DATA {
            custom_mode: 0,
            mavtype: MavType::MAV_TYPE_CAMERA,
            autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
            base_mode: MavModeFlag::empty(),
            system_status: if active { MavState::MAV_STATE_ACTIVE } else { MavState::MAV_STATE_STANDBY },
            mavlink_version: MAVLINK_VERSION,
        })
    }

    /// What the camera is, `CAMERA_INFORMATION`.
    pub fn camera_information(&mut self, time_ms: u32, report: &CameraReport) -> OutFrame {
        let [columns, rows] = report.size_px;
        self.frame(&CAMERA_INFORMATION_DATA {
            time_boot_ms: time_ms,
            vendor_name: letters(b"Adit"),
            model_name: letters(b"Rotator"),
            firmware_version: 0,
            focal_length: report.focal_px * PIXEL_MM,
            sensor_size_h: f32::from(columns) * PIXEL_MM,
            sensor_size_v: f32::from(rows) * PIXEL_MM,
            resolution_h: columns,
            resolution_v: rows,
            lens_id: 0,
            flags: CameraCapFlags::CAMERA_CAP_FLAGS_CAPTURE_IMAGE,
            ..CAMERA_INFORMATION_DATA::DEFAULT
        })
    }

    /// It takes photos, not films, `CAMERA_SETTINGS`.
    pub fn camera_settings(&mut self, time_ms: u32) -> OutFrame {
        self.frame(&CAMERA_SETTINGS_DATA { time_boot_ms: time_ms, mode_id: CameraMode::CAMERA_MODE_IMAGE })
    }

    /// Where photos go is not known, `STORAGE_INFORMATION`: the camera has its own card.
    pub fn storage_information(&mut self, time_ms: u32) -> OutFrame {
        self.frame(&STORAGE_INFORMATION_DATA {
            time_boot_ms: time_ms,
            storage_id: 1,
            storage_count: 1,
            status: StorageStatus::STORAGE_STATUS_NOT_SUPPORTED,
            total_capacity: f32::NAN,
            used_capacity: f32::NAN,
            available_capacity: f32::NAN,
            read_speed: f32::NAN,
            write_speed: f32::NAN,
        })
    }

    /// What the camera does: photos every so often, or nothing (`CAMERA_CAPTURE_STATUS`).
    pub fn capture_status(&mut self, time_ms: u32, period_s: Option<f32>) -> OutFrame {
        self.frame(&CAMERA_CAPTURE_STATUS_DATA {
            time_boot_ms: time_ms,
            image_interval: period_s.unwrap_or(0.0),
            recording_time_ms: 0,
            available_capacity: 0.0,
            // 2: a series is set, between photos.
            image_status: if period_s.is_some() { 2 } else { 0 },
            video_status: 0,
        })
    }

    /// The shutter was commanded for this capture.
    pub fn camera_trigger(&mut self, time_us: u64, sequence: u32) -> OutFrame {
        self.frame(&CAMERA_TRIGGER_DATA { time_usec: time_us, seq: sequence })
    }

    /// A capture has come to its end, `CAMERA_IMAGE_CAPTURED`.
    pub fn image_captured(&mut self, report: &CaptureReport) -> OutFrame {
        self.frame(&CAMERA_IMAGE_CAPTURED_DATA {
            time_boot_ms: report.time_ms,
            image_index: report.index,
            q: report.rotation,
            capture_result: if report.taken { MavBool::MAV_BOOL_TRUE } else { MavBool::empty() },
            camera_id: 0,
            ..CAMERA_IMAGE_CAPTURED_DATA::DEFAULT
        })
    }
}

fn letters(word: &[u8]) -> [u8; 32] {
    let mut field = [0; 32];
    for (place, letter) in field.iter_mut().zip(word) {
        *place = *letter;
    }
    field
}
