//! The systems that Python can name: what an observer knows, and the plants.

use super::spec::Spec;
use crate::Scalar;
use crate::model::{InputGain, Model, PhaseVariable, last, no_input};
use crate::models::{Correction, Crackle, Diffusion, Lee, SanfelicePraly, Ship, VanDerPol};
use nalgebra::SVector;
use pyo3::prelude::*;

/// The model that an observer knows, chosen at run time; its order was checked against the
/// observer's when it was built.
#[derive(Clone, Copy)]
pub enum AnyModel {
    Unknown,
    Input(InputGain<f64>),
    Lee(Lee),
    SanfelicePraly(SanfelicePraly<f64>),
    VanDerPol(VanDerPol<f64>),
    Crackle(Crackle<f64>),
}

/// The first K entries of x̂.
#[inline(always)]
fn head<const K: usize, const N: usize>(x: &SVector<f64, N>) -> SVector<f64, K> {
    SVector::from_fn(|i, _| if i < N { x[i] } else { 0.0 })
}

impl<const N: usize> Model<f64, N, 1> for AnyModel {
    #[inline(always)]
    fn f_hat(&self, t: f64, x: &SVector<f64, N>, u: &SVector<f64, 1>) -> SVector<f64, N> {
        match self {
            Self::SanfelicePraly(_) => self.known_vector(t, x),
            _ => last(self.phi(t, x, u)),
        }
    }
}

impl<const N: usize> PhaseVariable<f64, N, 1> for AnyModel {
    #[inline(always)]
    fn phi(&self, t: f64, x: &SVector<f64, N>, u: &SVector<f64, 1>) -> f64 {
        match self {
            Self::Unknown | Self::SanfelicePraly(_) => Scalar::NEG_ZERO,
            Self::Input(model) => model.phi(t, x, u),
            Self::Lee(_) | Self::VanDerPol(_) | Self::Crackle(_) => self.known(t, x),
        }
    }
}

// Apart, so that a law under a scheme of many stages holds no model many times.
impl AnyModel {
    #[inline(never)]
    fn known_vector<const N: usize>(&self, t: f64, x: &SVector<f64, N>) -> SVector<f64, N> {
        match self {
            Self::SanfelicePraly(model) => head(&model.f_hat(t, &head(x), &no_input())),
            _ => last(Scalar::NEG_ZERO),
        }
    }

    #[inline(never)]
    fn known<const N: usize>(&self, t: f64, x: &SVector<f64, N>) -> f64 {
        match self {
            Self::Lee(model) => model.phi(t, &head(x), &no_input()),
            Self::VanDerPol(model) => model.phi(t, &head(x), &no_input()),
            Self::Crackle(model) => model.phi(t, &head(x), &no_input()),
            Self::Unknown | Self::Input(_) | Self::SanfelicePraly(_) => Scalar::NEG_ZERO,
        }
    }
}

impl AnyModel {
    pub fn read(spec: &Spec<'_>) -> PyResult<Self> {
        let kind = spec.text("kind")?;
        Ok(match kind.as_str() {
            "none" => {
                spec.only(&["kind"])?;
                Self::Unknown
            }
            "input" => {
                spec.only(&["kind", "b0"])?;
                Self::Input(InputGain { b0: crate::error::finite("b0", spec.f64("b0")?)? })
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

pub fn read_lee(spec: &Spec<'_>) -> PyResult<Lee> {
    spec.only(&["kind"])?;
    Ok(Lee)
}

pub fn read_sanfelice_praly(spec: &Spec<'_>) -> PyResult<SanfelicePraly<f64>> {
    spec.only(&["kind", "nu1", "nu2"])?;
    Ok(SanfelicePraly::new(spec.f64("nu1")?, spec.f64_or("nu2", 0.1)?)?)
}

pub fn read_van_der_pol(spec: &Spec<'_>, correction: Correction) -> PyResult<VanDerPol<f64>> {
    spec.only(&["kind", "epsilon", "sigma", "multiplicative"])?;
    let diffusion = if spec.flag_or("multiplicative", false)? {
        Diffusion::Multiplicative
    } else {
        Diffusion::Additive
    };
    let (epsilon, sigma) = (spec.f64_or("epsilon", 0.8)?, spec.f64_or("sigma", 0.5)?);
    Ok(VanDerPol::new(epsilon, sigma, diffusion, correction)?)
}

pub fn read_crackle(spec: &Spec<'_>) -> PyResult<Crackle<f64>> {
    spec.only(&["kind", "phi_max"])?;
    Ok(Crackle::new(spec.f64_or("phi_max", 3.0)?)?)
}

pub fn read_ship(spec: &Spec<'_>) -> PyResult<Ship<f64>> {
    spec.only(&["kind", "delta", "w"])?;
    let w = if spec.get("w")?.is_some() { spec.vector::<3>("w", 3)? } else { [0.0; 3] };
    Ok(Ship::new(spec.f64_or("delta", 0.0)?, w)?)
}

/// The papers' plants.
#[derive(Clone, Copy)]
pub enum AnyPlant {
    Lee(Lee),
    SanfelicePraly(SanfelicePraly<f64>),
    VanDerPol(VanDerPol<f64>),
    Crackle(Crackle<f64>),
    Ship(Ship<f64>),
}

impl AnyPlant {
    pub fn read(spec: &Spec<'_>) -> PyResult<Self> {
        let kind = spec.text("kind")?;
        Ok(match kind.as_str() {
            "lee" => Self::Lee(read_lee(spec)?),
            "sanfelice-praly" => Self::SanfelicePraly(read_sanfelice_praly(spec)?),
            "van-der-pol" => Self::VanDerPol(read_van_der_pol(spec, Correction::Derived)?),
            "crackle" => Self::Crackle(read_crackle(spec)?),
            "ship" => Self::Ship(read_ship(spec)?),
            other => {
                let known = ["lee", "sanfelice-praly", "van-der-pol", "crackle", "ship"];
                return Err(spec.unknown("kind", other, &known));
            }
        })
    }

    pub fn len(&self) -> usize {
        match self {
            Self::Lee(_) | Self::SanfelicePraly(_) | Self::VanDerPol(_) => 2,
            Self::Crackle(_) => 5,
            Self::Ship(_) => 6,
        }
    }
}
