//! The two fluids of the vehicle, from tables of their reference equations of state.
//!
//! [`Nitrous`]: saturation line, compressed liquid, isentropes through the two-phase dome.
//! [`Nitrogen`]: real gas. The tables are made by `tools/reference/make_fluid_tables.py`, committed, and
//! read once.

mod nitrogen;
mod nitrous;

pub use nitrogen::{Isotherm, Nitrogen};
pub use nitrous::{Critical, Liquid, Nitrous, Saturation, Stagnation};
