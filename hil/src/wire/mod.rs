//! The wire: bytes and what they mean.
//!
//! Bytes move in [`link`], mean something in [`mavlink`], and suffer in between what `disruption` says. What
//! comes in is handed on as controls, status and `request`s, in words of no protocol. Which messages a flight
//! controller is sent, and when, is data in [`profile`] and is put together in [`stream`]; acknowledgements
//! and texts wait their turn in `reply`. [`port`] knows the serial ports of this machine.
//!
//! A link knows no message, and a codec is a pure function of bytes.

pub mod port;

pub mod link;
pub mod mavlink;

pub(crate) mod disruption;
pub(crate) mod failure;

pub mod profile;
pub(crate) mod request;

pub(crate) mod reply;
pub mod stream;

pub(crate) mod fc_link;
