//! The laws of `hgo_rs`, written down as tables of operations.
//!
//! A law of the core is run once over [`trace::Traced`] numbers, which remember how they were computed:
//! what comes out is a [`table::Table`], operations in order, each value computed once, with the law's
//! bits. A model of the user's own is a table too, and stands within the law's. Tables are compiled for
//! the core's interpreter, run, or handed on to be printed. The core's elementary functions are printed by
//! [`elementary`].
//!
//! Specs are plain data ([`Value`]), from Python's objects or from a TOML file; what is refused, and what
//! a user's function raises, is an [`Error`]. Nothing here knows Python.
//!
//! # Floors
//!
//! A file imports lower floors only, and of other crates `hgo_rs`: `error` (0); `value`, `order`,
//! `vectors`, `sparing` (1); `spec`, `design` (2); `table`, `choices`, `systems` (3); `trace`, `compile`,
//! `elementary`, `recursion` (4); `tabled`, `derivative`, `record` (5); `model`, `tables`, `joint` (6); `step` (7); `laws`, `called` (8);
//! `observer`, `live` (9); `study`, `config` (10); `llvm` (11). Files of a folder may lie lower than the folder.

// Every error here is an `Error`, which says what it is about.
#![allow(clippy::missing_errors_doc)]

mod called;
pub mod choices;
pub mod compile;
#[cfg(feature = "toml")]
pub mod config;
pub mod derivative;
pub mod design;
pub mod elementary;
pub mod error;
mod joint;
mod laws;
pub mod live;
pub mod llvm;
mod model;
pub mod observer;
pub mod order;
pub mod record;
pub mod recursion;
pub mod sparing;
pub mod spec;
mod step;
pub mod study;
pub mod systems;
pub mod table;
mod tabled;
pub mod tables;
pub mod trace;
pub mod value;
pub mod vectors;

pub use error::{Error, Result};
pub use order::{CHAINS, MAX_INPUTS};
pub use spec::Spec;
pub use value::{Function, Numbers, Value};
