//! What goes wrong with the board itself, when, for how long. What goes wrong around it is the simulated world's.

/// A kind of fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum BoardFaultKind {
    /// A chip holds SDA or SCL of I2C1 low: every transfer waits for a bus that is never free.
    BusHeld,
    /// The card is pulled out of its slot, and put back at the end.
    CardPulled,
    /// Blocks read from the card fail their check.
    CardReadErrors,
    /// The card takes no blocks.
    CardWriteErrors,
    /// Every free cluster of the card is gone; lasts for good.
    CardFull,
    /// One FRAM byte in eight changes; lasts for good.
    FramCorrupt,
    /// The telemetry line carries random bytes at its full rate, and nothing else.
    TelemetryGarbage,
    /// A hostile peer fills the telemetry line beside what the vehicle says.
    TelemetryFlood,
    /// USART2 never finishes sending: whoever waits for it waits for ever.
    TelemetryStuck,
    /// The core stands still until the watchdog restarts it.
    CoreHang,
    /// The core's next access to a peripheral fails, which is a hard fault.
    CoreCrash,
    /// Somebody turns the safety switch on, which forbids servo and shutter; off again at the end.
    SafetySwitch,
    /// The supply fails; it comes back at the end.
    PowerCut,
}

/// A fault and its time.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct BoardFault {
    /// What happens.
    pub kind: BoardFaultKind,
    /// When it begins, from the flight's start.
    pub at_s: f64,
    /// How long it lasts; `None`: to the end.
    pub for_s: Option<f64>,
}

impl BoardFault {
    /// When it begins.
    pub(crate) fn begins_ns(&self) -> u64 {
        (self.at_s * 1e9) as u64
    }

    /// When it ends.
    pub(crate) fn ends_ns(&self) -> u64 {
        self.for_s.map_or(u64::MAX, |for_s| ((self.at_s + for_s) * 1e9) as u64)
    }
}

/// All faults of a flight, and which of the singular ones have happened.
#[derive(Clone, Debug, Default)]
pub(crate) struct BoardFaults {
    faults: Vec<BoardFault>,
    happened: Vec<bool>,
}

impl BoardFaults {
    pub(crate) fn new(faults: &[BoardFault]) -> Self {
        Self { faults: faults.to_vec(), happened: vec![false; faults.len()] }
    }

    /// Tells whether a fault of this kind holds.
    pub(crate) fn holds(&self, kind: BoardFaultKind, now_ns: u64) -> bool {
        let holds = |fault: &BoardFault| (fault.begins_ns()..fault.ends_ns()).contains(&now_ns);
        self.faults.iter().any(|fault| fault.kind == kind && holds(fault))
    }

    /// Tells, once per fault, that one of this kind has begun.
    pub(crate) fn begins(&mut self, kind: BoardFaultKind, now_ns: u64) -> bool {
        let mut begun = false;
        for (fault, happened) in self.faults.iter().zip(&mut self.happened) {
            if fault.kind == kind && fault.begins_ns() <= now_ns && !*happened {
                *happened = true;
                begun = true;
            }
        }
        begun
    }

    /// The next instant in `(from_ns, to_ns)` at which the supply goes or comes.
    pub(crate) fn power_edge(&self, from_ns: u64, to_ns: u64) -> Option<u64> {
        let cuts = self.faults.iter().filter(|fault| fault.kind == BoardFaultKind::PowerCut);
        let edges = cuts.flat_map(|fault| [fault.begins_ns(), fault.ends_ns()]);
        edges.filter(|edge| *edge > from_ns && *edge < to_ns).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut() -> BoardFaults {
        BoardFaults::new(&[BoardFault { kind: BoardFaultKind::PowerCut, at_s: 1.0, for_s: Some(0.5) }])
    }

    #[test]
    fn a_fault_holds_from_its_beginning_to_its_end() {
        let holds = |now_ns| cut().holds(BoardFaultKind::PowerCut, now_ns);
        let times_ns = [999_999_999, 1_000_000_000, 1_499_999_999, 1_500_000_000];
        assert_eq!(times_ns.map(holds), [false, true, true, false]);
    }

    #[test]
    fn a_fault_begins_once() {
        let mut faults = cut();
        let kind = BoardFaultKind::PowerCut;
        assert!(!faults.begins(kind, 999_999_999));
        assert!(faults.begins(kind, 1_000_000_000) && !faults.begins(kind, 1_000_000_001));
    }

    #[test]
    fn the_supply_goes_and_comes_within_a_step() {
        let faults = cut();
        assert_eq!(faults.power_edge(999_000_000, 1_004_000_000), Some(1_000_000_000));
        assert_eq!(faults.power_edge(1_000_000_000, 2_000_000_000), Some(1_500_000_000));
        assert_eq!(faults.power_edge(1_500_000_000, 2_000_000_000), None);
    }
}
