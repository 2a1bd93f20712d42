//! Closed forms.

#[path = "../fixture/mod.rs"]
mod fixture;

mod corrections;
mod motion;
mod mpc;
