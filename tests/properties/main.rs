//! What holds for every design, every observer, every sample: properties, tried on random cases.

#![allow(clippy::float_cmp)] // where two numbers are compared for equality, equal bits are meant

#[path = "../catalogue/mod.rs"]
mod catalogue;
mod designs;
mod gains;
mod laws;
mod memories;
mod metrics;
mod polynomials;
mod samples;
mod saturations;
mod streams;

use catalogue::{SCHEMES, Visitor, visit_all};
use hgo_rs::gain::{AdaptiveGain, ConstantGain, DeadZoneGain, GainLaw};
use hgo_rs::integrate::{Integrator, PlantScheme, StochasticIntegrator};
use hgo_rs::memory::Memory;
use hgo_rs::metrics::{LogHistogram, Moments, SettlingTime, Window};
use hgo_rs::model::{InputGain, StrictFeedback, Unknown, no_input};
use hgo_rs::models::{Crackle, Diffusion, Lee, SanfelicePraly, Ship, VanDerPol};
use hgo_rs::noise::{Channel, Draw, Noise, SecondOrderSections, Sine, Stream};
use hgo_rs::observer::{ContinuousLaw, Discretisation, Discretised, Euler, Measurement};
use hgo_rs::observers::{
    HardClip, LowPowerObserver, ModifiedObserver, NoSaturation, ReducedOrderObserver,
    RepelledCollection, Saturation, SmoothSaturation, StandardObserver,
};
use hgo_rs::polynomial::{
    coefficients_from_poles, is_hurwitz, low_power_coefficients, low_power_coefficients_from_poles,
    low_power_polynomial,
};
use hgo_rs::schedule::{FixedStep, Schedule, StochasticApproximation};
use hgo_rs::simulate::{DIVERGED, Experiment, Probe, RunMetrics, Sample};
use hgo_rs::{DesignError, Observer, Scalar, Status};
use nalgebra::{SMatrix, SVector, Vector2, Vector3};
use proptest::prelude::*;
use std::fmt::Debug;

fn config(cases: u32) -> ProptestConfig {
    let cases = if cfg!(debug_assertions) { cases / 4 } else { cases };
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

fn close(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance * b.abs().max(1e-300)
}
