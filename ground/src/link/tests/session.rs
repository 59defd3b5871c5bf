//! Who is there, commands, records, errors.

use adit_protocol::mavlink::{Encoding, FrameDecoder, Sender};

use super::*;

#[tokio::test]
async fn the_board_is_found_on_every_kind_of_socket() {
    for line in lines() {
        let script = Script { system: 7, encoding: Encoding::Cast, ..Script::default() };
        let (session, _board) = connected(&line, script, config()).await;
        let board = session.board().await.unwrap();
        assert_eq!((board.target, board.encoding, board.uid), ([7, 191], Encoding::Cast, Some(0xABC)), "{}", line[1]);
        assert_eq!(board.version, Some([0, 1, 2, 0]));
        session.close().await.unwrap();
    }
}

#[tokio::test]
async fn a_command_over_a_bad_line_is_obeyed_once() {
    for line in lines() {
        let (session, board) = connected(&line, Script { damage: 0.3, ..Script::default() }, config()).await;
        let target = session.board().await.unwrap().target;
        assert_eq!(session.command(target, 246, [0.0; 7]).await.unwrap(), CommandOutcome::Accepted);
        assert_eq!(session.command(target, 9999, [0.0; 7]).await.unwrap(), CommandOutcome::Unsupported);
        assert_eq!(board.ledger().obeyed, [246, 9999], "{}", line[1]);
    }
}

#[tokio::test]
async fn silence_is_told_with_who_was_heard_instead() {
    let short = Patience { answer: Duration::from_millis(20), silence: Duration::from_millis(400) };
    let wanted = Config { system: Some(9), patience: short, ..Config::default() };
    let (session, _board) = over_tcp(Script::default(), wanted).await;
    let error = session.board().await.unwrap_err().to_string();
    assert!(error.contains("component 191") && error.contains("autopilot 1/1, board 1/191"), "{error}");
    let nobody = format!("udpin:127.0.0.1:{}", free_port()).parse().unwrap();
    let session = Session::open(&nobody, Config { patience: short, ..Config::default() }).await.unwrap();
    let error = session.board().await.unwrap_err().to_string();
    assert!(error.contains("nothing at all was heard"), "{error}");
}

#[tokio::test]
async fn what_cannot_be_opened_is_named() {
    let short = Patience { answer: Duration::from_millis(20), silence: Duration::from_millis(20) };
    let config = || Config { patience: short, ..Config::default() };
    let nobody = format!("tcpout:127.0.0.1:{}", free_port());
    let error = Session::open(&nobody.parse().unwrap(), config()).await.unwrap_err();
    assert!(error.to_string().contains(&nobody), "{error}");
    let error = Session::open(&"serial:/dev/no-such-port".parse().unwrap(), config()).await.unwrap_err();
    let error = error.to_string();
    assert!(["/dev/no-such-port", "no such port", "serial ports"].iter().all(|words| error.contains(words)), "{error}");
}

#[tokio::test]
async fn a_client_and_a_server_are_there_again_after_the_peer_was_gone() {
    for line in lines() {
        let [theirs, _] = &line;
        let (session, board) = connected(&line, Script::default(), config()).await;
        session.board().await.unwrap();
        drop(board);
        let again = ScriptedBoard::start(theirs, Script::default()).await;
        let target = session.board().await.unwrap().target;
        assert_eq!(session.command(target, 400, [1.0; 7]).await.unwrap(), CommandOutcome::Accepted, "{}", line[1]);
        assert_eq!(again.ledger().obeyed, [400]);
    }
}

#[tokio::test]
async fn a_server_turns_to_whoever_connected_last() {
    let line = lines().into_iter().find(|[_, ours]| matches!(ours, Connection::TcpIn(_))).unwrap();
    let (session, _vanished) = connected(&line, Script::default(), config()).await;
    session.board().await.unwrap();
    let newer = ScriptedBoard::start(&line[0], Script { system: 2, ..Script::default() }).await;
    while session.heard().iter().all(|peer| peer.system != 2) {
        tokio::task::yield_now().await;
    }
    assert_eq!(session.command([2, 191], 400, [1.0; 7]).await.unwrap(), CommandOutcome::Accepted);
    assert_eq!(newer.ledger().obeyed, [400]);
}

#[tokio::test]
async fn a_record_holds_every_frame_of_both_ends_in_order_of_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.tlog");
    let (session, board) = over_tcp(Script::default(), Config { record: Some(path.clone()), ..config() }).await;
    session.board().await.unwrap();
    let summary = session.close().await.unwrap();
    drop(board);
    let content = std::fs::read(&path).unwrap();
    let (mut rest, mut times, mut senders) = (&content[..], Vec::new(), Vec::new());
    while let Some((time, behind)) = rest.split_first_chunk::<8>() {
        let mut decoder = FrameDecoder::default();
        let frame = behind.iter().find_map(|byte| decoder.push(*byte)).unwrap();
        assert_eq!(frame.wire(), &behind[..frame.wire().len()], "nothing lies between time and frame");
        times.push(u64::from_be_bytes(*time));
        senders.push((frame.system, frame.component));
        rest = &behind[frame.wire().len()..];
    }
    assert_eq!(times.len() as u64, summary.recorded);
    assert!(times.is_sorted());
    for sender in [(1, 1), (1, 191), (255, 190)] {
        assert!(senders.contains(&sender), "{sender:?}");
    }
}

#[cfg(target_os = "linux")]
#[tokio::test]
async fn a_full_disk_ends_the_record_and_is_told_but_the_session_goes_on() {
    let (session, _board) = over_tcp(Script::default(), Config { record: Some("/dev/full".into()), ..config() }).await;
    session.board().await.unwrap();
    assert!(session.state().borrow().record_failed);
    let error = session.close().await.unwrap_err();
    assert!(matches!(error, LinkError::Record { .. }), "{error}");
}

#[tokio::test]
async fn what_is_sent_last_goes_out_before_the_session_ends() {
    let (session, board) = over_tcp(Script::default(), config()).await;
    session.board().await.unwrap();
    session.send(|sender: &mut Sender| sender.command([1, 191], 31_010, 0, &[0.0; 7])).await.unwrap();
    session.close().await.unwrap();
    while board.ledger().obeyed.is_empty() {
        tokio::task::yield_now().await;
    }
    assert_eq!(board.ledger().obeyed, [31_010]);
}
