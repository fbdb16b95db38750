//! The laws of `hgo_rs` as tables of operations.
pub mod called;
pub mod choices;
pub mod compile;
pub mod error;
pub mod order;
pub mod recursion;
pub mod spec;
pub mod systems;
pub mod table;
pub mod tabled;
pub mod tables;
pub mod trace;
pub mod value;

pub use error::{Error, Result};
pub use spec::Spec;
pub use value::{Function, Numbers, Value};
