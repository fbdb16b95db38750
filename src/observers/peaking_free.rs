//! The low-power peaking-free observer, Astolfi, Marconi, Praly and Teel (11).
//!
//! The equations stand in [`super::LowPower`]: (11) is (5) with a saturation from
//! [`crate::saturation`] on the auxiliary states. The estimates x̂ then stay bounded independently
//! of ℓ during the transient, and the auxiliary states grow with ℓ only.

use super::LowPower;

/// The peaking-free observer (11).
pub type PeakingFreeObserver<T, G, Md, S, const N: usize, const M: usize = 0> =
    LowPower<T, G, Md, S, N, M>;
