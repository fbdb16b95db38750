//! Floor 3. The systems that Python can name: what an observer knows, and the plants.

use crate::error::Result;
use crate::spec::Spec;
use hgo_rs::Scalar;
use hgo_rs::model::{InputGain, Model, PhaseVariable, last, no_input};
use hgo_rs::models::{Correction, Crackle, Diffusion, Lee, SanfelicePraly, Ship, VanDerPol};
use nalgebra::SVector;

/// The model that an observer knows, chosen at run time; its order was checked against the
/// observer's when it was built.
#[derive(Clone, Copy)]
pub enum AnyModel<T = f64> {
    /// Nothing.
    Unknown,
    /// Its input.
    Input(InputGain<T>),
    /// Lee, Choi and Khalil.
    Lee(Lee),
    /// Sanfelice and Praly.
    SanfelicePraly(SanfelicePraly<T>),
    /// Fu, Kang and Li.
    VanDerPol(VanDerPol<T>),
    /// Astolfi, Marconi, Praly and Teel.
    Crackle(Crackle<T>),
}

/// The first K entries of x̂.
#[inline(always)]
fn head<T: Scalar, const K: usize, const N: usize>(x: &SVector<T, N>) -> SVector<T, K> {
    SVector::from_fn(|i, _| if i < N { x[i] } else { T::ZERO })
}

impl<T: Scalar, S: Scalar + From<T>, const N: usize> Model<S, N, 1> for AnyModel<T> {
    #[inline(always)]
    fn f_hat(&self, t: S, x: &SVector<S, N>, u: &SVector<S, 1>) -> SVector<S, N> {
        match self {
            Self::SanfelicePraly(_) => self.known_vector(t, x),
            _ => last(self.phi(t, x, u)),
        }
    }
}

impl<T: Scalar, S: Scalar + From<T>, const N: usize> PhaseVariable<S, N, 1> for AnyModel<T> {
    #[inline(always)]
    fn phi(&self, t: S, x: &SVector<S, N>, u: &SVector<S, 1>) -> S {
        match self {
            Self::Unknown | Self::SanfelicePraly(_) => S::NEG_ZERO,
            Self::Input(model) => model.phi(t, x, u),
            Self::Lee(_) | Self::VanDerPol(_) | Self::Crackle(_) => self.known(t, x),
        }
    }
}

// Apart, so that a law under a scheme of many stages holds no model many times.
impl<T: Scalar> AnyModel<T> {
    #[inline(never)]
    fn known_vector<S, const N: usize>(&self, t: S, x: &SVector<S, N>) -> SVector<S, N>
    where
        S: Scalar + From<T>,
    {
        match self {
            Self::SanfelicePraly(model) => head(&model.f_hat(t, &head(x), &no_input())),
            _ => last(S::NEG_ZERO),
        }
    }

    #[inline(never)]
    fn known<S: Scalar + From<T>, const N: usize>(&self, t: S, x: &SVector<S, N>) -> S {
        match self {
            Self::Lee(model) => model.phi(t, &head(x), &no_input()),
            Self::VanDerPol(model) => model.phi(t, &head(x), &no_input()),
            Self::Crackle(model) => model.phi(t, &head(x), &no_input()),
            Self::Unknown | Self::Input(_) | Self::SanfelicePraly(_) => S::NEG_ZERO,
        }
    }
}

impl<T: Scalar> AnyModel<T> {
    /// The model that a spec names.
    pub fn read(spec: &Spec<'_>) -> Result<Self> {
        let kind = spec.text("kind")?;
        Ok(match kind.as_str() {
            "none" => {
                spec.only(&["kind"])?;
                Self::Unknown
            }
            "input" => {
                spec.only(&["kind", "b0"])?;
                let b0 = hgo_rs::error::finite("b0", spec.f64("b0")?)?;
                Self::Input(InputGain { b0: T::from_f64(b0) })
            }
            "lee" => Self::Lee(read_lee(spec)?),
            "sanfelice-praly" => Self::SanfelicePraly(read_sanfelice_praly(spec)?),
            "van-der-pol" => Self::VanDerPol(read_van_der_pol(spec, Correction::Derived)?),
            "crackle" => Self::Crackle(read_crackle(spec)?),
            other => {
                let known = ["none", "input", "lee", "sanfelice-praly", "van-der-pol", "crackle"];
                return Err(spec.unknown("kind", other, &known));
            }
        })
    }

    /// Order of the system, if the model fits one order only.
    pub fn order(&self) -> Option<usize> {
        match self {
            Self::Unknown | Self::Input(_) => None,
            Self::Lee(_) | Self::SanfelicePraly(_) | Self::VanDerPol(_) => Some(2),
            Self::Crackle(_) => Some(5),
        }
    }
}

/// The plant of Lee, Choi and Khalil.
pub fn read_lee(spec: &Spec<'_>) -> Result<Lee> {
    spec.only(&["kind"])?;
    Ok(Lee)
}

/// The plant of Sanfelice and Praly.
pub fn read_sanfelice_praly<T: Scalar>(spec: &Spec<'_>) -> Result<SanfelicePraly<T>> {
    spec.only(&["kind", "nu1", "nu2"])?;
    let [nu1, nu2] = [spec.f64("nu1")?, spec.f64_or("nu2", 0.1)?].map(T::from_f64);
    Ok(SanfelicePraly::new(nu1, nu2)?)
}

/// The plant of Fu, Kang and Li, with a form of its correction term.
pub fn read_van_der_pol<T: Scalar>(
    spec: &Spec<'_>,
    correction: Correction,
) -> Result<VanDerPol<T>> {
    spec.only(&["kind", "epsilon", "sigma", "multiplicative"])?;
    let diffusion = if spec.flag_or("multiplicative", false)? {
        Diffusion::Multiplicative
    } else {
        Diffusion::Additive
    };
    let (epsilon, sigma) = (spec.f64_or("epsilon", 0.8)?, spec.f64_or("sigma", 0.5)?);
    let [epsilon, sigma] = [epsilon, sigma].map(T::from_f64);
    Ok(VanDerPol::new(epsilon, sigma, diffusion, correction)?)
}

/// The plant of order 5 of Astolfi, Marconi, Praly and Teel.
pub fn read_crackle<T: Scalar>(spec: &Spec<'_>) -> Result<Crackle<T>> {
    spec.only(&["kind", "phi_max"])?;
    Ok(Crackle::new(T::from_f64(spec.f64_or("phi_max", 3.0)?))?)
}

/// The ship of Katayama.
pub fn read_ship<T: Scalar>(spec: &Spec<'_>) -> Result<Ship<T>> {
    spec.only(&["kind", "delta", "w"])?;
    let w = if spec.has("w") { spec.vector::<3>("w", 3)? } else { [0.0; 3] };
    Ok(Ship::new(T::from_f64(spec.f64_or("delta", 0.0)?), w.map(T::from_f64))?)
}

/// The papers' plants.
#[derive(Clone, Copy)]
pub enum AnyPlant<T = f64> {
    /// Lee, Choi and Khalil.
    Lee(Lee),
    /// Sanfelice and Praly.
    SanfelicePraly(SanfelicePraly<T>),
    /// Fu, Kang and Li.
    VanDerPol(VanDerPol<T>),
    /// Astolfi, Marconi, Praly and Teel.
    Crackle(Crackle<T>),
    /// Katayama.
    Ship(Ship<T>),
    /// One of the user's own.
    Own,
}

impl<T: Scalar> AnyPlant<T> {
    /// The plant that a spec names.
    pub fn read(spec: &Spec<'_>) -> Result<Self> {
        let kind = spec.text("kind")?;
        Ok(match kind.as_str() {
            "lee" => Self::Lee(read_lee(spec)?),
            "sanfelice-praly" => Self::SanfelicePraly(read_sanfelice_praly(spec)?),
            "van-der-pol" => Self::VanDerPol(read_van_der_pol(spec, Correction::Derived)?),
            "crackle" => Self::Crackle(read_crackle(spec)?),
            "ship" => Self::Ship(read_ship(spec)?),
            "own-plant" => Self::Own,
            other => {
                let known =
                    ["lee", "sanfelice-praly", "van-der-pol", "crackle", "ship", "own-plant"];
                return Err(spec.unknown("kind", other, &known));
            }
        })
    }
}
