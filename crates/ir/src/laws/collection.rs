//! Collections of copies, and the modified observer.

use super::continuous;
use crate::choices::{AnyGain, Manner, MovingGain};
use crate::error::{Result, refused};
use crate::model::Given;
use crate::order::MAX_INPUTS;
use crate::spec::Spec;
use crate::tabled::LawTables;
use crate::tables::Tables;
use crate::trace::{Setting, Traced};
use hgo_rs::Scalar;
use hgo_rs::observers::{ModifiedObserver, RepelledCollection};

pub(super) fn tables<const C: usize>(
    spec: &Spec<'_>,
    given: &Given<'_>,
    setting: Setting,
    modified: bool,
) -> Result<Tables> {
    const N: usize = 2;
    spec.only(&["kind", "n", "k", "k_bar", "copies", "gain", "model", "method", "timing"])?;
    let (k, k_bar) = (spec.vector::<N>("k", N)?, spec.vector::<N>("k_bar", N)?);
    let (gain, manner) = (spec.sub("gain")?, Manner::read(spec)?);
    let copies = || {
        let model = given.install(N)?;
        let AnyGain::Moving(MovingGain::Adaptive(gain)) = AnyGain::read(&gain)? else {
            return Err(refused(
                "a collection needs the adaptive gain law, Sanfelice and Praly (23)",
            ));
        };
        let [k, k_bar] = [k, k_bar].map(|k| k.map(Traced::from_f64));
        Ok(RepelledCollection::<Traced, _, N, C, MAX_INPUTS>::new(k, k_bar, gain, model)?)
    };
    let n_u = given.n_u()?;
    let law = if modified {
        let modified = || Ok(ModifiedObserver { collection: copies()? });
        LawTables::known(setting, manner, n_u, modified)?
    } else {
        LawTables::known(setting, manner, n_u, copies)?
    };
    continuous(given, setting, manner, &law)
}
