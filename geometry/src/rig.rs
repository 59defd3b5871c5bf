//! The rotating camera rig: from shaft angle to camera pose.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::Real;

/// Which way the top of the photo points while the camera looks at the wall.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum ImageUp {
    /// Along the tunnel, in the direction of travel.
    Forward,
    /// Along the tunnel, backwards.
    Backward,
    /// Around the section, clockwise looking forward.
    Clockwise,
    /// Around the section, counter-clockwise looking forward.
    Counterclockwise,
}

/// How the camera sits on the shaft.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Rig<T: Real> {
    /// Photos per full turn of the shaft.
    pub images_per_turn: u16,
    /// Which way is up in the photo.
    pub image_up: ImageUp,
    /// Optical centre ahead of the shaft axis, along the viewing direction.
    pub lever_radial_m: T,
    /// Optical centre ahead of the body origin, along the shaft.
    pub lever_forward_m: T,
    /// Small rotation of the camera against its nominal mounting, as a rotation vector in camera axes (radians).
    pub mount_rotvec_rad: [T; 3],
}

impl<T: Real> Rig<T> {
    /// Returns the camera's pose in the body frame at section angle `shaft_rad` (0 up, clockwise looking forward).
    ///
    /// The nominal camera looks radially outwards; `body_from_cam = nominal(shaft) * exp(mount_rotvec)`. The lever
    /// arm follows the nominal viewing direction.
    pub fn body_from_cam(&self, shaft_rad: T) -> Isometry3<T> {
        let outward = outward(shaft_rad);
        let nominal = nominal_rotation(self.image_up, shaft_rad);
        let mount = UnitQuaternion::from_scaled_axis(Vector3::from(self.mount_rotvec_rad));
        let centre = outward * self.lever_radial_m + Vector3::x() * self.lever_forward_m;
        Isometry3::from_parts(Translation3::from(centre), nominal * mount)
    }

    /// The same rig in another scalar.
    pub fn cast<U: Real>(&self) -> Rig<U> {
        let to = |value: T| U::of(value.to_f64());
        Rig {
            images_per_turn: self.images_per_turn,
            image_up: self.image_up,
            lever_radial_m: to(self.lever_radial_m),
            lever_forward_m: to(self.lever_forward_m),
            mount_rotvec_rad: self.mount_rotvec_rad.map(to),
        }
    }
}

/// Unit vector in the body frame that points to the wall at section angle `phi_rad`.
pub fn outward<T: Real>(phi_rad: T) -> Vector3<T> {
    let (sin, cos) = phi_rad.sin_cos();
    Vector3::new(T::zero(), sin, -cos)
}

/// Unit vector in the body frame along the section, clockwise looking forward, at section angle `phi_rad`.
pub fn clockwise<T: Real>(phi_rad: T) -> Vector3<T> {
    let (sin, cos) = phi_rad.sin_cos();
    Vector3::new(T::zero(), cos, sin)
}

/// Rotation `body_from_cam` of a perfectly mounted camera at section angle `shaft_rad`.
pub fn nominal_rotation<T: Real>(image_up: ImageUp, shaft_rad: T) -> UnitQuaternion<T> {
    let z = outward(shaft_rad);
    let up = match image_up {
        ImageUp::Forward => Vector3::x(),
        ImageUp::Backward => -Vector3::x(),
        ImageUp::Clockwise => clockwise(shaft_rad),
        ImageUp::Counterclockwise => -clockwise(shaft_rad),
    };
    let y = -up;
    let x = y.cross(&z);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, z])))
}

/// Rotation `tunnel_from_body` from roll, pitch and yaw (radians; aerospace order yaw, then pitch, then roll).
pub fn attitude<T: Real>(roll_rad: T, pitch_rad: T, yaw_rad: T) -> UnitQuaternion<T> {
    UnitQuaternion::from_euler_angles(roll_rad, pitch_rad, yaw_rad)
}
