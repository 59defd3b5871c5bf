//! A MAVLink peer at a connection: a ground station that watches the simulated vehicle.

use std::io::{ErrorKind, Read, Result, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::time::Duration;

use adit_protocol::connection::Connection;
use adit_protocol::mavlink::MAX_FRAME_BYTES;
use serialport::SerialPort;

/// A line that has nothing does not hold the simulation up.
const SERIAL_WAIT: Duration = Duration::from_millis(1);
/// A datagram of an Ethernet.
const DATAGRAM_BYTES: usize = 1500;

/// The line.
enum Line {
    Serial(Box<dyn SerialPort>),
    /// To whoever spoke last, or to one.
    Udp(UdpSocket, Option<SocketAddr>),
    /// Waits for somebody, if there is a listener.
    Tcp(Option<TcpListener>, Option<TcpStream>),
}

/// The peer.
pub struct Peer(Line);

impl Peer {
    /// Opens the connection. Where others are to come, it does not wait for them.
    ///
    /// # Errors
    /// If there is no such port or address, or nobody there.
    pub fn open(connection: &Connection) -> Result<Self> {
        Ok(Self(match connection {
            Connection::Serial { path, baud } => {
                Line::Serial(serialport::new(path, *baud).timeout(SERIAL_WAIT).open()?)
            }
            Connection::UdpIn(address) => Line::Udp(quiet(UdpSocket::bind(address)?)?, None),
            Connection::UdpOut(address) => {
                let to = std::net::ToSocketAddrs::to_socket_addrs(address)?.next();
                let own = if to.is_some_and(|to| to.is_ipv6()) { "[::]:0" } else { "0.0.0.0:0" };
                Line::Udp(quiet(UdpSocket::bind(own)?)?, to)
            }
            Connection::TcpIn(address) => {
                let listener = TcpListener::bind(address)?;
                listener.set_nonblocking(true)?;
                Line::Tcp(Some(listener), None)
            }
            Connection::TcpOut(address) => Line::Tcp(None, Some(prompt(TcpStream::connect(address)?)?)),
        }))
    }

    /// What has come in.
    ///
    /// # Errors
    /// If the line broke; a peer that goes away is no error where another one may come.
    pub fn read(&mut self) -> Result<Vec<u8>> {
        match &mut self.0 {
            Line::Serial(port) => {
                // Reading would wait, asking does not.
                let waiting = port.bytes_to_read()? as usize;
                let mut bytes = vec![0; waiting];
                let read = if waiting == 0 { 0 } else { or_nothing(port.read(&mut bytes))? };
                bytes.truncate(read);
                Ok(bytes)
            }
            Line::Udp(socket, peer) => {
                let (mut bytes, mut datagram) = (Vec::new(), [0; DATAGRAM_BYTES]);
                loop {
                    match socket.recv_from(&mut datagram) {
                        Ok((length, from)) => {
                            *peer = Some(from);
                            bytes.extend(&datagram[..length]);
                        }
                        Err(error) if is_passing(&error) => return Ok(bytes),
                        Err(error) => return Err(error),
                    }
                }
            }
            Line::Tcp(listener, stream) => {
                if let (Some(listener), None) = (listener.as_ref(), stream.as_ref()) {
                    *stream = listener.accept().ok().map(|(stream, _)| prompt(stream)).transpose()?;
                }
                let Some(open) = stream else { return Ok(Vec::new()) };
                let mut bytes = vec![0; 16 * MAX_FRAME_BYTES];
                let read = match open.read(&mut bytes) {
                    Ok(0) => Err(ErrorKind::ConnectionReset.into()),
                    other => or_nothing(other),
                };
                match (read, listener) {
                    (Ok(read), _) => {
                        bytes.truncate(read);
                        Ok(bytes)
                    }
                    (Err(_), Some(_)) => {
                        *stream = None;
                        Ok(Vec::new())
                    }
                    (Err(error), None) => Err(error),
                }
            }
        }
    }

    /// Sends a frame; what a line does not take just now is lost, as on any line.
    ///
    /// # Errors
    /// If the line broke.
    pub fn write(&mut self, bytes: &[u8]) -> Result<()> {
        match &mut self.0 {
            Line::Serial(port) => or_nothing(port.write_all(bytes)),
            Line::Udp(socket, Some(peer)) => or_nothing(socket.send_to(bytes, *peer).map(|_| ())),
            Line::Tcp(listener, Some(stream)) => match or_nothing(stream.write_all(bytes)) {
                Err(_) if listener.is_some() => {
                    self.0 = Line::Tcp(listener.take(), None);
                    Ok(())
                }
                other => other,
            },
            Line::Udp(_, None) | Line::Tcp(_, None) => Ok(()),
        }
    }
}

fn quiet(socket: UdpSocket) -> Result<UdpSocket> {
    socket.set_nonblocking(true)?;
    Ok(socket)
}

fn prompt(stream: TcpStream) -> Result<TcpStream> {
    stream.set_nonblocking(true)?;
    stream.set_nodelay(true)?;
    Ok(stream)
}

/// Nothing there, no room, or nobody at the other end of a datagram: it may be otherwise the next time.
fn is_passing(error: &std::io::Error) -> bool {
    use ErrorKind::{ConnectionRefused, Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), WouldBlock | TimedOut | Interrupted | ConnectionRefused)
}

fn or_nothing<T: Default>(result: Result<T>) -> Result<T> {
    match result {
        Err(error) if is_passing(&error) => Ok(T::default()),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(text: &str) -> Peer {
        Peer::open(&text.parse().expect("a connection")).expect("opens")
    }

    /// Reads until something comes.
    fn wait(peer: &mut Peer) -> Vec<u8> {
        for _ in 0..100_000 {
            let bytes = peer.read().expect("reads");
            if !bytes.is_empty() {
                return bytes;
            }
            std::thread::yield_now();
        }
        panic!("nothing came");
    }

    #[test]
    fn two_ends_of_udp_hear_each_other() {
        let port = UdpSocket::bind("127.0.0.1:0").expect("binds").local_addr().expect("has").port();
        let mut waits = open(&format!("udpin:127.0.0.1:{port}"));
        waits.write(&[9]).expect("is lost without a peer");
        let mut calls = open(&format!("udpout:127.0.0.1:{port}"));
        calls.write(&[1, 2, 3]).expect("sends");
        assert_eq!(wait(&mut waits), [1, 2, 3]);
        waits.write(&[4]).expect("sends");
        assert_eq!(wait(&mut calls), [4]);
    }

    #[test]
    fn a_client_of_tcp_may_go_and_another_come() {
        let port = TcpListener::bind("127.0.0.1:0").expect("binds").local_addr().expect("has").port();
        let mut waits = open(&format!("tcpin:127.0.0.1:{port}"));
        assert!(waits.read().expect("nobody").is_empty());
        for round in 0..2 {
            let mut calls = open(&format!("tcpout:127.0.0.1:{port}"));
            calls.write(&[round]).expect("sends");
            assert_eq!(wait(&mut waits), [round]);
            waits.write(&[round + 10]).expect("sends");
            assert_eq!(wait(&mut calls), [round + 10]);
            drop(calls);
            // Its end is seen at the next look.
            for _ in 0..100 {
                assert!(waits.read().expect("gone").is_empty());
                std::thread::yield_now();
            }
        }
    }
}
