//! A serial line, played by a pseudo-terminal.

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio_serial::{SerialPort, SerialStream};

use super::*;

#[tokio::test]
async fn bytes_go_both_ways_over_a_serial_line_and_a_pulled_plug_is_told() {
    let (mut other, port) = SerialStream::pair().unwrap();
    let connection = Connection::Serial { path: port.name().unwrap(), baud: 57_600 };
    drop(port);
    let mut line = Line::open(&connection, PATIENCE.silence).await.unwrap();
    let taken = Line::open(&connection, PATIENCE.silence).await.unwrap_err();
    assert!(matches!(taken, LinkError::Serial { .. }), "a port has one user");
    assert!(matches!(line.next().await, Some(LineEvent::Up { peer }) if peer.ends_with("at 57600 baud")));
    other.write_all(&[0xFD, 0, 13, 10]).await.unwrap();
    let mut heard = Vec::new();
    while heard.len() < 4 {
        let Some(LineEvent::Bytes(bytes)) = line.next().await else { panic!("no bytes") };
        heard.extend(bytes);
    }
    assert_eq!(heard, [0xFD, 0, 13, 10], "nothing is taken for an end of line");
    line.send(vec![10, 13, 0xFE]);
    let mut sent = [0; 3];
    other.read_exact(&mut sent).await.unwrap();
    assert_eq!(sent, [10, 13, 0xFE]);
    drop(other);
    assert!(matches!(line.next().await, Some(LineEvent::Down { .. })));
}
