//! Floor 8. Observers whose model is made of Python functions: the core's laws, step by step, with calls where
//! the model stands.

use crate::error::Result;
use crate::order::MAX_INPUTS;
use crate::recursion::{AnyObserver, Block, Recursion, larger};
use crate::step::{Steps, within};
use crate::table::Table;
use crate::tables::Tables;
use hgo_rs::observer::Status;

/// An observer whose step calls functions.
pub struct Called {
    tables: Tables,
    /// The use of a sample with current timing, and the way to the next one.
    correct: Option<Steps<Table>>,
    advance: Steps<Table>,
}

impl Called {
    pub fn new(tables: Tables, correct: Option<Steps<Table>>, advance: Steps<Table>) -> Self {
        Self { tables, correct, advance }
    }

    /// One half of a step for one sample; the innovation is told where it is asked for. Where the
    /// model has no value the memory is held.
    fn one(
        &self,
        steps: &Steps<Table>,
        memory: &mut [f64],
        given: (&[f64], &[f64]),
        time: (f64, f64),
        innovation: &mut [f64],
    ) -> Result<Status> {
        let present = given.0.iter().all(|y| y.is_finite());
        let inputs = self.tables.inputs(memory, given, time);
        let made = steps.choose(memory, present).evaluate(&inputs)?;
        let (next, told) = made.split_at(memory.len());
        innovation.iter_mut().zip(told).for_each(|(slot, told)| *slot = *told);
        if !next.iter().all(|value| value.is_finite()) && within(memory) {
            return Ok(Status::ModelUndefined);
        }
        memory.copy_from_slice(next);
        Ok(if present { Status::Updated } else { Status::Predicted })
    }
}

impl Recursion for Called {
    fn correct(&self, memory: &mut [f64], y: &[f64], t: f64) -> Result<Status> {
        let Some(correct) = &self.correct else {
            let present = y.iter().all(|y| y.is_finite());
            return Ok(if present { Status::Updated } else { Status::Predicted });
        };
        let u = [0.0; MAX_INPUTS];
        let u = u.get(..self.tables.n_u()).unwrap_or(&[]); // no correction depends on it
        self.one(correct, memory, (y, u), (t, 0.0), &mut [])
    }

    fn advance(&self, memory: &mut [f64], y: &[f64], u: &[f64], t: f64, dt: f64) -> Result<Status> {
        self.one(&self.advance, memory, (y, u), (t, dt), &mut [])
    }

    fn over_block(&self, memory: &mut [f64], block: Block<'_>) -> Result<f64> {
        let Block { t, dt, mut y, u, memory: rows, innovation, status } = block;
        let (p, q) = (self.tables.n_y(), self.tables.n_u());
        let (mut most, mut undefined) = (0.0, false);
        for (k, (row, status)) in rows.chunks_exact_mut(memory.len()).zip(status).enumerate() {
            let (y, u) = (y.take(k, p), &u[k * q..(k + 1) * q]);
            let told = innovation.get_mut(k * p..(k + 1) * p).unwrap_or_default();
            if undefined {
                // the record is refused: no function is called any more
                row.copy_from_slice(memory);
                *status = Status::Predicted as u8;
                continue;
            }
            let next = dt.get(k).copied();
            let mut made;
            if let Some(correct) = &self.correct {
                made = self.one(correct, memory, (y, u), (t[k], 0.0), told)?;
                row.copy_from_slice(memory);
                if let Some(dt) = next
                    && made != Status::ModelUndefined
                {
                    let moved = self.one(&self.advance, memory, (y, u), (t[k], dt), &mut [])?;
                    made = if moved == Status::ModelUndefined { moved } else { made };
                }
            } else {
                row.copy_from_slice(memory);
                made = if let Some(dt) = next {
                    self.one(&self.advance, memory, (y, u), (t[k], dt), told)?
                } else {
                    let mut end = memory.to_vec(); // for the last sample's innovation
                    let made = self.one(&self.advance, &mut end, (y, u), (t[k], 1.0), told)?;
                    if made == Status::ModelUndefined { Status::Predicted } else { made }
                };
            }
            *status = made as u8;
            undefined = made == Status::ModelUndefined;
            for value in &*row {
                most = if value.is_finite() { larger(most, *value) } else { f64::NAN };
            }
        }
        Ok(most)
    }
}

impl AnyObserver for Called {
    fn n(&self) -> usize {
        self.tables.n()
    }
    fn n_y(&self) -> usize {
        self.tables.n_y()
    }
    fn n_u(&self) -> usize {
        self.tables.n_u()
    }
    fn is_current(&self) -> bool {
        self.tables.is_current()
    }
    fn initial(&self) -> Vec<f64> {
        self.tables.initial().to_vec()
    }
    fn begin(&self, memory: &mut [f64], y: &[f64]) -> Result<bool> {
        self.tables.begin(memory, y)
    }
    fn recursion(&self) -> &dyn Recursion {
        self
    }
}
