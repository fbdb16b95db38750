//! Floor 2. The observers, one law a file, its paper and equations at the head.

mod collection;
mod low_power;
mod peaking_free;
mod reduced_order;
mod sampled_data;
mod standard;

pub use collection::{CopyState, ModifiedObserver, RepelledCollection};
pub use low_power::{LowPower, LowPowerObserver, LowPowerState};
pub use peaking_free::PeakingFreeObserver;
pub use reduced_order::{ReducedOrderObserver, ReducedOrderState};
pub use sampled_data::SampledDataObserver;
pub use standard::StandardObserver;

pub use crate::saturation::{HardClip, NoSaturation, Saturation, SmoothSaturation};

use crate::Scalar;
use crate::error::{DesignError, finite};
use nalgebra::SVector;

/// Orders that the package is built and tested for.
pub const MAX_ORDER: usize = 12;

/// Coefficients that are finite, for an order within 1 to [`MAX_ORDER`].
fn checked<T: Scalar, const N: usize>(
    name: &'static str,
    k: [T; N],
) -> Result<SVector<T, N>, DesignError> {
    crate::error::require(
        "n",
        T::from_f64(N as f64),
        (1..=MAX_ORDER).contains(&N),
        "the order must be 1 to 12",
    )?;
    for entry in k {
        finite(name, entry)?;
    }
    Ok(SVector::from_fn(|i, _| k[i]))
}

/// Coefficients with powers of the gain ℓ folded in, which the precision must be able to hold.
fn folded<T: Scalar, const N: usize>(
    k: SVector<T, N>,
    ell: T,
) -> Result<SVector<T, N>, DesignError> {
    let allowed = "its powers times the coefficients must be finite in the chosen precision";
    let fits = k.iter().all(|k| k.is_finite());
    crate::error::require("ell", ell, fits, allowed).map(|_| k)
}

/// A x̂: the chain of integrators ẋᵢ = xᵢ₊₁.
#[inline(always)]
fn chain<T: Scalar, const N: usize>(x: &SVector<T, N>) -> SVector<T, N> {
    SVector::from_fn(|i, _| if i + 1 < N { x[i + 1] } else { T::NEG_ZERO })
}

/// Staggered sweep of a chain: xᵢ⁺ += dt·(xᵢ₊₁⁺ − xᵢ₊₁), from the bottom up.
#[inline(always)]
fn stagger_chain<T: Scalar, const N: usize>(
    old: &SVector<T, N>,
    mut new: SVector<T, N>,
    dt: T,
) -> SVector<T, N> {
    for i in (1..N).rev() {
        let moved = dt * (new[i] - old[i]);
        new[i - 1] += moved;
    }
    new
}
