//! Floor 7. The laws as tables, one builder a file: the core's law over traced numbers, by its spec.

mod chains;
mod collection;
mod low_power;
mod reduced_order;
mod sampled;
mod standard;

use crate::choices::{AnyMethod, Manner};
use crate::dispatch_order;
use crate::error::{Result, refused};
use crate::model::Given;
use crate::order::order_refused;
use crate::spec::Spec;
use crate::tabled::LawTables;
use crate::tables::{PlacedChain, Shape, Tables};
use crate::trace::Setting;
use hgo_rs::observer::Timing;

impl Tables {
    /// Of the observer that a spec describes.
    pub fn read(spec: &Spec<'_>, setting: Setting) -> Result<Self> {
        if spec.text("kind")? == "chains" {
            return chains::tables(spec, setting);
        }
        of(spec, &Given::read(spec)?, setting)
    }
}

/// The tables of one law.
fn of(spec: &Spec<'_>, given: &Given<'_>, setting: Setting) -> Result<Tables> {
    let kind = spec.text("kind")?;
    match kind.as_str() {
        "sampled-data" => return sampled::tables(spec, given, setting),
        "reduced-order" => return reduced_order::tables(spec, given, setting),
        _ => {}
    }
    let n = spec.count("n")?;
    match kind.as_str() {
        "standard" => {
            dispatch_order!(n, N => standard::tables::<N>(spec, given, setting),
                            else Err(order_refused(n)))
        }
        "low-power" | "peaking-free" => {
            let saturated = kind == "peaking-free";
            dispatch_order!(n, N => low_power::tables::<N>(spec, given, setting, saturated),
                            else Err(order_refused(n)))
        }
        "collection" | "modified" => {
            if n != 2 {
                return Err(refused(format!(
                    "n = {n} is not allowed: a collection has n = 2 from Python"
                )));
            }
            let modified = kind == "modified";
            match spec.count("copies")? {
                2 => collection::tables::<2>(spec, given, setting, modified),
                3 => collection::tables::<3>(spec, given, setting, modified),
                4 => collection::tables::<4>(spec, given, setting, modified),
                5 => collection::tables::<5>(spec, given, setting, modified),
                copies => {
                    Err(refused(format!("copies = {copies} is not allowed: 2 to 5 from Python")))
                }
            }
        }
        other => Err(spec.unknown(
            "kind",
            other,
            &[
                "standard",
                "low-power",
                "peaking-free",
                "collection",
                "modified",
                "sampled-data",
                "reduced-order",
            ],
        )),
    }
}

/// Of a continuous law.
fn continuous(
    given: &Given<'_>,
    setting: Setting,
    manner: Manner,
    law: &LawTables,
) -> Result<Tables> {
    let current = manner.timing == Timing::Current;
    let memory = law.memory(manner.timing);
    let mut initial = law.initial.clone();
    initial.resize(memory, 0.0);
    let placed = matches!(manner.method, AnyMethod::Placed(_));
    let together = !current && !placed;
    Ok(Tables {
        shape: Shape {
            n: law.n,
            n_y: 1,
            n_u: given.n_u()?,
            memory,
            signals: law.len,
            current,
            initial,
        },
        correct: law.correct(setting, manner)?,
        advance: law.advance(setting, manner)?,
        missing: None,
        unstarted: None,
        placed: law.gains().map_or_else(Vec::new, |gains| {
            let elapsed = current.then_some(law.len);
            vec![PlacedChain { channel: 0, elapsed, gains: gains.clone() }]
        }),
        law: if together { Some(law.together(setting)?) } else { None },
        parameters: given.parameters().to_vec(),
    })
}
