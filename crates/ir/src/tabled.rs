//! Floor 5. Continuous laws as tables: each function of a law is traced once, and the schemes of the core run
//! over the tables. (Laws times schemes, each pair compiled, would be many times as much code.)

use crate::Function;
use crate::choices::{AnyMethod, AnyMotion, Manner, not_placed};
use crate::error::{Result, refused};
use crate::order::MAX_INPUTS;
use crate::table::Table;
use crate::trace::{self, PlacedGains, Setting, Traced, inline, input, inputs, named, trace};
use hgo_rs::Scalar;
use hgo_rs::injection::{Implicit, Injected, OneChain, Placement, Proper};
use hgo_rs::inter_sample::InterSample;
use hgo_rs::memory::Memory;
use hgo_rs::motion::{Flow, Motion};
use hgo_rs::observer::{
    ContinuousLaw, Current, CurrentState, Discretised, Observer, Scheme, Timing, absent,
};
use hgo_rs::observers::BlockGains;
use nalgebra::SVector;
use std::sync::{Arc, Mutex};

/// Room for a law's memory, its innovations and its inputs.
const Z: usize = 40;
const E: usize = 6;
const U: usize = MAX_INPUTS;

type State = SVector<Traced, Z>;
type Innovations = SVector<Traced, E>;
type Inputs = SVector<Traced, U>;

/// The functions of a law.
pub struct LawTables {
    /// Estimated states, entries of the memory, innovations, known inputs.
    pub n: usize,
    pub len: usize,
    errors: usize,
    n_u: usize,
    pub initial: Vec<f64>,
    /// (z, y) → e.
    pub(crate) innovation: Table,
    /// (t, z, e, u) → ż.
    rate: Table,
    /// (z, e) → what of it is due to e.
    injection: Table,
    /// (z before, z after, dt) → z after a staggered step.
    stagger: Table,
    /// z → z within the set that the law lives in.
    pub(crate) admissible: Table,
    /// (z, e) → z at a sample.
    pub(crate) jumped: Table,
    /// Whether that moves anything.
    pub jumps: bool,
    /// If its eigenvalues are placed.
    pub(crate) placed: Option<PlacedTables>,
}

/// The halves of a step of a law whose chain moves exactly.
#[derive(Default)]
pub(crate) struct PlacedTables {
    /// How many known terms there are.
    pub(crate) n_f: usize,
    /// (t, z, u) → the known terms.
    pub(crate) terms: Table,
    /// (z, y, terms, dt) → z after a step along the chain under these terms.
    pub(crate) flow: Table,
    /// terms → what the chain makes of them.
    pub(crate) chain: Table,
    /// (z, δ) → z, its estimate moved by δ.
    pub(crate) shifted: Table,
    /// Of a placed method: (z, y, dt, gains) → z after the use of a sample.
    pub(crate) correct: Table,
    /// Of the others: (z, e, dt) → what a sample moves, as a rate; of the inter-sample predictor over the step,
    /// with what is left of e.
    kick: Table,
    /// The gains, where they are inputs.
    gains: Option<Arc<Gains>>,
}

/// Where the gains of a placed correction come from.
enum GainsOf {
    /// They are computed in the table.
    Table,
    /// They are inputs of it.
    Inputs(Arc<Gains>),
    /// The law computes them, called from the table.
    Call(Arc<Gains>),
}

/// Gains of a placed correction as numbers.
pub trait Numbers<T: Scalar>: Copy {
    const COUNT: usize;
    fn from_numbers(values: &[T]) -> Self;
    fn numbers(&self) -> Vec<T>;
}

impl<T: Scalar, const N: usize> Numbers<T> for SVector<T, N> {
    const COUNT: usize = N;
    fn from_numbers(values: &[T]) -> Self {
        Self::read(values)
    }
    fn numbers(&self) -> Vec<T> {
        self.as_slice().to_vec()
    }
}

impl<T: Scalar, const N: usize> Numbers<T> for [BlockGains<T, N>; 2] {
    const COUNT: usize = 4 * N;
    fn from_numbers(values: &[T]) -> Self {
        let part = |i: usize| SVector::read(values.get(i * N..).unwrap_or(&[]));
        [BlockGains { a: part(0), b: part(1) }, BlockGains { a: part(2), b: part(3) }]
    }
    fn numbers(&self) -> Vec<T> {
        self.iter().flat_map(|gains| [gains.a, gains.b]).flat_map(|part| part.numbers()).collect()
    }
}

/// Lengths of corrections whose gains are remembered.
const RECENT: usize = 8;

/// (time, innovation, memory) → gains.
type GainsOfTime = dyn Fn(f64, f64, &[f64]) -> Vec<f64> + Send + Sync;

/// The gains of a law's placed corrections, computed by the law itself: they depend on its coefficients,
/// on the time that a correction is for and, where the gain moves, on innovation and memory; on no model.
pub struct Gains {
    pub count: usize,
    of: Box<GainsOfTime>,
    /// Those of the lengths used last.
    recent: Mutex<Vec<(u64, Vec<f64>)>>,
}

impl Gains {
    /// Of this law, in its precision.
    fn new<T, L>(law: L, at: Placement) -> Result<Arc<Self>>
    where
        T: Scalar,
        L: Injected<T, Innovation = T, Gains: Numbers<T>, Poles: Send + Sync>
            + Send
            + Sync
            + 'static,
    {
        let poles = law.poles(at)?;
        let of = move |length, e, memory: &[f64]| {
            // a constant gain has no memory in the table: its r stays as it begins
            let (mut z, mut memory) = (law.initial(), memory.iter());
            z.visit_mut(&mut |entry| *entry = memory.next().map_or(*entry, |of| T::from_f64(*of)));
            let (e, length) = (T::from_f64(e), T::from_f64(length));
            let gains = law.gains(at, &poles, &z, &e, length).numbers();
            gains.into_iter().map(T::to_f64).collect()
        };
        Ok(Arc::new(Self { count: L::Gains::COUNT, of: Box::new(of), recent: Mutex::default() }))
    }

    /// Of a law in the precision of the trace.
    pub fn of<L, L32>(
        setting: Setting,
        at: Placement,
        double: impl FnOnce() -> Result<L>,
        single: impl FnOnce() -> Result<L32>,
    ) -> Result<Arc<Self>>
    where
        L: Injected<f64, Innovation = f64, Gains: Numbers<f64>, Poles: Send + Sync>
            + Send
            + Sync
            + 'static,
        L32: Injected<f32, Innovation = f32, Gains: Numbers<f32>, Poles: Send + Sync>
            + Send
            + Sync
            + 'static,
    {
        if setting.single { Self::new(single()?, at) } else { Self::new(double()?, at) }
    }

    /// The gains of a correction for this time, of a gain that does not move. No thread waits for another:
    /// where one is at the remembered gains, the others compute.
    pub fn write(&self, length: f64, into: &mut [f64]) {
        let bits = length.to_bits();
        if let Ok(recent) = self.recent.try_lock()
            && let Some((_, known)) = recent.iter().find(|(known, _)| *known == bits)
        {
            into.copy_from_slice(known);
            return;
        }
        let gains = (self.of)(length, 0.0, &[]);
        into.copy_from_slice(&gains);
        if let Ok(mut recent) = self.recent.try_lock() {
            if recent.len() == RECENT {
                recent.remove(0);
            }
            recent.push((bits, gains));
        }
    }
}

/// Within a table: (time, innovation, memory) → gains.
impl Function for Gains {
    fn call(&self, arguments: &[f64]) -> Result<Vec<f64>> {
        match arguments {
            [length, e, memory @ ..] => Ok((self.of)(*length, *e, memory)),
            _ => Err(refused("gains are found from a time, an innovation and a memory")),
        }
    }
}

/// A continuous law of any order over traced numbers: what it moves are slices, so that all that is made
/// of its tables is compiled once.
trait Law {
    fn initial(&self) -> Vec<Traced>;
    fn innovation(&self, z: &[Traced], y: Traced) -> Vec<Traced>;
    fn rate(&self, t: Traced, z: &[Traced], e: &[Traced], u: &[Traced]) -> Vec<Traced>;
    fn injection(&self, z: &[Traced], e: &[Traced]) -> Vec<Traced>;
    fn stagger(&self, old: &[Traced], new: &[Traced], dt: Traced) -> Vec<Traced>;
    fn admissible(&self, z: &[Traced]) -> Vec<Traced>;
    fn jumped(&self, z: &[Traced], e: &[Traced]) -> Vec<Traced>;
}

/// One whose chain can move exactly.
trait FlowingLaw: Law {
    fn terms(&self, t: Traced, z: &[Traced], u: &[Traced]) -> Vec<Traced>;
    fn flow(&self, z: &[Traced], y: Traced, f: &[Traced], dt: Traced) -> Vec<Traced>;
    fn chain(&self, delta: &[Traced]) -> Vec<Traced>;
    fn shifted(&self, z: &[Traced], delta: &[Traced]) -> Vec<Traced>;
    fn kick(&self, z: &[Traced], e: &[Traced]) -> Vec<Traced>;
}

/// One whose eigenvalues can be placed.
trait PlacedLaw: FlowingLaw {
    fn closing(&self, z: &[Traced], e: &[Traced], dt: Traced) -> Result<Vec<Traced>>;
    fn decaying(&self, z: &[Traced], e: &[Traced], dt: Traced) -> Result<Vec<Traced>>;
    /// For a time that is asked for once the poles are known.
    fn gains(
        &self,
        at: Placement,
        z: &[Traced],
        y: Traced,
        dt: &dyn Fn() -> Traced,
    ) -> Result<Vec<Traced>>;
    fn inject(&self, z: &[Traced], y: Traced, gains: &[Traced], dt: Traced) -> Vec<Traced>;
}

/// A law of the core as such.
struct Flat<L> {
    law: L,
    /// Entries of its memory in the tables: its room for the gain's, which stands last, may be larger.
    len: usize,
}

impl<L: ContinuousLaw<Traced>> Flat<L> {
    fn z(&self, z: &L::State) -> Vec<Traced> {
        let mut z = flat(z);
        z.truncate(self.len);
        z
    }
}

impl<L> Law for Flat<L>
where
    L: ContinuousLaw<Traced, Input: Memory<Traced>, Innovation: Memory<Traced>>,
{
    fn initial(&self) -> Vec<Traced> {
        self.z(&self.law.initial())
    }
    fn innovation(&self, z: &[Traced], y: Traced) -> Vec<Traced> {
        flat(&self.law.innovation(&L::State::read(z), y))
    }
    fn rate(&self, t: Traced, z: &[Traced], e: &[Traced], u: &[Traced]) -> Vec<Traced> {
        let (e, u) = (L::Innovation::read(e), L::Input::read(u));
        self.z(&self.law.rate(t, &L::State::read(z), &e, &u))
    }
    fn injection(&self, z: &[Traced], e: &[Traced]) -> Vec<Traced> {
        self.z(&self.law.injection(&L::State::read(z), &L::Innovation::read(e)))
    }
    fn stagger(&self, old: &[Traced], new: &[Traced], dt: Traced) -> Vec<Traced> {
        self.z(&self.law.stagger(&L::State::read(old), L::State::read(new), dt))
    }
    fn admissible(&self, z: &[Traced]) -> Vec<Traced> {
        self.z(&self.law.admissible(L::State::read(z)))
    }
    fn jumped(&self, z: &[Traced], e: &[Traced]) -> Vec<Traced> {
        self.z(&self.law.jumped(L::State::read(z), &L::Innovation::read(e)))
    }
}

impl<L> FlowingLaw for Flat<L>
where
    L: ContinuousLaw<Traced, Input: Memory<Traced>, Innovation: Memory<Traced>>
        + Flow<Traced, L::State, L::Input>,
{
    fn terms(&self, t: Traced, z: &[Traced], u: &[Traced]) -> Vec<Traced> {
        flat(&self.law.terms(t, &L::State::read(z), &L::Input::read(u)))
    }
    fn flow(&self, z: &[Traced], y: Traced, f: &[Traced], dt: Traced) -> Vec<Traced> {
        self.z(&self.law.flow_under(&L::State::read(z), y, &L::Terms::read(f), dt))
    }
    fn chain(&self, delta: &[Traced]) -> Vec<Traced> {
        flat(&self.law.chain(&L::Terms::read(delta)))
    }
    fn shifted(&self, z: &[Traced], delta: &[Traced]) -> Vec<Traced> {
        self.z(&self.law.shifted(&L::State::read(z), &L::Terms::read(delta)))
    }
    fn kick(&self, z: &[Traced], e: &[Traced]) -> Vec<Traced> {
        self.z(&self.law.kick(&L::State::read(z), &L::Innovation::read(e)))
    }
}

impl<L> PlacedLaw for Flat<L>
where
    L: Injected<Traced, Input: Memory<Traced>, Innovation: Memory<Traced>, Gains: Numbers<Traced>>,
{
    fn closing(&self, z: &[Traced], e: &[Traced], dt: Traced) -> Result<Vec<Traced>> {
        self.law.closed()?;
        Ok(self.z(&self.law.closing(&L::State::read(z), &L::Innovation::read(e), dt)))
    }
    fn decaying(&self, z: &[Traced], e: &[Traced], dt: Traced) -> Result<Vec<Traced>> {
        self.law.decays()?;
        let (z, e) = self.law.decaying(&L::State::read(z), &L::Innovation::read(e), dt);
        Ok([self.z(&z), flat(&e)].concat())
    }
    fn gains(
        &self,
        at: Placement,
        z: &[Traced],
        y: Traced,
        dt: &dyn Fn() -> Traced,
    ) -> Result<Vec<Traced>> {
        let (poles, z) = (self.law.poles(at)?, L::State::read(z));
        Ok(self.law.gains(at, &poles, &z, &self.law.innovation(&z, y), dt()).numbers())
    }
    fn inject(&self, z: &[Traced], y: Traced, gains: &[Traced], dt: Traced) -> Vec<Traced> {
        let z = L::State::read(z);
        let e = self.law.innovation(&z, y);
        self.z(&self.law.inject(&z, &e, &L::Gains::from_numbers(gains), dt))
    }
}

/// What is known of a law beside its type: its known inputs, whether its gain is the same at every sample,
/// and entries at the end of its memory that its gain has no use for.
#[derive(Clone, Copy)]
pub struct Kept {
    pub n_u: usize,
    pub still: bool,
    pub spare: usize,
}

/// What is known of a law by its type.
#[derive(Clone, Copy)]
struct Sizes {
    n: usize,
    len: usize,
    errors: usize,
}

impl Sizes {
    fn of<L>(spare: usize) -> Self
    where
        L: ContinuousLaw<Traced, Innovation: Memory<Traced>>,
    {
        let len = L::State::LEN.saturating_sub(spare);
        Self { n: L::ESTIMATED, len, errors: L::Innovation::LEN }
    }
}

/// One function of a law: its inputs by name and number, then what the law's model has for inputs of its
/// own, which come to be when the law is built.
fn part(
    setting: Setting,
    given: &[(&str, usize)],
    function: impl FnOnce(&[Vec<Traced>]) -> Result<Vec<Traced>>,
) -> Result<Table> {
    trace(setting, || {
        let given: Vec<Vec<Traced>> =
            given.iter().map(|(name, count)| inputs(name, *count)).collect();
        Ok(named("made", &function(&given)?))
    })
}

/// (z, e, dt) → what a sample moves, as a rate.
type Kick<'a> = dyn Fn(&[Traced], &[Traced], Traced) -> Result<Vec<Traced>> + 'a;

/// Its table.
fn kicked(setting: Setting, Sizes { len, errors, .. }: Sizes, kick: &Kick<'_>) -> Result<Table> {
    part(setting, &[("z", len), ("e", errors), ("dt", 1)], |of| kick(&of[0], &of[1], of[2][0]))
}

pub fn flat<M: Memory<Traced>>(memory: &M) -> Vec<Traced> {
    let mut values = vec![Traced::ZERO; M::LEN];
    memory.write(&mut values);
    values
}

impl LawTables {
    /// Of a law whose eigenvalues cannot be placed.
    pub fn known<L>(
        setting: Setting,
        manner: Manner,
        kept: Kept,
        build: impl Fn() -> Result<L>,
    ) -> Result<Self>
    where
        L: ContinuousLaw<Traced, Input: Memory<Traced>, Innovation: Memory<Traced>> + 'static,
    {
        let sizes = Sizes::of::<L>(kept.spare);
        if !matches!(manner.method, AnyMethod::Known(_)) {
            return Err(not_placed(manner.method));
        }
        Self::of(setting, kept.n_u, sizes, &|| Ok(Box::new(Flat { law: build()?, len: sizes.len })))
    }

    /// Of a law whose chain can move exactly and whose eigenvalues cannot be placed.
    pub fn flowing<L>(
        setting: Setting,
        manner: Manner,
        kept: Kept,
        build: impl Fn() -> Result<L>,
    ) -> Result<Self>
    where
        L: ContinuousLaw<Traced, Input: Memory<Traced>, Innovation: Memory<Traced>>
            + Flow<Traced, L::State, L::Input>
            + 'static,
    {
        let sizes = Sizes::of::<L>(kept.spare);
        Self::that_flows(setting, manner, kept.n_u, (sizes, L::Terms::LEN), &|| {
            Ok(Box::new(Flat { law: build()?, len: sizes.len }))
        })
    }

    fn that_flows(
        setting: Setting,
        manner: Manner,
        n_u: usize,
        (sizes, n_f): (Sizes, usize),
        build: &dyn Fn() -> Result<Box<dyn FlowingLaw>>,
    ) -> Result<Self> {
        let placed = match manner.method {
            AnyMethod::Known(_) => None,
            AnyMethod::Proper => Some(PlacedTables {
                kick: kicked(setting, sizes, &|z, e, _| Ok(build()?.kick(z, e)))?,
                ..Self::chain(setting, (sizes.len, n_f, n_u), build)?
            }),
            other => return Err(not_placed(other)),
        };
        Ok(Self { placed, ..Self::of(setting, n_u, sizes, &|| Ok(build()?))? })
    }

    /// Of any other.
    pub fn any<L>(
        setting: Setting,
        manner: Manner,
        kept: Kept,
        build: impl Fn() -> Result<L>,
        gains: impl Fn(Placement) -> Result<Arc<Gains>>,
    ) -> Result<Self>
    where
        L: Injected<
                Traced,
                Input: Memory<Traced>,
                Innovation: Memory<Traced>,
                Gains: Numbers<Traced>,
            > + 'static,
    {
        let sizes = Sizes::of::<L>(kept.spare);
        let of = (sizes, L::Terms::LEN, L::TRACEABLE);
        let build = || -> Result<Box<dyn PlacedLaw>> {
            Ok(Box::new(Flat { law: build()?, len: sizes.len }))
        };
        Self::that_is_placed(setting, manner, kept, of, &build, &gains)
    }

    fn that_is_placed(
        setting: Setting,
        manner: Manner,
        Kept { n_u, still, .. }: Kept,
        (sizes, n_f, traceable): (Sizes, usize, bool),
        build: &dyn Fn() -> Result<Box<dyn PlacedLaw>>,
        gains: &dyn Fn(Placement) -> Result<Arc<Gains>>,
    ) -> Result<Self> {
        let chain = || Self::chain(setting, (sizes.len, n_f, n_u), &|| Ok(build()?));
        let placed = match manner.method {
            AnyMethod::Known(_) => None,
            AnyMethod::Proper => Some(PlacedTables {
                kick: kicked(setting, sizes, &|z, e, _| Ok(build()?.kick(z, e)))?,
                ..chain()?
            }),
            AnyMethod::Implicit => Some(PlacedTables {
                kick: kicked(setting, sizes, &|z, e, dt| build()?.closing(z, e, dt))?,
                ..PlacedTables::default()
            }),
            AnyMethod::InterSample => Some(PlacedTables {
                kick: kicked(setting, sizes, &|z, e, dt| build()?.decaying(z, e, dt))?,
                ..chain()?
            }),
            AnyMethod::Placed(at) => {
                let known = still && matches!(setting.gains, PlacedGains::For(_));
                let given = still
                    && match setting.gains {
                        PlacedGains::Given => true,
                        PlacedGains::Held => !traceable,
                        PlacedGains::Computed | PlacedGains::For(_) => false,
                    };
                let gains = match (given, traceable || known) {
                    (true, _) => GainsOf::Inputs(gains(at)?),
                    (false, true) => GainsOf::Table,
                    (false, false) => GainsOf::Call(gains(at)?),
                };
                let at = (at, manner.timing);
                Some(Self::placed(setting, at, sizes.len, build, gains, chain()?)?)
            }
        };
        Ok(Self { placed, ..Self::of(setting, n_u, sizes, &|| Ok(build()?))? })
    }

    fn of(
        setting: Setting,
        n_u: usize,
        Sizes { n, len, errors }: Sizes,
        build: &dyn Fn() -> Result<Box<dyn Law>>,
    ) -> Result<Self> {
        let mut initial = Vec::new();
        part(setting, &[], |_| {
            initial = build()?.initial().into_iter().map(Scalar::to_f64).collect();
            Ok(Vec::new())
        })?;
        let jumped =
            part(setting, &[("z", len), ("e", errors)], |of| Ok(build()?.jumped(&of[0], &of[1])))?;
        let moving = [("t", 1), ("z", len), ("e", errors), ("u", n_u)];
        let stagger = [("old", len), ("new", len), ("dt", 1)];
        Ok(Self {
            n,
            len,
            errors,
            n_u,
            initial,
            innovation: part(setting, &[("z", len), ("y", 1)], |of| {
                Ok(build()?.innovation(&of[0], of[1][0]))
            })?,
            rate: part(setting, &moving, |of| Ok(build()?.rate(of[0][0], &of[1], &of[2], &of[3])))?,
            injection: part(setting, &[("z", len), ("e", errors)], |of| {
                Ok(build()?.injection(&of[0], &of[1]))
            })?,
            stagger: part(setting, &stagger, |of| Ok(build()?.stagger(&of[0], &of[1], of[2][0])))?,
            admissible: part(setting, &[("z", len)], |of| Ok(build()?.admissible(&of[0])))?,
            jumps: !jumped.operations.is_empty(),
            jumped,
            placed: None,
        })
    }

    /// The parts of a law whose chain moves exactly.
    fn chain(
        setting: Setting,
        (len, n_f, n_u): (usize, usize, usize),
        build: &dyn Fn() -> Result<Box<dyn FlowingLaw>>,
    ) -> Result<PlacedTables> {
        let known = [("t", 1), ("z", len), ("u", n_u)];
        let free = [("z", len), ("y", 1), ("f", n_f), ("dt", 1)];
        let terms = part(setting, &known, |of| Ok(build()?.terms(of[0][0], &of[1], &of[2])))?;
        let flow =
            part(setting, &free, |of| Ok(build()?.flow(&of[0], of[1][0], &of[2], of[3][0])))?;
        let chain = part(setting, &[("delta", n_f)], |of| Ok(build()?.chain(&of[0])))?;
        let shifted =
            part(
                setting,
                &[("z", len), ("delta", n_f)],
                |of| Ok(build()?.shifted(&of[0], &of[1])),
            )?;
        Ok(PlacedTables { n_f, terms, flow, chain, shifted, ..PlacedTables::default() })
    }

    fn placed(
        setting: Setting,
        (at, timing): (Placement, Timing),
        len: usize,
        build: &dyn Fn() -> Result<Box<dyn PlacedLaw>>,
        gains: GainsOf,
        chain: PlacedTables,
    ) -> Result<PlacedTables> {
        let (inputs, called) = match gains {
            GainsOf::Inputs(gains) => (Some(gains), None),
            GainsOf::Call(gains) => (None, Some(gains)),
            GainsOf::Table => (None, None),
        };
        let count = inputs.as_ref().map_or(0, |gains| gains.count);
        let sampled = [("z", len), ("y", 1), ("dt", 1), ("gains", count)];
        let correct = part(setting, &sampled, |of| {
            let (law, z, y, dt) = (build()?, of[0].as_slice(), of[1][0], of[2][0]);
            if count > 0 {
                return Ok(law.inject(z, y, &of[3], dt));
            }
            if let Some(gains) = &called {
                let e = law.innovation(z, y);
                let given = [&[dt], e.as_slice(), z].concat();
                let gains = trace::native(gains.clone(), &given, gains.count);
                return Ok(law.inject(z, y, &gains, dt));
            }
            let PlacedGains::For(length) = setting.gains else {
                return Ok(law.inject(z, y, &law.gains(at, z, y, &|| dt)?, dt));
            };
            let length = || Traced::from_f64(length);
            let gains = law.gains(at, z, y, &length)?;
            let length = length();
            let made = law.inject(z, y, &gains, length);
            if timing == Timing::Predictor {
                return Ok(made);
            }
            // a correction for no time, as at the start, moves nothing; for another time it has no value
            let chosen = made.iter().zip(z).map(|(made, z)| {
                let other = trace::if_equal([dt, Traced::ZERO], *z, Traced::from_f64(f64::NAN));
                trace::if_equal([dt, length], *made, other)
            });
            Ok(chosen.collect())
        })?;
        Ok(PlacedTables { correct, gains: inputs, ..chain })
    }

    /// The gains of a placed correction, where they are inputs of the step.
    pub fn gains(&self) -> Option<&Arc<Gains>> {
        self.placed.as_ref()?.gains.as_ref()
    }

    /// (t, z, y, u) → ż: what moves together with a plant.
    pub fn together(&self, setting: Setting) -> Result<(Table, Table)> {
        let rate = trace(setting, || {
            let (t, z) = (input("t"), inputs("z", self.len));
            let (y, u) = (input("y[0]"), inputs("u", self.n_u));
            let own = self.own();
            let law = Tabled { tables: self, motion: AnyMotion::Held, own: &own, gains: &[] };
            let (z, u) = (State::read(&z), Inputs::read(&u));
            let rate = law.rate(t, &z, &law.innovation(&z, y), &u);
            Ok(named("z", &rate.as_slice()[..self.len]))
        })?;
        Ok((rate, self.admissible.clone()))
    }

    /// Inputs of the law's model: those of its functions behind what they are given.
    fn own(&self) -> Vec<Traced> {
        let given = 1 + self.len + self.errors + self.n_u;
        self.rate.inputs[given..].iter().map(|name| input(name)).collect()
    }

    /// Entries of an observer's memory.
    pub fn memory(&self, manner: Manner) -> usize {
        self.len + manner.held()
    }

    /// Whether the estimate is corrected, then moves.
    pub fn is_placed(&self) -> bool {
        self.placed.as_ref().is_some_and(|of| !of.correct.outputs.is_empty())
    }

    /// What a step is traced over: (t, dt, z, y, u, own inputs of the model, gains).
    fn over<R>(&self, manner: Manner, step: impl FnOnce(Tabled<'_>, Given<'_>) -> R) -> R {
        let (t, dt) = (input("t"), input("dt"));
        let memory = inputs("z", self.memory(manner));
        let (y, u) = (input("y[0]"), Inputs::read(&inputs("u", self.n_u)));
        let own = self.own();
        let gains = inputs("gains", self.gains().map_or(0, |gains| gains.count));
        let law = Tabled { tables: self, motion: manner.motion, own: &own, gains: &gains };
        let (z, held) = memory.split_at(self.len);
        step(law, Given { t, dt, z: State::read(z), held, y, u })
    }

    /// The memory and the innovation as outputs.
    fn made(&self, z: &State, held: &[Traced], innovation: &[Traced]) -> Vec<(String, Traced)> {
        let z = [&z.as_slice()[..self.len], held].concat();
        [named("z", &z), named("innovation", innovation)].concat()
    }

    /// The use of a sample with current timing: (t, dt, z, y, u, …) → (z⁺, innovation).
    pub fn correct(&self, setting: Setting, manner: Manner) -> Result<Option<Table>> {
        if manner.timing == Timing::Predictor {
            return Ok(None);
        }
        let table = trace(setting, || {
            self.over(manner, |law, given| {
                Ok(match manner.method {
                    AnyMethod::Known(scheme) => self.corrected(law, scheme, &given),
                    AnyMethod::Placed(_) => self.corrected(law, law, &given),
                    AnyMethod::Proper => {
                        self.corrected(law, Proper { motion: manner.motion }, &given)
                    }
                    AnyMethod::Implicit => self.corrected(law, Implicit, &given),
                    AnyMethod::InterSample => return Err(not_placed(manner.method)),
                })
            })
        })?;
        Ok(Some(table))
    }

    /// The way to the next sample: (t, dt, z, y, u, …) → (z⁺, innovation with predictor timing).
    pub fn advance(&self, setting: Setting, manner: Manner) -> Result<Table> {
        trace(setting, || {
            self.over(manner, |law, given| {
                Ok(match manner.method {
                    AnyMethod::Known(scheme) => self.moved(law, scheme, manner, &given),
                    AnyMethod::Placed(_) => self.moved(law, law, manner, &given),
                    AnyMethod::Proper => {
                        self.moved(law, Proper { motion: manner.motion }, manner, &given)
                    }
                    AnyMethod::Implicit => self.moved(law, Implicit, manner, &given),
                    AnyMethod::InterSample => self.decayed(law, manner, &given),
                })
            })
        })
    }

    fn corrected<'a, S: Scheme<Traced, Tabled<'a>>>(
        &self,
        law: Tabled<'a>,
        scheme: S,
        given: &Given<'_>,
    ) -> Vec<(String, Traced)> {
        let observer = Current { law, scheme };
        let before = CurrentState { law: given.z, elapsed: given.held[0] };
        let mut next = before;
        observer.correct(&mut next, &given.y, given.t);
        let innovation = observer.innovation(given.t, &before, &given.y, &given.u);
        self.made(&next.law, &[next.elapsed], &[innovation])
    }

    fn moved<'a, S: Scheme<Traced, Tabled<'a>>>(
        &self,
        law: Tabled<'a>,
        scheme: S,
        manner: Manner,
        given: &Given<'_>,
    ) -> Vec<(String, Traced)> {
        let Given { t, dt, z, y, u, .. } = given;
        match manner.timing {
            Timing::Predictor => {
                let observer = Discretised { law, scheme };
                let mut next = *z;
                observer.advance(&mut next, y, u, *t, *dt);
                self.made(&next, &[], &[observer.innovation(*t, z, y, u)])
            }
            Timing::Current => {
                let observer = Current { law, scheme };
                let mut next = CurrentState { law: *z, elapsed: given.held[0] };
                observer.predict(&mut next, u, *t, *dt);
                self.made(&next.law, &[next.elapsed], &[])
            }
        }
    }

    fn decayed(&self, law: Tabled<'_>, manner: Manner, given: &Given<'_>) -> Vec<(String, Traced)> {
        let Given { t, dt, z, held, y, u } = given;
        let observer = InterSample { law, motion: manner.motion };
        let before = (*z, Innovations::read(held));
        let mut next = before;
        observer.advance(&mut next, y, u, *t, *dt);
        let innovation = observer.innovation(*t, &before, y, u);
        self.made(&next.0, &next.1.as_slice()[..self.errors], &[innovation])
    }
}

/// The inputs of a step.
struct Given<'a> {
    t: Traced,
    dt: Traced,
    z: State,
    /// The time of the next correction, with current timing.
    held: &'a [Traced],
    y: Traced,
    u: Inputs,
}

/// A law that is known by its tables; as a scheme, the one that places its eigenvalues.
#[derive(Clone, Copy)]
struct Tabled<'a> {
    tables: &'a LawTables,
    motion: AnyMotion,
    own: &'a [Traced],
    gains: &'a [Traced],
}

impl Tabled<'_> {
    fn call(&self, table: &Table, given: &[&[Traced]]) -> State {
        State::read(&inline(table, &[given.concat().as_slice(), self.own].concat()))
    }
    /// A part of a law that is placed; of another one there is none to ask for.
    fn placed(&self, part: impl Fn(&PlacedTables) -> &Table, given: &[&[Traced]]) -> State {
        self.tables.placed.as_ref().map_or(State::zero(), |of| self.call(part(of), given))
    }
    fn z<'b>(&self, z: &'b State) -> &'b [Traced] {
        &z.as_slice()[..self.tables.len]
    }
    fn f<'b>(&self, f: &'b State) -> &'b [Traced] {
        &f.as_slice()[..self.tables.placed.as_ref().map_or(0, |of| of.n_f)]
    }
    fn e<'b>(&self, e: &'b Innovations) -> &'b [Traced] {
        &e.as_slice()[..self.tables.errors]
    }
    fn u<'b>(&self, u: &'b Inputs) -> &'b [Traced] {
        &u.as_slice()[..self.tables.n_u]
    }
}

impl ContinuousLaw<Traced> for Tabled<'_> {
    type State = State;
    type Input = Inputs;
    type Innovation = Innovations;
    const ESTIMATED: usize = Z;
    fn initial(&self) -> State {
        State::zero()
    }
    fn innovation(&self, z: &State, y: Traced) -> Innovations {
        let made = self.call(&self.tables.innovation, &[self.z(z), &[y]]);
        Innovations::read(made.as_slice())
    }
    fn rate(&self, t: Traced, z: &State, e: &Innovations, u: &Inputs) -> State {
        self.call(&self.tables.rate, &[&[t], self.z(z), self.e(e), self.u(u)])
    }
    fn injection(&self, z: &State, e: &Innovations) -> State {
        self.call(&self.tables.injection, &[self.z(z), self.e(e)])
    }
    fn stagger(&self, old: &State, new: State, dt: Traced) -> State {
        self.call(&self.tables.stagger, &[self.z(old), self.z(&new), &[dt]])
    }
    fn admissible(&self, z: State) -> State {
        self.call(&self.tables.admissible, &[self.z(&z)])
    }
    fn jumped(&self, z: State, e: &Innovations) -> State {
        self.call(&self.tables.jumped, &[self.z(&z), self.e(e)])
    }
    fn kick(&self, z: &State, e: &Innovations) -> State {
        self.placed(|of| &of.kick, &[self.z(z), self.e(e), &[Traced::ZERO]])
    }
    fn speed(&self, _: &State) -> Traced {
        Traced::ONE
    }
    fn estimate<'a>(&self, z: &'a State) -> &'a [Traced] {
        &z.as_slice()[..self.tables.n]
    }
}

impl OneChain<Traced> for Tabled<'_> {
    fn decaying(&self, z: &State, e: &Innovations, dt: Traced) -> (State, Innovations) {
        let made = self.placed(|of| &of.kick, &[self.z(z), self.e(e), &[dt]]);
        (made, Innovations::read(&made.as_slice()[self.tables.len..]))
    }

    fn closing(&self, z: &State, e: &Innovations, dt: Traced) -> State {
        self.placed(|of| &of.kick, &[self.z(z), self.e(e), &[dt]])
    }
}

impl Flow<Traced, State, Inputs> for Tabled<'_> {
    type Terms = State;
    fn terms(&self, t: Traced, z: &State, u: &Inputs) -> State {
        self.placed(|of| &of.terms, &[&[t], self.z(z), self.u(u)])
    }
    fn flow(&self, z: &State, f: &State, dt: Traced) -> State {
        self.flow_under(z, absent(), f, dt)
    }
    fn flow_under(&self, z: &State, y: Traced, f: &State, dt: Traced) -> State {
        self.placed(|of| &of.flow, &[self.z(z), &[y], self.f(f), &[dt]])
    }
    fn chain(&self, delta: &State) -> State {
        self.placed(|of| &of.chain, &[self.f(delta)])
    }
    fn shifted(&self, z: &State, delta: &State) -> State {
        self.placed(|of| &of.shifted, &[self.z(z), self.f(delta)])
    }
    fn rows(&self) -> usize {
        self.tables.n
    }
}

impl<'a> Scheme<Traced, Tabled<'a>> for Tabled<'a> {
    const OVER_GAPS: bool = true;
    fn advance(
        &self,
        law: &Self,
        t: Traced,
        z: &State,
        y: Traced,
        u: &Inputs,
        dt: Traced,
    ) -> State {
        self.predict(law, t, &self.correct(law, z, y, dt), u, dt)
    }
    fn predict(&self, _: &Self, t: Traced, z: &State, u: &Inputs, dt: Traced) -> State {
        self.motion.moved(self, t, z, u, dt)
    }
    fn correct(&self, _: &Self, z: &State, y: Traced, dt: Traced) -> State {
        self.placed(|of| &of.correct, &[self.z(z), &[y], &[dt], self.gains])
    }
}
