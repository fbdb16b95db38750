//! Floor 3. Plant, noise and observer in one loop.
//!
//! Three clocks: the observer steps by its schedule; the plant moves over the same time (or a
//! schedule of its own) in equal substeps; a noise draw is held for a number of steps.

use crate::Scalar;
use crate::error::DesignError;
use crate::integrate::{Integrator, PlantScheme, RightHandSide, WienerIncrement, plant_step};
use crate::memory::Memory;
use crate::metrics::{LogHistogram, Moments, SettlingTime, Window};
use crate::model::{Plant, StochasticIntegrator};
use crate::noise::{Channel, Noise, Sine, Stream};
use crate::observer::{ContinuousLaw, Measurement, Observer, Status};
use crate::schedule::Schedule;

/// Beyond this magnitude a run counts as diverged and is stopped.
pub const DIVERGED: f64 = 1e12;

/// What is the same for every run of an experiment.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Experiment<'a, T, P, S> {
    /// The plant.
    pub plant: P,
    /// How the plant moves.
    pub plant_scheme: PlantScheme,
    /// Equal substeps of the plant in one step, ≥ 1.
    pub substeps: u32,
    /// When the observer steps.
    pub schedule: S,
    /// When the plant steps, if not with the observer.
    pub plant_schedule: Option<S>,
    /// Measurement noise.
    pub noise: Noise<'a, T>,
    /// Number of steps K; samples are k = 0 … K.
    pub steps: u64,
    /// Seed of the study.
    pub seed: u64,
}

/// One sample of a run, as a probe sees it.
#[derive(Clone, Copy, Debug)]
pub struct Sample<'a, T, X, Z, Y> {
    /// Step index k.
    pub k: u64,
    /// Time in s.
    pub t: T,
    /// Plant state.
    pub x: &'a X,
    /// Observer memory.
    pub z: &'a Z,
    /// Measurement with noise.
    pub y: &'a Y,
    /// True values of what is estimated.
    pub truth: &'a [T],
    /// Their estimates.
    pub estimate: &'a [T],
}

/// Looks at every sample of a run.
pub trait Probe<T: Scalar> {
    /// Take a sample.
    fn sample<X: Memory<T>, Z: Memory<T>, Y: Measurement<T>>(
        &mut self,
        sample: &Sample<'_, T, X, Z, Y>,
    );
    /// Whether the run should stop early (asked now and then).
    #[inline(always)]
    fn interrupted(&mut self, _k: u64) -> bool {
        false
    }
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Finish<X, Z> {
    /// Last plant state.
    pub x: X,
    /// Last observer memory.
    pub z: Z,
    /// First sample at which a state was not finite or beyond [`DIVERGED`].
    pub diverged_at: Option<u64>,
    /// First sample at which the observer's model had no value.
    pub undefined_at: Option<u64>,
}

impl<T: Scalar, P: Plant<T>, S: Schedule<T>> Experiment<'_, T, P, S> {
    /// Refuse what no run could mean.
    ///
    /// # Errors
    /// A stochastic scheme that the plant does not support; no substeps; no hold.
    pub fn check(&self) -> Result<(), DesignError> {
        if let PlantScheme::Stochastic(scheme) = self.plant_scheme {
            let allowed = "this plant does not support the stochastic scheme: it needs process \
                           noise, and the strong order 1.5 scheme needs it to be additive";
            let value = match scheme {
                StochasticIntegrator::EulerMaruyama => 0.5,
                StochasticIntegrator::Milstein => 1.0,
                StochasticIntegrator::Taylor15 => 1.5,
            };
            let supported = self.plant.supports(scheme);
            crate::error::require("plant_method (strong order)", value, supported, allowed)?;
        }
        if let PlantScheme::Deterministic(_) = self.plant_scheme {
            let allowed = "the plant has process noise, which a deterministic plant_method would \
                           leave out: choose euler-maruyama, milstein or taylor-1.5, or sigma = 0";
            let noisy = self.plant.has_process_noise();
            crate::error::require("plant_method (strong order)", 0.0, !noisy, allowed)?;
        }
        let substeps = f64::from(self.substeps);
        crate::error::require("substeps", substeps, self.substeps >= 1, "it must be at least 1")?;
        let hold = self.noise.hold as f64;
        crate::error::require("hold", hold, self.noise.hold >= 1, "it must be at least 1 step")?;
        Ok(())
    }

    /// The plant's state after a step of length dt under the input u.
    #[inline(always)]
    fn move_plant(
        &self,
        process: &mut Stream,
        t: T,
        x: &P::State,
        u: &P::Input,
        dt: T,
    ) -> P::State {
        if self.plant_scheme == PlantScheme::Held {
            return *x;
        }
        let h = dt / T::from_f64(f64::from(self.substeps));
        let mut state = *x;
        for i in 0..self.substeps {
            let time = t + T::from_f64(f64::from(i)) * h;
            state = match self.plant_scheme {
                PlantScheme::Held => state,
                PlantScheme::Deterministic(scheme) => {
                    plant_step(scheme, &self.plant, time, &state, u, h)
                }
                PlantScheme::Stochastic(scheme) => {
                    let (xi1, xi2) = process.normal_pair();
                    let xi = (T::from_f64(xi1), T::from_f64(xi2));
                    let w = WienerIncrement::from_normals(xi, h);
                    scheme.step(&self.plant, time, &state, u, h, w)
                }
            };
        }
        state
    }

    /// Run `run` of the experiment with an observer in discrete time, which is told `tell(u)` of
    /// the plant's input u.
    #[inline(always)]
    pub fn sampled<O>(
        &self,
        observer: &O,
        tell: impl Fn(&P::Input) -> O::Input,
        run: u64,
        x0: P::State,
        z0: O::State,
        probe: &mut impl Probe<T>,
    ) -> Finish<P::State, O::State>
    where
        O: Observer<T, Measurement = P::Output>,
    {
        let own = |t: T, x: &P::State, dt: T, _: &P::Input| self.plant.control(t, x, dt);
        let given = |_: T, _: &P::Output, _: &[T], u: &P::Input| *u;
        self.moved((observer, tell), (own, given), run, (x0, z0), probe)
    }

    /// The same with a feedback in place of the plant's own input: `control(t, y, x_hat)` at each sample,
    /// on the estimate that the observer's timing gives there, then held. A sample is measured under the
    /// input that has been in force until then, which is 0 at the start. What the feedback follows, and
    /// states of its own, it holds itself.
    #[inline(always)]
    pub fn closed<O>(
        &self,
        observer: &O,
        mut control: impl FnMut(T, &P::Output, &[T]) -> P::Input,
        tell: impl Fn(&P::Input) -> O::Input,
        run: u64,
        (x0, z0): (P::State, O::State),
        probe: &mut impl Probe<T>,
    ) -> Finish<P::State, O::State>
    where
        O: Observer<T, Measurement = P::Output>,
    {
        let held = |_: T, _: &P::State, _: T, u: &P::Input| *u;
        let given = |t: T, y: &P::Output, x_hat: &[T], _: &P::Input| control(t, y, x_hat);
        self.moved((observer, tell), (held, given), run, (x0, z0), probe)
    }

    /// A run whose input is what `before` says at a sample, then what `after` makes of it once the sample
    /// is there.
    #[inline(always)]
    fn moved<O>(
        &self,
        (observer, tell): (&O, impl Fn(&P::Input) -> O::Input),
        (before, mut after): (
            impl Fn(T, &P::State, T, &P::Input) -> P::Input,
            impl FnMut(T, &P::Output, &[T], &P::Input) -> P::Input,
        ),
        run: u64,
        (x0, z0): (P::State, O::State),
        probe: &mut impl Probe<T>,
    ) -> Finish<P::State, O::State>
    where
        O: Observer<T, Measurement = P::Output>,
    {
        let mut measurement = Stream::new(self.seed, run, Channel::Measurement);
        let mut process = Stream::new(self.seed, run, Channel::Process);
        let mut held = P::Output::fill(|| T::ZERO);
        let mut end = Finish { x: x0, z: z0, diverged_at: None, undefined_at: None };
        let (mut t, mut plant_t) = (T::ZERO, T::ZERO);
        let bound = T::from_f64(DIVERGED);
        let mut u = P::Input::zero();
        for k in 0..=self.steps {
            if !(end.x.within(bound) && end.z.within(bound)) {
                end.diverged_at = Some(k);
                break;
            }
            let dt = self.schedule.dt(k);
            held = self.noise.draw(&mut measurement, k, held);
            let sines = self.noise.sines(t);
            u = before(plant_t, &end.x, dt, &u);
            let output = self.plant.output(plant_t, &end.x, &u);
            let y = output.plus(held).plus(P::Output::fill(|| sines));
            let mut status = observer.correct(&mut end.z, &y, t);
            u = after(t, &y, observer.estimate(&end.z), &u);
            probe.sample(&Sample {
                k,
                t,
                x: &end.x,
                z: &end.z,
                y: &y,
                truth: self.plant.truth(&end.x),
                estimate: observer.estimate(&end.z),
            });
            let interrupted = probe.interrupted(k);
            let more = k < self.steps && !interrupted;
            if more {
                let moved = observer.advance(&mut end.z, &y, &tell(&u), t, dt);
                status = if moved == Status::ModelUndefined { moved } else { status };
            }
            if status == Status::ModelUndefined && end.undefined_at.is_none() {
                end.undefined_at = Some(k);
            }
            if interrupted {
                break;
            }
            if more {
                let schedule = self.plant_schedule.unwrap_or(self.schedule);
                let plant_dt = schedule.dt(k);
                end.x = self.move_plant(&mut process, plant_t, &end.x, &u, plant_dt);
                plant_t = schedule.next_time(plant_t, k, plant_dt);
                t = self.schedule.next_time(t, k, dt);
            }
        }
        end
    }

    /// Run `run` with plant and observer integrated together as one differential equation. The
    /// drawn noise is held over each step; sines are continuous in time.
    #[allow(clippy::too_many_arguments)]
    #[inline(always)]
    pub fn joint<L>(
        &self,
        law: &L,
        tell: impl Fn(&P::Input) -> L::Input,
        integrator: Integrator,
        run: u64,
        x0: P::State,
        z0: L::State,
        probe: &mut impl Probe<T>,
    ) -> Finish<P::State, L::State>
    where
        L: ContinuousLaw<T>,
        P: Plant<T, Output = T>,
    {
        let mut measurement = Stream::new(self.seed, run, Channel::Measurement);
        let mut held = T::ZERO;
        let mut end = Finish { x: x0, z: z0, diverged_at: None, undefined_at: None };
        let mut t = T::ZERO;
        let bound = T::from_f64(DIVERGED);
        let frozen = self.plant_scheme == PlantScheme::Held;
        for k in 0..=self.steps {
            if !(end.x.within(bound) && end.z.within(bound)) {
                end.diverged_at = Some(k);
                break;
            }
            let dt = self.schedule.dt(k);
            held = self.noise.draw(&mut measurement, k, held);
            let u = self.plant.control(t, &end.x, dt);
            let y = self.plant.output(t, &end.x, &u) + held + self.noise.sines(t);
            probe.sample(&Sample {
                k,
                t,
                x: &end.x,
                z: &end.z,
                y: &y,
                truth: self.plant.truth(&end.x),
                estimate: law.estimate(&end.z),
            });
            if probe.interrupted(k) {
                break;
            }
            if k < self.steps {
                let told = tell(&u);
                let (plant, sines) = (&self.plant, self.noise.sines);
                let both = Both { plant, sines, law, held, frozen, u: &u, told: &told };
                let (x, z) = integrator.step(both, t, &(end.x, end.z), dt);
                let z = law.admissible(z);
                let mut spoilt = T::ZERO; // NaN where an entry is not finite
                z.visit(&mut |entry| spoilt += T::ZERO * entry);
                if spoilt.is_finite() || !x.within(bound) {
                    end.z = z;
                } else {
                    end.undefined_at = end.undefined_at.or(Some(k)); // no value: the memory is held
                }
                end.x = x;
                t = self.schedule.next_time(t, k, dt);
            }
        }
        end
    }
}

/// Plant and observer as one differential equation, the drawn noise held.
struct Both<'a, T: Scalar, P: Plant<T>, L: ContinuousLaw<T>> {
    plant: &'a P,
    sines: &'a [Sine<T>],
    law: &'a L,
    held: T,
    frozen: bool,
    u: &'a P::Input,
    told: &'a L::Input,
}

impl<T: Scalar, P: Plant<T, Output = T>, L: ContinuousLaw<T>> RightHandSide<T, (P::State, L::State)>
    for Both<'_, T, P, L>
{
    #[inline(always)]
    fn at(&self, t: T, (x, z): &(P::State, L::State)) -> (P::State, L::State) {
        let y = self.plant.output(t, x, self.u) + self.held + Sine::sum(self.sines, t);
        let x_rate = if self.frozen { P::State::zero() } else { self.plant.drift(t, x, self.u) };
        (x_rate, self.law.rate(t, z, &self.law.innovation(z, y), self.told))
    }
}

impl<T: Scalar> Noise<'_, T> {
    /// The drawn part of a measurement's noise at step k, entry by entry.
    #[inline(always)]
    fn draw<Y: Measurement<T>>(&self, stream: &mut Stream, k: u64, held: Y) -> Y {
        if self.hold > 1 && !k.is_multiple_of(self.hold) {
            return held;
        }
        Y::fill(|| self.fresh(stream, k))
    }
}

/// The metrics of one run, over buffers of the caller.
///
/// Signals are the errors x̂ − x followed by the rest of the observer's memory.
#[derive(Debug)]
pub struct RunMetrics<'a, T> {
    /// Windows of samples.
    pub windows: &'a [Window],
    /// Signals in the moments: errors and further memory entries.
    pub signals: usize,
    /// windows × signals.
    pub moments: &'a mut [Moments<T>],
    /// Largest magnitude of each memory entry.
    pub peak: &'a mut [T],
    /// Settling time of ‖x̂ − x‖.
    pub settling: Option<SettlingTime<T>>,
    /// Where ‖x̂ − x‖² is collected.
    pub histogram: Option<(Window, LogHistogram<'a>)>,
}

impl<T: Scalar> Probe<T> for RunMetrics<'_, T> {
    #[inline(always)]
    fn sample<X: Memory<T>, Z: Memory<T>, Y: Measurement<T>>(
        &mut self,
        sample: &Sample<'_, T, X, Z, Y>,
    ) {
        let errors = || sample.estimate.iter().zip(sample.truth).map(|(e, x)| *e - *x);
        let known = sample.estimate.len().min(sample.truth.len());
        let rows = self.moments.chunks_exact_mut(self.signals.max(1));
        for (window, row) in self.windows.iter().zip(rows) {
            if window.contains(sample.k) {
                let mut slots = row.iter_mut();
                for (moment, error) in slots.by_ref().take(known).zip(errors()) {
                    moment.push(error);
                }
                let mut index = 0;
                sample.z.visit(&mut |value| {
                    if index >= known
                        && let Some(moment) = slots.next()
                    {
                        moment.push(value);
                    }
                    index += 1;
                });
            }
        }
        let mut peaks = self.peak.iter_mut();
        sample.z.visit(&mut |value| {
            if let Some(peak) = peaks.next() {
                *peak = peak.max(value.abs());
            }
        });
        if self.settling.is_some() || self.histogram.is_some() {
            let mut square = T::ZERO;
            errors().for_each(|e| square += e * e);
            if let Some(settling) = &mut self.settling {
                settling.push(sample.t, square.sqrt());
            }
            if let Some((window, histogram)) = &mut self.histogram
                && window.contains(sample.k)
            {
                histogram.push(square.to_f64());
            }
        }
    }
}

/// A plant's state after `coarse` steps of a stochastic scheme, and after the same time and the
/// same Brownian path in `coarse × fine` steps of a finer scheme.
///
/// The increments ΔW and ΔZ of a coarse step are the exact sums of those of its fine steps. `stop`
/// is asked before every 4096th fine step whether to end early.
#[allow(clippy::too_many_arguments)]
pub fn coupled_paths<T: Scalar, P: Plant<T>>(
    plant: &P,
    scheme: StochasticIntegrator,
    fine_scheme: StochasticIntegrator,
    x0: P::State,
    t_end: T,
    (coarse, fine): (u32, u32),
    stream: &mut Stream,
    stop: impl Fn() -> bool,
) -> (P::State, P::State) {
    let h_coarse = t_end / T::from_f64(f64::from(coarse));
    let h = h_coarse / T::from_f64(f64::from(fine));
    let (mut x_coarse, mut x_fine) = (x0, x0);
    for i in 0..coarse {
        let t = T::from_f64(f64::from(i)) * h_coarse;
        let u = plant.control(t, &x_fine, h_coarse);
        let mut sum = WienerIncrement { dw: T::ZERO, dz: T::ZERO };
        for j in 0..fine {
            if (i.wrapping_mul(fine).wrapping_add(j)).is_multiple_of(4096) && stop() {
                return (x_coarse, x_fine);
            }
            let (xi1, xi2) = stream.normal_pair();
            let w = WienerIncrement::from_normals((T::from_f64(xi1), T::from_f64(xi2)), h);
            let time = t + T::from_f64(f64::from(j)) * h;
            x_fine = fine_scheme.step(plant, time, &x_fine, &u, h, w);
            sum = sum.then(w, h);
        }
        x_coarse = scheme.step(plant, t, &x_coarse, &u, h_coarse, sum);
    }
    (x_coarse, x_fine)
}
