//! The emulated board as a thing to plug into: its telemetry ports as pseudo-terminals of this machine.
//!
//! Virtual time keeps to the clock on the wall, but runs ahead while a simulator talks on TELEM2: there every answer is waited
//! for, and the sooner it comes the better.

use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use adit_firmware::io::{Inputs, Outputs};
use adit_hil_sim::command::MissionFile;
use adit_hil_sim::flight::Board as _;
use adit_hil_sim::scene::Wall;
use adit_hil_sim::world::{PilotAction, World};
use anyhow::{Context, Result};
use serialport::{SerialPort, TTYPort};

use crate::EmulatedBoard;

/// One step of virtual time.
const STEP: Duration = Duration::from_millis(1);
/// Virtual time may run ahead for this long after something was said on TELEM2.
const TALKING: Duration = Duration::from_millis(20);
/// A terminal that nobody reads is written to no longer than this at a time.
const WRITE: Duration = Duration::from_millis(1);

/// Which ports to offer, as links to be made at these places.
#[derive(Clone, Debug, Default)]
pub struct Ports {
    /// The autopilot's.
    pub telem1: Option<PathBuf>,
    /// A simulator's.
    pub telem2: Option<PathBuf>,
}

/// A pseudo-terminal with a link to its far end.
struct Terminal {
    near: TTYPort,
    /// Held open, so that the near end does not break whenever a program at the far end closes it.
    _far: TTYPort,
    link: PathBuf,
}

impl Terminal {
    fn new(link: &Path) -> Result<Self> {
        let (mut near, far) = TTYPort::pair().context("cannot make a pseudo-terminal")?;
        near.set_timeout(WRITE).context("pseudo-terminal")?;
        let name = far.name().context("the pseudo-terminal has no name")?;
        // A link that an earlier run left behind is replaced; a file is not.
        if link.is_symlink() {
            std::fs::remove_file(link).with_context(|| format!("cannot replace {}", link.display()))?;
        }
        std::os::unix::fs::symlink(&name, link).with_context(|| format!("cannot make link {}", link.display()))?;
        Ok(Self { near, _far: far, link: link.to_owned() })
    }

    fn read(&mut self) -> Result<Vec<u8>> {
        let waiting = self.near.bytes_to_read().context("pseudo-terminal")? as usize;
        let mut bytes = vec![0; waiting];
        self.near.read_exact(&mut bytes).context("pseudo-terminal")?;
        Ok(bytes)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        match self.near.write_all(bytes) {
            // Nobody reads: as on a wire, what is not taken is lost.
            Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock) => Ok(()),
            other => other.context("pseudo-terminal"),
        }
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        // The link goes with the terminal; one that is gone already is no loss.
        let _ = std::fs::remove_file(&self.link);
    }
}

/// A vehicle that hovers at the tunnel's mouth, with the board in it.
#[derive(Debug)]
pub struct Hovering {
    world: World,
    senses: Inputs,
}

impl Hovering {
    /// In the mission's tunnel, with the mission's faults.
    ///
    /// # Errors
    /// If the tunnel cannot be built.
    pub fn new(file: &MissionFile) -> Result<Self> {
        let (survey, simulation) = (&file.mission.survey, &file.simulation);
        let wall = Wall::new(survey.profile.build().context("tunnel")?, &simulation.wall, file.seed)?;
        let world = World::new(wall, &survey.rig, &file.mission.parameters(), simulation, file.seed);
        Ok(Self { world, senses: Inputs::default() })
    }

    /// What the board senses at `now_s`, while it does this.
    pub fn sense(&mut self, now_s: f64, outputs: &Outputs) -> Inputs {
        while self.world.now_s() < now_s {
            self.senses = self.world.step(outputs, PilotAction::default());
        }
        self.senses
    }
}

/// Runs the board as long as `around` says what it senses, which is asked before each step with the board's time in seconds
/// and what the board did at last, and for the first time when the ports are there.
///
/// # Errors
/// If a terminal cannot be made or breaks, or the emulator fails.
pub fn serve(
    board: &mut EmulatedBoard,
    ports: &Ports,
    mut around: impl FnMut(f64, &Outputs) -> Option<Inputs>,
) -> Result<()> {
    let open = |link: &Option<PathBuf>| link.as_deref().map(Terminal::new).transpose();
    let (mut telem1, mut telem2) = (open(&ports.telem1)?, open(&ports.telem2)?);
    let began = Instant::now();
    // How far virtual time has run ahead in all.
    let mut ahead = Duration::ZERO;
    let mut now = Duration::ZERO;
    let mut talking_until = Duration::ZERO;
    let mut outputs = Outputs::default();
    while let Some(inputs) = around(now.as_secs_f64(), &outputs) {
        if let Some(terminal) = &mut telem1 {
            board.say_on_telem1(&terminal.read()?);
        }
        if let Some(terminal) = &mut telem2 {
            let bytes = terminal.read()?;
            if !bytes.is_empty() {
                talking_until = now + TALKING;
            }
            board.say_on_telem2(&bytes);
        }
        now += STEP;
        outputs = board.step(now.as_micros() as u64, &inputs)?;
        let [heard1, heard2] = board.heard().map(<[u8]>::to_vec);
        for (terminal, heard) in [(&mut telem1, heard1), (&mut telem2, heard2)] {
            if let Some(terminal) = terminal {
                terminal.write(&heard)?;
            }
        }
        let lead = now.saturating_sub(ahead + began.elapsed());
        if now < talking_until {
            ahead += lead;
        } else {
            std::thread::sleep(lead);
        }
    }
    Ok(())
}
