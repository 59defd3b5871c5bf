//! The parameter protocol from a ground station's side.

use adit_protocol::parameters::ParameterTable;

use super::*;

const MARGIN: &str = "SPD_MARGIN";

/// Values that are told, by name.
fn values(said: &[Incoming], encoding: Encoding) -> Vec<(String, Value)> {
    let value = |incoming: &Incoming| match incoming {
        Incoming::ParameterValue { name: Some(name), value, .. } => {
            Some((name.to_string(), Value::read(*value, encoding)?))
        }
        _ => None,
    };
    said.iter().filter_map(value).collect()
}

fn set(link: &mut Link, now_us: u64, name: &str, value: Value, encoding: Encoding) {
    link.receive(now_us, Port::Service, &ground().parameter_set(BOARD, name, value.write(encoding)));
}

#[test]
fn all_parameters_are_listed_as_the_autopilot_would() {
    for (autopilot_number, encoding) in [(3, Encoding::Cast), (12, Encoding::Bytewise)] {
        let mut link = link();
        let beat = VehicleBeat { autopilot: autopilot_number, ..AUTO };
        link.receive(0, Port::Autopilot, &autopilot().vehicle_heartbeat(beat));
        step(&mut link, 0, Mode::Idle, None);
        link.receive(0, Port::Service, &ground().parameter_list([3, 0]));
        let mut heard = Vec::new();
        for tick in 0..200 {
            step(&mut link, tick * 5_000, Mode::Idle, None);
            heard.extend(values(&said(&mut link, tick * 5_000), encoding));
        }
        let mut table = ParameterTable::new(parameters());
        let rows = ParameterTable::rows();
        assert_eq!(heard.len(), rows.len());
        for (index, (name, value)) in heard.iter().enumerate() {
            assert_eq!((name.as_str(), Some(*value)), (rows[index].name, table.get(index)));
        }
    }
}

#[test]
fn one_is_read_by_name_or_place_and_an_unknown_one_is_met_with_silence() {
    let mut link = link();
    step(&mut link, 0, Mode::Idle, None);
    link.receive(0, Port::Service, &ground().parameter_read(BOARD, MARGIN));
    link.receive(0, Port::Service, &ground().parameter_read_at(BOARD, 1));
    link.receive(0, Port::Service, &ground().parameter_read(BOARD, "NO_SUCH_THING"));
    link.receive(0, Port::Service, &ground().parameter_read_at(BOARD, 10_000));
    let heard = values(&said(&mut link, 0), Encoding::Cast);
    let expected = [(MARGIN.to_owned(), Value::Real(0.9)), ("TUN_RADIUS_M".to_owned(), Value::Real(3.0))];
    assert_eq!(heard, expected);
}

#[test]
fn a_change_is_answered_when_it_is_kept() {
    let mut link = link();
    step(&mut link, 0, Mode::Idle, None);
    set(&mut link, 0, MARGIN, Value::Real(0.8), Encoding::Cast);
    assert_eq!(values(&said(&mut link, 0), Encoding::Cast), []);
    let Some(Keep::Parameters(kept)) = link.take_keep(0) else { panic!("nothing to keep") };
    assert_eq!(kept.speed.margin, 0.8);
    assert_eq!(link.take_keep(0), None, "one at a time");
    link.kept(true);
    let heard = said(&mut link, 0);
    assert_eq!(values(&heard, Encoding::Cast), [(MARGIN.to_owned(), Value::Real(0.8))]);
    assert_eq!(texts(&heard), ["parameters kept, in force after a restart"]);
}

#[test]
fn what_cannot_be_kept_or_is_refused_is_answered_with_the_old_value() {
    let mut link = link();
    step(&mut link, 0, Mode::Idle, None);
    set(&mut link, 0, MARGIN, Value::Real(0.8), Encoding::Cast);
    assert!(link.take_keep(0).is_some());
    link.kept(false);
    assert_eq!(values(&said(&mut link, 0), Encoding::Cast), [(MARGIN.to_owned(), Value::Real(0.9))]);
    set(&mut link, 0, MARGIN, Value::Real(8.0), Encoding::Cast);
    let heard = said(&mut link, 0);
    assert_eq!(values(&heard, Encoding::Cast), [(MARGIN.to_owned(), Value::Real(0.9))]);
    assert_eq!(texts(&heard), ["SPD_MARGIN: value refused"]);
    step(&mut link, 0, Mode::Scanning, None);
    set(&mut link, 0, MARGIN, Value::Real(0.8), Encoding::Cast);
    let heard = said(&mut link, 0);
    assert_eq!(values(&heard, Encoding::Cast), [(MARGIN.to_owned(), Value::Real(0.9))]);
    assert!(texts(&heard).contains(&"SPD_MARGIN: not while scanning".to_owned()));
    assert_eq!(link.take_keep(0), None);
}

#[test]
fn what_changes_while_the_memory_works_is_kept_next_and_answered_then() {
    let mut link = link();
    step(&mut link, 0, Mode::Idle, None);
    set(&mut link, 0, MARGIN, Value::Real(0.8), Encoding::Cast);
    assert!(link.take_keep(0).is_some());
    set(&mut link, 0, "LOG_PERIOD_S", Value::Real(2.0), Encoding::Cast);
    link.kept(true);
    assert_eq!(values(&said(&mut link, 0), Encoding::Cast), [(MARGIN.to_owned(), Value::Real(0.8))]);
    let Some(Keep::Parameters(kept)) = link.take_keep(0) else { panic!("the second is forgotten") };
    assert_eq!((kept.speed.margin, kept.log.sample_period_s), (0.8, 2.0));
    // When the second cannot be kept, the first stays.
    link.kept(false);
    let heard = values(&said(&mut link, 0), Encoding::Cast);
    assert_eq!(heard, [("LOG_PERIOD_S".to_owned(), Value::Real(0.5))]);
}
