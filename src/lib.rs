#![doc = include_str!("../README.md")]
//!
//! # Notation
//!
//! | symbol | name here | meaning |
//! |---|---|---|
//! | ℓ, 1/ε, r | `ell`, `epsilon`, `r` | the high gain in 1/s; r where a law moves it |
//! | n | `N` | order: number of estimated states |
//! | x, x̂ | `x`, `x_hat` | state and estimate |
//! | y, ŷ = x̂₁ | `y` | measured output and its estimate |
//! | e = y − x̂₁ | `innovation` | what a sample tells |
//! | kᵢ, K | `k` | injection coefficients of the standard law |
//! | αᵢ, βᵢ, ηᵢ | `alpha`, `beta`, `eta` | coefficients and auxiliary states of the low-power law |
//! | φ, f̂ | `phi`, `f_hat` | what the observer knows of the system |
//! | T, a(k) | `dt` | length of a step in s |
//! | z | `z` | an observer's memory: x̂ and whatever else it moves |
//!
//! # Floors
//!
//! A file uses lower floors only, or what is named before it on its own: `elementary`,
//! `scalar`, `error`, `memory`, `measurement`, `wide`, `polynomial` (0); `dual`, `factor`, `shape`, `gain`, `schedule`, `saturation`, `model`, `laws`,
//! `integrate`, `observer`, `motion`, `injection`, `inter_sample`, `noise`, `metrics`, `program` (1); `models`,
//! `observers` (2); `simulate`, `covariance`, `estimator`, `turn` (3). Nothing names `std`, `alloc` or
//! Python, nothing allocates and nothing panics.
#![cfg_attr(not(feature = "std"), no_std)]

#[cfg(not(any(feature = "std", feature = "libm")))]
compile_error!("hgo-rs needs feature `std` (default) or, without std, feature `libm`");

pub mod covariance;
pub mod dual;
pub mod elementary;
pub mod error;
pub mod estimator;
pub mod factor;
pub mod gain;
pub mod injection;
pub mod integrate;
pub mod inter_sample;
pub mod laws;
pub mod measurement;
pub mod memory;
pub mod metrics;
pub mod model;
pub mod models;
pub mod motion;
pub mod noise;
pub mod observer;
pub mod observers;
pub mod polynomial;
pub mod program;
pub mod saturation;
pub mod scalar;
pub mod schedule;
pub mod shape;
pub mod simulate;
pub mod turn;
mod wide;

/// The examples of the documentation, run as tests.
#[cfg(doctest)]
mod pages {
    #[doc = include_str!("../docs/architecture.md")]
    mod architecture {}
    #[doc = include_str!("../docs/rust.md")]
    mod rust {}
    #[doc = include_str!("../firmware/README.md")]
    mod firmware {}
}

pub use error::DesignError;
pub use estimator::Estimator;
pub use nalgebra;
pub use observer::{Observer, Status, Timing};
pub use scalar::Scalar;

/// What most programs need: `use hgo_rs::prelude::*;`
pub mod prelude {
    pub use crate::error::DesignError;
    pub use crate::estimator::Estimator;
    pub use crate::gain::{
        AdaptiveGain, ConstantGain, DeadZoneGain, HomogeneousGain, PrescribedTimeGain, Shaped,
        SwitchedGain,
    };
    pub use crate::injection::{Placed, Placement};
    pub use crate::integrate::{Integrator, PlantScheme};
    pub use crate::memory::Memory;
    pub use crate::metrics::{Moments, Window};
    pub use crate::model::{InputGain, Model, PhaseVariable, Plant, Unknown, last, no_input};
    pub use crate::motion::{Held, ImplicitMotion, Motion, Rk4Motion};
    pub use crate::noise::{Channel, Draw, Noise, Stream};
    pub use crate::observer::{
        Causal, Current, Discretisation, Discretised, Euler, Hold, Observer, RungeKutta,
        StaggeredEuler, Status,
    };
    pub use crate::observers::{
        HardClip, HighGainEkf, LowPower, LowPowerObserver, ModifiedObserver, NoSaturation,
        PeakingFreeObserver, ReducedOrderObserver, RepelledCollection, SampledDataObserver,
        SampledEkf, SmoothSaturation, StandardObserver,
    };
    pub use crate::polynomial::{coefficients_from_poles, low_power_coefficients_from_poles};
    pub use crate::scalar::Scalar;
    pub use crate::schedule::{FixedStep, Schedule, StochasticApproximation};
    pub use crate::simulate::{Experiment, RunMetrics};
    pub use crate::turn::{Turn, Wrapped};
}
