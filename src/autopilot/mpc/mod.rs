//! Predictive control as a quadratic program: the program, an interior-point solver, and an independent
//! solver.
//!
//! ```text
//! Problem → interior_point::solve → Solution      in flight: fixed size, no allocation, few microseconds a stage
//!         → oracle::solve         → Solution      general sparse solver: the proof in tests, the fallback in flight
//! ```
//!
//! A program has up to [`MAX_STAGES`] stages of a time-varying affine model with [`STATES`] states and
//! [`INPUTS`] inputs, quadratic costs on state, input and change of input, limits on input and its change,
//! and soft limits on two states that stand for tilt. What state and input mean is the caller's; so is
//! the scaling, which should bring every number that matters near one.

#![allow(clippy::needless_range_loop)] // in linear algebra several arrays run along one index

pub mod model;

pub mod problem;
pub mod riccati;

pub mod interior_point;
pub mod oracle;

pub use interior_point::Workspace;
pub use model::{CostToGo, INPUTS, Linear, STATES, StageCost};
pub use problem::{MAX_STAGES, Problem, Settings, Solution, Stage, Status, TILT, Tilt};
pub use riccati::{InfiniteHorizon, dare};
