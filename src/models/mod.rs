//! Floor 2. The papers' plants, one file each, and what their observers know of them.

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
