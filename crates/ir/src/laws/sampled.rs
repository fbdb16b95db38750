//! The sampled-data observer.

use crate::dispatch_order;
use crate::error::{Result, refused};
use crate::model::{Given, OwnModel, OwnSampled};
use crate::order::{MAX_INPUTS, order_refused};
use crate::spec::Spec;
use crate::systems::read_van_der_pol;
use crate::tables::{Build, Tables, half_table, halves, shape_of};
use crate::trace::{self, Setting, Traced, input};
use hgo_rs::models::Correction;
use hgo_rs::observers::SampledDataObserver;

pub(super) fn tables(spec: &Spec<'_>, given: &Given<'_>, setting: Setting) -> Result<Tables> {
    spec.only(&["kind", "model", "gain", "wrap"])?;
    if let Given::Own(own) = given {
        return dispatch_order!(own.n, N => of_own::<N>(given, own, setting),
                               else Err(order_refused(own.n)));
    }
    let correction = match spec.text_or("gain", "derived")?.as_str() {
        "derived" => Correction::Derived,
        "printed" => Correction::Printed,
        other => return Err(spec.unknown("gain", other, &["derived", "printed"])),
    };
    let known = spec.sub("model")?;
    let name = known.text("kind")?;
    if name != "van-der-pol" {
        return Err(known.unknown("kind", &name, &["van-der-pol"]));
    }
    of(given, setting, &|| {
        let model = read_van_der_pol::<Traced>(&spec.sub("model")?, correction)?;
        Ok(halves(SampledDataObserver::<_, 2, 0> { model }))
    })
}

/// Tables of a sampled-data observer that `build` makes.
fn of(given: &Given<'_>, setting: Setting, build: Build<'_>) -> Result<Tables> {
    let shape = shape_of(given.n_u()?, build)?;
    let advance = |present| half_table(Setting { present, ..setting }, &shape, false, build);
    let (present, missing) = (advance(true)?, advance(false)?);
    let tables = Tables::of_halves(shape, None, present, given.parameters());
    Ok(Tables { missing: Some(missing), ..tables })
}

fn of_own<const N: usize>(given: &Given<'_>, own: &OwnModel, setting: Setting) -> Result<Tables> {
    if own.form != "sampled" {
        return Err(refused(
            "the sampled-data observer needs a model of sampled-data form: f, K_T and h",
        ));
    }
    of(given, setting, &|| {
        let parameters = own.names().iter().map(|name| input(name)).collect();
        let function = trace::function(own.table.clone(), parameters);
        let model = OwnSampled { function, n: own.n, n_u: own.n_u };
        Ok(halves(SampledDataObserver::<_, N, MAX_INPUTS> { model }))
    })
}
