//! Floor 6. Feedback: what closes the loop of a plant and an observer, and signals that are watched in it.

use super::plants::PlantTables;
use crate::error::{Result, refused};
use crate::spec::Spec;
use crate::table::Table;
use crate::trace::{self, Traced};
use hgo_rs::Scalar;
use hgo_rs::integrate::Integrator;
use hgo_rs::memory::Memory;
use nalgebra::SVector;

/// States that a controller may have.
pub const CONTROLLER: usize = 16;
/// Signals that may be watched.
const SIGNALS: usize = 64;
/// Sampling periods by which an input may come late.
const DELAY: usize = 64;

/// A controller, its delay and the signals that are watched.
pub struct Feedback {
    /// Inputs of the plant that it gives.
    pub n_u: usize,
    /// Signals.
    pub watched: usize,
    /// Sampling periods between a sample and the use of the input that is computed from it.
    pub delay: usize,
    /// For each watched signal the threshold of its settling time.
    pub settle: Vec<Option<f64>>,
    /// Whether the true states stand where estimates do.
    from_state: bool,
    /// Whether the controller's states have rates, else they are a recursion.
    continuous: bool,
    /// States of the controller at the start.
    start: Vec<f64>,
    /// Estimates that the tables take.
    n: usize,
    /// (t, y, x̂, c, parameters) → (u, ċ or the next c).
    law: Table,
    /// (t, x, u, y, x̂, c, parameters) → the signals.
    signals: Table,
    parameters: Vec<f64>,
    /// For each input of the observer the plant's that it is told.
    tells: Vec<usize>,
}

/// What a controller sees at a sample.
#[derive(Clone, Copy)]
pub struct Seen<'a> {
    /// Time in s.
    pub t: Traced,
    /// The plant's state.
    pub x: &'a [Traced],
    /// What is measured.
    pub y: &'a [Traced],
    /// The estimates.
    pub x_hat: &'a [Traced],
    /// The controller's states.
    pub c: &'a [Traced],
}

impl Feedback {
    /// From a spec, for a plant and an observer of n states; `truth` are the states it estimates.
    ///
    /// # Errors
    /// Tables of other sizes, a delay or an order beyond its limit, states that have no true value.
    pub fn read(spec: &Spec<'_>, plant: &PlantTables, n: usize) -> Result<Self> {
        spec.only(&[
            "law",
            "signals",
            "parameters",
            "delay",
            "from",
            "continuous",
            "start",
            "tells",
            "settle",
        ])?;
        let from_state = match spec.text("from")?.as_str() {
            "estimate" => false,
            "state" => true,
            other => return Err(spec.unknown("from", other, &["estimate", "state"])),
        };
        let n_u = plant.open;
        let start = spec.numbers("start")?.values.clone();
        let parameters = spec.numbers("parameters")?.values.clone();
        if let Some(bad) = start.iter().chain(&parameters).find(|value| !value.is_finite()) {
            return Err(refused(format!(
                "feedback: a start or a parameter of the controller is {bad}; it must be finite"
            )));
        }
        let delay = spec.count("delay")?;
        for (name, value, most) in
            [("delay", delay, DELAY), ("states of the controller", start.len(), CONTROLLER)]
        {
            if value > most {
                return Err(refused(format!(
                    "feedback: {name} = {value} is not allowed: at most {most}"
                )));
            }
        }
        let (law, signals) = (Table::read(&spec.sub("law")?)?, Table::read(&spec.sub("signals")?)?);
        let seen = 1 + plant.n_y + n + start.len() + parameters.len();
        let watched = signals.outputs.len();
        for (name, table, given, made) in [
            ("law", &law, seen, n_u + start.len()),
            ("signals", &signals, seen + plant.n + n_u, watched),
        ] {
            if table.inputs.len() != given || table.outputs.len() != made || watched > SIGNALS {
                return Err(refused(format!(
                    "feedback: the table {name} has {} inputs and {} outputs; it must have {given} \
                     and {made}, and at most {SIGNALS} signals are watched",
                    table.inputs.len(),
                    table.outputs.len()
                )));
            }
        }
        let tells = spec.wholes("tells")?.unwrap_or_default();
        if let Some(none) = tells.iter().find(|told| **told >= n_u) {
            return Err(refused(format!(
                "feedback: tells = {none} is not allowed: the plant has {n_u} inputs"
            )));
        }
        let settle = spec.numbers("settle")?.values.clone();
        if settle.len() != watched {
            return Err(refused("feedback: settle must have one threshold a signal, NaN for none"));
        }
        let settle = settle.into_iter().map(|level| Some(level).filter(|level| *level > 0.0));
        let unknown = from_state
            && law
                .depends(|input| {
                    let estimate = input.checked_sub(1 + plant.n_y);
                    estimate.is_some_and(|i| i < n && i >= plant.truth.len())
                })
                .iter()
                .zip(0..)
                .any(|(depends, value)| *depends && law.outputs.contains(&value));
        if unknown {
            return Err(refused(
                "feedback from the state takes an estimate that stands for no state of the plant",
            ));
        }
        Ok(Self {
            n_u,
            watched,
            delay,
            settle: settle.collect(),
            from_state,
            continuous: spec.flag_or("continuous", true)?,
            start,
            n,
            law,
            signals,
            parameters,
            tells,
        })
    }

    /// Columns of a run that belong to it: the inputs that are in force and the watched signals, which are
    /// those of the present sample; the inputs that wait; the controller's states.
    pub fn columns(&self) -> usize {
        self.now() + self.later()
    }

    /// Columns that are computed at a sample.
    pub fn now(&self) -> usize {
        self.n_u + self.watched
    }

    /// Columns that are computed for the next one.
    pub fn later(&self) -> usize {
        self.delay * self.n_u + self.start.len()
    }

    /// The columns at the start.
    pub fn starts(&self) -> Vec<f64> {
        let mut starts = vec![0.0; self.columns() - self.start.len()];
        starts.extend_from_slice(&self.start);
        starts
    }

    /// Whether the output is needed for the input.
    pub fn takes_output(&self, n_y: usize) -> bool {
        let depends = self.law.depends(|input| (1..=n_y).contains(&input));
        self.law.outputs.iter().take(self.n_u).any(|output| depends[*output])
    }

    /// Of an observer with so many inputs what each is told.
    pub fn told(&self, u: &[Traced], n_u: usize) -> Vec<Traced> {
        let known = self.tells.iter().map(|at| u.get(*at).copied().unwrap_or(Traced::ZERO));
        known.chain(std::iter::repeat(Traced::ZERO)).take(n_u).collect()
    }

    fn parameters(&self) -> Vec<Traced> {
        self.parameters.iter().map(|value| Traced::from_f64(*value)).collect()
    }

    /// What it sees of the state: n numbers.
    pub fn seen_of(&self, truth: &[usize], x: &[Traced], z: &[Traced]) -> Vec<Traced> {
        if !self.from_state {
            return z[..self.n].to_vec();
        }
        let known = truth.iter().map(|at| x[*at]);
        known.chain(std::iter::repeat(Traced::ZERO)).take(self.n).collect()
    }

    /// The input and the rates, or the next values, of its states.
    pub fn law(&self, seen: Seen<'_>) -> (Vec<Traced>, Vec<Traced>) {
        let Seen { t, y, x_hat, c, .. } = seen;
        let given = [&[t], y, x_hat, c, &self.parameters()].concat();
        let mut made = trace::inline(&self.law, &given);
        let moved = made.split_off(self.n_u);
        (made, moved)
    }

    /// Its states at the next sample, the measurement and the estimates held until then.
    pub fn next(&self, seen: Seen<'_>, dt: Traced) -> Vec<Traced> {
        if !self.continuous {
            return self.law(seen).1;
        }
        let rate = |t: Traced, c: &SVector<Traced, CONTROLLER>| {
            let c = &c.as_slice()[..self.start.len()];
            SVector::read(&self.law(Seen { t, c, ..seen }).1)
        };
        let end = Integrator::Rk4.step(rate, seen.t, &SVector::read(seen.c), dt);
        end.as_slice()[..self.start.len()].to_vec()
    }

    /// Whether it may be a part of one differential equation.
    ///
    /// # Errors
    /// A delay or a recursion; an input that depends on the output, which depends on the input.
    pub fn check_joint(&self, plant: &PlantTables) -> Result<()> {
        let direct = plant.output.depends(|input| input >= 2 + plant.n);
        let direct = plant.output.outputs.iter().any(|output| direct[*output]);
        if direct && self.takes_output(plant.n_y) {
            return Err(refused(
                "feedback: u depends on y, and the output y of the plant on u: an algebraic loop; \
                 leave y out of the feedback, or take mode 'sampled'",
            ));
        }
        if self.delay > 0 || !(self.continuous || self.start.is_empty()) {
            return Err(refused(
                "mode = 'joint' is not allowed: a delay and a recursion count samples; take mode \
                 'sampled'",
            ));
        }
        Ok(())
    }

    /// The signals, under the input u.
    pub fn signals(&self, seen: Seen<'_>, u: &[Traced]) -> Vec<Traced> {
        let Seen { t, x, y, x_hat, c } = seen;
        let given = [&[t], x, u, y, x_hat, c, &self.parameters()].concat();
        trace::inline(&self.signals, &given)
    }
}
