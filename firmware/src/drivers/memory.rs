//! A small byte-addressed memory that keeps what is written through a loss of power.

/// Byte-addressed, power-fail safe, ready for the next access as soon as a call returns.
pub trait Memory {
    /// Why an access failed.
    type Error;

    /// Fills `bytes` from `address` on.
    ///
    /// # Errors
    /// The bus failed or the range lies outside the memory; `bytes` then holds nothing of worth.
    fn read(&mut self, address: u16, bytes: &mut [u8]) -> Result<(), Self::Error>;

    /// Stores `bytes` from `address` on.
    ///
    /// # Errors
    /// The bus failed or the range lies outside the memory. A part of the range may have been stored.
    fn write(&mut self, address: u16, bytes: &[u8]) -> Result<(), Self::Error>;
}
