//! `hopbench-hil`: everything that touches the world.
#![allow(missing_docs)]
pub mod command;
pub mod load;
