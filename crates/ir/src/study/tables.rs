//! Floor 7. What a study evaluates, as tables.

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

/// Room for a plant's state and an observer's memory in a joint study.
const BOTH: usize = MAX_STATES + 64;

/// The tables of a study.
#[allow(clippy::struct_excessive_bools)] // four answers to four questions
pub struct StudyTables {
    /// (t, dt, the plant's time, sines, z, x, noise) → (z⁺, y, u) and, where plant and observer are one
    /// differential equation, x⁺. z⁺ is the memory after the use of the sample, with predictor timing at
    /// the next one.
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
        joint: Option<Integrator>,
    ) -> Result<Self> {
        let random = matches!(plan.plant_scheme, PlantScheme::Stochastic(_));
        let both = PlantScheme::Stochastic(StochasticIntegrator::Taylor15);
        let moves = joint.is_none() && plan.plant_scheme != PlantScheme::Held;
        let study = Making { plan, observer, plant };
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
}

impl Making<'_> {
    fn setting() -> Setting {
        Setting::usual(false)
    }

    /// What the observer is told of the plant's input: as many entries as it takes, 0 beyond.
    fn told(&self, u: &[Traced]) -> Vec<Traced> {
        let zeros = std::iter::repeat(Traced::ZERO);
        u.iter().copied().chain(zeros).take(self.observer.n_u()).collect()
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
            let (x, noise) = (inputs("x", self.plant.n), self.noise());
            let made = trace::inline(&self.plant.output, &[&[plant_t, dt], x.as_slice()].concat());
            let (u, output) = made.split_at(self.plant.n_u);
            let y: Vec<Traced> =
                output.iter().zip(&noise).map(|(output, noise)| *output + *noise + sines).collect();
            let given = [&[t, dt], z.as_slice(), &y, &self.told(u), &self.parameters()].concat();
            let mut next = trace::inline(&taking, &given);
            next.truncate(z.len());
            Ok([named("z", &next), named("y", &y), named("u", u)].concat())
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
            let (x, held) = (inputs("x", self.plant.n), self.noise());
            let of = |sine: &Sine<f64>| Sine {
                amplitude: Traced::from_f64(sine.amplitude),
                omega: Traced::from_f64(sine.omega),
                phase: Traced::from_f64(sine.phase),
            };
            let sines: Vec<Sine<Traced>> = self.plan.sines.iter().map(of).collect();
            let parameters = self.parameters();
            let made = trace::inline(&self.plant.output, &[&[t, dt], x.as_slice()].concat());
            let (u, output) = made.split_at(self.plant.n_u);
            let told = self.told(u);
            let y: Vec<Traced> =
                output.iter().zip(&held).map(|(output, noise)| *output + *noise + now).collect();
            let frozen = self.plan.plant_scheme == PlantScheme::Held;
            let system = |t: Traced, both: &SVector<Traced, BOTH>| {
                let (z, x) = both.as_slice().split_at(z.len());
                let x = &x[..self.plant.n];
                let made = trace::inline(&self.plant.drift, &[&[t], x, u].concat());
                let (drift, output) = made.split_at(self.plant.n);
                let sum = Sine::sum(&sines, t);
                let y = output.iter().zip(&held).map(|(output, held)| *output + *held + sum);
                let y: Vec<Traced> = y.collect();
                let given = [&[t], z, &y, told.as_slice(), &parameters].concat();
                let mut rates = trace::inline(rate, &given);
                if frozen {
                    rates.extend(vec![Traced::ZERO; x.len()]);
                } else {
                    rates.extend_from_slice(drift);
                }
                SVector::read(&rates)
            };
            let start = SVector::read(&[z.as_slice(), &x].concat());
            let end = integrator.step(system, t, &start, dt);
            let (next, moved) = end.as_slice().split_at(z.len());
            let next = trace::inline(admissible, next);
            let moved = named("x", &moved[..x.len()]);
            Ok([named("z", &next), named("y", &y), named("u", u), moved].concat())
        })
    }
}
