//! The controller: the board's logic behind one function.

use adit_protocol::parameters::Parameters;

use crate::io::{Inputs, Outputs};

/// The rotator board's logic.
#[derive(Clone, Debug)]
pub struct Controller {
    parameters: Parameters,
}

impl Controller {
    /// A controller in mode Boot.
    pub fn new(parameters: Parameters) -> Self {
        Self { parameters }
    }

    /// The parameters in force.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// Takes the inputs of this moment and returns what shall be done. `now_us` since the board's start.
    pub fn step(&mut self, now_us: u64, inputs: &Inputs) -> Outputs {
        let _ = (now_us, inputs);
        Outputs::default()
    }
}
