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
    assert!(matches!(taken, LinkError::Serial { trouble: SerialTrouble::Busy, .. }), "{taken:?}");
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

#[tokio::test]
async fn bytes_that_are_no_frames_are_told_with_the_port_and_what_to_try() {
    let (mut other, port) = SerialStream::pair().unwrap();
    let path = port.name().unwrap();
    drop(port);
    let connection = Connection::Serial { path: path.clone(), baud: 57_600 };
    let short = Patience { answer: Duration::from_millis(20), silence: Duration::from_millis(1500) };
    let session = Session::open(&connection, Config { patience: short, ..Config::default() }).await.unwrap();
    // What 921,600 baud look like at 57,600: bytes of no pattern.
    let noise: Vec<u8> = (0_u32..2000).map(|count| (count.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    other.write_all(&noise).await.unwrap();
    let error = session.board().await.unwrap_err();
    assert!(matches!(error, LinkError::Noise { .. }), "{error:?}");
    let error = error.to_string();
    assert!(error.contains(&path) && error.contains("921600") && error.contains("57600 baud"), "{error}");
}

#[tokio::test]
async fn what_is_no_serial_port_is_named_with_those_that_are() {
    let file = tempfile::NamedTempFile::new().unwrap();
    let path = file.path().to_string_lossy().into_owned();
    let error =
        Line::open(&Connection::Serial { path: path.clone(), baud: 57_600 }, PATIENCE.silence).await.unwrap_err();
    let LinkError::Serial { trouble: SerialTrouble::Other, known, .. } = &error else { panic!("{error:?}") };
    let words = error.to_string();
    assert!(words.contains(&path) && known.iter().all(|port| words.contains(port)), "{words}");
}

#[test]
fn each_trouble_with_a_port_says_what_to_do() {
    // Nothing is forbidden to who runs the tests as root, so the system's answer stands for the port's.
    let of = |kind, is_there| super::super::transport::trouble(kind, is_there).to_string();
    assert!(of(std::io::ErrorKind::PermissionDenied, true).contains("usermod -aG dialout"));
    assert!(of(std::io::ErrorKind::NotFound, false).contains("plugged in"));
    assert!(of(std::io::ErrorKind::NotFound, true).contains("end that program first"));
    assert!(of(std::io::ErrorKind::InvalidInput, true).contains("does not know this rate"));
}
