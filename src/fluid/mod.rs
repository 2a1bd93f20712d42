//! The two fluids of the vehicle, from tables of their reference equations of state.
//!
//! [`Nitrous`]: saturation line, compressed liquid, isentropes through the two-phase dome. [`Nitrogen`]: real
//! gas as a function of pressure. [`RealGas`] and [`NitrousVapor`]: gas as a function of density. The tables
//! are made by `tools/reference/make_fluid_tables.py`, committed, and read once.

mod nitrogen;
mod nitrous;

mod gas;

pub use gas::{GasPoint, Interface, NitrousVapor, RealGas};
pub use nitrogen::{Isotherm, Nitrogen};
pub use nitrous::{CriticalFlow, Liquid, Nitrous, Saturation, Stagnation};
