//! Where a MAVLink peer is, as the MAVLink world writes it: `serial:/dev/ttyUSB0:57600`, `udpin:0.0.0.0:14550`,
//! `udpout:host:port`, `tcpin:host:port`, `tcpout:host:port`.

use std::fmt;
use std::str::FromStr;

/// Rate of a serial line that names none.
pub const DEFAULT_BAUD: u32 = 57_600;

/// Where a peer is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Connection {
    /// At the other end of a serial line.
    Serial {
        /// The device.
        path: String,
        /// Its rate.
        baud: u32,
    },
    /// Wherever the first datagram to this address comes from.
    UdpIn(String),
    /// At this address.
    UdpOut(String),
    /// Whoever connects to this address.
    TcpIn(String),
    /// At this address.
    TcpOut(String),
}

/// Why a text names no peer.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{found:?} is no connection; expected serial:DEVICE:BAUD, udpin:HOST:PORT, udpout:HOST:PORT, tcpin:HOST:PORT or \
     tcpout:HOST:PORT"
)]
pub struct ConnectionError {
    /// What was given.
    pub found: String,
}

impl FromStr for Connection {
    type Err = ConnectionError;

    fn from_str(text: &str) -> Result<Self, ConnectionError> {
        let wrong = || ConnectionError { found: text.to_owned() };
        let (kind, rest) = text.split_once(':').ok_or_else(wrong)?;
        if kind == "serial" {
            let (path, baud) = match rest.rsplit_once(':') {
                Some((path, baud)) => (path, baud.parse().map_err(|_| wrong())?),
                None => (rest, DEFAULT_BAUD),
            };
            let sound = !path.is_empty() && baud > 0;
            return if sound { Ok(Self::Serial { path: path.to_owned(), baud }) } else { Err(wrong()) };
        }
        let (host, port) = rest.rsplit_once(':').ok_or_else(wrong)?;
        if host.is_empty() || port.parse::<u16>().is_err() {
            return Err(wrong());
        }
        let address = rest.to_owned();
        Ok(match kind {
            "udpin" => Self::UdpIn(address),
            "udpout" => Self::UdpOut(address),
            "tcpin" => Self::TcpIn(address),
            "tcpout" => Self::TcpOut(address),
            _ => return Err(wrong()),
        })
    }
}

impl fmt::Display for Connection {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial { path, baud } => write!(formatter, "serial:{path}:{baud}"),
            Self::UdpIn(address) => write!(formatter, "udpin:{address}"),
            Self::UdpOut(address) => write!(formatter, "udpout:{address}"),
            Self::TcpIn(address) => write!(formatter, "tcpin:{address}"),
            Self::TcpOut(address) => write!(formatter, "tcpout:{address}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_is_read_as_it_is_written() {
        for text in [
            "serial:/dev/ttyUSB0:57600",
            "udpin:0.0.0.0:14550",
            "udpout:localhost:14550",
            "tcpin:127.0.0.1:5760",
            "tcpout:[::1]:5760",
        ] {
            assert_eq!(text.parse::<Connection>().unwrap().to_string(), text);
        }
        let serial = "serial:COM3".parse::<Connection>().unwrap();
        assert_eq!(serial, Connection::Serial { path: "COM3".to_owned(), baud: DEFAULT_BAUD });
    }

    #[test]
    fn what_is_no_connection_is_told_with_what_would_be() {
        for text in
            ["", "udp", "udpin:", "udpin:1.2.3.4", "tcpout:host:port", "serial:", "serial:/dev/x:fast", "carrier:a:1"]
        {
            let error = text.parse::<Connection>().unwrap_err().to_string();
            assert!(error.contains("udpin:HOST:PORT") && error.contains(&format!("{text:?}")), "{error}");
        }
    }
}
