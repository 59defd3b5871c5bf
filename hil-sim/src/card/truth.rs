//! Tables of what truly happened.

use std::fmt::Write as _;

use crate::flight::Flight;

/// Rows of `flight.csv` are this far apart.
const ROW_S: f64 = 0.05;

/// `photos.csv`: which photo was taken when, answering which press of the shutter.
pub(super) fn photos_csv(flight: &Flight, names: &[String]) -> String {
    let mut text = String::from("photo,time_s,press,surplus,shaft_deg,speed_mps,turning_deg_per_s\n");
    for (name, exposure) in names.iter().zip(&flight.exposures) {
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{name},{:.6},{},{},{:.4},{:.4},{:.3}",
            exposure.time_s,
            exposure.press,
            u8::from(exposure.surplus),
            exposure.shaft_rad.to_degrees(),
            exposure.velocity_mps.norm(),
            exposure.angular_velocity_rad_per_s.norm().to_degrees(),
        );
    }
    text
}

/// `flight.csv`: the true trajectory, and what the board made of it.
pub(super) fn flight_csv(flight: &Flight) -> String {
    let mut text = String::from(
        "time_s,x_m,y_m,z_m,roll_deg,pitch_deg,yaw_deg,speed_mps,shaft_deg,mode,limit_mps,estimate_y_m,estimate_z_m\n",
    );
    let mut next_s = 0.0;
    for moment in &flight.moments {
        if moment.time_s < next_s {
            continue;
        }
        next_s = moment.time_s + ROW_S - 1e-9;
        let [x, y, z] = moment.vehicle.position_m.into();
        let [roll, pitch, yaw] = moment.vehicle.attitude_rad.map(f64::to_degrees);
        let cell = |value: Option<f32>| value.map_or_else(String::new, |value| format!("{value:.4}"));
        let _ = writeln!(
            text,
            "{:.3},{x:.4},{y:.4},{z:.4},{roll:.3},{pitch:.3},{yaw:.3},{:.4},{:.3},{:?},{},{},{}",
            moment.time_s,
            moment.vehicle.velocity_mps.x,
            moment.shaft_rad.to_degrees(),
            moment.mode,
            cell(moment.limit_mps),
            cell(moment.estimate_m.map(|estimate| estimate[0])),
            cell(moment.estimate_m.map(|estimate| estimate[1])),
        );
    }
    text
}
