//! Keys: who signs, who is believed, how a key comes to the board.

use std::path::PathBuf;

use adit_protocol::mavlink::{Key, SignatureError, Value};
use tempfile::TempDir;

use super::*;

const SHORT: Patience = Patience { answer: Duration::from_millis(20), silence: Duration::from_millis(400) };

fn key_file() -> (TempDir, PathBuf, Key) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("board.key");
    let key = KeyFile::create(&path).unwrap().key;
    (folder, path, key)
}

fn signed(path: &std::path::Path) -> Config {
    Config { key: Some(KeyFile::read(path).unwrap()), ..config() }
}

#[tokio::test]
async fn a_board_with_a_key_obeys_who_signs_and_is_believed_though_its_clock_is_behind() {
    let (_folder, path, key) = key_file();
    for line in lines() {
        let script = Script { key: Some(key), damage: 0.2, ..Script::default() };
        let (session, _board) = connected(&line, script, signed(&path)).await;
        let board = session.board().await.unwrap();
        let value = Value::Whole(12);
        assert_eq!(session.set_parameter(&board, "RIG_IMAGES", value).await.unwrap(), value, "{}", line[1]);
        session.close().await.unwrap();
        std::fs::remove_file(path.with_file_name("board.key.state")).unwrap();
    }
}

#[tokio::test]
async fn an_unsigned_change_is_not_obeyed_and_the_board_is_quoted() {
    let (_folder, _, key) = key_file();
    let script = Script { key: Some(key), ..Script::default() };
    let (session, _board) = over_tcp(script, Config { patience: SHORT, ..Config::default() }).await;
    let board = session.board().await.unwrap();
    let error = session.set_parameter(&board, "RIG_IMAGES", Value::Whole(12)).await.unwrap_err().to_string();
    assert!(error.contains("the board says: refused request of 255/190: unsigned"), "{error}");
}

#[tokio::test]
async fn with_a_key_an_unsigned_board_is_not_believed() {
    let (_folder, path, _) = key_file();
    let (session, _board) = over_tcp(Script::default(), Config { patience: SHORT, ..signed(&path) }).await;
    let error = session.board().await.unwrap_err().to_string();
    assert!(error.contains("board 1/191 (not believed: the message is not signed)"), "{error}");
}

#[tokio::test]
async fn what_one_session_heard_is_not_believed_when_it_is_said_again_in_the_next() {
    let (_folder, path, key) = key_file();
    let (session, _board) = over_tcp(Script { key: Some(key), ..Script::default() }, signed(&path)).await;
    let mut heard = session.listen();
    session.board().await.unwrap();
    let said = loop {
        let message = heard.recv().await.unwrap();
        if message.trust == Trust::Verified {
            break message.frame.clone();
        }
    };
    session.close().await.unwrap();
    let kept = KeyFile::read(&path).unwrap();
    assert_eq!(kept.heard().clone().judge(Some(&key), &said), Trust::Refused(SignatureError::Replayed));
    assert!(kept.time(std::time::UNIX_EPOCH) > 0, "nor is a time signed again when the clock is put back");
}

#[tokio::test]
async fn a_key_is_given_and_taken_over_a_bad_line() {
    let (_folder, path, key) = key_file();
    for line in lines() {
        let (session, _board) = connected(&line, Script { damage: 0.25, ..Script::default() }, config()).await;
        let board = session.board().await.unwrap();
        let time = KeyFile::read(&path).unwrap().time(std::time::SystemTime::now());
        session.install_key(&board, key, time).await.unwrap();
        session.remove_key(&board).await.unwrap();
    }
}

#[tokio::test]
async fn a_port_that_takes_no_keys_says_so() {
    let (_folder, _, key) = key_file();
    let (session, _board) = over_tcp(Script { is_service_port: false, ..Script::default() }, config()).await;
    let board = session.board().await.unwrap();
    let error = session.install_key(&board, key, 5).await.unwrap_err();
    assert!(error.to_string().contains("TELEM2 only"), "{error}");
    assert!(matches!(session.remove_key(&board).await, Err(LinkError::KeyRefused { .. })));
}
