//! What must survive a loss of power: parameters and the flight's state, in the FRAM.

use adit_firmware::drivers::fram::Fram;
use adit_firmware::health::Task;
use adit_firmware::link;
use adit_firmware::store::{FlightState, FlightStore, LinkStore, ParameterStore, Stored};
use adit_protocol::parameters::Parameters;
use embassy_time::{Duration, with_timeout};

use crate::blackboard::{CHECK_INS, KEEP, KEPT, Keep, notify, now_us};
use crate::crash;
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
        let trouble = match ParameterStore::load(&mut self.fram) {
            Ok(Stored::Loaded { value, .. }) => return (value.parameters, self.load_flight()),
            Ok(Stored::Empty) => "none stored",
            Ok(Stored::Corrupt) => "both copies damaged",
            Ok(Stored::OtherVersion { .. }) => "of another version",
            Err(_) => "FRAM silent",
        };
        notify(format_args!("default parameters: {trouble}"));
        (Parameters::default(), self.load_flight())
    }

    /// What the link must know from before the start.
    pub(crate) fn load_link(&mut self) -> link::Memory {
        // A FRAM that is silent has been told of already.
        LinkStore::load(&mut self.fram).unwrap_or_default()
    }

    fn load_flight(&mut self) -> FlightState {
        let stored = FlightStore::load(&mut self.fram).ok().and_then(Stored::value);
        self.flight = stored.unwrap_or_default();
        self.flight.starts = self.flight.starts.wrapping_add(1);
        self.save();
        self.flight
    }

    /// Stores new parameters and starts anew with them.
    fn adopt(&mut self, parameters: &Parameters) {
        if ParameterStore::save(&mut self.fram, parameters).is_err() {
            notify(format_args!("FRAM does not take the card's parameters"));
            return;
        }
        crash::make_safe();
        crash::leave_note(format_args!("new parameters from the card"));
        cortex_m::peripheral::SCB::sys_reset()
    }

    fn save(&mut self) {
        if FlightStore::save(&mut self.fram, &self.flight).is_err() {
            defmt::error!("FRAM does not take the flight's state");
        }
    }
}

/// Keeps the numbers of the last capture and of the log file.
#[embassy_executor::task]
pub(crate) async fn keep(mut store: Store) -> ! {
    loop {
        CHECK_INS.report(Task::Store, now_us());
        let Ok(keep) = with_timeout(PERIOD, KEEP.receive()).await else { continue };
        match keep {
            Keep::Capture(number) => store.flight.last_capture = number,
            Keep::LogFile(number) => store.flight.log_number = number,
            Keep::Parameters(parameters) => {
                store.adopt(&parameters);
                continue;
            }
            Keep::Link(keep) => {
                // The link waits for this one.
                let _ = KEPT.try_send(LinkStore::save(&mut store.fram, &keep).is_ok());
                continue;
            }
        }
        store.save();
    }
}
