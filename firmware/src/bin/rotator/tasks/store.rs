//! What must survive a loss of power: parameters and the flight's state, in the FRAM.

use adit_firmware::drivers::fram::Fram;
use adit_firmware::health::Task;
use adit_firmware::store::{FlightState, FlightStore, Loaded, ParameterStore};
use adit_protocol::parameters::Parameters;
use embassy_time::{Duration, with_timeout};

use crate::blackboard::{CHECK_INS, LAST_CAPTURE, notify, now_us};
use crate::pins::FramSpi;

/// It reports at least this often.
const PERIOD: Duration = Duration::from_millis(100);

/// The memory and what is in it.
pub(crate) struct Store {
    fram: Fram<FramSpi>,
    flight: FlightState,
}

impl Store {
    pub(crate) fn new(fram: Fram<FramSpi>) -> Self {
        Self { fram, flight: FlightState::default() }
    }

    /// Reads both at the start, counts the start, and says what is amiss.
    pub(crate) fn load(&mut self) -> (Parameters, FlightState) {
        let parameters = match ParameterStore::load(&mut self.fram) {
            Loaded::Stored(parameters) => parameters,
            Loaded::Empty => {
                notify(format_args!("no parameters stored: defaults in use"));
                Parameters::default()
            }
            Loaded::Corrupt | Loaded::Newer { .. } => {
                notify(format_args!("parameters unreadable: defaults in use"));
                Parameters::default()
            }
            Loaded::Unreachable => {
                notify(format_args!("FRAM silent: default parameters in use"));
                Parameters::default()
            }
        };
        if let Loaded::Stored(flight) = FlightStore::load(&mut self.fram) {
            self.flight = flight;
        }
        self.flight.starts = self.flight.starts.wrapping_add(1);
        self.flight.log_number = self.flight.log_number % 9999 + 1;
        self.save();
        (parameters, self.flight)
    }

    fn save(&mut self) {
        if FlightStore::save(&mut self.fram, &self.flight).is_err() {
            defmt::error!("FRAM does not take the flight's state");
        }
    }
}

/// Keeps the number of the last capture.
#[embassy_executor::task]
pub(crate) async fn keep(mut store: Store) -> ! {
    loop {
        CHECK_INS.report(Task::Store, now_us());
        if let Ok(last_capture) = with_timeout(PERIOD, LAST_CAPTURE.wait()).await
            && last_capture != store.flight.last_capture
        {
            store.flight.last_capture = last_capture;
            store.save();
        }
    }
}
