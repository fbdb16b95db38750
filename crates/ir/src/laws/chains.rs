//! Observers of several outputs, one law a chain.

use super::of;
use crate::error::{Result, refused};
use crate::model::{Given, OwnModel};
use crate::order::CHAINS;
use crate::spec::Spec;
use crate::table::Table;
use crate::tables::{PlacedChain, Shape, Tables};
use crate::trace::{self, Setting, Traced, input, inputs, named, trace};

/// Of an observer of several outputs: one observer for each chain, which takes the states of the
/// other chains as they stand at the beginning of a step.
pub(super) fn tables(spec: &Spec<'_>, setting: Setting) -> Result<Tables> {
    spec.only(&["kind", "observers", "model"])?;
    let own = OwnModel::read(&spec.sub("model")?)?;
    if own.form != "chains" {
        return Err(refused("an observer of several outputs needs a model of chains"));
    }
    let specs = spec.list("observers")?;
    if specs.len() > CHAINS {
        return Err(refused(format!("{} outputs are not allowed: 1 to {CHAINS}", specs.len())));
    }
    if specs.len() != own.orders.len() {
        return Err(refused(format!(
            "{} observers do not fit a model of {} chains",
            specs.len(),
            own.orders.len()
        )));
    }
    let chains: Vec<Tables> = specs
        .iter()
        .enumerate()
        .map(|(chain, spec)| of(spec, &Given::Chain(&own, chain), setting))
        .collect::<Result<_>>()?;
    if chains.iter().any(|of| of.shape.current != chains[0].shape.current) {
        return Err(refused("the observers of a model of chains must have the same timing"));
    }
    // the memory: the estimates of all chains, then the rest of each
    let mut place = Vec::new();
    let (mut x, mut rest) = (0, own.n);
    for of in &chains {
        let Shape { n, memory, .. } = of.shape;
        place.push((x..x + n).chain(rest..rest + memory - n).collect::<Vec<usize>>());
        (x, rest) = (x + n, rest + memory - n);
    }
    let mut initial = vec![0.0; rest];
    for (of, place) in chains.iter().zip(&place) {
        place.iter().zip(&of.shape.initial).for_each(|(place, value)| initial[*place] = *value);
    }
    let placed = chains.iter().zip(&place).enumerate().flat_map(|(channel, (of, place))| {
        of.placed.iter().map(move |PlacedChain { elapsed, gains, .. }| PlacedChain {
            channel,
            elapsed: elapsed.map(|elapsed| place[elapsed]),
            gains: gains.clone(),
        })
    });
    let placed = placed.collect();
    let joined = |half: &dyn Fn(&Tables) -> Table| {
        trace(setting, || {
            let (t, dt) = (input("t"), input("dt"));
            let (z, y) = (inputs("z", rest), inputs("y", chains.len()));
            let u = inputs("u", own.n_u);
            let parameters: Vec<Traced> = own.names().iter().map(|name| input(name)).collect();
            let (mut moved, mut innovation) = (z.clone(), Vec::new());
            for (chain, ((of, place), y)) in chains.iter().zip(&place).zip(&y).enumerate() {
                let memory: Vec<Traced> = place.iter().map(|place| z[*place]).collect();
                let count = of.placed.first().map_or(0, |placed| placed.gains.count);
                let gains = inputs(&format!("gains{chain}"), count);
                let (memory, shared) = (memory.as_slice(), &z[..own.n]);
                let given = [&[t, dt], memory, &[*y], &u, shared, &parameters, &gains];
                let made = trace::inline(&half(of), &given.concat());
                place.iter().zip(&made).for_each(|(place, value)| moved[*place] = *value);
                innovation.extend_from_slice(&made[memory.len()..]);
            }
            Ok([named("z", &moved), named("innovation", &innovation)].concat())
        })
    };
    let corrects = chains.iter().all(|of| of.correct.is_some());
    let correct =
        if corrects { Some(joined(&|of| of.correct.clone().unwrap_or_default())?) } else { None };
    let advance = joined(&|of| of.advance.clone())?;
    let start = trace(setting, || {
        let (mut z, y) = (inputs("z", rest), inputs("y", chains.len()));
        for ((of, place), y) in chains.iter().zip(&place).zip(y) {
            let Some(start) = &of.start else { continue };
            let memory: Vec<Traced> = place.iter().map(|place| z[*place]).collect();
            let begun = trace::inline(start, &[memory.as_slice(), &[y]].concat());
            place.iter().zip(begun).for_each(|(place, value)| z[*place] = value);
        }
        Ok(named("z", &z))
    })?;
    let current = chains.first().is_some_and(|of| of.shape.current);
    let (n, n_y, n_u, memory) = (own.n, chains.len(), own.n_u, rest);
    let shape = Shape { n, n_y, n_u, memory, signals: memory, current, initial };
    Ok(Tables {
        shape,
        correct,
        advance,
        missing: None,
        unstarted: None,
        placed,
        law: None,
        parameters: own.parameters,
        start: Some(start),
    })
}
