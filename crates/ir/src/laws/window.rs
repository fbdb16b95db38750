//! Gains on a window of innovations.

use crate::error::{Result, refused};
use crate::model::Given;
use crate::spec::Spec;
use crate::tables::{Build, Tables, half_table, halves, shape_of};
use crate::trace::{Setting, Traced};
use hgo_rs::Scalar;
use hgo_rs::observers::WindowObserver;
use nalgebra::SMatrix;

pub(super) const KIND: &str = "window";

/// `$call::<n, m>$given` for the sizes that are built.
macro_rules! sized {
    ($n:ident, [$($order:literal)*], $m:ident, $lengths:tt, $call:ident $given:tt) => {
        match $n {
            $($order => sized!(@ $order, $m, $lengths, $call $given),)*
            n => Err(refused(format!("n = {n} is not allowed: a window takes 2 to 5"))),
        }
    };
    (@ $order:literal, $m:ident, [$($length:literal)*], $call:ident $given:tt) => {
        match $m {
            $($length => $call::<$order, $length>$given,)*
            m => Err(refused(format!(
                "window = {m} is not allowed: 1 to 12 samples, 15, 17, 21, 25 or 31"
            ))),
        }
    };
}

pub(super) fn tables(spec: &Spec<'_>, given: &Given<'_>, setting: Setting) -> Result<Tables> {
    spec.only(&["kind", "n", "window", "W", "dt", "model", "wrap"])?;
    if given.n_u()? > 0 || spec.sub("model")?.text("kind")? != "none" {
        return Err(refused("model is not allowed: a window of samples knows no model"));
    }
    let (n, m) = (spec.count("n")?, spec.count("window")?);
    sized!(
        n,
        [2 3 4 5],
        m,
        [1 2 3 4 5 6 7 8 9 10 11 12 15 17 21 25 31],
        of (spec, given, setting)
    )
}

fn of<const N: usize, const K: usize>(
    spec: &Spec<'_>,
    given: &Given<'_>,
    setting: Setting,
) -> Result<Tables> {
    let (w, dt) = (spec.list_of("W", N * K)?, spec.f64("dt")?);
    recursion(given, setting, &|| {
        let w = SMatrix::<_, N, K>::from_row_iterator(w.iter().copied().map(Traced::from_f64));
        Ok(halves(WindowObserver::new(w, Traced::from_f64(dt))?))
    })
}

fn recursion(given: &Given<'_>, setting: Setting, build: Build<'_>) -> Result<Tables> {
    let shape = shape_of(0, build)?;
    let correct = |present| half_table(Setting { present, ..setting }, &shape, true, build);
    let (present, missing) = (correct(true)?, correct(false)?);
    let advance = half_table(setting, &shape, false, build)?;
    let tables = Tables::of_halves(shape, Some(present), advance, given.parameters());
    Ok(Tables { missing: Some(missing), ..tables })
}
