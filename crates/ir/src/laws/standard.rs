//! The standard law of any order.

use super::continuous;
use crate::choices::{AnyGain, Manner};
use crate::error::{Result, refused};
use crate::model::Given;
use crate::order::MAX_INPUTS;
use crate::spec::Spec;
use crate::systems::AnyModel;
use crate::tabled::{Gains, LawTables};
use crate::tables::Tables;
use crate::trace::{Setting, Traced};
use hgo_rs::Scalar;
use hgo_rs::observers::StandardObserver;

pub(super) fn tables<const N: usize>(
    spec: &Spec<'_>,
    given: &Given<'_>,
    setting: Setting,
) -> Result<Tables> {
    spec.only(&["kind", "n", "k", "gain", "model", "method", "timing"])?;
    let (k, manner) = (spec.vector::<N>("k", N)?, Manner::read(spec)?);
    let gain = spec.sub("gain")?;
    let gains = |at| {
        let (gain, model) = (AnyGain::read(&gain)?, AnyModel::Unknown);
        Gains::new::<f64, _>(StandardObserver::<f64, _, _, N, 1>::new(k, gain, model)?, at)
    };
    macro_rules! law {
        ($gain:pat => $made:expr) => {
            LawTables::any(
                setting,
                manner,
                given.n_u()?,
                || {
                    let model = given.install(N)?;
                    let $gain = AnyGain::read(&gain)? else {
                        return Err(refused("another gain law"));
                    };
                    let k = k.map(Traced::from_f64);
                    Ok(StandardObserver::<Traced, _, _, N, MAX_INPUTS>::new(k, $made, model)?)
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
