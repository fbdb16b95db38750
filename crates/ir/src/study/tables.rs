//! Floor 7. What a study evaluates, as tables.

use super::feedback::{CONTROLLER, Feedback, Seen};
use super::plan::{AnySchedule, DrawKind, Plan};
use super::plants::{MAX_STATES, PlantTables};
use crate::error::{Result, refused};
use crate::table::Table;
use crate::tables::Tables;
use crate::trace::{self, Setting, Traced, input, inputs, named, trace};
use hgo_rs::Scalar;
use hgo_rs::integrate::{Integrator, PlantScheme};
use hgo_rs::memory::Memory;
use hgo_rs::model::StochasticIntegrator;
use hgo_rs::noise::Sine;
use hgo_rs::schedule::Schedule;
use nalgebra::SVector;

/// Room for a plant's state, an observer's memory and a controller's states in a joint study.
const ALL: usize = MAX_STATES + 64 + CONTROLLER;

/// The tables of a study.
#[allow(clippy::struct_excessive_bools)] // four answers to four questions
pub struct StudyTables {
    /// (t, dt, the plant's time, sines, z, x, noise) → (z⁺, y, u), the feedback's columns of this sample,
    /// those of the next one and, where plant and observer are one differential equation, x⁺. z⁺ is the
    /// memory after the use of the sample, with predictor timing at the next one. x is the plant's state,
    /// then the feedback's columns.
    pub sample: Table,
    /// With current timing (t, dt, z, u) → z⁺ at the next sample.
    pub predict: Option<Table>,
    /// (t, h, x, u, ξ₁, ξ₂) → x⁺, where the plants move by it.
    pub plant: Option<Table>,
    /// Whether a sample shows the memory after its use.
    pub is_current: bool,
    /// Whether plant and observer are one differential equation.
    pub is_joint: bool,
    /// Whether the plants' step takes normal values, and both of a pair.
    pub is_random: bool,
    /// See [`Self::is_random`].
    pub draws_both: bool,
}

/// The length of a step: a number where it is always the same.
fn length(schedule: AnySchedule, name: &str, per: f64) -> Traced {
    let given = input(name);
    match schedule {
        AnySchedule::Fixed(fixed) => Traced::from_f64(fixed.dt(0) / per),
        AnySchedule::Decreasing(_) => given,
    }
}

impl StudyTables {
    pub fn of(
        plan: &Plan,
        observer: &Tables,
        plant: &PlantTables,
        feedback: Option<&Feedback>,
        joint: Option<Integrator>,
    ) -> Result<Self> {
        let random = matches!(plan.plant_scheme, PlantScheme::Stochastic(_));
        let both = PlantScheme::Stochastic(StochasticIntegrator::Taylor15);
        let moves = joint.is_none() && plan.plant_scheme != PlantScheme::Held;
        let study = Making { plan, observer, plant, feedback };
        Ok(Self {
            sample: match joint {
                None => study.sample()?,
                Some(integrator) => study.joint(integrator)?,
            },
            predict: study.predict()?,
            plant: if moves { Some(study.step()?) } else { None },
            is_current: observer.is_current(),
            is_joint: joint.is_some(),
            is_random: random && moves,
            draws_both: plan.plant_scheme == both,
        })
    }

    /// Whether functions of the user's are called.
    pub fn calls(&self) -> bool {
        let optional = [&self.predict, &self.plant];
        let mut tables = optional.into_iter().flatten().chain([&self.sample]);
        tables.any(|table| !table.calls.is_empty())
    }

    /// Whether no table depends on the time.
    pub fn are_timeless(&self) -> bool {
        let free = |table: &Table, clocks: &[usize]| {
            let depends = table.depends(|input| clocks.contains(&input));
            !table.outputs.iter().any(|output| depends[*output])
        };
        let free_of_t =
            |table: &Option<Table>| table.as_ref().is_none_or(|table| free(table, &[0]));
        free(&self.sample, &[0, 2]) && free_of_t(&self.predict) && free_of_t(&self.plant)
    }

    /// The largest number of values that a table needs at a time.
    pub fn width(&self) -> usize {
        let tables = [Some(&self.sample), self.predict.as_ref(), self.plant.as_ref()];
        tables.into_iter().flatten().map(Table::width).max().unwrap_or(0)
    }

    /// Operations of a sample.
    pub fn operations(&self, substeps: u32) -> usize {
        let of = |table: &Option<Table>| table.as_ref().map_or(0, |table| table.operations.len());
        self.sample.operations.len() + of(&self.predict) + of(&self.plant) * substeps as usize
    }
}

/// What the tables are made of.
struct Making<'a> {
    plan: &'a Plan,
    observer: &'a Tables,
    plant: &'a PlantTables,
    feedback: Option<&'a Feedback>,
}

/// The state part of a run's columns.
struct Columns {
    /// The plant's state.
    x: Vec<Traced>,
    /// Inputs that are in force.
    u: Vec<Traced>,
    /// Inputs that wait, the next one first.
    waiting: Vec<Traced>,
    /// The controller's states.
    c: Vec<Traced>,
}

impl Making<'_> {
    fn setting() -> Setting {
        Setting::usual(false)
    }

    /// What the observer is told of the plant's input: as many entries as it takes, 0 beyond.
    fn told(&self, u: &[Traced]) -> Vec<Traced> {
        if let Some(feedback) = self.feedback.filter(|feedback| feedback.n_u > 0) {
            return feedback.told(u, self.observer.n_u());
        }
        let zeros = std::iter::repeat(Traced::ZERO);
        u.iter().copied().chain(zeros).take(self.observer.n_u()).collect()
    }

    /// A run's columns of the plant and the feedback.
    fn columns(&self) -> Columns {
        let count = self.feedback.map_or(0, Feedback::columns);
        let mut x = inputs("x", self.plant.n + count);
        let mut rest = x.split_off(self.plant.n);
        let Some(feedback) = self.feedback else {
            return Columns { x, u: Vec::new(), waiting: Vec::new(), c: Vec::new() };
        };
        let mut later = rest.split_off(feedback.now());
        let c = later.split_off(feedback.delay * feedback.n_u);
        rest.truncate(feedback.n_u);
        Columns { x, u: rest, waiting: later, c }
    }

    /// What a feedback makes of a sample, on the memory that it shows: the inputs that come into force, the
    /// columns of now, and those of the next sample. Without one, nothing.
    fn closed(
        &self,
        at: (Traced, Traced),
        of: &Columns,
        y: &[Traced],
        z: &[Traced],
    ) -> [Vec<Traced>; 3] {
        let Some(feedback) = self.feedback else { return [const { Vec::new() }; 3] };
        let (Columns { x, waiting, c, .. }, (t, dt)) = (of, at);
        let x_hat = feedback.seen_of(&self.plant.truth, x, z);
        let seen = Seen { t, x, y, x_hat: &x_hat, c };
        let mut queue = [waiting.as_slice(), &feedback.law(seen).0].concat();
        let mut later = queue.split_off(feedback.n_u);
        later.extend(feedback.next(seen, dt));
        let now = self.now(t, of, y, z, &queue);
        [queue, now, later]
    }

    /// The columns of now: a feedback's inputs in force and the signals that are watched under them.
    fn now(
        &self,
        t: Traced,
        of: &Columns,
        y: &[Traced],
        z: &[Traced],
        u: &[Traced],
    ) -> Vec<Traced> {
        let Some(feedback) = self.feedback else { return Vec::new() };
        let x_hat = &z[..self.observer.n()];
        let signals = feedback.signals(Seen { t, x: &of.x, y, x_hat, c: &of.c }, u);
        [u, &signals].concat()
    }

    fn parameters(&self) -> Vec<Traced> {
        self.observer.parameters().iter().map(|value| Traced::from_f64(*value)).collect()
    }

    fn noise(&self) -> Vec<Traced> {
        let given = inputs("noise", self.plant.n_y);
        if matches!(self.plan.draw, DrawKind::None) {
            vec![Traced::NEG_ZERO; given.len()]
        } else {
            given
        }
    }

    fn sines(&self) -> Traced {
        let given = input("sines");
        if self.plan.sines.is_empty() { Traced::NEG_ZERO } else { given }
    }

    fn sample(&self) -> Result<Table> {
        let taking = self.observer.taking(self.plan.samples_miss())?;
        trace(Self::setting(), || {
            let (t, dt) = (input("t"), length(self.plan.schedule, "dt", 1.0));
            let (plant_t, sines) = (input("plant_t"), self.sines());
            let z = inputs("z", self.observer.memory_len());
            let (of, noise) = (self.columns(), self.noise());
            let given = [&[plant_t, dt], of.x.as_slice(), &of.u].concat();
            let made = trace::inline(&self.plant.output, &given);
            let (own, output) = made.split_at(self.plant.n_u - self.plant.open);
            let y: Vec<Traced> =
                output.iter().zip(&noise).map(|(output, noise)| *output + *noise + sines).collect();
            let take = |u: &[Traced]| {
                let told = self.told(u);
                let given = [&[t, dt], z.as_slice(), &y, &told, &self.parameters()].concat();
                let mut next = trace::inline(&taking, &given);
                next.truncate(z.len());
                next
            };
            // a correction belongs to the input until now, a recursion over the coming step to the new one
            let corrected = self.observer.is_current().then(|| take(&[own, &of.u].concat()));
            let shown = corrected.as_ref().unwrap_or(&z);
            let [u, now, later] = self.closed((t, dt), &of, &y, shown);
            let u = [own, &u].concat();
            let next = corrected.clone().unwrap_or_else(|| take(&u));
            let closed = [named("u", &u), named("now", &now), named("later", &later)].concat();
            Ok([named("z", &next), named("y", &y), closed].concat())
        })
    }

    fn predict(&self) -> Result<Option<Table>> {
        if self.observer.correct().is_none() {
            return Ok(None);
        }
        let table = trace(Self::setting(), || {
            let (t, dt) = (input("t"), length(self.plan.schedule, "dt", 1.0));
            let (z, u) = (inputs("z", self.observer.memory_len()), inputs("u", self.plant.n_u));
            let nothing = vec![Traced::ZERO; self.plant.n_y];
            let told = self.told(&u);
            let given = [&[t, dt], z.as_slice(), &nothing, &told, &self.parameters()].concat();
            let mut next = trace::inline(self.observer.advance(), &given);
            next.truncate(z.len());
            Ok(named("z", &next))
        });
        table.map(Some)
    }

    fn step(&self) -> Result<Table> {
        trace(Self::setting(), || {
            let schedule = self.plan.plant_schedule.unwrap_or(self.plan.schedule);
            let t = input("t");
            let h = length(schedule, "h", f64::from(self.plan.substeps));
            let (x, u) = (inputs("x", self.plant.n), inputs("u", self.plant.n_u));
            let given = [&[t, h], x.as_slice(), &u, &inputs("xi", 2)].concat();
            Ok(named("x", &trace::inline(&self.plant.step, &given)))
        })
    }

    /// Plant and observer as one differential equation, the drawn noise held.
    fn joint(&self, integrator: Integrator) -> Result<Table> {
        let Some((rate, admissible)) = self.observer.law() else {
            return Err(refused(super::SAMPLED_ONLY));
        };
        trace(Self::setting(), || {
            let (t, dt) = (input("t"), length(self.plan.schedule, "dt", 1.0));
            let (_, now) = (input("plant_t"), self.sines());
            let z = inputs("z", self.observer.memory_len());
            let (columns, held) = (self.columns(), self.noise());
            let Columns { x, c, .. } = &columns;
            let of = |sine: &Sine<f64>| Sine {
                amplitude: Traced::from_f64(sine.amplitude),
                omega: Traced::from_f64(sine.omega),
                phase: Traced::from_f64(sine.phase),
            };
            let sines: Vec<Sine<Traced>> = self.plan.sines.iter().map(of).collect();
            let parameters = self.parameters();
            // an input that the plant gives itself is held; a feedback's is that of the moment
            let open = vec![Traced::ZERO; self.plant.open];
            let made = trace::inline(&self.plant.output, &[&[t, dt], x.as_slice(), &open].concat());
            let own = &made[..self.plant.n_u - self.plant.open];
            let sampled = |made: &[Traced]| -> Vec<Traced> {
                let output = made[own.len()..].iter().zip(&held);
                output.map(|(output, noise)| *output + *noise + now).collect()
            };
            let close = |t: Traced, x: &[Traced], z: &[Traced], c: &[Traced], y: &[Traced]| {
                let Some(feedback) = self.feedback else { return (Vec::new(), Vec::new()) };
                let x_hat = feedback.seen_of(&self.plant.truth, x, z);
                feedback.law(Seen { t, x, y, x_hat: &x_hat, c })
            };
            let frozen = self.plan.plant_scheme == PlantScheme::Held;
            let system = |t: Traced, all: &SVector<Traced, ALL>| {
                let (z, rest) = all.as_slice().split_at(z.len());
                let (x, rest) = rest.split_at(x.len());
                let c = &rest[..c.len()];
                let sum = Sine::sum(&sines, t);
                let measured = |output: &[Traced]| -> Vec<Traced> {
                    output.iter().zip(&held).map(|(y, held)| *y + *held + sum).collect()
                };
                let of_plant =
                    |u: &[Traced]| trace::inline(&self.plant.drift, &[&[t], x, own, u].concat());
                // either y or u needs the other
                let without = measured(&of_plant(&open)[self.plant.n..]);
                let (u, moved) = close(t, x, z, c, &without);
                let (made, u) = (of_plant(&u), [own, &u].concat());
                let (drift, output) = made.split_at(self.plant.n);
                let given = [&[t], z, &measured(output), &self.told(&u), &parameters].concat();
                let mut rates = trace::inline(rate, &given);
                if frozen {
                    rates.extend(vec![Traced::ZERO; x.len()]);
                } else {
                    rates.extend_from_slice(drift);
                }
                rates.extend(moved);
                SVector::read(&rates)
            };
            let start = SVector::read(&[z.as_slice(), x, c].concat());
            let end = integrator.step(system, t, &start, dt);
            let (next, rest) = end.as_slice().split_at(z.len());
            let next = trace::inline(admissible, next);
            let (moved, later) = (named("x", &rest[..x.len()]), &rest[x.len()..x.len() + c.len()]);
            let (u, _) = close(t, x, &z, c, &sampled(&made));
            let given = [&[t, dt], x.as_slice(), &u].concat();
            let y = sampled(&trace::inline(&self.plant.output, &given));
            let shown = self.now(t, &columns, &y, &z, &u);
            let closed = [named("u", &[own, &u].concat()), named("now", &shown)].concat();
            let later = named("later", later);
            Ok([named("z", &next), named("y", &y), closed, later, moved].concat())
        })
    }
}
