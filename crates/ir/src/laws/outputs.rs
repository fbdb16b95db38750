//! Floor 7. What is known of a law's outputs: the start from their first samples, and the turns of those that wrap.
//! A table of one that wraps stands between a sample that is moved by whole turns to the nearest to its
//! prediction and an estimate that is brought back into one turn.

use crate::error::{Result, refused};
use crate::model::Given;
use crate::spec::Spec;
use crate::table::Table;
use crate::tables::{MEMORY, Shape, Tables};
use crate::trace::{self, Setting, Traced, input, inputs, named, trace};
use hgo_rs::Scalar;
use hgo_rs::laws::{Form, Law, Sizes};
use hgo_rs::observers::LAWS;
use hgo_rs::turn::Turn;

/// Whether an output of an observer wraps.
pub fn wraps(spec: &Spec<'_>) -> bool {
    let inner = || spec.list("observers").unwrap_or_default();
    spec.has("wrap") || (spec.has("observers") && inner().iter().any(wraps))
}

/// An output: the entries of the memory that are of its coordinate, what stands for the output itself
/// first, and its turn if it wraps.
struct Output {
    entries: Vec<usize>,
    turn: Option<f64>,
}

impl Output {
    /// The whole turns of a value, within a trace; none of an output that does not wrap.
    fn whole(&self, value: Traced) -> Result<Option<Traced>> {
        let turn = self.turn.map(|length| Turn::new(Traced::from_f64(length))).transpose()?;
        Ok(turn.map(|turn| turn.whole(value)))
    }
}

/// The tables of a law with the start from first samples, and, where outputs wrap as its spec says, with
/// all that takes or moves an estimate between the two reductions.
pub(super) fn finished(
    tables: Tables,
    law: &Law,
    spec: &Spec<'_>,
    given: &Given<'_>,
    setting: Setting,
) -> Result<Tables> {
    let outputs = outputs(law, spec, &tables.shape)?;
    let is_first = match given {
        Given::Own(own) if own.form == "sampled" => own.table.outputs.last() == Some(&1),
        _ => true,
    };
    let estimated = law.form != Form::StrictFeedback;
    let start =
        if is_first && estimated { Some(start(&tables.shape, &outputs, setting)?) } else { None };
    if outputs.iter().all(|output| output.turn.is_none()) {
        return Ok(Tables { start, ..tables });
    }
    if !is_first {
        return Err(refused(
            "wrap is not allowed for a model whose output h is not its first state: leave h out, or \
             unwrap the samples",
        ));
    }
    let made = |table: &Table| wrapped(table, &tables.shape, &outputs, setting);
    let correct = tables.correct.as_ref().map(made).transpose()?;
    let advance = made(&tables.advance)?;
    let missing = tables.missing.as_ref().map(made).transpose()?;
    let unstarted = match &tables.unstarted {
        Some((index, [with, without])) => Some((*index, [made(with)?, made(without)?])),
        None => None,
    };
    // a rate has no step after which the estimate could be brought back
    Ok(Tables { correct, advance, missing, unstarted, start, law: None, ..tables })
}

/// A step of chains that move together, with the reductions of those whose output wraps. `chains`: the spec of
/// each, its shape, and where its memory stands in that of all.
pub(super) fn together<'a>(
    table: Table,
    shape: &Shape,
    chains: impl Iterator<Item = (&'a Spec<'a>, &'a Shape, &'a Vec<usize>)>,
    setting: Setting,
) -> Result<Table> {
    let mut all = Vec::new();
    for (spec, own, place) in chains {
        let Some(law) = Law::find(LAWS, &spec.text("kind")?) else { continue };
        all.extend(outputs(law, spec, own)?.into_iter().map(|output| {
            let entries = output.entries.iter().map(|entry| place[*entry]).collect();
            Output { entries, ..output }
        }));
    }
    let plain = all.iter().all(|output| output.turn.is_none());
    if plain { Ok(table) } else { wrapped(&table, shape, &all, setting) }
}

/// The outputs; of those that wrap one turn for a law of one output, or one or none (NaN) for each.
fn outputs(law: &Law, spec: &Spec<'_>, shape: &Shape) -> Result<Vec<Output>> {
    let n_y = shape.n_y;
    let mut turns = vec![f64::NAN; n_y];
    if spec.has("wrap") {
        turns.clone_from(&spec.numbers("wrap")?.values);
    }
    if turns.len() != n_y {
        return Err(refused(format!(
            "wrap has {} entries; it must have {n_y}, None for an output that does not wrap",
            turns.len()
        )));
    }
    let m = law.size.map_or(Ok(0), |(name, _)| spec.count(name))?;
    let sizes = Sizes { n: shape.n, m, outputs: n_y, ..Sizes::default() };
    let output = |(output, length): (usize, f64)| {
        let turn = Some(length).filter(|length| !length.is_nan());
        turn.map(Turn::new).transpose()?; // refuses what is none
        Ok(Output { entries: entries(law, &sizes, output), turn })
    };
    turns.into_iter().enumerate().map(output).collect()
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

/// [`start`] where these entries of the memory, one an output, are the outputs, and none wraps.
pub(super) fn start_at(firsts: &[usize], shape: &Shape, setting: Setting) -> Result<Table> {
    let outputs = firsts.iter().map(|first| Output { entries: vec![*first], turn: None });
    start(shape, &outputs.collect::<Vec<_>>(), setting)
}

/// A memory whose estimates of the outputs are first samples, where these are there, in one turn.
fn start(shape: &Shape, outputs: &[Output], setting: Setting) -> Result<Table> {
    trace(setting, || {
        let (mut z, y) = (inputs("z", shape.memory), inputs("y", shape.n_y));
        for (output, y) in outputs.iter().zip(y) {
            let begun = output.whole(y)?.map_or(y, |whole| y - whole);
            for entry in &output.entries {
                if let Some(slot) = z.get_mut(*entry) {
                    *slot = trace::if_equal([trace::nothing(y); 2], begun, *slot);
                }
            }
        }
        Ok(named("z", &z))
    })
}

/// A part of a step between the two reductions.
fn wrapped(table: &Table, shape: &Shape, outputs: &[Output], setting: Setting) -> Result<Table> {
    trace(setting, || {
        let mut given: Vec<Traced> = table.inputs.iter().map(|name| input(name)).collect();
        let told = trace::inline(table, &given); // what takes a sample tells its innovation
        let samples = given.iter_mut().skip(MEMORY + shape.memory);
        for ((output, y), e) in outputs.iter().zip(samples).zip(told.iter().skip(shape.memory)) {
            if let Some(whole) = output.whole(*e)? {
                *y -= whole;
            }
        }
        let mut made = trace::inline(table, &given);
        for output in outputs {
            let estimate = output.entries.first().and_then(|entry| made.get(*entry)).copied();
            let Some(whole) = estimate.map(|x| output.whole(x)).transpose()?.flatten() else {
                continue;
            };
            for entry in &output.entries {
                if let Some(slot) = made.get_mut(*entry) {
                    *slot -= whole;
                }
            }
        }
        Ok(table.output_names.iter().cloned().zip(made).collect())
    })
}
