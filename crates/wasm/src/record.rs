//! Floor 2. An observer over a record, sample by sample as `hgo_ir::step` does it.

use crate::gains::{Gains, gains};
use crate::numbers::{Live, Step};
use hgo_rs::program::Registers;

/// When the samples were taken.
#[derive(Clone, Copy)]
pub enum Clock<'a> {
    /// Sample k at k times this.
    Period(f64),
    /// At these times.
    Times(&'a [f64]),
}

impl Clock<'_> {
    fn at(self, k: usize) -> f64 {
        match self {
            Self::Period(period) => k as f64 * period,
            Self::Times(t) => t[k],
        }
    }

    fn step(self, k: usize) -> f64 {
        match self {
            Self::Period(period) => period,
            Self::Times(t) => t[k + 1] - t[k],
        }
    }
}

/// What is given of a record: a row a sample.
#[derive(Clone, Copy)]
pub struct Record<'a> {
    /// When.
    pub clock: Clock<'a>,
    /// Samples; NaN is missing.
    pub y: &'a [f64],
    /// Known inputs.
    pub u: &'a [f64],
}

/// Where the memory stands among the inputs of a step.
const MEMORY: usize = 2;

/// An observer at one gain.
pub struct Running<'a> {
    live: &'a Live,
    ell: f64,
    gains: Option<Box<Gains>>,
}

impl<'a> Running<'a> {
    /// `None` where the law refuses the gain.
    pub fn new(live: &'a Live, ell: f64) -> Option<Self> {
        let gains = gains(live, ell);
        (gains.is_some() == (live.gains > 0)).then_some(Self { live, ell, gains })
    }

    /// Inputs before the parameters.
    fn given(&self) -> usize {
        MEMORY + self.live.memory() + 1 + self.live.n_u
    }

    fn at_rest(&self, step: &Step) -> Registers<f64> {
        let mut r = Registers::zero();
        for (register, value) in &step.constants {
            r.0[usize::from(*register)] = *value;
        }
        let (first, parameters) = (self.given(), &self.live.parameters);
        r.0[first..first + parameters.len()].copy_from_slice(parameters);
        r.0[first + parameters.len() - 1] = self.ell;
        r
    }

    /// Estimates (N, n) and innovations (N,) from a memory on; gives how many samples have finite ones.
    pub fn over(
        &self,
        record: Record<'_>,
        memory: &[f64],
        x_hat: &mut [f64],
        e: &mut [f64],
    ) -> usize {
        let Live { n, n_u, current, whole, correct, .. } = self.live;
        let (n, n_u, m) = (*n, *n_u, self.live.memory());
        let mut r = self.at_rest(whole);
        r.0[MEMORY..MEMORY + m].copy_from_slice(memory);
        let mut known = None;
        let (count, sample) = (record.y.len(), MEMORY + m);
        let first_gain = self.given() + self.live.parameters.len();
        let mut next = vec![0.0; m];
        for k in 0..count {
            let (y, last) = (record.y[k], k + 1 == count);
            let mut step = whole;
            let dt = match (last, correct) {
                (true, Some(alone)) => {
                    let mut fresh = self.at_rest(alone);
                    fresh.0[MEMORY..sample].copy_from_slice(&r.0[MEMORY..sample]);
                    (r, step, known) = (fresh, alone, None);
                    0.0
                }
                (true, None) => 1.0, // of which the innovation alone is asked
                (false, _) => record.clock.step(k),
            };
            (r.0[0], r.0[1], r.0[sample]) = (record.clock.at(k), dt, y);
            r.0[sample + 1..=sample + n_u].copy_from_slice(&record.u[k * n_u..(k + 1) * n_u]);
            if let Some(gains) = &self.gains {
                let elapsed = r.0[sample - 1];
                let length = match (*current, y.is_finite()) {
                    (false, _) => dt,
                    (true, true) => elapsed,
                    (true, false) => 0.0,
                };
                if known != Some(length.to_bits()) {
                    let made = gains(length);
                    r.0[first_gain..first_gain + made.len()].copy_from_slice(&made);
                    known = Some(length.to_bits());
                }
            }
            let row = &mut x_hat[k * n..(k + 1) * n];
            if !current {
                row.copy_from_slice(&r.0[MEMORY..MEMORY + n]);
            }
            step.program().run(&mut r);
            let made = |i: usize, r: &Registers<f64>| r.0[usize::from(step.outputs[i])];
            e[k] = made(m, &r);
            if *current {
                let shown = if last { 0 } else { m + 1 };
                (0..n).for_each(|i| row[i] = made(shown + i, &r));
            }
            if !row.iter().all(|value| value.is_finite()) {
                return k;
            }
            (0..m).for_each(|i| next[i] = made(i, &r));
            r.0[MEMORY..sample].copy_from_slice(&next);
        }
        count
    }

    /// One step over dt from a memory, by a sample, of an observer without inputs: what is shown of the memory
    /// and the memory after it, both without the time that a filter holds.
    pub fn step(&self, z: &[f64], y: f64, dt: f64) -> (Vec<f64>, Vec<f64>) {
        let Live { current, whole, .. } = self.live;
        let m = self.live.memory();
        let own = m - usize::from(*current);
        let mut r = self.at_rest(whole);
        (r.0[1], r.0[MEMORY + m]) = (dt, y);
        r.0[MEMORY..MEMORY + own].copy_from_slice(&z[..own]);
        if *current {
            r.0[MEMORY + own] = dt;
        }
        if let Some(gains) = &self.gains {
            let (first, made) = (self.given() + self.live.parameters.len(), gains(dt));
            r.0[first..first + made.len()].copy_from_slice(&made);
        }
        let before = r.0[MEMORY..MEMORY + own].to_vec();
        whole.program().run(&mut r);
        let made = |i: usize| r.0[usize::from(whole.outputs[i])];
        let next = (0..own).map(made).collect();
        let shown = if *current { (0..own).map(|i| made(m + 1 + i)).collect() } else { before };
        (shown, next)
    }
}
