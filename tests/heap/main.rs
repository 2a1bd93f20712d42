//! Nothing asks the allocator for memory while it flies. A program of its own: the allocator is replaced by
//! one that counts.

#[path = "../fixture/mod.rs"]
mod fixture;

mod flight;
mod mpc;
