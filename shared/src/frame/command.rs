//! Encoding of commands on the wire: a number, then the fields.
//!
//! A flow frame is numbered by its kind of sums, so that no byte is spent on a second number: with
//! every field at its extreme, all framing included, it just fits one full-speed USB packet.

use super::message::{Command, Config, Frame, Sums};
use crate::sums::centred::FixedCentredSums;
use crate::sums::pair::FixedPairSums;
use crate::time::Instant;
use core::fmt;
use serde::de::{Deserialize, Deserializer, EnumAccess, Error, VariantAccess, Visitor};
use serde::ser::{Serialize, Serializer};

const HELLO: u32 = 0;
const CONFIG: u32 = 1;
const FRAME_CLOSED_FORM: u32 = 2;
const SETPOINT: u32 = 3;
const JOG: u32 = 4;
const ZERO: u32 = 5;
const STOP: u32 = 6;
const RESET: u32 = 7;
const PING: u32 = 8;
const HOME: u32 = 9;
const MOTORS: u32 = 10;
const FRAME_MIDPOINT: u32 = 11;
const TRIGGER: u32 = 12;

/// Instants of a flow frame and one kind of sums, in this order.
type Parts<S> = (Instant, Instant, S);

impl Serialize for Command {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        const NAME: &str = "Command";
        match self {
            Self::Hello => to.serialize_unit_variant(NAME, HELLO, "Hello"),
            Self::Config(config) => to.serialize_newtype_variant(NAME, CONFIG, "Config", config),
            Self::Frame(frame) => {
                let (capture, reference) = (frame.capture, frame.reference);
                match &frame.sums {
                    Sums::ClosedForm(sums) => to.serialize_newtype_variant(
                        NAME,
                        FRAME_CLOSED_FORM,
                        "FrameClosedForm",
                        &(capture, reference, sums),
                    ),
                    Sums::Midpoint(sums) => to.serialize_newtype_variant(
                        NAME,
                        FRAME_MIDPOINT,
                        "FrameMidpoint",
                        &(capture, reference, sums),
                    ),
                }
            }
            Self::Setpoint { position_um } => {
                to.serialize_newtype_variant(NAME, SETPOINT, "Setpoint", position_um)
            }
            Self::Jog { distance_um } => {
                to.serialize_newtype_variant(NAME, JOG, "Jog", distance_um)
            }
            Self::Zero => to.serialize_unit_variant(NAME, ZERO, "Zero"),
            Self::Stop => to.serialize_unit_variant(NAME, STOP, "Stop"),
            Self::Reset => to.serialize_unit_variant(NAME, RESET, "Reset"),
            Self::Ping { host_us } => to.serialize_newtype_variant(NAME, PING, "Ping", host_us),
            Self::Home { axes } => to.serialize_newtype_variant(NAME, HOME, "Home", axes),
            Self::Motors { on } => to.serialize_newtype_variant(NAME, MOTORS, "Motors", on),
            Self::Trigger(trigger) => {
                to.serialize_newtype_variant(NAME, TRIGGER, "Trigger", trigger)
            }
        }
    }
}

impl<'de> Deserialize<'de> for Command {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        from.deserialize_enum("Command", &[], Numbered)
    }
}

struct Numbered;

impl<'de> Visitor<'de> for Numbered {
    type Value = Command;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a command")
    }

    fn visit_enum<A: EnumAccess<'de>>(self, data: A) -> Result<Command, A::Error> {
        let (number, fields) = data.variant::<u32>()?;
        let plain = match number {
            HELLO => Command::Hello,
            ZERO => Command::Zero,
            STOP => Command::Stop,
            RESET => Command::Reset,
            _ => return with_fields(number, fields),
        };
        fields.unit_variant().map(|()| plain)
    }
}

fn with_fields<'de, V: VariantAccess<'de>>(number: u32, fields: V) -> Result<Command, V::Error> {
    Ok(match number {
        CONFIG => Command::Config(fields.newtype_variant::<Config>()?),
        FRAME_CLOSED_FORM => {
            let (capture, reference, sums) = fields.newtype_variant::<Parts<FixedPairSums>>()?;
            Command::Frame(Frame {
                capture,
                reference,
                sums: Sums::ClosedForm(sums),
            })
        }
        FRAME_MIDPOINT => {
            let (capture, reference, sums) = fields.newtype_variant::<Parts<FixedCentredSums>>()?;
            Command::Frame(Frame {
                capture,
                reference,
                sums: Sums::Midpoint(sums),
            })
        }
        SETPOINT => Command::Setpoint {
            position_um: fields.newtype_variant()?,
        },
        JOG => Command::Jog {
            distance_um: fields.newtype_variant()?,
        },
        PING => Command::Ping {
            host_us: fields.newtype_variant()?,
        },
        HOME => Command::Home {
            axes: fields.newtype_variant()?,
        },
        MOTORS => Command::Motors {
            on: fields.newtype_variant()?,
        },
        TRIGGER => Command::Trigger(fields.newtype_variant()?),
        _ => return Err(V::Error::custom("no such command")),
    })
}
