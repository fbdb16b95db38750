//! Floor 2. The papers' plants, one file each, and what their observers know of them.

/// What every plant with y = x₁, no input and all states asked for says the same way, inside its
/// `impl Plant`: $n is its order.
macro_rules! first_state_measured {
    ($n:literal) => {
        type State = nalgebra::SVector<T, $n>;
        type Input = nalgebra::SVector<T, 0>;
        type Output = T;
        const TRUTH: (usize, usize) = (0, $n);
        #[inline(always)]
        fn output(&self, _: T, x: &Self::State, _: &Self::Input) -> T {
            x.x
        }
        #[inline(always)]
        fn truth<'a>(&self, x: &'a Self::State) -> &'a [T] {
            x.as_slice()
        }
        #[inline(always)]
        fn control(&self, _: T, _: &Self::State, _: T) -> Self::Input {
            crate::model::no_input()
        }
    };
}

mod crackle;
mod lee;
mod sanfelice_praly;
mod ship;
mod van_der_pol;

pub use crackle::Crackle;
pub use lee::Lee;
pub use sanfelice_praly::SanfelicePraly;
pub use ship::{Ship, ShipState};
pub use van_der_pol::{Correction, Diffusion, VanDerPol};
