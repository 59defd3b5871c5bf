//! What goes wrong on the real image, on the emulated board, while it scans.
//!
//! | fault | expected |
//! |---|---|
//! | a range sensor unplugged, at zero, frozen | named within its time, the scan goes on, named again when it is back |
//! | the sensors' bus held low for a second | all silent, made anew, all back; no restart |
//! | encoder silent | Degraded, tags say that the angle is the commanded one; back |
//! | servo stalled | late turns, then Fault: no pulse, no photo |
//! | camera deaf | missed photos, the vehicle is braked, Fault |
//! | autopilot's position and attitude silent | tags carry the board's own attitude |
//! | card full | the pilot is told, the self-test refuses |
//! | card pulled and put back | Degraded and told; a second file; no tag lost |
//! | FRAM corrupt | defaults, and the pilot is told |
//! | card fails while a log is fetched | no answer then, and one when it is asked again (`logs.rs`) |
//! | garbage on the link at full rate | sensors, shaft and log served as ever, no capture lost, no restart |
//! | a hostile peer at the link's full rate: unsigned, forged and replayed orders, questions | no capture lost, nothing changed, the owner obeyed |
//! | a task hangs, the core hangs, a fault of the core | servo and shutter let go, restart in time, cause and words in the next log |
//! | power cut | parameters always whole, the log loses the last record at most (`power.rs`) |

mod common;
mod logs;
mod power;
mod restart;
mod scan;
