//! Outputs that wrap: the finished tables of a law, between a sample that is moved by whole turns to the
//! nearest to its prediction and an estimate that is brought back into one turn.

use crate::error::{Result, refused};
use crate::model::Given;
use crate::spec::Spec;
use crate::table::Table;
use crate::tables::{MEMORY, Shape, Tables};
use crate::trace::{self, Setting, Traced, input, trace};
use hgo_rs::Scalar;
use hgo_rs::laws::{Law, Sizes};
use hgo_rs::turn::Turn;

/// Whether an output of an observer wraps.
pub fn wraps(spec: &Spec<'_>) -> bool {
    let inner = || spec.list("observers").unwrap_or_default();
    spec.has("wrap") || (spec.has("observers") && inner().iter().any(wraps))
}

/// An output that wraps: its turn, and the entries of the memory that are of its coordinate, what stands
/// for the output itself first.
struct Wrapped {
    output: usize,
    length: f64,
    entries: Vec<usize>,
}

/// The tables of a law whose outputs wrap as its spec says.
pub(super) fn wrapped(
    tables: Tables,
    law: &Law,
    spec: &Spec<'_>,
    given: &Given<'_>,
    setting: Setting,
) -> Result<Tables> {
    if !spec.has("wrap") {
        return Ok(tables);
    }
    if let Given::Own(own) = given
        && own.form == "sampled"
        && own.table.outputs.last() != Some(&1)
    {
        return Err(refused(
            "wrap is not allowed for a model whose output h is not its first state: leave h out, or \
             unwrap the samples",
        ));
    }
    let outputs = outputs(law, spec, &tables.shape)?;
    let made = |table: &Table| of(table, &tables.shape, &outputs, setting);
    let correct = tables.correct.as_ref().map(made).transpose()?;
    let advance = made(&tables.advance)?;
    let missing = tables.missing.as_ref().map(made).transpose()?;
    let unstarted = match &tables.unstarted {
        Some((index, [with, without])) => Some((*index, [made(with)?, made(without)?])),
        None => None,
    };
    // a rate has no step after which the estimate could be brought back
    Ok(Tables { correct, advance, missing, unstarted, law: None, ..tables })
}

/// The outputs that wrap: one turn for a law of one output, or one or none (NaN) for each.
fn outputs(law: &Law, spec: &Spec<'_>, shape: &Shape) -> Result<Vec<Wrapped>> {
    let n_y = shape.n_y;
    let given = spec.numbers("wrap")?;
    if given.values.len() != n_y {
        return Err(refused(format!(
            "wrap has {} entries; it must have {n_y}, None for an output that does not wrap",
            given.values.len()
        )));
    }
    let m = law.size.map_or(Ok(0), |(name, _)| spec.count(name))?;
    let sizes = Sizes { n: shape.n, m, outputs: n_y, ..Sizes::default() };
    let mut outputs = Vec::new();
    for (output, length) in given.values.iter().enumerate().filter(|(_, length)| !length.is_nan()) {
        let entries = entries(law, &sizes, output);
        Turn::new(*length)?;
        outputs.push(Wrapped { output, length: *length, entries });
    }
    Ok(outputs)
}

/// Entries of a law's memory that are of an output's coordinate: the first of an estimate, of each copy, or
/// the last sample.
fn entries(law: &Law, sizes: &Sizes, output: usize) -> Vec<usize> {
    let mut first = 0;
    let mut entries = Vec::new();
    for part in law.memory {
        match part.name {
            "x_hat" => entries.push(first),
            "copies" => entries.extend((0..sizes.m).map(|copy| first + copy * (sizes.n + 1))),
            "y" => entries.push(first + output),
            _ => {}
        }
        first += (part.len)(sizes);
    }
    entries
}

/// A part of a step between the two reductions.
fn of(table: &Table, shape: &Shape, outputs: &[Wrapped], setting: Setting) -> Result<Table> {
    trace(setting, || {
        let mut given: Vec<Traced> = table.inputs.iter().map(|name| input(name)).collect();
        let told = trace::inline(table, &given); // what takes a sample tells its innovation
        for Wrapped { output, length, .. } in outputs {
            let turn = Turn::new(Traced::from_f64(*length))?;
            let sample = given.get_mut(MEMORY + shape.memory + output);
            if let (Some(y), Some(e)) = (sample, told.get(shape.memory + output)) {
                *y -= turn.whole(*e);
            }
        }
        let mut made = trace::inline(table, &given);
        for Wrapped { length, entries, .. } in outputs {
            let turn = Turn::new(Traced::from_f64(*length))?;
            let Some(estimate) = entries.first().and_then(|entry| made.get(*entry)) else {
                continue;
            };
            let beyond = turn.whole(*estimate);
            for entry in entries {
                if let Some(slot) = made.get_mut(*entry) {
                    *slot -= beyond;
                }
            }
        }
        Ok(table.output_names.iter().cloned().zip(made).collect())
    })
}
