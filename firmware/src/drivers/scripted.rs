//! For tests: an I2C bus that expects given transactions and answers them, and an executor for futures that never wait.

use std::collections::VecDeque;
use std::future::Future;
use std::pin::pin;
use std::task::{Context, Poll, Waker};

use embedded_hal_async::i2c::{ErrorKind, ErrorType, I2c, NoAcknowledgeSource, Operation};

/// What a target says that is not there.
pub(crate) const NACK: ErrorKind = ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address);

/// Runs a future that is ready at once.
pub(crate) fn block_on<F: Future>(future: F) -> F::Output {
    match pin!(future).as_mut().poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(output) => output,
        Poll::Pending => panic!("a scripted bus never waits"),
    }
}

/// One transaction: from START to STOP.
#[derive(Clone, Debug)]
pub(crate) enum Step {
    /// Exactly these bytes are written to the address, and acknowledged.
    Write(u8, Vec<u8>),
    /// As many bytes are read from the address, and these are the answer.
    Read(u8, Vec<u8>),
    /// The first are written and the second answered after a repeated START.
    WriteRead(u8, Vec<u8>, Vec<u8>),
    /// Whatever is asked, nobody is at this address.
    Nack(u8),
}

/// The bus.
#[derive(Debug)]
pub(crate) struct ScriptedI2c(VecDeque<Step>);

impl ScriptedI2c {
    pub(crate) fn new(steps: impl IntoIterator<Item = Step>) -> Self {
        Self(steps.into_iter().collect())
    }

    /// Checks that all that was expected has happened.
    pub(crate) fn finish(self) {
        assert!(self.0.is_empty(), "never asked for: {:?}", self.0);
    }
}

impl ErrorType for ScriptedI2c {
    type Error = ErrorKind;
}

impl I2c for ScriptedI2c {
    async fn transaction(&mut self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), ErrorKind> {
        let step = self.0.pop_front().unwrap_or_else(|| panic!("not in the script: {operations:x?} at {address:#04x}"));
        match (&step, operations) {
            (Step::Write(at, expected), [Operation::Write(bytes)]) if (*at, &expected[..]) == (address, *bytes) => {
                Ok(())
            }
            (Step::Read(at, answer), [Operation::Read(bytes)]) if (*at, answer.len()) == (address, bytes.len()) => {
                bytes.copy_from_slice(answer);
                Ok(())
            }
            (Step::WriteRead(at, expected, answer), [Operation::Write(written), Operation::Read(bytes)])
                if (*at, &expected[..], answer.len()) == (address, *written, bytes.len()) =>
            {
                bytes.copy_from_slice(answer);
                Ok(())
            }
            (Step::Nack(at), _) if *at == address => Err(NACK),
            (_, operations) => panic!("expected {step:x?}, found {operations:x?} at {address:#04x}"),
        }
    }
}
