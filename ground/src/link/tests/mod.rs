//! Sessions over real sockets with a scripted board at the other end, on lines that lose, repeat and reorder.

pub(crate) mod board;
mod logs;
mod parameters;
mod peers;
#[cfg(unix)]
mod serial;
mod session;
mod signing;

use std::time::Duration;

use adit_protocol::connection::Connection;

use super::*;
pub(crate) use board::{Script, ScriptedBoard};

/// Short enough that lost answers cost little, long enough that a busy machine is not taken for silence.
const PATIENCE: Patience = Patience { answer: Duration::from_millis(60), silence: Duration::from_secs(20) };

fn free_port() -> u16 {
    std::net::UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// Both ends of a line: the board's, then ours.
fn lines() -> Vec<[Connection; 2]> {
    [["udpout", "udpin"], ["udpin", "udpout"], ["tcpin", "tcpout"], ["tcpout", "tcpin"]]
        .into_iter()
        .map(|kinds| {
            let port = free_port();
            kinds.map(|kind| format!("{kind}:127.0.0.1:{port}").parse().unwrap())
        })
        .collect()
}

pub(crate) fn config() -> Config {
    Config { patience: PATIENCE, ..Config::default() }
}

/// A session with a scripted board on a line.
async fn connected([theirs, ours]: &[Connection; 2], script: Script, config: Config) -> (Session, ScriptedBoard) {
    // Who waits is opened first.
    if matches!(ours, Connection::TcpIn(_)) {
        let session = Session::open(ours, config).await.unwrap();
        return (session, ScriptedBoard::start(theirs, script).await);
    }
    let board = ScriptedBoard::start(theirs, script).await;
    (Session::open(ours, config).await.unwrap(), board)
}

/// A session on the simplest line.
pub(crate) async fn over_tcp(script: Script, config: Config) -> (Session, ScriptedBoard) {
    let lines = lines();
    let line = lines.iter().find(|[_, ours]| matches!(ours, Connection::TcpOut(_))).unwrap();
    connected(line, script, config).await
}
