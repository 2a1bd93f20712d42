//! Optimal guidance by lossless convexification: a least-fuel motion of the point mass under the engine's
//! thrust band, found in a few milliseconds by a second-order cone program, or the next best motion if there
//! is none.
//!
//! ```text
//! Problem ─► flight time (bisection) ─► transcription ─► conic solver ─► verification ─► Trajectory
//!                                                                        │ rejected
//!            ladder: previous plan ─► wider glide slope ─► least landing error ─► quintic ─► ramps
//! ```
//!
//! [`plan`] is a pure function of its arguments and always returns a motion; [`Plan::rung`] says which. Its
//! cost is bounded by the number of solves and their greatest number of iterations, never by a clock.

mod problem;

pub mod conic;

mod transcription;

pub mod flight_time;
pub mod verification;

mod closed_form;
mod plan;

mod ladder;

pub use flight_time::Effort;
pub use ladder::plan;
pub use plan::{Plan, PlanRequest, Rung, Settings};
pub use problem::{Engine, GlideSlope, Limits, Problem, Refusal, Start, THRUST_FLOOR_SHARE, Target};
pub use transcription::{Motion, Objective, program};
pub use verification::{FixedTimeSolution, solve};
