//! The wire: bytes and what they mean.
//!
//! Bytes move in [`link`], mean something in [`mavlink`], and suffer in between what [`disruption`] says. Which of
//! them a flight controller is sent, and when, is data in [`profile`] and is put together in [`stream`]; answers and texts
//! wait their turn in [`reply`]. [`port`] knows the serial ports of this machine.
//!
//! A link knows no message, and a codec is a pure function of bytes.

pub mod port;

pub mod link;
pub mod mavlink;

pub mod disruption;

pub mod profile;
pub mod reply;
pub mod stream;
