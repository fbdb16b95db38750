//! Floor 9. An observer from its spec, as it runs: a program, or, where its model calls functions, its
//! tables value by value.

use crate::called::Called;
use crate::error::Result;
use crate::recursion::AnyObserver;
use crate::spec::Spec;
use crate::step::Programmed;
use crate::table::Table;
use crate::tables::Tables;
use crate::trace::{PlacedGains, Setting};

/// An observer from its spec.
pub fn build(spec: &Spec<'_>) -> Result<Box<dyn AnyObserver>> {
    let setting = Setting { gains: PlacedGains::Given, ..Setting::usual(false) };
    let tables = Tables::read(spec, setting)?;
    let calls = |table: &Table| !table.calls.is_empty();
    if calls(&tables.advance) || tables.correct.as_ref().is_some_and(calls) {
        let (correct, advance) = tables.halves(|table| Ok(table.clone()))?;
        return Ok(Box::new(Called::new(tables, correct, advance)));
    }
    let (correct, advance) = tables.halves(|table| tables.program(table, 0))?;
    let whole = match &tables.correct {
        None => tables.forms(&tables.advance, |table| tables.program(table, 0))?,
        Some(correct) => tables.forms(correct, |correct| {
            tables.program(&tables.whole(correct)?, correct.outputs.len())
        })?,
    };
    Ok(Box::new(Programmed { tables, whole, correct, advance }))
}
