//! Recorded logs as text: blocks of lines become columns, columns become lines.
//!
//! A cell is a number, a date, or a time of day. Numbers are rounded correctly: the bits are those of any
//! other correct parser. A line that is malformed is an error that names its place; none is passed over
//! but blank ones and comments.
//!
//! # Floors
//!
//! `cells`, `write` (0); `rows` (1). A file imports lower floors only.

mod cells;
mod rows;
mod write;

pub use cells::{MISSING, Sign, daytime, is_missing, moment, number};
pub use rows::{Column, Fault, Kind, LINE, Layout, Reader, Rows, Values, What, cells_of, is_idle};
pub use write::{Cells, append};
