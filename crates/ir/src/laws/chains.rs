//! Observers of several outputs, one law a chain.

use super::{of, outputs};
use crate::choices::AnyMotion;
use crate::error::{Result, refused};
use crate::joint::{Chain, Joint};
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
    let current = chains.first().is_some_and(|of| of.shape.current);
    let (n, n_y, n_u, memory) = (own.n, chains.len(), own.n_u, rest);
    let shape = Shape { n, n_y, n_u, memory, signals: n, current, initial };
    let several = Several { own: &own, chains: &chains, place: &place, shape: &shape, setting };
    let corrects = chains.iter().all(|of| of.correct.is_some());
    let half = |of: &Tables| of.correct.clone().unwrap_or_default();
    let correct = if corrects { Some(several.each(half)?) } else { None };
    let advance = match motion_of(&chains)? {
        AnyMotion::Held => several.each(|of| of.advance.clone())?,
        motion => {
            let wrapping = specs.iter().zip(&chains).zip(&place);
            let wrapping = wrapping.map(|((spec, of), place)| (spec, &of.shape, place));
            outputs::together(several.together(motion)?, &shape, wrapping, setting)?
        }
    };
    let (placed, start) = (several.placed(), several.start()?);
    Ok(Tables {
        shape,
        correct,
        advance,
        missing: None,
        unstarted: None,
        placed,
        law: None,
        moving: None,
        parameters: own.parameters,
        start: Some(start),
    })
}

/// The chains of a model, and where the memory of each stands in that of all.
struct Several<'a> {
    own: &'a OwnModel,
    chains: &'a [Tables],
    place: &'a [Vec<usize>],
    shape: &'a Shape,
    setting: Setting,
}

/// The inputs of a step of all chains.
struct Inputs {
    t: Traced,
    dt: Traced,
    z: Vec<Traced>,
    y: Vec<Traced>,
    u: Vec<Traced>,
    parameters: Vec<Traced>,
    /// Of each chain.
    gains: Vec<Vec<Traced>>,
}

impl Several<'_> {
    fn placed(&self) -> Vec<PlacedChain> {
        let chains = self.chains.iter().zip(self.place).enumerate();
        let placed = chains.flat_map(|(channel, (of, place))| {
            of.placed.iter().map(move |PlacedChain { elapsed, gains, .. }| PlacedChain {
                channel,
                elapsed: elapsed.map(|elapsed| place[elapsed]),
                gains: gains.clone(),
            })
        });
        placed.collect()
    }

    /// Within a trace.
    fn inputs(&self) -> Inputs {
        let (t, dt, z) = (input("t"), input("dt"), inputs("z", self.shape.memory));
        let (y, u) = (inputs("y", self.chains.len()), inputs("u", self.own.n_u));
        let parameters = self.own.names().iter().map(|name| input(name)).collect();
        let gains = self.chains.iter().enumerate().map(|(chain, of)| {
            let count = of.placed.first().map_or(0, |placed| placed.gains.count);
            inputs(&format!("gains{chain}"), count)
        });
        let gains = gains.collect();
        Inputs { t, dt, z, y, u, parameters, gains }
    }

    /// The memory that begins at first samples.
    fn start(&self) -> Result<Table> {
        trace(self.setting, || {
            let (mut z, y) = (inputs("z", self.shape.memory), inputs("y", self.chains.len()));
            for ((of, place), y) in self.chains.iter().zip(self.place).zip(y) {
                let Some(start) = &of.start else { continue };
                let memory: Vec<Traced> = place.iter().map(|place| z[*place]).collect();
                let begun = trace::inline(start, &[memory.as_slice(), &[y]].concat());
                place.iter().zip(begun).for_each(|(place, value)| z[*place] = value);
            }
            Ok(named("z", &z))
        })
    }

    /// A part of a step, of each chain by itself: the others stand as they were.
    fn each(&self, half: impl Fn(&Tables) -> Table) -> Result<Table> {
        trace(self.setting, || {
            let Inputs { t, dt, z, y, u, parameters, gains } = self.inputs();
            let (mut moved, mut innovation) = (z.clone(), Vec::new());
            for (chain, (of, place)) in self.chains.iter().zip(self.place).enumerate() {
                let memory: Vec<Traced> = place.iter().map(|place| z[*place]).collect();
                let (memory, shared) = (memory.as_slice(), &z[..self.own.n]);
                let given = [&[t, dt], memory, &[y[chain]], &u, shared, &parameters, &gains[chain]];
                let made = trace::inline(&half(of), &given.concat());
                place.iter().zip(&made).for_each(|(place, value)| moved[*place] = *value);
                innovation.extend_from_slice(&made[memory.len()..]);
            }
            Ok([named("z", &moved), named("innovation", &innovation)].concat())
        })
    }

    /// The way to the next sample of chains that move together.
    fn together(&self, motion: AnyMotion) -> Result<Table> {
        trace(self.setting, || {
            let Inputs { t, dt, z, y, u, parameters, gains } = self.inputs();
            let moving = self.chains.iter().filter_map(|of| of.moving.as_ref());
            let mut first = 0;
            let moving = moving.zip(self.place).map(|((law, _), place)| {
                let f = first..first + law.placed.as_ref().map_or(0, |of| of.n_f);
                first = f.end;
                Chain { law, place, f }
            });
            let (chains, n, n_u) = (moving.collect(), self.own.n, self.own.n_u);
            let joint = Joint { chains, motion, n, n_u, parameters: &parameters };
            let sampled = (!self.shape.current).then_some((y.as_slice(), gains.as_slice()));
            let moved = joint.advance((t, dt), &z, &u, sampled);
            let innovation = |(y, of): (&Traced, &Vec<usize>)| *y - z[of[0]];
            let innovation: Vec<Traced> = if self.shape.current {
                Vec::new()
            } else {
                y.iter().zip(self.place).map(innovation).collect()
            };
            Ok([named("z", &moved), named("innovation", &innovation)].concat())
        })
    }
}

/// How the model of these chains moves.
fn motion_of(chains: &[Tables]) -> Result<AnyMotion> {
    let of = |chain: &Tables| chain.moving.as_ref().map_or(AnyMotion::Held, |(_, motion)| *motion);
    let first = chains.first().map_or(AnyMotion::Held, of);
    if chains.iter().any(|chain| of(chain) != first) {
        return Err(refused(
            "the observers of a model of chains must have the same motion and substeps: the model of all \
             chains moves at once",
        ));
    }
    let placed = |chain: &Tables| chain.moving.as_ref().is_none_or(|(law, _)| law.is_placed());
    if !chains.iter().all(placed) {
        return Err(refused(
            "motion is not allowed where an observer of a chain corrects while it moves (methods proper and \
             inter-sample): choose motion held, or method zoh",
        ));
    }
    Ok(first)
}
