//! High-gain observers of the literature, one definition each.
#![cfg_attr(not(feature = "std"), no_std)]

#[cfg(not(any(feature = "std", feature = "libm")))]
compile_error!("hgo-rs needs feature `std` (default) or, without std, feature `libm`");

pub mod covariance;
pub mod error;
pub mod gain;
pub mod integrate;
pub mod memory;
pub mod metrics;
pub mod model;
pub mod models;
pub mod noise;
pub mod observer;
pub mod observers;
pub mod polynomial;
#[cfg(feature = "python")]
mod python;
pub mod scalar;
pub mod schedule;
pub mod simulate;

pub use error::DesignError;
pub use observer::{Observer, Status, Timing};
pub use scalar::Scalar;
