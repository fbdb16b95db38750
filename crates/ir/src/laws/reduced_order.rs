//! The reduced-order observer.

use crate::error::{Result, refused};
use crate::model::{Given, OwnModel, OwnStrictFeedback};
use crate::order::MAX_INPUTS;
use crate::spec::Spec;
use crate::systems::read_ship;
use crate::tables::{Build, Shape, Tables, half_table, halves, shape_of};
use crate::trace::{self, Setting, Traced, input};
use hgo_rs::Scalar;
use hgo_rs::model::StrictFeedback;
use hgo_rs::models::Ship;
use hgo_rs::observers::ReducedOrderObserver;
use std::cmp::Ordering;

pub(super) fn tables(spec: &Spec<'_>, given: &Given<'_>, setting: Setting) -> Result<Tables> {
    spec.only(&["kind", "model", "h_bar", "epsilon", "wrap"])?;
    let Given::Own(own) = &given else {
        let known = spec.sub("model")?;
        let name = known.text("kind")?;
        if name != "ship" {
            return Err(known.unknown("kind", &name, &["ship"]));
        }
        return of::<Ship<Traced>, 3, 3, 2>(spec, given, setting, || read_ship(&known));
    };
    if own.form != "strict-feedback" {
        return Err(refused("the reduced-order observer needs a strict-feedback model"));
    }
    macro_rules! sizes {
        ($(($x:literal, $z:literal)),+) => {
            match (own.n, own.n_z) {
                $(($x, $z) => of_own::<$x, $z>(spec, given, own, setting),)+
                (n_x, n_z) => Err(refused(format!(
                    "{n_x} measured and {n_z} unmeasured states are not allowed: the \
                     reduced-order observer takes 1 to 4, and no more unmeasured than measured"
                ))),
            }
        };
    }
    sizes! {
        (1, 1), (2, 1), (2, 2), (3, 1), (3, 2), (3, 3), (4, 1), (4, 2), (4, 3), (4, 4)
    }
}

fn of_own<const NX: usize, const NZ: usize>(
    spec: &Spec<'_>,
    given: &Given<'_>,
    own: &OwnModel,
    setting: Setting,
) -> Result<Tables> {
    of::<_, NX, NZ, MAX_INPUTS>(spec, given, setting, || {
        let parameters = own.names().iter().map(|name| input(name)).collect();
        let function = trace::function(own.table.clone(), parameters);
        Ok(OwnStrictFeedback { function, n_u: own.n_u })
    })
}

/// Of the model that `model` makes.
fn of<Md, const NX: usize, const NZ: usize, const M: usize>(
    spec: &Spec<'_>,
    given: &Given<'_>,
    setting: Setting,
    model: impl Fn() -> Result<Md>,
) -> Result<Tables>
where
    Md: StrictFeedback<Traced, NX, NZ, M> + 'static,
{
    let (h_bar, epsilon) = (spec.vector::<NZ>("h_bar", NZ)?, spec.f64("epsilon")?);
    let n_u = given.n_u()?;
    let build = || {
        let h_bar = h_bar.map(Traced::from_f64);
        let epsilon = Traced::from_f64(epsilon);
        let observer = ReducedOrderObserver::<_, Md, NX, NZ, M>::new(h_bar, epsilon, model()?)?;
        Ok(halves(observer))
    };
    // the filters' states are no signals; behind them, outputs and inputs the time that has passed
    recursion(given, setting, (n_u, NZ, NZ + NX + M), &build)
}

/// With so many inputs and signals, and the place in the memory of the time that has passed.
fn recursion(
    given: &Given<'_>,
    setting: Setting,
    (n_u, signals, elapsed): (usize, usize, usize),
    build: Build<'_>,
) -> Result<Tables> {
    let shape = Shape { signals, ..shape_of(n_u, build)? };
    let correct = |started, present| {
        let answer = Some(if started { Ordering::Greater } else { Ordering::Equal });
        half_table(Setting { present, answer, ..setting }, &shape, true, build)
    };
    let (present, missing) = (correct(true, true)?, correct(true, false)?);
    let unstarted = Some((elapsed, [correct(false, true)?, correct(false, false)?]));
    let advance = half_table(setting, &shape, false, build)?;
    let tables = Tables::of_halves(shape, Some(present), advance, given.parameters());
    Ok(Tables { missing: Some(missing), unstarted, ..tables })
}
