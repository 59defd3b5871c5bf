//! The board's tasks: thin loops that carry data between drivers and the controller.
//!
//! | task | runs in | priority | period | stack |
//! |---|---|---|---|---|
//! | drivers' interrupts | their own vectors | 0 | - | shared |
//! | control | executor on DCMI's vector | 6 | 5 ms | shared |
//! | sensors (or herobus beside the Hub), imu, link, store, supervisor | executor on CAN2's error vector | 7 | 5 to 100 ms | shared |
//! | log | thread mode | lowest | when there is something to write | shared |
//!
//! Control is above the others, so that no bus and no card delays shaft and shutter. The log waits for its card in thread
//! mode, where everybody may interrupt it. Deadlines: [`adit_firmware::health`].

#[cfg(not(feature = "hil"))]
pub(crate) mod control;
pub(crate) mod herobus;
pub(crate) mod imu;
pub(crate) mod link;
pub(crate) mod log;
pub(crate) mod sensors;
#[cfg(feature = "hil")]
pub(crate) mod simulated;
pub(crate) mod store;
pub(crate) mod supervisor;
