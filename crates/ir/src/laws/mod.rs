//! Floor 8. The laws as tables: the core's law over traced numbers, by its spec. Those of the list that are
//! given by a rate have one builder; a recursion has its own.

mod chains;
mod ekf;
mod outputs;
mod rates;
mod reduced_order;
mod sampled;
mod window;

pub use outputs::wraps;

use crate::error::{Result, refused};
use crate::model::{CHAINED, Given};
use crate::spec::Spec;
use crate::tables::Tables;
use crate::trace::Setting;
use hgo_rs::laws::{Form, Law};
use hgo_rs::observers::LAWS;

impl Tables {
    /// Of the observer that a spec describes.
    pub fn read(spec: &Spec<'_>, setting: Setting) -> Result<Self> {
        if spec.text("kind")? == "chains" {
            if ekf::all(&spec.list("observers")?)? {
                return ekf::joint(spec, setting);
            }
            return chains::tables(spec, setting);
        }
        of(spec, &Given::read(spec)?, setting)
    }
}

/// The tables of one law.
fn of(spec: &Spec<'_>, given: &Given<'_>, setting: Setting) -> Result<Tables> {
    let kind = spec.text("kind")?;
    let law = Law::find(LAWS, &kind).ok_or_else(|| {
        let known: Vec<&str> = LAWS.iter().map(|law| law.kind).collect();
        spec.unknown("kind", &kind, &known)
    })?;
    if matches!(given, Given::Own(own) if own.form == CHAINED) && law.form != Form::Chain {
        return Err(refused(format!(
            "a nonlinear chain is not allowed here: the {} does not divide its correction by slopes; use the \
             standard observer",
            law.title
        )));
    }
    let tables = match kind.as_str() {
        ekf::KIND if ekf::is_sampled(spec)? => ekf::tables(law, spec, given, setting),
        "sampled-data" => sampled::tables(spec, given, setting),
        window::KIND => window::tables(spec, given, setting),
        "reduced-order" => reduced_order::tables(spec, given, setting),
        _ => rates::tables(law, spec, given, setting),
    }?;
    outputs::finished(tables, law, spec, given, setting)
}
