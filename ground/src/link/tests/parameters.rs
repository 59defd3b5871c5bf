//! Lists and changes of parameters over bad lines.

use adit_protocol::mavlink::{Encoding, Value};
use adit_protocol::parameters::{ParameterTable, Parameters};

use super::*;

#[tokio::test]
async fn a_list_over_a_bad_line_comes_complete_in_either_encoding() {
    for (line, encoding) in lines().iter().zip([Encoding::Cast, Encoding::Bytewise].into_iter().cycle()) {
        let script = Script { damage: 0.25, encoding, ..Script::default() };
        let (session, _board) = connected(line, script, config()).await;
        let board = session.board().await.unwrap();
        let mut seen = Vec::new();
        let list = session.parameters(&board, &mut |there, of| seen.push((there, of))).await.unwrap();
        let mut table = ParameterTable::new(Parameters::default());
        for (parameter, (index, row)) in list.iter().zip(ParameterTable::rows().iter().enumerate()) {
            let expected = Some(parameter.value).filter(|value| Some(*value) == table.get(index));
            assert!(parameter.name == row.name && expected.is_some(), "{parameter:?}");
        }
        assert_eq!(seen.last(), Some(&(90, 90)));
        assert!(seen.is_sorted(), "progress goes on");
    }
}

#[tokio::test]
async fn a_change_is_done_when_it_is_answered_and_a_refusal_tells_why() {
    for line in lines() {
        let (session, scripted) = connected(&line, Script { damage: 0.25, ..Script::default() }, config()).await;
        let board = session.board().await.unwrap();
        assert_eq!(session.set_parameter(&board, "RIG_IMAGES", Value::Whole(12)).await.unwrap(), Value::Whole(12));
        let degrees = session.set_parameter(&board, "RIG_MOUNT_X_DEG", Value::Real(-12.3)).await.unwrap();
        assert!(same_value(degrees, Value::Real(-12.3)));
        let error = session.set_parameter(&board, "SPD_MARGIN", Value::Real(2.0)).await.unwrap_err();
        let LinkError::ParameterRefused { found, .. } = &error else { panic!("{error}") };
        assert_eq!(*found, Value::Real(Parameters::default().speed.margin));
        assert!(error.to_string().contains("asked for 2, the board has"), "{error}");
        assert_eq!(scripted.ledger().parameters.unwrap().rig.images_per_turn, 12);
        assert_eq!(session.parameter(&board, "RIG_IMAGES").await.unwrap().value, Value::Whole(12));
    }
}

#[tokio::test]
async fn a_refusal_on_a_good_line_comes_with_the_boards_words() {
    let (session, _board) = over_tcp(Script::default(), config()).await;
    let board = session.board().await.unwrap();
    let error = session.set_parameter(&board, "SPD_MARGIN", Value::Real(2.0)).await.unwrap_err();
    assert!(error.to_string().contains("the board says: SPD_MARGIN: value refused"), "{error}");
}

#[tokio::test]
async fn a_name_that_nobody_knows_is_not_answered() {
    let short = Patience { answer: Duration::from_millis(20), silence: Duration::from_millis(300) };
    let (session, _board) = over_tcp(Script::default(), Config { patience: short, ..Config::default() }).await;
    let board = session.board().await.unwrap();
    for name in ["NO_SUCH", "A_NAME_OF_MORE_THAN_16_LETTERS"] {
        let error = session.parameter(&board, name).await.unwrap_err();
        assert!(matches!(error, LinkError::NoAnswer { .. }) && error.to_string().contains(name), "{error}");
    }
}
