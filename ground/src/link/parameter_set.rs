//! The board's parameters as one thing, out of the figures that the link tells, and a fingerprint of them.
//!
//! On the link angles are in degrees: what went there and back may differ in a last digit from what a mission file says. So a
//! fingerprint is that of the parameters as the link tells them.

use adit_protocol::log::{EncodeError, parameters_hash};
use adit_protocol::mavlink::Value;
use adit_protocol::parameters::{ParameterTable, Parameters, SetError};

use super::parameter_fetch::Parameter;

/// A parameter may be possible only once others are set.
const PASSES: usize = 3;

/// Why figures make no parameters.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{name}")]
pub struct GatherError {
    /// The figure that is not possible.
    pub name: String,
    /// Why.
    pub source: SetError,
}

/// Parameters as named figures, in the board's order.
pub fn figures(parameters: &Parameters) -> Vec<(&'static str, Value)> {
    let mut table = ParameterTable::new(parameters.clone());
    let rows = ParameterTable::rows().iter().enumerate();
    rows.filter_map(|(index, row)| Some((row.name, table.get(index)?))).collect()
}

/// The parameters that figures make. Those that this program does not know are left out.
///
/// # Errors
/// [`GatherError`]; a section that is a chain of vertices has no figures.
pub fn gathered(figures: &[Parameter]) -> Result<Parameters, GatherError> {
    let mut table = ParameterTable::new(Parameters::default());
    let mut open: Vec<(usize, &Parameter)> =
        figures.iter().filter_map(|figure| Some((ParameterTable::find(&figure.name)?, figure))).collect();
    let mut failed = None;
    for _ in 0..PASSES {
        failed = None;
        open.retain(|(index, figure)| match table.set(*index, figure.value) {
            Ok(()) => false,
            Err(source) => {
                failed.get_or_insert(GatherError { name: figure.name.clone(), source });
                true
            }
        });
    }
    failed.map_or_else(|| Ok(table.parameters().clone()), Err)
}

/// The hash of parameters as the link tells them.
///
/// # Errors
/// [`EncodeError`] if they are longer than a board takes.
pub fn fingerprint(parameters: &Parameters) -> Result<u64, EncodeError> {
    let mut table = ParameterTable::new(parameters.clone());
    for (index, _) in ParameterTable::rows().iter().enumerate() {
        if let Some(value) = table.get(index) {
            // What is not possible as it is stays as it is.
            let _ = table.set(index, value);
        }
    }
    parameters_hash(table.parameters())
}

#[cfg(test)]
mod tests {
    use adit_geometry::camera::Distortion;
    use adit_geometry::profile::ProfileSpec;

    use super::*;

    fn told(parameters: &Parameters) -> Vec<Parameter> {
        let figure = |(index, (name, value)): (u16, (&str, Value))| Parameter { name: name.to_owned(), value, index };
        (0..).zip(figures(parameters)).map(figure).collect()
    }

    fn kinds() -> Vec<Parameters> {
        let mut angles = Parameters::default();
        // An angle that degrees in single precision do not give back.
        angles.rig.mount_rotvec_rad = [0.012_345_679, -0.3, 1.1e-5];
        angles.link.axis_yaw_rad = Some(2.3);
        let mut fisheye = Parameters::default();
        fisheye.camera.distortion = Distortion::KannalaBrandt([0.01, -0.02, 0.003, 0.0]);
        let section = |profile| Parameters { profile, ..Parameters::default() };
        vec![
            angles,
            fisheye,
            section(ProfileSpec::Rectangle { width_m: 1.0, height_m: 9.0, axis_height_m: 8.0 }),
            section(ProfileSpec::Underpass { width_m: 4.0, wall_m: 2.4, rise_m: 0.8, axis_height_m: 1.4 }),
        ]
    }

    #[test]
    fn figures_make_the_parameters_that_they_came_from() {
        for parameters in kinds() {
            let back = gathered(&told(&parameters)).unwrap();
            assert_eq!(fingerprint(&back).unwrap(), fingerprint(&parameters).unwrap(), "{parameters:?}");
        }
    }

    #[test]
    fn every_figure_is_in_the_fingerprint() {
        let parameters = Parameters::default();
        let expected = fingerprint(&parameters).unwrap();
        for (index, row) in ParameterTable::rows().iter().enumerate() {
            let mut table = ParameterTable::new(parameters.clone());
            let value = table.get(index).unwrap();
            let other = if value.real() == row.least { row.most } else { row.least };
            // A size that the circle does not have, or a coefficient that the lens does not have, waits for one that does.
            if table.set(index, Value::Real(other)).is_ok() && *table.parameters() != parameters {
                assert_ne!(fingerprint(table.parameters()).unwrap(), expected, "{}", row.name);
            }
        }
    }

    #[test]
    fn a_chain_is_told_by_no_figures() {
        let mut list = told(&Parameters::default());
        let shape = list.iter_mut().find(|figure| figure.name == "TUN_SHAPE").unwrap();
        shape.value = Value::Whole(4);
        assert_eq!(gathered(&list).unwrap_err().name, "TUN_SHAPE");
    }
}
