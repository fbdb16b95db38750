//! Floor 2. The observers, one law a file, its paper and equations at the head.

mod collection;
mod low_power;
mod peaking_free;
mod reduced_order;
mod sampled_data;
mod standard;

pub use collection::{CopyState, ModifiedObserver, ModifiedState, RepelledCollection};
pub use low_power::{BlockGains, LowPower, LowPowerObserver, LowPowerState};
pub use peaking_free::PeakingFreeObserver;
pub use reduced_order::{ReducedOrderObserver, ReducedOrderState};
pub use sampled_data::SampledDataObserver;
pub use standard::{StandardObserver, StandardState};

pub use crate::saturation::{HardClip, NoSaturation, Saturation, SmoothSaturation};

use crate::Scalar;
use crate::error::{DesignError, finite};
use crate::gain::GainLaw;
use crate::memory::Memory;
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

/// Coefficient i times ℓ to the power of `exponent(i)`, which the precision must be able to hold.
fn folded<T: Scalar, const N: usize>(
    k: &SVector<T, N>,
    ell: T,
    exponent: impl Fn(usize) -> usize,
) -> Result<SVector<T, N>, DesignError> {
    let allowed = "its powers times the coefficients must be finite, and not 0, in the chosen \
                   precision";
    let products: SVector<T, N> = SVector::from_fn(|i, _| k[i] * ell.powi(exponent(i)));
    let held =
        |(k, product): (&T, &T)| product.is_finite() && (*product != T::ZERO || *k == T::ZERO);
    let fits = k.iter().zip(products.iter()).all(held);
    crate::error::require("ell", ell, fits, allowed).map(|_| products)
}

/// Coefficients that [`folded`] turns into `products` again, bit for bit: a quotient that does not
/// give its product back is one rounding off, and moved by it.
#[cfg(feature = "serde")]
fn unfolded<T: Scalar, const N: usize>(
    products: &SVector<T, N>,
    ell: T,
    exponent: impl Fn(usize) -> usize,
) -> SVector<T, N> {
    SVector::from_fn(|i, _| {
        let (product, power) = (products[i], ell.powi(exponent(i)));
        let k = product / power;
        if k * power == product { k } else { k + (product - k * power) / power }
    })
}

/// A x̂: the chain of integrators ẋᵢ = xᵢ₊₁.
#[inline(always)]
fn chain<T: Scalar, const N: usize>(x: &SVector<T, N>) -> SVector<T, N> {
    SVector::from_fn(|i, _| if i + 1 < N { x[i + 1] } else { T::NEG_ZERO })
}

/// What of the gain's rate is due to the innovation.
#[inline(always)]
fn driven<T: Scalar, G: GainLaw<T>, const N: usize>(
    gain: &G,
    memory: &G::Memory,
    e: T,
) -> G::Memory {
    gain.rate::<N>(memory, e).zip(&gain.rate::<N>(memory, T::ZERO), |rate, free| rate - free)
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
