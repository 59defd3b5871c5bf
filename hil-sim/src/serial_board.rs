//! A real board at the other end of a serial line: hardware in the loop.
//!
//! The board runs the `hil` build of the flash image and answers each step's inputs with its outputs
//! ([`adit_firmware::hil`]). The world waits for the answer, so a slow line makes a slow flight, not another one.

use std::io::{Read, Write};
use std::time::{Duration, Instant};

use adit_firmware::hil::{self, Answer, Decoder, Question};
use adit_firmware::io::{Inputs, Outputs};
use adit_protocol::log::parameters_hash;
use adit_protocol::parameters::Parameters;
use serialport::SerialPort;

use crate::flight::{Board, BoardError};

/// A question that is not answered within this is asked again: bytes get lost where a line is plugged in.
const ANSWER: Duration = Duration::from_millis(500);
/// So often, then the board counts as gone: ten seconds, for a board that has just been plugged in must boot first.
const ATTEMPTS: u32 = 20;
/// One read waits no longer than this.
const READ: Duration = Duration::from_millis(20);

/// The board.
pub struct SerialBoard {
    port: Box<dyn SerialPort>,
    decoder: Decoder,
}

impl SerialBoard {
    /// Opens the port and sets the board up for a flight.
    ///
    /// # Errors
    /// [`BoardError::Open`] with the ports that there are; [`BoardError::Silent`] if nothing answers;
    /// [`BoardError::Parameters`] if the board understood other parameters.
    pub fn open(path: &str, parameters: &Parameters) -> Result<Self, BoardError> {
        let port = serialport::new(path, hil::BAUD).timeout(READ).open().map_err(|source| BoardError::Open {
            port: path.to_owned(),
            source,
            known: known_ports(),
        })?;
        let mut board = Self { port, decoder: Decoder::default() };
        // Ends whatever an interrupted flight left half said.
        board.port.write_all(&[0]).map_err(BoardError::Line)?;
        let expected = parameters_hash(parameters).ok();
        let answer = board.ask(&Question::Begin(parameters.clone()), |answer| match answer {
            Answer::Ready { parameters_hash } => Some(parameters_hash),
            Answer::Done { .. } => None,
        })?;
        if Some(answer) == expected { Ok(board) } else { Err(BoardError::Parameters) }
    }

    /// Asks until an answer comes that fits.
    fn ask<T>(&mut self, question: &Question, fits: impl Fn(Answer) -> Option<T>) -> Result<T, BoardError> {
        let bytes = hil::encode(question).ok_or(BoardError::Parameters)?;
        for _ in 0..ATTEMPTS {
            self.port.write_all(&bytes).map_err(BoardError::Line)?;
            let asked = Instant::now();
            while asked.elapsed() < ANSWER {
                if let Some(answer) = self.read()?.into_iter().find_map(&fits) {
                    return Ok(answer);
                }
            }
        }
        Err(BoardError::Silent { seconds: ANSWER.as_secs_f64() * f64::from(ATTEMPTS) })
    }

    fn read(&mut self) -> Result<Vec<Answer>, BoardError> {
        let mut bytes = [0; 512];
        match self.port.read(&mut bytes) {
            Ok(count) => Ok(bytes[..count].iter().filter_map(|byte| self.decoder.push(*byte)).collect()),
            Err(error) if error.kind() == std::io::ErrorKind::TimedOut => Ok(Vec::new()),
            Err(error) => Err(BoardError::Line(error)),
        }
    }
}

impl Board for SerialBoard {
    fn step(&mut self, now_us: u64, inputs: &Inputs) -> Result<Outputs, BoardError> {
        // A question asked twice gets a second answer, which belongs to no later step: its time tells.
        self.ask(&Question::Step { now_us, inputs: *inputs }, |answer| match answer {
            Answer::Done { now_us: answered_us, outputs } if answered_us == now_us => Some(outputs),
            _ => None,
        })
    }
}

fn known_ports() -> String {
    let ports = serialport::available_ports().unwrap_or_default();
    let names: Vec<String> = ports.into_iter().map(|port| port.port_name).collect();
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}
