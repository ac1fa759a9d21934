//! Live cameras and the station for a workbench.

use super::ServoError;
use super::station_link::StationLink;
use super::triggering::{TriggerWatch, Triggering};
use super::workbench::{Bench, Shot};
use std::sync::mpsc::Receiver;
use trinocular_core::time::Instant;
use trinocular_vision::images::FrameSet;
use trinocular_vision::images::cameras::live::LiveCameras;
use trinocular_vision::images::cameras::stamp::offset_us;

/// Clock of the capture times.
#[derive(Debug)]
enum Clock {
    /// A clock of this computer.
    Host {
        /// The link's clock minus that of the capture times, µs.
        offset_us: i64,
    },
    /// The clock of the station, which triggers the cameras.
    Station(TriggerWatch),
}

/// Live cameras for a [workbench](super::workbench). Dropping it ends the triggers.
pub struct CameraBench {
    cameras: LiveCameras,
    station: StationLink,
    clock: Clock,
    /// Events of the cameras and their triggers, in words.
    told: Receiver<String>,
    news: Vec<String>,
}

impl CameraBench {
    /// Makes a bench around a station that has been started and triggers the cameras, if it is to.
    /// `told` gives the words for what happens at the cameras.
    pub fn new(
        cameras: LiveCameras,
        station: StationLink,
        triggering: Option<Triggering>,
        told: Receiver<String>,
    ) -> Self {
        let clock = match triggering {
            Some(triggering) => Clock::Station(TriggerWatch::new(triggering)),
            None => Clock::Host {
                offset_us: offset_us(|| station.now().micros(), || cameras.now_us()),
            },
        };
        Self {
            cameras,
            station,
            clock,
            told,
            news: Vec::new(),
        }
    }

    fn next_images(&mut self) -> Result<Option<FrameSet>, ServoError> {
        match (&mut self.clock, self.station.serial_mut()) {
            (Clock::Station(watch), Some(serial)) => {
                let tell = |news: &str| self.news.push(news.to_owned());
                watch.next_images(serial, &mut self.cameras, tell)
            }
            _ => Ok(self.cameras.next().transpose()?),
        }
    }
}

impl Bench for CameraBench {
    fn next_shot(&mut self) -> Result<Option<Shot>, ServoError> {
        let Some(images) = self.next_images()? else {
            return Ok(None);
        };
        let taken = match self.clock {
            Clock::Host { offset_us } => {
                let here_us = images.time_us.saturating_add_signed(offset_us);
                self.station.station_time(Instant::from_micros(here_us))?
            }
            Clock::Station(_) => Instant::from_micros(images.time_us),
        };
        Ok(Some(Shot { images, taken }))
    }

    fn station(&mut self) -> &mut StationLink {
        &mut self.station
    }

    fn take_news(&mut self) -> Vec<String> {
        self.news.extend(self.told.try_iter());
        std::mem::take(&mut self.news)
    }
}

impl Drop for CameraBench {
    fn drop(&mut self) {
        self.station.end_triggers();
    }
}
