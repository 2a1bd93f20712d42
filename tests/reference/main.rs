//! Against other codes and published figures; the data of other codes lies beside the tests.

#[path = "../fixture/mod.rs"]
mod fixture;

mod basilisk;
mod combustion;
mod engine;
mod environment;
mod feed;
mod fluid;
mod gas_balance;
mod lcvx;
mod manifold;
mod motion;
mod mpc;
mod open_loop;
mod paper_mode;
mod scipy;
mod slosh;
mod vehicles;
