//! Interpolation in one and two variables, bracketed roots, and the reading of numeric tables.
//!
//! * [`UniformCubic`], [`UniformGrid`]: cubic Hermite on uniform nodes, slopes from differences of fourth
//!   order, so that the error falls with the fourth power of the step. Look-up costs no search.
//! * [`Monotone`]: shape-preserving cubic on arbitrary knots (Fritsch and Butland).
//! * [`log_near`], [`Power`]: logarithm and power by a series around an [`Anchor`].
//! * [`bracketed_root`]: safeguarded secant. [`table`]: text to columns.
//!
//! Outside its nodes every interpolant holds the value of its end.

mod anchor;
mod monotone;
mod root;
pub mod table;
mod uniform;

pub use anchor::{Anchor, Power, log_near};
pub use monotone::{Monotone, Place};
pub use root::{Bracket, Root, RootStatus, bracketed_root};
pub use uniform::{Sample, UniformCubic, UniformGrid};
