//! Floor 3. Continuous laws whose step is cut in two, a prediction and a correction: current timing under every
//! method, and the methods that place eigenvalues under both timings.
//!
//! What is chosen at run time stays so, one law's halves behind one table of functions: there are too
//! many combinations to compile each as one loop.

use crate::errors::{Result, refused};
use crate::interrupt::StopFlag;
use crate::plan::{NO_PLANT, PREDICTOR_ONLY, Plan, Studied, StudyResult};
use hgo_ir::choices::{AnyMethod, Manner, NOT_PLACED};
use hgo_ir::recursion::{AnyObserver, Block, Recursion};
use hgo_ir::systems::AnyPlant;
use hgo_rs::Scalar;
use hgo_rs::injection::{Injected, Placed};
use hgo_rs::memory::Memory;
use hgo_rs::observer::{
    ContinuousLaw, Discretisation, Discretised, Observer, Scheme, Status, Timing,
};
use hgo_rs::schedule::Schedule;
use nalgebra::SVector;
use std::sync::{Arc, Mutex};

/// No memory of a law of order 2 or 5 is longer than this.
const WIDEST: usize = 24;

/// The two halves of a step, on the law's memory as a flat vector.
pub trait Halves: Send + Sync {
    fn initial(&self) -> Vec<f64>;
    fn predict(&self, memory: &mut [f64], u: &[f64], t: f64, dt: f64) -> hgo_ir::Result<()>;
    fn correct(&self, memory: &mut [f64], y: f64, dt: f64);
    /// [`Scheme::OVER_GAPS`].
    fn over_gaps(&self) -> bool;
    /// The same with its gains computed for steps of this length, if that is of use.
    fn prepared(&self, dt: f64) -> Option<Box<dyn Halves>>;
}

/// A method of [`hgo_rs::observer::METHODS`]: a step without a sample, and its correction.
pub struct Known<L> {
    pub free: Box<dyn Recursion>,
    pub law: L,
}

impl<L> Halves for Known<L>
where
    L: ContinuousLaw<f64, Input: Memory<f64>> + Send + Sync + 'static,
{
    fn initial(&self) -> Vec<f64> {
        flat(&self.law.initial())
    }
    fn predict(&self, memory: &mut [f64], u: &[f64], t: f64, dt: f64) -> hgo_ir::Result<()> {
        self.free.advance(memory, &[f64::NAN], u, t, dt).map(|_| ())
    }
    fn correct(&self, memory: &mut [f64], y: f64, dt: f64) {
        let (law, z) = (&self.law, L::State::read(memory));
        // the same for every method
        law.admissible(hgo_rs::observer::Euler.correct(law, &z, y, dt)).write(memory);
    }
    fn over_gaps(&self) -> bool {
        false
    }
    fn prepared(&self, _: f64) -> Option<Box<dyn Halves>> {
        None
    }
}

impl<L> Halves for Discretised<L, Placed<f64, L::Poles, L::Gains>>
where
    L: Injected<f64, Input: Memory<f64>> + Send + Sync + 'static,
    L::Poles: Send + Sync,
    L::Gains: Send + Sync,
{
    fn initial(&self) -> Vec<f64> {
        flat(&self.law.initial())
    }
    fn predict(&self, memory: &mut [f64], u: &[f64], t: f64, dt: f64) -> hgo_ir::Result<()> {
        let (law, z, u) = (&self.law, L::State::read(memory), L::Input::read(u));
        law.admissible(self.scheme.predict(law, t, &z, &u, dt)).write(memory);
        Ok(())
    }
    fn correct(&self, memory: &mut [f64], y: f64, dt: f64) {
        let (law, z) = (&self.law, L::State::read(memory));
        law.admissible(self.scheme.correct(law, &z, y, dt)).write(memory);
    }
    fn over_gaps(&self) -> bool {
        true
    }
    fn prepared(&self, dt: f64) -> Option<Box<dyn Halves>> {
        L::CONSTANT.then(|| -> Box<dyn Halves> { Box::new(Observer::prepared(self, dt)) })
    }
}

fn flat(z: &impl Memory<f64>) -> Vec<f64> {
    let mut values = Vec::new();
    z.visit(&mut |value| values.push(value));
    values
}

/// An observer of two halves. Memory: the law's; with current timing then the time that the next
/// correction is for, as in [`hgo_rs::observer::Current`].
pub struct Halved {
    pub halves: Box<dyn Halves>,
    pub n: usize,
    pub n_u: usize,
    /// Entries of the law's memory.
    pub law_len: usize,
    pub timing: Timing,
    over_gaps: bool,
    /// The halves prepared for the length of the last correction, `None` where that is of no use.
    usual: Mutex<Option<Usual>>,
}

/// The length of a correction, and halves prepared for it.
type Usual = (f64, Option<Arc<dyn Halves>>);

impl Halved {
    pub fn new(halves: Box<dyn Halves>, n: usize, n_u: usize, timing: Timing) -> Self {
        let (law_len, over_gaps) = (halves.initial().len(), halves.over_gaps());
        Self { halves, n, n_u, law_len, timing, over_gaps, usual: Mutex::default() }
    }

    /// The halves with gains for corrections of this length, which most steps have in common.
    fn usual(&self, dt: f64) -> Option<Arc<dyn Halves>> {
        let mut usual = self.usual.lock().ok()?;
        if let Some((length, halves)) = &*usual
            && length.to_bits() == dt.to_bits()
        {
            return halves.clone();
        }
        let halves = self.halves.prepared(dt).map(Arc::from);
        *usual = Some((dt, halves.clone()));
        halves
    }

    /// Take the sample, with current timing.
    fn corrected(&self, halves: &dyn Halves, memory: &mut [f64], y: f64) {
        let (law, held) = memory.split_at_mut(self.law_len);
        if let [elapsed] = held {
            let left = elapsed.while_missing(y);
            halves.correct(law, y, *elapsed - left);
            *elapsed = left;
        }
    }

    /// Move to the next sample; with predictor timing by the sample y.
    fn moved(
        &self,
        halves: &dyn Halves,
        memory: &mut [f64],
        y: f64,
        u: &[f64],
        (t, dt): (f64, f64),
    ) -> hgo_ir::Result<()> {
        let (law, held) = memory.split_at_mut(self.law_len);
        match held {
            [elapsed] => *elapsed = if self.over_gaps { *elapsed + dt } else { dt },
            _ => halves.correct(law, y, dt),
        }
        halves.predict(law, u, t, dt)
    }
}

fn sample(y: &[f64]) -> f64 {
    y.first().copied().unwrap_or(f64::NAN)
}

impl Recursion for Halved {
    fn correct(&self, memory: &mut [f64], y: &[f64], _: f64) -> hgo_ir::Result<Status> {
        let y = sample(y);
        if let Some(elapsed) = memory.get(self.law_len) {
            let usual = self.usual(*elapsed);
            self.corrected(usual.as_deref().unwrap_or(&*self.halves), memory, y);
        }
        Ok(Status::of(&y))
    }

    fn advance(
        &self,
        memory: &mut [f64],
        y: &[f64],
        u: &[f64],
        t: f64,
        dt: f64,
    ) -> hgo_ir::Result<Status> {
        let y = sample(y);
        let usual = if self.timing == Timing::Predictor { self.usual(dt) } else { None };
        let halves = usual.as_deref().unwrap_or(&*self.halves);
        self.moved(halves, memory, y, u, (t, dt))?;
        Ok(Status::of(&y))
    }

    fn over_block(&self, memory: &mut [f64], mut block: Block<'_>) -> hgo_ir::Result<f64> {
        let usual = block.dt.first().and_then(|dt| self.usual(*dt));
        let halves = usual.as_deref().unwrap_or(&*self.halves);
        let m = memory.len();
        let (mut largest, mut spoilt) = (0.0_f64, 0.0);
        for (k, row) in block.memory.chunks_exact_mut(m).enumerate() {
            let (t, u) = (block.t[k], &block.u[k * self.n_u..][..self.n_u]);
            let y = block.y.take(k, 1)[0];
            if let Some(innovation) = block.innovation.get_mut(k) {
                *innovation = y - memory[0];
            }
            self.corrected(halves, memory, y);
            row.copy_from_slice(memory);
            for value in row {
                largest = largest.max(value.abs());
                spoilt += 0.0 * *value; // NaN once the memory is not finite
            }
            block.status[k] = Status::of(&y) as u8;
            if let Some(dt) = block.dt.get(k) {
                self.moved(halves, memory, y, u, (t, *dt))?;
            }
        }
        Ok(largest + spoilt)
    }
}

impl AnyObserver for Halved {
    fn n(&self) -> usize {
        self.n
    }
    fn n_y(&self) -> usize {
        1
    }
    fn n_u(&self) -> usize {
        self.n_u
    }
    fn is_current(&self) -> bool {
        self.timing == Timing::Current
    }
    fn initial(&self) -> Vec<f64> {
        let mut memory = self.halves.initial();
        memory.resize(self.law_len + self.timing.held(), 0.0);
        memory
    }
    fn recursion(&self) -> &dyn Recursion {
        self
    }
}

impl Studied for Halved {
    fn law(&self) -> &dyn AnyObserver {
        self
    }
    fn study(&self, plan: &Plan, stop: &StopFlag) -> Result<StudyResult> {
        match (self.n, self.timing) {
            (2, Timing::Predictor) => of_halved(&Watched::<2, false>::new(self), plan, stop),
            (2, Timing::Current) => of_halved(&Watched::<2, true>::new(self), plan, stop),
            (5, Timing::Predictor) => of_halved(&Watched::<5, false>::new(self), plan, stop),
            (5, Timing::Current) => of_halved(&Watched::<5, true>::new(self), plan, stop),
            _ => Err(refused(NO_PLANT)),
        }
    }
}

/// The same as an observer of the core, for studies.
#[derive(Clone, Copy)]
pub struct Watched<'a, const N: usize, const CURRENT: bool> {
    pub whole: &'a Halved,
    halves: &'a dyn Halves,
}

impl<'a, const N: usize, const CURRENT: bool> Watched<'a, N, CURRENT> {
    fn new(whole: &'a Halved) -> Self {
        Self { whole, halves: &*whole.halves }
    }

    fn memory<'z>(&self, z: &'z mut SVector<f64, WIDEST>) -> &'z mut [f64] {
        &mut z.as_mut_slice()[..self.whole.law_len + self.whole.timing.held()]
    }

    /// With these halves in their place.
    pub fn with(&self, halves: &'a dyn Halves) -> Self {
        Self { halves, ..*self }
    }
}

impl<const N: usize, const CURRENT: bool> Observer<f64> for Watched<'_, N, CURRENT> {
    type State = SVector<f64, WIDEST>;
    type Measurement = f64;
    type Input = SVector<f64, 1>;
    const TIMING: Timing = if CURRENT { Timing::Current } else { Timing::Predictor };
    const ESTIMATED: usize = N;

    fn initial(&self) -> Self::State {
        Self::State::read(&AnyObserver::initial(self.whole))
    }

    fn correct(&self, z: &mut Self::State, y: &f64, _: f64) -> Status {
        self.whole.corrected(self.halves, self.memory(z), *y);
        Status::of(y)
    }

    fn advance(&self, z: &mut Self::State, y: &f64, u: &Self::Input, t: f64, dt: f64) -> Status {
        let u = &u.as_slice()[..self.whole.n_u];
        // the halves of compiled laws call nothing that could fail
        match self.whole.moved(self.halves, self.memory(z), *y, u, (t, dt)) {
            Ok(()) => Status::of(y),
            Err(_) => Status::ModelUndefined,
        }
    }

    fn estimate<'b>(&self, z: &'b Self::State) -> &'b [f64] {
        &z.as_slice()[..N]
    }

    fn innovation(&self, _: f64, z: &Self::State, y: &f64, _: &Self::Input) -> f64 {
        *y - z[0]
    }
}

/// The halves of a law whose eigenvalues cannot be placed.
pub fn known_halves<L>(
    manner: Manner,
    law: L,
    free: impl FnOnce(Discretisation) -> Box<dyn Recursion>,
) -> Result<Box<dyn Halves>>
where
    L: ContinuousLaw<f64, Input: Memory<f64>> + Send + Sync + 'static,
{
    match manner.method {
        AnyMethod::Known(scheme) => Ok(Box::new(Known { free: free(scheme), law })),
        AnyMethod::Placed(_) => Err(refused(NOT_PLACED)),
    }
}

/// The halves of a law whose eigenvalues can be placed.
pub fn halves<L>(
    manner: Manner,
    law: L,
    free: impl FnOnce(Discretisation) -> Box<dyn Recursion>,
) -> Result<Box<dyn Halves>>
where
    L: Injected<f64, Input: Memory<f64>> + Send + Sync + 'static,
    L::Poles: Send + Sync,
    L::Gains: Send + Sync,
{
    match manner.method {
        AnyMethod::Known(_) => known_halves(manner, law, free),
        AnyMethod::Placed(placement) => {
            Ok(Box::new(Discretised { law, scheme: Placed::new(&law, placement)? }))
        }
    }
}

/// Laws whose step is cut in two, with the plants of their order.
fn of_halved<const N: usize, const CURRENT: bool>(
    observer: &Watched<'_, N, CURRENT>,
    plan: &Plan,
    stop: &StopFlag,
) -> Result<StudyResult> {
    if plan.is_joint() {
        return Err(refused(PREDICTOR_ONLY));
    }
    let prepared = observer.whole.halves.prepared(plan.schedule.dt(0));
    let observer = match &prepared {
        Some(halves) => &observer.with(&**halves),
        None => observer,
    };
    let kept = observer.whole.law_len; // the time of the next correction is no signal
    match plan.plant {
        AnyPlant::Lee(plant) if N == 2 => plan.sampled(observer, plant, kept, stop),
        AnyPlant::SanfelicePraly(plant) if N == 2 => plan.sampled(observer, plant, kept, stop),
        AnyPlant::VanDerPol(plant) if N == 2 => plan.sampled(observer, plant, kept, stop),
        AnyPlant::Crackle(plant) if N == 5 => plan.sampled(observer, plant, kept, stop),
        _ => Err(refused(NO_PLANT)),
    }
}
