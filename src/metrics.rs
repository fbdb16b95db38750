//! Floor 1. Metrics that stream: nothing grows with the number of steps.

use crate::Scalar;

/// Samples from k = `from` up to, not including, `to`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Window {
    /// First sample.
    pub from: u64,
    /// One past the last sample.
    pub to: u64,
}

impl Window {
    /// Whether sample k lies in the window.
    #[inline(always)]
    pub fn contains(&self, k: u64) -> bool {
        k >= self.from && k < self.to
    }
}

/// Which metrics a study asks for: what is not wanted costs nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[allow(clippy::struct_excessive_bools)] // four answers to four questions
pub struct Wanted {
    /// Means over the windows.
    pub mean: bool,
    /// Root mean squares over the windows.
    pub rms: bool,
    /// Largest magnitudes in the windows.
    pub max: bool,
    /// Largest magnitudes of the memory over the whole run.
    pub peak: bool,
}

impl Wanted {
    /// All of them.
    pub const ALL: Self = Self { mean: true, rms: true, max: true, peak: true };
}

/// Mean, root mean square and largest magnitude of a signal.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Moments<T> {
    count: u64,
    sum: T,
    sum_of_squares: T,
    max: T,
}

impl<T: Scalar> Moments<T> {
    /// Take one value.
    #[inline(always)]
    pub fn push(&mut self, value: T) {
        self.count += 1;
        self.sum += value;
        self.sum_of_squares += value * value;
        self.max = self.max.max(value.abs());
    }

    /// From what was added up elsewhere.
    pub fn from_sums(count: u64, sum: T, sum_of_squares: T, max: T) -> Self {
        Self { count, sum, sum_of_squares, max }
    }

    /// Arithmetic mean; NaN before the first value.
    pub fn mean(&self) -> T {
        self.sum / T::from_f64(self.count as f64)
    }

    /// Root mean square; NaN before the first value.
    pub fn rms(&self) -> T {
        (self.sum_of_squares / T::from_f64(self.count as f64)).sqrt()
    }

    /// Largest magnitude; NaN before the first value.
    pub fn max(&self) -> T {
        if self.count == 0 { T::from_f64(f64::NAN) } else { self.max }
    }
}

/// Time of the last sample at which a distance was at or above a threshold.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SettlingTime<T> {
    threshold: T,
    last: T,
}

impl<T: Scalar> SettlingTime<T> {
    /// Settled means below `threshold`.
    pub fn new(threshold: T) -> Self {
        Self { threshold, last: T::ZERO }
    }

    /// Take the distance at time t.
    #[inline(always)]
    pub fn push(&mut self, t: T, distance: T) {
        if distance >= self.threshold {
            self.last = t;
        }
    }

    /// Settling time in s; 0 if the threshold was never reached.
    pub fn time(&self) -> T {
        self.last
    }
}

/// A histogram of positive values in bins of equal ratio, from which quantiles are read.
#[derive(Debug, PartialEq, Eq)]
pub struct LogHistogram<'a> {
    counts: &'a mut [u64],
}

impl<'a> LogHistogram<'a> {
    /// Bins an octave; a quantile is good to 2^(1/32) − 1 = 2.2 % before interpolation.
    pub const PER_OCTAVE: usize = 32;
    /// Binary logarithm of the lowest edge.
    pub const LOWEST: f64 = -40.0;
    /// Number of bins: 64 octaves.
    pub const BINS: usize = 64 * Self::PER_OCTAVE;

    /// Over a caller's buffer of [`Self::BINS`] counts.
    pub fn new(counts: &'a mut [u64]) -> Self {
        Self { counts }
    }

    /// Lower edge of bin j.
    pub fn edge(j: usize) -> f64 {
        Scalar::powf(2.0, Self::LOWEST + j as f64 / Self::PER_OCTAVE as f64)
    }

    /// Take one value; what lies outside goes to the first or last bin.
    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    pub fn push(&mut self, value: f64) {
        let position = (Scalar::ln(value) * core::f64::consts::LOG2_E - Self::LOWEST)
            * Self::PER_OCTAVE as f64;
        // `as` saturates: below 0 and NaN become 0
        let bin = (position as usize).min(self.counts.len().saturating_sub(1));
        if let Some(count) = self.counts.get_mut(bin) {
            *count += 1;
        }
    }

    /// The value below which a fraction q of what was taken lies, interpolated within its bin on
    /// the logarithmic scale; NaN before the first value.
    pub fn quantile(&self, q: f64) -> f64 {
        let total: u64 = self.counts.iter().sum();
        if total == 0 {
            return f64::NAN;
        }
        let wanted = q.clip(0.0, 1.0) * total as f64;
        let mut below = 0.0;
        for (j, count) in self.counts.iter().enumerate() {
            let count = *count as f64;
            if below + count >= wanted && count > 0.0 {
                let part = (wanted - below) / count;
                let octaves = (j as f64 + part) / Self::PER_OCTAVE as f64;
                return Scalar::powf(2.0, Self::LOWEST + octaves);
            }
            below += count;
        }
        Self::edge(self.counts.len())
    }
}
