//! Bytes to and from a peer, over a serial line, UDP or TCP.
//!
//! A task owns the socket. What goes wrong after the first opening is told and mended: a client connects again, a server waits
//! for the next peer, a serial line is opened again when its adapter is back. What is sent meanwhile is dropped, since an old
//! command is worse than none. UDP that waits for peers answers whoever spoke last.

use std::io;
use std::net::SocketAddr;
use std::time::Duration;

use adit_protocol::connection::Connection;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream, UdpSocket};
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep, timeout_at};
use tokio_serial::{SerialPortBuilderExt, SerialPortType};

use super::error::{LinkError, SerialTrouble};

/// Time between two attempts to connect.
const RETRY: Duration = Duration::from_millis(500);
/// More than the longest datagram that carries MAVLink.
const READ_BYTES: usize = 4096;
/// Events and frames that wait.
const QUEUE: usize = 256;

/// What happens on a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LineEvent {
    /// A peer is there; bytes from now on are its.
    Up {
        /// Who, in words.
        peer: String,
    },
    /// Bytes came.
    Bytes(Vec<u8>),
    /// The peer is gone.
    Down {
        /// Why, in words.
        why: String,
    },
}

/// A line that is open.
#[derive(Debug)]
pub struct Line {
    incoming: mpsc::Receiver<LineEvent>,
    outgoing: mpsc::Sender<Vec<u8>>,
}

impl Line {
    /// Opens a line. A TCP client tries until `patience` has passed; a server and UDP need no peer for being open.
    ///
    /// Must be called within a tokio runtime.
    ///
    /// # Errors
    /// [`LinkError::Serial`] with the ports that there are, [`LinkError::Open`] for sockets.
    pub async fn open(connection: &Connection, patience: Duration) -> Result<Self, LinkError> {
        let (events, incoming) = mpsc::channel(QUEUE);
        let (outgoing, frames) = mpsc::channel(QUEUE);
        let ends = Ends { events, frames };
        let failed = |source| LinkError::Open { connection: connection.to_string(), source };
        match connection {
            Connection::Serial { path, baud } => {
                let (path, baud) = (path.clone(), *baud);
                let first = open_serial(&path, baud)?;
                let peer = format!("{path} at {baud} baud");
                tokio::spawn(ends.serve_stream(first, peer, async move || open_serial(&path, baud).ok()));
            }
            Connection::UdpIn(address) => {
                let socket = UdpSocket::bind(address).await.map_err(failed)?;
                tokio::spawn(ends.serve_datagrams(socket, None));
            }
            Connection::UdpOut(address) => {
                let peer = resolve(address).await.map_err(failed)?;
                let any = if peer.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
                let socket = UdpSocket::bind(any).await.map_err(failed)?;
                tokio::spawn(ends.serve_datagrams(socket, Some(peer)));
            }
            Connection::TcpIn(address) => {
                let listener = TcpListener::bind(address).await.map_err(failed)?;
                tokio::spawn(ends.serve_peers(listener));
            }
            Connection::TcpOut(address) => {
                let first = connect_within(address, patience).await.map_err(failed)?;
                let (peer, address) = (address.clone(), address.clone());
                tokio::spawn(ends.serve_stream(first, peer, async move || connect(&address).await.ok()));
            }
        }
        Ok(Self { incoming, outgoing })
    }

    /// What happens next; `None` when the line is closed for good.
    pub async fn next(&mut self) -> Option<LineEvent> {
        self.incoming.recv().await
    }

    /// Sends bytes; a peer that is not there, or does not read, gets none.
    pub fn send(&self, bytes: Vec<u8>) {
        // Who asks, asks again: waiting here would hold up what comes in.
        let _ = self.outgoing.try_send(bytes);
    }

    /// Closes the line when everything that was sent is out, or after a moment.
    pub(super) async fn close(self) {
        let Self { mut incoming, outgoing } = self;
        drop(outgoing);
        let emptied = async { while incoming.recv().await.is_some() {} };
        let _ = tokio::time::timeout(RETRY, emptied).await;
    }
}

/// The serial ports of this machine, with what is known of their adapters.
pub fn serial_ports() -> Vec<String> {
    let ports = tokio_serial::available_ports().unwrap_or_default();
    let described = ports.into_iter().map(|port| match port.port_type {
        SerialPortType::UsbPort(usb) => match usb.product {
            Some(product) => format!("{} ({product})", port.port_name),
            None => format!("{} (USB)", port.port_name),
        },
        _ => port.port_name,
    });
    described.collect()
}

fn open_serial(path: &str, baud: u32) -> Result<tokio_serial::SerialStream, LinkError> {
    tokio_serial::new(path, baud).open_native_async().map_err(|error| {
        let source = io::Error::from(error);
        LinkError::Serial {
            path: path.to_owned(),
            trouble: trouble(source.kind(), std::path::Path::new(path).exists()),
            known: serial_ports(),
            source,
        }
    })
}

/// The crate says of a port in use that there is none.
pub(super) fn trouble(kind: io::ErrorKind, is_there: bool) -> SerialTrouble {
    match kind {
        io::ErrorKind::NotFound if is_there => SerialTrouble::Busy,
        io::ErrorKind::NotFound => SerialTrouble::Missing,
        io::ErrorKind::PermissionDenied => SerialTrouble::Forbidden,
        _ => SerialTrouble::Other,
    }
}

async fn resolve(address: &str) -> io::Result<SocketAddr> {
    let mut found = tokio::net::lookup_host(address).await?;
    found.next().ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, "the name has no address"))
}

async fn connect(address: &str) -> io::Result<TcpStream> {
    let stream = TcpStream::connect(address).await?;
    // Frames are short and answers are waited for.
    stream.set_nodelay(true)?;
    Ok(stream)
}

async fn connect_within(address: &str, patience: Duration) -> io::Result<TcpStream> {
    let deadline = Instant::now() + patience;
    loop {
        let failed = match timeout_at(deadline, connect(address)).await {
            Ok(Ok(stream)) => return Ok(stream),
            Ok(Err(error)) => error,
            Err(_) => return Err(io::ErrorKind::TimedOut.into()),
        };
        if Instant::now() + RETRY > deadline {
            return Err(failed);
        }
        sleep(RETRY).await;
    }
}

async fn accept(listener: &TcpListener) -> (TcpStream, SocketAddr) {
    loop {
        if let Ok(accepted) = listener.accept().await {
            return accepted;
        }
        sleep(RETRY).await;
    }
}

/// The task's ends of the two queues.
struct Ends {
    events: mpsc::Sender<LineEvent>,
    frames: mpsc::Receiver<Vec<u8>>,
}

/// Why a task ends.
enum End {
    /// Nobody uses the line any more.
    Closed,
    /// The peer is gone.
    Lost(io::Error),
}

impl Ends {
    async fn tell(&self, event: LineEvent) {
        // Who has closed the line hears no more.
        let _ = self.events.send(event).await;
    }

    async fn down(&self, error: &io::Error) {
        self.tell(LineEvent::Down { why: error.to_string() }).await;
    }

    /// Carries a stream, and opens it again whenever it is lost.
    async fn serve_stream<S, F>(mut self, first: S, peer: String, reopen: F)
    where
        S: AsyncRead + AsyncWrite,
        F: AsyncFn() -> Option<S>,
    {
        let mut stream = first;
        loop {
            self.tell(LineEvent::Up { peer: peer.clone() }).await;
            let End::Lost(error) = self.carry(stream).await else { return };
            self.down(&error).await;
            let again = async {
                loop {
                    sleep(RETRY).await;
                    if let Some(stream) = reopen().await {
                        return stream;
                    }
                }
            };
            match dropping(&mut self.frames, again).await {
                Some(next) => stream = next,
                None => return,
            }
        }
    }

    /// Carries the stream of whoever connected last: a peer that vanished without a word does not bar the next.
    async fn serve_peers(mut self, listener: TcpListener) {
        let Some(mut next) = dropping(&mut self.frames, accept(&listener)).await else { return };
        loop {
            let (stream, peer) = next;
            // Without it answers come late, which is no reason to refuse the peer.
            let _ = stream.set_nodelay(true);
            self.tell(LineEvent::Up { peer: peer.to_string() }).await;
            let ended = tokio::select! {
                end = self.carry(stream) => Ok(end),
                accepted = accept(&listener) => Err(accepted),
            };
            next = match ended {
                Ok(End::Closed) => return,
                Ok(End::Lost(error)) => {
                    self.down(&error).await;
                    match dropping(&mut self.frames, accept(&listener)).await {
                        Some(accepted) => accepted,
                        None => return,
                    }
                }
                Err(accepted) => accepted,
            };
        }
    }

    /// Carries bytes both ways until one of them fails.
    async fn carry<S: AsyncRead + AsyncWrite>(&mut self, stream: S) -> End {
        let (mut reader, mut writer) = tokio::io::split(stream);
        let events = &self.events;
        let frames = &mut self.frames;
        let reading = async {
            let mut buffer = vec![0; READ_BYTES];
            loop {
                match reader.read(&mut buffer).await {
                    Ok(0) => {
                        return End::Lost(io::Error::new(io::ErrorKind::UnexpectedEof, "the peer closed the line"));
                    }
                    Ok(count) => {
                        let bytes = buffer.get(..count).unwrap_or_default().to_vec();
                        if events.send(LineEvent::Bytes(bytes)).await.is_err() {
                            return End::Closed;
                        }
                    }
                    Err(error) => return End::Lost(error),
                }
            }
        };
        let writing = async {
            while let Some(frame) = frames.recv().await {
                let written = async {
                    writer.write_all(&frame).await?;
                    writer.flush().await
                };
                if let Err(error) = written.await {
                    return End::Lost(error);
                }
            }
            End::Closed
        };
        tokio::select! {
            end = reading => end,
            end = writing => end,
        }
    }

    async fn serve_datagrams(mut self, socket: UdpSocket, fixed: Option<SocketAddr>) {
        let mut peer = fixed;
        if let Some(peer) = peer {
            self.tell(LineEvent::Up { peer: peer.to_string() }).await;
        }
        let mut buffer = vec![0; READ_BYTES];
        loop {
            tokio::select! {
                received = socket.recv_from(&mut buffer) => match received {
                    Ok((count, from)) => {
                        if fixed.is_none() && peer != Some(from) {
                            peer = Some(from);
                            self.tell(LineEvent::Up { peer: from.to_string() }).await;
                        }
                        let bytes = buffer.get(..count).unwrap_or_default().to_vec();
                        self.tell(LineEvent::Bytes(bytes)).await;
                    }
                    // Some systems tell here that an earlier datagram found nobody.
                    Err(_) => sleep(RETRY).await,
                },
                frame = self.frames.recv() => {
                    let Some(frame) = frame else { return };
                    if let Some(peer) = peer {
                        // A datagram that does not arrive is a loss like any other.
                        let _ = socket.send_to(&frame, peer).await;
                    }
                }
            }
        }
    }
}

/// Waits for something while what is sent is dropped; `None` when the line is closed.
async fn dropping<T>(frames: &mut mpsc::Receiver<Vec<u8>>, wanted: impl Future<Output = T>) -> Option<T> {
    tokio::pin!(wanted);
    loop {
        tokio::select! {
            done = &mut wanted => return Some(done),
            frame = frames.recv() => { frame?; }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_trouble_of_a_port_has_its_own_words() {
        use io::ErrorKind::{InvalidInput, NotFound, PermissionDenied};
        let words = [(NotFound, false), (NotFound, true), (PermissionDenied, true), (InvalidInput, true)]
            .map(|(kind, is_there)| trouble(kind, is_there).to_string());
        for (words, expected) in words.iter().zip(["no such port", "another program", "dialout", "no serial port"]) {
            assert!(words.contains(expected), "{words}");
        }
    }
}
