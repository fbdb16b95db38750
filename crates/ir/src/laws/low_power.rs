//! The low-power and the peaking-free law.

use super::continuous;
use crate::choices::{AnyGain, AnySaturation, Manner};
use crate::error::{Result, refused};
use crate::model::Given;
use crate::order::MAX_INPUTS;
use crate::spec::Spec;
use crate::tabled::{Gains, LawTables};
use crate::tables::Tables;
use crate::trace::{Setting, Traced};
use hgo_rs::Scalar;
use hgo_rs::injection::Placement;
use hgo_rs::model::Unknown;
use hgo_rs::observers::LowPower;
use std::sync::Arc;

pub(super) fn tables<const N: usize>(
    spec: &Spec<'_>,
    given: &Given<'_>,
    setting: Setting,
    saturated: bool,
) -> Result<Tables> {
    let manner = Manner::read(spec)?;
    if matches!(given, Given::Own(own) if own.form == "triangular") {
        return Err(refused(
            "a triangular model is not allowed here: the low-power and the peaking-free observer \
             need a phase-variable model (known terms in the last equation only); use the standard \
             observer",
        ));
    }
    if matches!(given, Given::Paper(Some(model)) if model.text("kind")? == "sanfelice-praly") {
        return Err(refused(
            "model = 'sanfelice-praly' is not allowed here: the low-power and the peaking-free \
             observer need a phase-variable model (known terms in the last equation only); use \
             the standard observer",
        ));
    }
    let (alpha, beta) = (spec.vector::<N>("alpha", N)?, spec.vector::<N>("beta", N - 1)?);
    let gain = spec.sub("gain")?;
    let gains = |at| {
        if setting.single {
            gains::<f32, N>(spec, at, saturated)
        } else {
            gains::<f64, N>(spec, at, saturated)
        }
    };
    macro_rules! law {
        ($gain:pat => $made:expr) => {
            LawTables::any(
                setting,
                manner,
                given.n_u()?,
                || {
                    let model = given.install(N)?;
                    let saturation = AnySaturation::<N, Traced>::read(spec, saturated)?;
                    let $gain = AnyGain::read(&gain)? else {
                        return Err(refused("another gain law"));
                    };
                    let [alpha, beta] = [alpha, beta].map(|k| k.map(Traced::from_f64));
                    Ok(LowPower::<Traced, _, _, _, N, MAX_INPUTS>::new(
                        alpha, beta, $made, model, saturation,
                    )?)
                },
                gains,
            )
        };
    }
    let law = if gain.text("law")? == "constant" {
        law!(AnyGain::Constant(gain) => gain)
    } else {
        law!(AnyGain::Moving(gain) => gain)
    };
    continuous(given, setting, manner, &law?)
}

/// The gains of placed corrections, which depend on no model.
fn gains<T: Scalar + Send + Sync + 'static, const N: usize>(
    spec: &Spec<'_>,
    at: Placement,
    saturated: bool,
) -> Result<Arc<Gains>> {
    let saturation = AnySaturation::<N, T>::read(spec, saturated)?;
    let [alpha, beta] = [spec.vector::<N>("alpha", N)?, spec.vector::<N>("beta", N - 1)?];
    let [alpha, beta] = [alpha, beta].map(|k| k.map(T::from_f64));
    let gain = AnyGain::read(&spec.sub("gain")?)?;
    let law = LowPower::<T, _, _, _, N, 0>::new(alpha, beta, gain, Unknown, saturation)?;
    Gains::new::<T, _>(law, at)
}
