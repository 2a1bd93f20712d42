//! What is wrong with this bench: looks at the machine, listens on a link, and names causes.
//!
//! Looking and judging are apart. [`machine::inspect`] and [`listen::listen`] gather a [`Machine`] and an
//! [`Observation`]; [`diagnose_machine`] and [`diagnose`] are pure functions of those. Every [`Finding`] says
//! what is seen, why it happens and what to do; `catalog` has them all.

mod finding;

mod channel;
mod observation;

mod catalog;

mod diagnosis;
pub mod listen;
pub mod machine;

pub use channel::{ChannelUse, MappedChannel, mapped_channels};
pub use diagnosis::diagnose;
pub use finding::{Finding, Severity};
pub use machine::{Machine, diagnose_machine};
pub use observation::{ControlsStatistics, Observation, Sender, Traffic};
