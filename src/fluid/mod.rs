//! The two fluids of the vehicle, from tables of their reference equations of state.
//!
//! [`Nitrous`]: saturation line, compressed liquid, isentropes through the two-phase dome.
//! [`Nitrogen`]: real gas over pressure. [`RealGas`] and [`NitrousVapor`]: over density. The tables are made by `tools/reference/make_fluid_tables.py`, committed, and
//! read once.

mod gas;
mod nitrogen;
mod nitrous;

pub use gas::{GasPoint, Interface, NitrousVapor, RealGas};
pub use nitrogen::{Isotherm, Nitrogen};
pub use nitrous::{Critical, Liquid, Nitrous, Saturation, Stagnation};
