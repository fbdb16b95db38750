//! Floor 6. Observers of the chains of one model, whose known terms move together: every stage of the motion
//! sees the states of all chains as they are then.

use crate::choices::AnyMotion;
use crate::order::{CHAINS, MAX_INPUTS};
use crate::table::Table;
use crate::tabled::{LawTables, PlacedTables};
use crate::trace::{Traced, inline};
use hgo_rs::memory::Memory;
use hgo_rs::motion::{Flow, Motion};
use hgo_rs::observer::absent;
use hgo_rs::observers::MAX_ORDER;
use nalgebra::SVector;
use std::ops::Range;

/// Room for the memories of all chains, and for their terms.
const Z: usize = CHAINS * (2 * MAX_ORDER + 1);
const F: usize = CHAINS * (MAX_ORDER + 1);

type State = SVector<Traced, Z>;
type Terms = SVector<Traced, F>;
type Inputs = SVector<Traced, MAX_INPUTS>;

/// One chain: its law, and where the entries of its memory stand.
pub(crate) struct Chain<'a> {
    pub(crate) law: &'a LawTables,
    pub(crate) place: &'a [usize],
    /// Where its terms stand among those of all chains.
    pub(crate) f: Range<usize>,
}

/// Chains that move together.
pub(crate) struct Joint<'a> {
    pub(crate) chains: Vec<Chain<'a>>,
    pub(crate) motion: AnyMotion,
    /// Estimated states of all chains, and inputs.
    pub(crate) n: usize,
    pub(crate) n_u: usize,
    pub(crate) parameters: &'a [Traced],
}

impl Joint<'_> {
    /// The memory of all chains after the period dt that begins at time t. With predictor timing the samples
    /// `y` of its beginning correct first, by these gains, each chain from the state where all stand; else the
    /// times of the next corrections grow.
    pub(crate) fn advance(
        &self,
        (t, dt): (Traced, Traced),
        z: &[Traced],
        u: &[Traced],
        sampled: Option<(&[Traced], &[Vec<Traced>])>,
    ) -> Vec<Traced> {
        let held = State::read(z);
        let mut before = held;
        for (i, chain) in self.chains.iter().enumerate() {
            if let Some((y, gains)) = sampled {
                let mut own = chain.own(&held);
                if chain.law.jumps {
                    let e = self.call(&chain.law.innovation, &[&own, &[y[i]]], &held);
                    own = self.call(&chain.law.jumped, &[&own, &e], &held);
                }
                let given: [&[Traced]; 4] = [&own, &[y[i]], &[dt], &gains[i]];
                chain.take(self.part(chain, |of| &of.correct, &given, &held), &mut before);
            } else if let Some(elapsed) = chain.place.get(chain.law.len) {
                before[*elapsed] += dt;
            }
        }
        let mut moved = self.motion.moved(self, t, &before, &Inputs::read(u), dt);
        for chain in &self.chains {
            let made = self.call(&chain.law.admissible, &[&chain.own(&moved)], &moved);
            chain.take(made, &mut moved);
        }
        moved.as_slice()[..z.len()].to_vec()
    }

    /// What a table of a chain's law makes, which may see the estimates of all chains.
    fn call(&self, table: &Table, given: &[&[Traced]], z: &State) -> Vec<Traced> {
        inline(table, &[&given.concat(), &z.as_slice()[..self.n], self.parameters].concat())
    }

    /// What a part of a chain's placed law makes; there is one, or the chains would not move together.
    fn part(
        &self,
        chain: &Chain<'_>,
        of: impl Fn(&PlacedTables) -> &Table,
        given: &[&[Traced]],
        z: &State,
    ) -> Vec<Traced> {
        chain.law.placed.as_ref().map_or_else(Vec::new, |parts| self.call(of(parts), given, z))
    }

    /// The chain's memory, changed by a part of its law.
    fn put(
        &self,
        chain: &Chain<'_>,
        of: impl Fn(&PlacedTables) -> &Table,
        given: &[&[Traced]],
        z: &mut State,
    ) {
        let made = self.part(chain, of, given, z);
        chain.take(made, z);
    }
}

impl Chain<'_> {
    /// Its law's own part of a memory of all chains.
    fn own(&self, z: &State) -> Vec<Traced> {
        self.place.iter().take(self.law.len).map(|place| z[*place]).collect()
    }
    /// That part, new.
    fn take(&self, made: Vec<Traced>, z: &mut State) {
        self.place.iter().zip(made).for_each(|(place, value)| z[*place] = value);
    }
}

impl Flow<Traced, State, Inputs> for Joint<'_> {
    type Terms = Terms;
    fn terms(&self, t: Traced, z: &State, u: &Inputs) -> Terms {
        let mut f = Terms::zero();
        for chain in &self.chains {
            let given: [&[Traced]; 3] = [&[t], &chain.own(z), &u.as_slice()[..self.n_u]];
            let made = self.part(chain, |of| &of.terms, &given, z);
            f.as_mut_slice()[chain.f.clone()].copy_from_slice(&made);
        }
        f
    }
    fn flow(&self, z: &State, f: &Terms, dt: Traced) -> State {
        let mut moved = *z;
        for chain in &self.chains {
            let f = &f.as_slice()[chain.f.clone()];
            let given: [&[Traced]; 4] = [&chain.own(z), &[absent()], f, &[dt]];
            self.put(chain, |of| &of.flow, &given, &mut moved);
        }
        moved
    }
    fn chain(&self, delta: &Terms) -> Terms {
        let mut rate = Terms::zero();
        for chain in &self.chains {
            let own = &delta.as_slice()[chain.f.clone()];
            let made = self.part(chain, |of| &of.chain, &[own], &State::zero());
            rate.as_mut_slice()[chain.f.clone()].copy_from_slice(&made);
        }
        rate
    }
    fn shifted(&self, z: &State, delta: &Terms) -> State {
        let mut shifted = *z;
        for chain in &self.chains {
            let delta = &delta.as_slice()[chain.f.clone()];
            self.put(chain, |of| &of.shifted, &[&chain.own(z), delta], &mut shifted);
        }
        shifted
    }
    fn rows(&self) -> usize {
        self.chains.last().map_or(0, |chain| chain.f.end)
    }
}
